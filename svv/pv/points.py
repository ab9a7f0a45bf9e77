"""Points of a mask, set by clicking into the view of the picture: the buttons of StyleRF Stylize's panel.

Client code, as in :mod:`svv.pv.undo`: the client has the mouse and the views. A click changes the text of a region's
points, which the panel then shows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkWeakReference

KINDS = {"ClickInside": "Positive", "ClickOutside": "Negative", "ClickRemove": ""}
"""Button -> the points of the Shown Mask's region to which clicks add; '' if they remove a point."""

CROSS, ARROW = 10, 0
"""VTK_CURSOR_CROSSHAIR and VTK_CURSOR_DEFAULT, which not every version of VTK exposes to Python."""

STILL = 3
"""Pixels that the mouse may move during a click; a longer motion drags the picture."""

MASK = 1
"""The output port that shows the picture."""

_watched: set[str] = set()
_clicks: list[Clicks] = []
"""The active handler, at most one; without this reference Python would collect it, because VTK holds none."""


class Clicks:
    """Click handler of the views that show a filter's picture: a click sets or removes a point."""

    def __init__(self, paint: Any, button: str) -> None:
        self.button = button
        self.filter = vtkWeakReference()  # does not keep a deleted filter alive
        self.filter.Set(paint.SMProxy)
        self._down: tuple[int, int] | None = None
        self._views = [view for view in views_of_mask(paint) if view.GetInteractor() is not None]
        self._tags = []
        for view in self._views:
            interactor = view.GetInteractor()
            for event, do in (("LeftButtonPressEvent", self._press), ("LeftButtonReleaseEvent", self._release)):
                self._tags.append((interactor, interactor.AddObserver(event, do)))
            view.GetRenderWindow().SetCurrentCursor(CROSS)

    def _press(self, interactor: Any, event: str) -> None:
        self._down = interactor.GetEventPosition()

    def _release(self, interactor: Any, event: str) -> None:
        at, proxy = interactor.GetEventPosition(), self.filter.Get()
        if proxy is None:
            self.stop()
        elif self._down is not None and math.dist(at, self._down) <= STILL:
            (view,) = (v for v in self._views if v.GetInteractor() == interactor)
            set_point(_python(proxy), place_under(view, at), self.button)

    def stop(self) -> None:
        """Stop handling clicks."""
        for interactor, tag in self._tags:
            interactor.RemoveObserver(tag)
        for view in self._views:
            view.GetRenderWindow().SetCurrentCursor(ARROW)
        self._tags, self._views = [], []


def watch_points(filter: Any) -> None:
    """Make a filter's buttons work, from now on.

    Args:
        filter: Proxy of StyleRF Stylize.
    """
    proxy = filter.SMProxy
    key = f"{id(proxy.GetSession()):x} {proxy.GetGlobalIDAsString()}"
    if key not in _watched:
        _watched.add(key)
        proxy.AddObserver("UpdatePropertyEvent", _pressed)


def _pressed(proxy: Any, event: str, name: str) -> None:
    """Start handling clicks for a button; if it is pressed again, stop."""
    if name not in KINDS:
        return
    again = False
    while _clicks:
        old = _clicks.pop()
        again = old.button == name and old.filter.Get() is proxy
        old.stop()
    paint = _python(proxy)
    if again:
        return
    if not views_of_mask(paint):
        vtkOutputWindow.GetInstance().DisplayWarningText(
            "StyleRFStylize: No view shows the picture: switch Preview Only on, press Apply, and show the second "
            "output, Mask.\n"
        )
        return
    _clicks.append(Clicks(paint, name))


_pressed.CallDataType = "string0"  # type: ignore[attr-defined]


def views_of_mask(paint: Any) -> list[Any]:
    """Return the views that show the picture of StyleRF Stylize."""
    from paraview import simple

    def shows(display: Any) -> bool:
        given = getattr(display, "Input", None)
        return given is not None and given.SMProxy == paint.SMProxy and given.Port == MASK and bool(display.Visibility)

    return [view for view in simple.GetRenderViews() if any(map(shows, view.Representations))]


def place_under(view: Any, at: Sequence[int]) -> tuple[float, float]:
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
    """Return the pixel of a picture's file, x from the left and y from the top, at a point in the image that shows it.

    Args:
        place: Point in the image's coordinates, whose rows are counted from the bottom.
        sizes: Width and height of the image, then those of the file.

    Returns:
        The pixel, or None outside the picture.
    """
    width, height, own_width, own_height = sizes
    column, row = place[0] + 0.5, height - place[1] - 0.5  # an image's point lies at the centre of its pixel
    if not (0 <= column < width and 0 <= row < height):
        return None
    return math.floor(column * own_width / width), math.floor(row * own_height / height)


def set_point(paint: Any, place: Sequence[float], button: str) -> None:
    """Set or remove a point, depending on the button.

    Args:
        paint: Proxy of StyleRF Stylize.
        place: Point in the coordinates of its second output.
        button: One of :data:`KINDS`.
    """
    paint.UpdatePropertyInformation()
    sizes = [int(n) for n in (paint.GetProperty("PictureSize").GetData() or "").split()]
    at = pixel_at(place, sizes) if sizes else None
    if at is None:
        return
    rows = {kind: paint.GetProperty(f"Region{paint.ShownMask}{kind}") for kind in KINDS.values() if kind}
    if KINDS[button]:
        row = rows[KINDS[button]]
        row.SetData("; ".join(filter(str.strip, [row.GetData() or "", f"{at[0]},{at[1]}"])))
    else:
        _without_nearest(rows, at)
    if paint.PreviewOnly:  # otherwise this would start painting; the panel waits for Apply
        from paraview import simple

        paint.SMProxy.UpdateVTKObjects()
        simple.RenderAllViews()


def _without_nearest(rows: dict[str, Any], at: tuple[int, int]) -> None:
    """Remove the point that is nearest to a pixel from the properties' texts."""
    from svv.pv.masks import points_in

    known = [(kind, point) for kind, row in rows.items() for point in points_in(row.GetData() or "", kind)]
    if not known:
        return
    kind, nearest = min(known, key=lambda one: math.dist(one[1], at))
    left = [point for k, point in known if k == kind and point != nearest]
    rows[kind].SetData("; ".join(f"{x:g},{y:g}" for x, y in left))


def _python(proxy: Any) -> Any:
    from paraview import servermanager

    return servermanager._getPyProxy(proxy)
