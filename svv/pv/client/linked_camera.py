"""The live camera: one camera for the volume rendering on the left and the scene's image on the right.

Client code, for the user interface and for scripts with an interactive view. :mod:`svv.pv.client.follow_property`
starts and stops it according to a filter's property *Follow Camera*.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterator, Sequence

from svv.core.frame_rate import Pace
from svv.errors import BadInput
from svv.pv.client.mouse import ForwardedMouse
from svv.pv.client.observers import Watched, WeakReference, python_proxy
from svv.pv.paraview_types import Display, Proxy, SMProxy, View

IMAGES = ("StyleRFRender", "StyleRFStylizedView")
"""Filters that render an image from a camera."""

PLACED = "StyleRFPlaceInView"
"""The filter that places such an image in the 3D view (:mod:`svv.pv.client.placing`)."""

NO_IMAGE = "There is no StyleRF image to follow the camera: add StyleRF Render or StyleRF Stylized View first."

LARGEST = 800
"""Longer side of the sharp image, in pixels."""

_paces: Watched[Pace] = Watched()
"""How large the images are while the mouse moves."""

_followers: list[CameraFollower] = []


class CameraFollower:
    """Passes a view's camera to a filter whenever it moves: a small image during the motion, a sharp one at its end.

    It keeps only weak references to the three, so each can be deleted; following then ends.

    Args:
        view: View whose camera is followed.
        filter: Proxy of StyleRF Render or StyleRF Stylized View.
        target: View that shows the filter's image.
    """

    def __init__(self, view: View, filter: Proxy, target: View) -> None:
        self._proxies = WeakReference(view.SMProxy), WeakReference(filter.SMProxy), WeakReference(target.SMProxy)
        self._last: object = None
        self._mouse = ForwardedMouse(target, view)
        self._wanted: bool | None = None
        self.drawing = False
        interactor = view.GetInteractor()
        self._interactor = WeakReference(interactor)
        # VTK holds no references to observers, so without these Python would collect them.
        self._do = {
            "InteractionEvent": lambda *_: self.update(True),
            "EndInteractionEvent": lambda *_: self.update(False),
        }
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
        """Whether this is the followed view, given as a proxy, and its camera is not that of the image."""
        return self._proxies[0].Get() is view and self._last != through(self.view, self.filter, False)

    @property
    def alive(self) -> bool:
        """Whether all three still exist; a proxy that a script deleted but still references does not count."""
        groups = zip(("views", "sources", "views"), (proxy.Get() for proxy in self._proxies), strict=True)
        return all(p is not None and p.GetSessionProxyManager().GetProxyName(group, p) for group, p in groups)

    def update(self, moving: bool) -> None:
        """Render the image from the view's camera if the camera has moved or the image size has changed."""
        self._wanted = moving
        if self.drawing or busy():
            return
        self.drawing = True
        try:
            while self._wanted is not None and self.alive:
                moving, self._wanted = self._wanted, None
                self._draw(moving)
        finally:
            self.drawing = False

    def _draw(self, moving: bool) -> None:
        from paraview import simple

        view, filter, target = self.view, self.filter, self.target
        wanted = through(view, filter, moving)
        if wanted == self._last:
            return
        self._last = wanted
        look_through(filter, view, moving)
        may_be_late(filter.SMProxy)
        timed(filter, filter.UpdatePipeline)
        fit(target, *filter.ImageSize)
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

    The longer side is :data:`LARGEST`, or that of the view if this is smaller and the image is placed in a 3D view.
    While the mouse moves, it is as large as :class:`svv.core.frame_rate.Pace` permits.

    Args:
        view: The followed view.
        filter: The image's filter.
        moving: Whether the mouse moves the view's camera.
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

    display = simple.Show(filter, view)
    display.SetRepresentationType("Slice")
    simple.ColorBy(display, ("POINTS", "RGBA"))
    display.MapScalars = 0
    display.SetScalarBarVisibility(view, False)
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
    """Let an image follow a camera, and set its filter's property Follow Camera.

    The image has a separate view: the one that already shows it, or a new one to the right of the followed view.

    Args:
        filter: Proxy of a StyleRF image filter; by default the active one, or the one created last.
        view: View whose camera is followed; by default the view that shows the volume, or the active one.

    Raises:
        BadInput: There is no image filter, or no 3D view.
    """
    from paraview import simple

    filter = filter or newest(IMAGES, NO_IMAGE)
    view = view or view_to_follow(filter)
    if view is None or view.GetXMLName() != "RenderView":
        raise BadInput("There is no 3D view to follow: show the volume in one first.")
    for old in [f for f in _followers if not f.alive or f.filter == filter]:
        old.stop()
        _followers.remove(old)
    active = simple.GetActiveView()
    target = next((v for v in simple.GetRenderViews() if v != view and shows(v, [filter])), None)
    if shows(view, [filter]):
        simple.Hide(filter, view)
    if target is None:
        layout = simple.GetLayout(view)
        if layout is None:  # views created by scripts may be in none
            simple.AssignViewToLayout(view)
            layout = simple.GetLayout(view)
        target = simple.CreateView("RenderView")
        simple.AssignViewToLayout(view=target, layout=layout, hint=layout.SplitViewHorizontal(view, 0.5))
        show_image(filter, target)
        active = view
    follower = CameraFollower(view, filter, target)
    _followers.append(follower)
    follower.update(False)
    simple.SetActiveView(active)
    filter.FollowCamera = 1
    return follower


