"""The live camera: one camera for the volume rendering on the left and the scene's image on the right. Client code.

:mod:`svv.pv.client.follow_property` starts and stops it according to a filter's property *Follow Camera*.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Container, Iterator, Sequence
from typing import Any

from svv.core.frame_rate import Pace
from svv.errors import BadInput
from svv.pv.display.mouse import ForwardedMouse
from svv.pv.observers import Watched, WeakReference, python_proxy
from svv.pv.paraview_types import Display, Proxy, SMProxy, View
from svv.pv.timers import Timer, window

IMAGES = ("StyleRFRender", "StyleRFStylizedView")
"""Filters that render an image from a camera."""

PLACED = "StyleRFPlaceInView"
"""The filter that places such an image in the 3D view (:mod:`svv.pv.client.placing`)."""

NO_IMAGE = "There is no StyleRF image to follow the camera: add StyleRF Render or StyleRF Stylized View first."

LARGEST = 800
"""Longer side of the sharp image, in pixels."""

SLICE = "ImageSliceRepresentation"
"""XML name of the representation of images in the window. ParaView's editor of colour maps, which is wider than the
panel, is no part of its own, and it has no colour bar."""

RESIZING = 300
"""Milliseconds after a change of a view's size until an image is made for it; more changes may follow."""

OWN = "StyleRF.image"
"""Annotation of a view that was made for an image."""

_paces: Watched[Pace] = Watched()
"""How large the images are while the mouse moves."""

_followers: list[CameraFollower] = []


class CameraFollower:
    """Passes a view's camera to an image filter when it moves: a small image meanwhile, a sharp one at its end.

    ``target`` shows the image. Only weak references are kept to the three, so each can be deleted; following then ends.
    """

    def __init__(self, view: View, filter: Proxy, target: View) -> None:
        self._proxies = WeakReference(view.SMProxy), WeakReference(filter.SMProxy), WeakReference(target.SMProxy)
        self._last: object = None
        self._fitted: object = None
        self._mouse = ForwardedMouse(target, view)
        self._wanted: bool | None = None
        self.drawing = False
        interactor = view.GetInteractor()
        self._interactor = WeakReference(interactor)
        # VTK holds no references to observers, so without these Python would collect them.
        self._do = {
            "InteractionEvent": lambda *_: self.update(True),
            "EndInteractionEvent": lambda *_: self.update(False),
            "ConfigureEvent": lambda *_: self._resized(),
        }
        self._timers: list[Timer] = []
        self._tags = [] if interactor is None else [interactor.AddObserver(*pair) for pair in self._do.items()]

    @property
    def view(self) -> View:
        """View whose camera is followed; None if it was deleted."""
        return python_proxy(self._proxies[0].Get())

    @property
    def filter(self) -> Proxy:
        """Filter that renders the image; None if it was deleted."""
        return python_proxy(self._proxies[1].Get())

    @property
    def target(self) -> View:
        """View that shows the image; None if it was deleted."""
        return python_proxy(self._proxies[2].Get())

    @property
    def behind(self) -> bool:
        """Whether the camera moved while ParaView was busy, so that the image is out of date."""
        return self._wanted is not None

    def strayed(self, view: SMProxy) -> bool:
        """Whether this is the followed view's proxy, and its camera is not that of the image.

        While an animation is saved, it may also be the view of the image: the other one need not be drawn then.
        """
        own = self._proxies[0].Get() is view or (saving_animation() and self._proxies[2].Get() is view)
        return own and self._last != through(self.view, self.filter, False)

    @property
    def alive(self) -> bool:
        """Whether all three still exist; a proxy that a script deleted but still references does not count."""
        groups = zip(("views", "sources", "views"), (proxy.Get() for proxy in self._proxies), strict=True)
        return all(p is not None and p.GetSessionProxyManager().GetProxyName(group, p) for group, p in groups)

    def update(self, moving: bool) -> None:
        """Render the image from the view's camera if the camera has moved or the image size has changed."""
        self._wanted = moving
        if self.drawing or (busy() and not saving_animation()):
            return
        self.drawing = True
        try:
            while self._wanted is not None and self.alive:
                moving, self._wanted = self._wanted, None
                self._draw(moving)
        finally:
            self.drawing = False

    def _resized(self) -> None:
        """Update the image when the view has its new size, which its proxy has later: as when a view is split."""
        interactor = self._interactor.Get()
        if interactor is not None and not any(timer.alive for timer in self._timers):
            self._timers[:] = [Timer(interactor, RESIZING, self._as_large)]

    def _as_large(self) -> None:
        self._timers.clear()
        if busy():
            self._resized()
        elif self.alive:
            if self._fitted != list(self.target.ViewSize):
                self._last = None
            self.update(False)

    def _draw(self, moving: bool) -> None:
        from paraview import simple

        view, filter, target = self.view, self.filter, self.target
        wanted = through(view, filter, moving)
        if wanted == self._last:
            return
        self._last = wanted
        look_through(filter, view, moving)
        if not saving_animation():
            may_be_late(filter.SMProxy)
        timed(filter, filter.UpdatePipeline)
        fit(target, *filter.ImageSize)
        self._fitted = list(target.ViewSize)
        simple.Render(target)

    def stop(self) -> None:
        """Stop following."""
        interactor = self._interactor.Get()
        for tag in self._tags if interactor is not None else ():
            interactor.RemoveObserver(tag)
        self._tags = []
        self._mouse.stop()


