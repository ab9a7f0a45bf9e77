"""The live camera: the volume rendering on the left, the scene's image on the right, one camera.

Client code, for the user interface and for scripts with a view that people move. :mod:`svv.pv.live` begins and ends it
as a filter's property *Follow Camera* says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from vtkmodules.vtkCommonCore import vtkWeakReference

from svv.errors import BadInput

IMAGES = ("StyleRFRender", "StyleRFStylizedView")
"""Filters whose output is an image from a camera."""

LARGEST = 800
"""Pixels of the sharp image's longer side."""

DRAGGING = 0.4
"""Size of the image while the mouse moves, as a part of the sharp one's."""

_followers: list[CameraFollower] = []


class CameraFollower:
    """Gives a filter the camera of a view whenever it moves: a small image meanwhile, a sharp one at the end.

    It holds none of the three, so each can be deleted; then nothing follows any longer.

    Args:
        view: Whose camera is followed.
        filter: StyleRF Render or StyleRF Stylized View, as ParaView's Python has it.
        target: The view that shows the filter's image.
    """

    def __init__(self, view: Any, filter: Any, target: Any) -> None:
        self._proxies = [_weak(proxy.SMProxy) for proxy in (view, filter, target)]
        self._last: object = None
        self._wanted: float | None = None
        self.drawing = False
        interactor = view.GetInteractor()
        self._interactor = _weak(interactor)
        # Held here, for VTK alone would let Python collect them.
        self._do = {
            "InteractionEvent": lambda *_: self.update(DRAGGING),
            "EndInteractionEvent": lambda *_: self.update(1.0),
        }
        self._tags = [] if interactor is None else [interactor.AddObserver(*pair) for pair in self._do.items()]

    @property
    def view(self) -> Any:
        """Whose camera is followed; None when it is gone."""
        return _python(self._proxies[0].Get())

    @property
    def filter(self) -> Any:
        """The image's filter; None when it is gone."""
        return _python(self._proxies[1].Get())

    @property
    def target(self) -> Any:
        """The view that shows the image; None when it is gone."""
        return _python(self._proxies[2].Get())

    @property
    def behind(self) -> bool:
        """Whether the camera moved while ParaView was busy, so that the image has still to be made."""
        return self._wanted is not None

    @property
    def alive(self) -> bool:
        """Whether all three are still there, and not only held by a script that has deleted them."""
        groups = zip(("views", "sources", "views"), (proxy.Get() for proxy in self._proxies), strict=True)
        return all(p is not None and p.GetSessionProxyManager().GetProxyName(group, p) for group, p in groups)

    def update(self, scale: float) -> None:
        """Make the image that the view's camera sees, if it has moved or the size is another."""
        self._wanted = scale
        if self.drawing or busy():
            return
        self.drawing = True
        try:
            while self._wanted is not None and self.alive:
                scale, self._wanted = self._wanted, None
                self._draw(scale)
        finally:
            self.drawing = False

    def _draw(self, scale: float) -> None:
        from paraview import simple

        view, filter, target = self.view, self.filter, self.target
        camera = camera_numbers(view)
        width, height = (max(int(scale * LARGEST * n / max(view.ViewSize)), 16) for n in view.ViewSize)
        if (camera, width, height) == self._last:
            return
        self._last = camera, width, height
        filter.Camera = camera
        filter.ImageSize = [width, height]
        filter.UpdatePipeline()
        fit(target, width, height)
        simple.Render(target)

    def stop(self) -> None:
        """Follow no longer."""
        interactor = self._interactor.Get()
        for tag in self._tags if interactor is not None else ():
            interactor.RemoveObserver(tag)
        self._tags = []


def busy() -> bool:
    """Whether ParaView is in the midst of an update; from 6.1 on it handles the mouse and timers meanwhile."""
    from paraview import servermanager

    connection = servermanager.ActiveConnection
    return connection is not None and bool(connection.Session.GetProgressHandler().GetEnableProgress())


def _weak(thing: Any) -> Any:
    reference = vtkWeakReference()
    reference.Set(thing)
    return reference


def _python(proxy: Any) -> Any:
    from paraview import servermanager

    return None if proxy is None else servermanager._getPyProxy(proxy)


def camera_numbers(view: Any) -> list[float]:
    """Position, focal point, view up and angle of view of a view's live camera."""
    # The view's properties follow the live camera only when the mouse is let go.
    camera = view.GetActiveCamera()
    return [*camera.GetPosition(), *camera.GetFocalPoint(), *camera.GetViewUp(), camera.GetViewAngle()]


