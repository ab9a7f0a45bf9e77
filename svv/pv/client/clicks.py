"""Clicks into views, for the buttons of panels that start and stop them; the client has the mouse and the views."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from vtkmodules.vtkCommonCore import vtkOutputWindow
from vtkmodules.vtkRenderingCore import vtkRenderWindowInteractor

from svv.pv.observers import WeakReference, python_proxy
from svv.pv.paraview_types import Proxy, View

CROSS, ARROW = 10, 0
"""VTK_CURSOR_CROSSHAIR and VTK_CURSOR_DEFAULT, which not every version of VTK exposes to Python."""

STILL = 3
"""Pixels that the mouse may move during a click; a longer motion drags the picture."""

FIRST = 2.0
"""Priority of the observers: before those that pass the mouse on to another view (:mod:`svv.pv.display.mouse`)."""

Act = Callable[[Proxy, View, Sequence[int]], None]
"""What a click does, given the filter's proxy, the view, and the pixel from the view's lower left."""

_clicks: list[Clicks] = []
"""The active handler, at most one; without this reference Python would collect it, because VTK holds none."""


class Clicks:
    """Click handler of some views for one button of a filter's panel."""

    def __init__(self, filter: Proxy, button: str, views: Sequence[View], act: Act) -> None:
        self.button, self._act = button, act
        self.filter = WeakReference(filter.SMProxy)
        self._down: tuple[int, int] | None = None
        self._views = [view for view in views if view.GetInteractor() is not None]
        self._tags = []
        for view in self._views:
            interactor = view.GetInteractor()
            for event, do in (("LeftButtonPressEvent", self._press), ("LeftButtonReleaseEvent", self._release)):
                self._tags.append((interactor, interactor.AddObserver(event, do, FIRST)))
            view.GetRenderWindow().SetCurrentCursor(CROSS)

    def _press(self, interactor: vtkRenderWindowInteractor, event: str) -> None:
        self._down = interactor.GetEventPosition()

    def _release(self, interactor: vtkRenderWindowInteractor, event: str) -> None:
        at, proxy = interactor.GetEventPosition(), self.filter.Get()
        if proxy is None:
            self.stop()
        elif self._down is not None and math.dist(at, self._down) <= STILL:
            (view,) = (v for v in self._views if v.GetInteractor() == interactor)
            self._act(python_proxy(proxy), view, at)

    def stop(self) -> None:
        """Stop handling clicks."""
        for interactor, tag in self._tags:
            interactor.RemoveObserver(tag)
        for view in self._views:
            view.GetRenderWindow().SetCurrentCursor(ARROW)
        self._tags, self._views = [], []


def press(filter: Proxy, button: str, views: Sequence[View], act: Act, no_view: str) -> None:
    """Let clicks into some views act for a filter's button, until another or the same one is pressed; or warn."""
    again = False
    while _clicks:
        old = _clicks.pop()
        again = old.button == button and old.filter.Get() is filter.SMProxy
        old.stop()
    if views and not again:
        _clicks.append(Clicks(filter, button, views, act))
    elif not again:
        vtkOutputWindow.GetInstance().DisplayWarningText(no_view)


def place_under(view: View, at: Sequence[int]) -> tuple[float, float]:
    """Return the point in an image's plane that is under a pixel of its view."""
    renderer = view.SMProxy.GetRenderer()
    ends = []
    for depth in (0.0, 1.0):
        renderer.SetDisplayPoint(at[0], at[1], depth)
        renderer.DisplayToWorld()
        x, y, z, w = renderer.GetWorldPoint()
        ends.append((x / w, y / w, z / w))
    near, far = ends
    along = 0.0 if near[2] == far[2] else near[2] / (near[2] - far[2])
    return near[0] + along * (far[0] - near[0]), near[1] + along * (far[1] - near[1])


def pixel_at(place: Sequence[float], sizes: Sequence[int]) -> tuple[int, int] | None:
    """Return the pixel of a picture's file, x from the left and y from the top, at a point in its image; None outside.

    The image's rows are counted from the bottom; ``sizes`` has its width and height, then those of the file.
    """
    width, height, own_width, own_height = sizes
    column, row = place[0] + 0.5, height - place[1] - 0.5  # an image's point lies at the centre of its pixel
    if not (0 <= column < width and 0 <= row < height):
        return None
    return math.floor(column * own_width / width), math.floor(row * own_height / height)