def busy() -> bool:
    """Return whether ParaView is in the middle of an update; since 6.1 it handles mouse and timer events meanwhile."""
    from paraview import servermanager

    connection = servermanager.ActiveConnection
    return connection is not None and bool(connection.Session.GetProgressHandler().GetEnableProgress())


def saving_animation() -> bool:
    """Return whether ParaView is drawing the frames of an animation into a file; it counts as busy meanwhile."""
    from paraview import simple

    scene = simple.GetAnimationScene().SMProxy.GetClientSideObject()
    return scene is not None and bool(scene.GetOverrideStillRender())


def may_be_late(proxy: SMProxy) -> None:
    """Let the next image of a filter with Live come later than the update that asks for it."""
    if proxy.GetProperty("Late") is not None:
        proxy.GetProperty("Late").SetElement(0, 1)
        proxy.UpdateProperty("Late", 1)  # every time, though it has the same value


def camera_numbers(view: View) -> list[float]:
    """Return position, focal point, view up and angle of view of a view's live camera."""
    # The view's properties are updated only when the mouse button is released.
    camera = view.GetActiveCamera()
    return [*camera.GetPosition(), *camera.GetFocalPoint(), *camera.GetViewUp(), camera.GetViewAngle()]


def parallel_scale_of(view: View) -> float:
    """Return half of the height that a view's live camera sees if it is orthographic, in world units; otherwise 0."""
    camera = view.GetActiveCamera()
    return camera.GetParallelScale() if camera.GetParallelProjection() else 0.0


def pace_of(filter: Proxy) -> Pace:
    """Return how large a filter's image is while the mouse moves."""
    pace = _paces.get(filter.SMProxy)
    if pace is None:
        pace = Pace()
        _paces.put(filter.SMProxy, pace)
    return pace


def timed(filter: Proxy, update: Callable[[], object]) -> None:
    """Update a filter's image, and learn from the time that this takes how large it may be while the mouse moves."""
    began = time.perf_counter()
    update()
    if filter.Moving:
        pace_of(filter).took(time.perf_counter() - began)


def through(view: View, filter: Proxy, moving: bool) -> tuple[list[float], float, list[int], int]:
    """Return camera, parallel scale and size of an image that follows a view, and whether it is made in a hurry.

    The longer side is :data:`LARGEST`, or that of a smaller view in which the image is placed. While the mouse moves,
    it is as large as :class:`svv.core.frame_rate.Pace` permits.
    """
    scale = pace_of(filter).part if moving else 1.0
    longer = max(view.ViewSize)
    sharp = min(LARGEST, longer) if placed(filter) else LARGEST
    size = [max(int(scale * sharp * side / longer), 16) for side in view.ViewSize]
    return camera_numbers(view), parallel_scale_of(view), size, int(moving)


def look_through(filter: Proxy, view: View, moving: bool) -> bool:
    """Give an image a view's camera, and the size of :func:`through`; return whether anything changed."""
    wanted = through(view, filter, moving)
    if (list(filter.Camera), filter.ParallelScale, list(filter.ImageSize), int(filter.Moving)) == wanted:
        return False
    filter.Camera, filter.ParallelScale, filter.ImageSize, filter.Moving = wanted
    return True