def followers() -> list[CameraFollower]:
    """Return all active followers."""
    return [follower for follower in _followers if follower.alive]


def follower_of(filter: Proxy) -> CameraFollower | None:
    """Return a filter's follower, or None if its image follows no camera."""
    return next((f for f in followers() if f.filter == filter), None)


def stop_following(filter: Proxy | None = None) -> None:
    """Stop a filter's image, or every image, from following."""
    ended = [f for f in _followers if filter is None or not f.alive or f.filter == filter]
    _followers[:] = [f for f in _followers if f not in ended]
    for follower in ended:
        follower.stop()
        if follower.filter is not None and follower.filter.FollowCamera:
            follower.filter.FollowCamera = 0


def view_to_follow(filter: Proxy) -> View | None:
    """Return the 3D view that shows the volume of a filter's image, or the active one; None if there is no 3D view."""
    from paraview import simple

    active = simple.GetActiveView()
    views = sorted(simple.GetRenderViews(), key=lambda view: view != active)  # the active one first
    before = list(upstream(filter))
    images = [source for source in simple.GetSources().values() if source.SMProxy.GetXMLName() in IMAGES]
    showing = [view for view in views if shows(view, before)]
    without = [view for view in views if not shows(view, images)]
    return next(iter([*showing, *without, *views]), None)


def shows(view: View, sources: Sequence[Proxy]) -> bool:
    """Return whether a view shows any of these sources."""
    given = [getattr(display, "Input", None) for display in view.Representations if display.Visibility]
    return any(one is not None and one.SMProxy == source.SMProxy for one in given for source in sources)


def upstream(filter: Proxy) -> Iterator[Proxy]:
    """Yield the filters and sources upstream of a filter."""
    given = getattr(filter, "Input", None)
    if given is not None:
        for one in [given] if hasattr(given, "SMProxy") else given:  # some filters take several inputs
            yield one
            yield from upstream(one)


def newest(kinds: Container[str], missing: str) -> Proxy:
    """Return the active filter if it is of one of these kinds, otherwise the last one that is.

    Raises:
        BadInput: There is none; ``missing`` is the sentence.
    """
    from paraview import simple

    for source in [simple.GetActiveSource(), *reversed(list(simple.GetSources().values()))]:
        if source is not None and source.SMProxy.GetXMLName() in kinds:
            found: Proxy = source
            return found
    raise BadInput(missing)
