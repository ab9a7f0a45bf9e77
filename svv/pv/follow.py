"""The live camera: the volume rendering on the left, the scene's image on the right, one camera.

Client code, for the user interface and for scripts with a view that people move.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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

    Args:
        view: Whose camera is followed.
        filter: StyleRF Render or StyleRF Stylized View, as ParaView's Python has it.
        target: The view that shows the filter's image.
    """

    def __init__(self, view: Any, filter: Any, target: Any) -> None:
        self.view, self.filter, self.target = view, filter, target
        self._last: object = None
        interactor = view.GetInteractor()
        self._tags = [] if interactor is None else [
            (interactor, interactor.AddObserver("InteractionEvent", lambda *_: self.update(DRAGGING))),
            (interactor, interactor.AddObserver("EndInteractionEvent", lambda *_: self.update(1.0))),
        ]  # fmt: skip
        self.update(1.0)

    def update(self, scale: float) -> None:
        """Make the image that the view's camera sees, if it has moved or the size is another."""
        from paraview import simple

        camera = camera_numbers(self.view)
        width, height = (max(int(scale * LARGEST * n / max(self.view.ViewSize)), 16) for n in self.view.ViewSize)
        if (camera, width, height) == self._last:
            return
        self._last = camera, width, height
        self.filter.Camera = camera
        self.filter.ImageSize = [width, height]
        self.filter.UpdatePipeline()
        fit(self.target, width, height)
        simple.Render(self.target)

    def stop(self) -> None:
        """Follow no longer."""
        for interactor, tag in self._tags:
            interactor.RemoveObserver(tag)
        self._tags = []


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
    """Split the view's layout: the volume stays left, the filter's image comes right and follows.

    Args:
        filter: An image filter of ours; by default the active one, or else the last that was made.
        view: Whose camera is followed; by default the active view.

    Raises:
        BadInput: there is no image filter, or no 3D view.
    """
    from paraview import simple

    filter = filter or _image_filter([simple.GetActiveSource(), *reversed(list(simple.GetSources().values()))])
    view = view or simple.GetActiveViewOrCreate("RenderView")
    if view.GetXMLName() != "RenderView":
        raise BadInput("The active view is no 3D view; click into the view that shows the volume first.")
    for old in [f for f in _followers if f.view == view]:
        old.stop()
        _followers.remove(old)
    simple.Hide(filter, view)
    layout = simple.GetLayout(view)
    if layout is None:  # a script's view need not be in one
        simple.AssignViewToLayout(view)
        layout = simple.GetLayout(view)
    target = next((f.target for f in _followers if f.filter == filter), None)
    if target is None:
        target = simple.CreateView("RenderView")
        simple.AssignViewToLayout(view=target, layout=layout, hint=layout.SplitViewHorizontal(view, 0.5))
    show_image(filter, target)
    follower = CameraFollower(view, filter, target)
    _followers.append(follower)
    simple.SetActiveView(view)
    return follower


def stop_following() -> None:
    """Let every image stand still."""
    while _followers:
        _followers.pop().stop()


def _image_filter(candidates: Sequence[Any]) -> Any:
    for source in candidates:
        if source is not None and source.SMProxy.GetXMLName() in IMAGES:
            return source
    raise BadInput("There is no StyleRF image to follow the camera: add StyleRF Render or StyleRF Stylized View first.")