def placed(filter: Proxy) -> bool:
    """Return whether a StyleRF Place In View takes the image of a filter."""
    from paraview import simple

    return any(
        source.SMProxy.GetXMLName() == PLACED and source.Input is not None and source.Input.SMProxy == filter.SMProxy
        for source in simple.GetSources().values()
    )


def show_image(filter: Proxy, view: View) -> Display:
    """Show an image filter's colours directly, in 2D; return the representation."""
    from paraview import simple

    if window() is not None:
        display = simple.Show(filter, view, SLICE)
        display.ColorArrayName = ["POINTS", "RGBA"]
    else:
        display = simple.Show(filter, view)
        display.SetRepresentationType("Slice")
        simple.ColorBy(display, ("POINTS", "RGBA"))
        display.SetScalarBarVisibility(view, False)
    display.MapScalars = 0
    view.InteractionMode = "2D"
    view.OrientationAxesVisibility = 0
    return display


def fit(view: View, width: int, height: int) -> None:
    """Move a view's camera so that an image of this many pixels fills the view."""
    camera = view.GetActiveCamera()
    camera.SetParallelProjection(1)
    centre = 0.5 * (width - 1), 0.5 * (height - 1)
    camera.SetFocalPoint(*centre, 0.0)
    camera.SetPosition(*centre, 2.0 * max(width, height))
    camera.SetViewUp(0.0, 1.0, 0.0)
    shown = view.ViewSize
    camera.SetParallelScale(0.5 * max(height, width * shown[1] / shown[0]))


def follow(filter: Proxy | None = None, view: View | None = None) -> CameraFollower:
    """Let an image follow a camera in a separate view (:func:`show_beside`), and set the property Follow Camera.

    By default, the filter is the active or newest image filter, the view that of the volume or the active one. In the
    window, a view with nothing in it is given the image's camera. Raises BadInput without filter or 3D view.
    """
    from paraview import simple

    filter = filter or newest(IMAGES, NO_IMAGE)
    view = view or view_to_follow(filter)
    if view is None or view.GetXMLName() != "RenderView":
        raise BadInput("There is no 3D view to follow: show the volume in one first.")
    _end([follower for follower in _followers if follower.filter in (None, filter)])
    if shows(view, [filter]):
        simple.Hide(filter, view)
        if window() is not None:  # where its eye was clicked, and the camera then put where it could be seen
            simple.ResetCamera(view)
    empty = not any(getattr(display, "Input", None) for display in view.Representations)
    if window() is not None and empty and all(follower.view != view for follower in followers()):
        look_at_scene(view, filter)
    follower = CameraFollower(view, filter, show_beside(filter, view))
    _followers.append(follower)
    follower.update(False)
    filter.FollowCamera = 1
    return follower


def show_beside(filter: Proxy, view: View) -> View:
    """Show an image in its view, one left by another image, or a new one to the right of the 3D view; return that."""
    from paraview import simple

    target = view_beside(filter, view)
    if target is not None and shows(target, [filter]):
        return target
    if target is None:
        layout = simple.GetLayout(view)
        if layout is None:  # views created by scripts may be in none
            simple.AssignViewToLayout(view)
            layout = simple.GetLayout(view)
        target = simple.CreateView("RenderView")
        target.SMProxy.SetAnnotation(OWN, "1")
        simple.AssignViewToLayout(view=target, layout=layout, hint=layout.SplitViewHorizontal(view, 0.5))
    show_image(filter, target)
    fit(target, *filter.ImageSize)
    simple.SetActiveView(view)
    return target


def view_beside(filter: Proxy, view: View) -> View | None:
    """Return the view beside a 3D view that shows an image, or one that was made for an image that is gone, or None."""
    from paraview import simple

    others = [other for other in simple.GetRenderViews() if other != view]
    showing = [other for other in others if shows(other, [filter])]
    left = [other for other in others if made_for_image(other) and not any(displays_in(other))]
    return next(iter([*showing, *left]), None)


def made_for_image(view: View) -> bool:
    """Return whether a view was made for an image, by :func:`show_beside`."""
    return view.SMProxy.HasAnnotation(OWN)