def show_image(filter: Any, view: Any) -> Any:
    """Show an image filter's colours as they are, flat and filling the view; returns the representation."""
    from paraview import simple

    display = simple.Show(filter, view)
    display.SetRepresentationType("Slice")
    simple.ColorBy(display, ("POINTS", "RGBA"))
    display.MapScalars = 0
    display.SetScalarBarVisibility(view, False)
    view.InteractionMode = "2D"
    view.OrientationAxesVisibility = 0
    return display


def fit(view: Any, width: int, height: int) -> None:
    """Let an image of this many pixels fill a view."""
    camera = view.GetActiveCamera()
    camera.SetParallelProjection(1)
    centre = 0.5 * (width - 1), 0.5 * (height - 1)
    camera.SetFocalPoint(*centre, 0.0)
    camera.SetPosition(*centre, 2.0 * max(width, height))
    camera.SetViewUp(0.0, 1.0, 0.0)
    shown = view.ViewSize
    camera.SetParallelScale(0.5 * max(height, width * shown[1] / shown[0]))


def follow(filter: Any = None, view: Any = None) -> CameraFollower:
    """Let an image follow a camera, and set its property Follow Camera.

    The image is shown in a view of its own: the one that shows it already, else a new one right of the followed view.

    Args:
        filter: An image filter of ours; by default the active one, or else the last that was made.
        view: Whose camera is followed; by default the view that shows the volume, else the active one.

    Raises:
        BadInput: there is no image filter, or no 3D view.
    """
    from paraview import simple

    filter = filter or _image_filter([simple.GetActiveSource(), *reversed(list(simple.GetSources().values()))])
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
        if layout is None:  # a script's view need not be in one
            simple.AssignViewToLayout(view)
            layout = simple.GetLayout(view)
        target = simple.CreateView("RenderView")
        simple.AssignViewToLayout(view=target, layout=layout, hint=layout.SplitViewHorizontal(view, 0.5))
        show_image(filter, target)
        active = view
    follower = CameraFollower(view, filter, target)
    _followers.append(follower)
    follower.update(1.0)
    simple.SetActiveView(active)
    filter.FollowCamera = 1
    return follower


def followers() -> list[CameraFollower]:
    """All that follow."""
    return [follower for follower in _followers if follower.alive]


def follower_of(filter: Any) -> CameraFollower | None:
    """What lets a filter's image follow, or None where nothing does."""
    return next((f for f in followers() if f.filter == filter), None)


def stop_following(filter: Any = None) -> None:
    """Let a filter's image, or every image, stand still."""
    ended = [f for f in _followers if filter is None or not f.alive or f.filter == filter]
    _followers[:] = [f for f in _followers if f not in ended]
    for follower in ended:
        follower.stop()
        if follower.filter is not None and follower.filter.FollowCamera:
            follower.filter.FollowCamera = 0


def view_to_follow(filter: Any) -> Any:
    """The 3D view that shows the volume that a filter's image is of; else the active one. None: there is none."""
    from paraview import simple

    active = simple.GetActiveView()
    views = sorted(simple.GetRenderViews(), key=lambda view: view != active)  # the active one first
    before = list(_upstream(filter))
    images = [source for source in simple.GetSources().values() if source.SMProxy.GetXMLName() in IMAGES]
    showing = [view for view in views if shows(view, before)]
    without = [view for view in views if not shows(view, images)]
    return next(iter([*showing, *without, *views]), None)


def shows(view: Any, sources: Sequence[Any]) -> bool:
    """Whether a view shows any of these sources."""
    given = [getattr(display, "Input", None) for display in view.Representations if display.Visibility]
    return any(one is not None and one.SMProxy == source.SMProxy for one in given for source in sources)


def _upstream(filter: Any) -> Iterator[Any]:
    """The filters and sources before a filter."""
    given = getattr(filter, "Input", None)
    if given is not None:
        for one in [given] if hasattr(given, "SMProxy") else given:  # some filters take several
            yield one
            yield from _upstream(one)


def _image_filter(candidates: Sequence[Any]) -> Any:
    for source in candidates:
        if source is not None and source.SMProxy.GetXMLName() in IMAGES:
            return source
    raise BadInput("There is no StyleRF image to follow the camera: add StyleRF Render or StyleRF Stylized View first.")