def look_at_scene(view: View, filter: Proxy) -> None:
    """Give a view the camera from which an image shows its scene, if it tells, unless the image has a camera."""
    if any(list(filter.Camera)[:6]):
        return
    told = filter.SMProxy.GetProperty("SeenFrom")
    filter.SMProxy.UpdatePropertyInformation(told)
    numbers = [float(number) for number in str(told.GetElement(0) or "").split()]
    if not numbers:
        return
    width, height = view.ViewSize
    left = 1.0 if view_beside(filter, view) else 0.5  # of its width, when it will have been split
    narrow = min(left * width / max(height, 1), 1.0)
    view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = numbers[:3], numbers[3:6], numbers[6:9]
    view.CenterOfRotation = numbers[3:6]
    view.CameraViewAngle = math.degrees(2.0 * math.atan(math.tan(0.5 * math.radians(numbers[9])) / narrow))


def followers() -> list[CameraFollower]:
    """Return all active followers."""
    return [follower for follower in _followers if follower.alive]


def follower_of(filter: Proxy) -> CameraFollower | None:
    """Return a filter's follower, or None if its image follows no camera."""
    return next((f for f in followers() if f.filter == filter), None)


def view_closed(filter: Proxy) -> bool:
    """Return whether the user has closed the view in which a filter's image followed another one."""
    from paraview import simple

    lost = [follower for follower in _followers if follower.filter == filter and not follower.alive]
    return window() is not None and any(follower.view in simple.GetRenderViews() for follower in lost)


def forget_closed(filter: Proxy) -> None:
    """Let a filter's image have a view again after the user has closed the one that it had."""
    _end([follower for follower in _followers if follower.filter == filter and not follower.alive])


def _end(ended: list[CameraFollower]) -> list[CameraFollower]:
    """Stop followers and forget them; return them."""
    for follower in ended:
        follower.stop()
        _followers.remove(follower)
    return ended


def stop_following(filter: Proxy | None = None) -> None:
    """Stop a filter's image, or every image, from following."""
    for follower in _end([f for f in _followers if filter is None or f.filter in (None, filter)]):
        if follower.filter is not None and follower.filter.FollowCamera:
            follower.filter.FollowCamera = 0


def view_to_follow(filter: Proxy) -> View | None:
    """Return the 3D view of the volume of a filter's image, or the active one, but none made for images; or None."""
    from paraview import simple

    active = simple.GetActiveView()
    found = [view for view in simple.GetRenderViews() if not made_for_image(view)]
    views = sorted(found, key=lambda view: view != active)  # the active one first
    before = list(upstream(filter))
    images = [source for source in simple.GetSources().values() if source.SMProxy.GetXMLName() in IMAGES]
    showing = [view for view in views if shows(view, before)]
    without = [view for view in views if not shows(view, images)]
    return next(iter([*showing, *without, *views]), None)


def shows(view: View, sources: Sequence[Proxy]) -> bool:
    """Return whether a view shows any of these sources."""
    return any(one.Input.SMProxy == source.SMProxy for one in displays_in(view) for source in sources)


def displays_in(view: View) -> Iterator[Display]:
    """Yield the representations by which a view, of any kind, shows sources and filters."""
    for display in getattr(view, "Representations", ()):
        if getattr(display, "Visibility", 0) and getattr(display, "Input", None) is not None:
            yield display


def inputs_of(source: Proxy) -> list[Proxy]:
    """Return the inputs of a filter, some of which take several; none of a source."""
    given: Any = getattr(source, "Input", None)
    return [given] if hasattr(given, "SMProxy") else list(given or ())


def upstream(filter: Proxy) -> Iterator[Proxy]:
    """Yield the filters and sources upstream of a filter."""
    for one in inputs_of(filter):
        yield one
        yield from upstream(one)


def newest(kinds: Container[str], missing: str) -> Proxy:
    """Return the active filter if it is of these kinds, else the last one that is; or raise BadInput(missing)."""
    from paraview import simple

    for source in [simple.GetActiveSource(), *reversed(list(simple.GetSources().values()))]:
        if source is not None and source.SMProxy.GetXMLName() in kinds:
            found: Proxy = source
            return found
    raise BadInput(missing)
