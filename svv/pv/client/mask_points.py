"""Points of a mask, set by clicks into the view of the picture: buttons of StyleRF Stylize's panel, in client code."""

from __future__ import annotations

import math
from collections.abc import Sequence

from svv.pv.client.clicks import Act, pixel_at, place_under, press
from svv.pv.display.linked_camera import displays_in
from svv.pv.observers import python_proxy, with_data
from svv.pv.paraview_types import Display, Property, Proxy, SMProxy, View

KINDS = {"ClickInside": "Positive", "ClickOutside": "Negative", "ClickRemove": ""}
"""Button -> the points of the Shown Mask's region to which clicks add; '' if they remove a point."""

MASK = 1
"""The output port that shows the picture."""

NO_VIEW = (
    "StyleRFStylize: No view shows the picture: switch Preview Only on, press Apply, and show the second output, "
    "Mask.\n"
)


@with_data("string0")
def pressed(proxy: SMProxy, event: str, name: str) -> None:
    """Start handling clicks for a button; if it is pressed again, stop. An observer of StyleRF Stylize."""
    if name not in KINDS:
        return
    paint = python_proxy(proxy)
    act: Act = lambda filter, view, at: set_point(filter, place_under(view, at), name)  # noqa: E731
    press(paint, name, views_of_mask(paint), act, NO_VIEW)


def views_of_mask(paint: Proxy) -> list[View]:
    """Return the views that show the picture of StyleRF Stylize."""
    from paraview import simple

    def shows(display: Display) -> bool:
        return bool(display.Input.SMProxy == paint.SMProxy and display.Input.Port == MASK)

    return [view for view in simple.GetRenderViews() if any(map(shows, displays_in(view)))]


def set_point(paint: Proxy, place: Sequence[float], button: str) -> None:
    """Set or remove a point of a mask at a place in the second output of StyleRF Stylize, by one of KINDS."""
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


def _without_nearest(rows: dict[str, Property], at: tuple[int, int]) -> None:
    """Remove the point that is nearest to a pixel from the properties' texts."""
    from svv.pv.work.style_masks import pixels_in

    known = [(kind, point) for kind, row in rows.items() for point in pixels_in(row.GetData() or "", kind)]
    if not known:
        return
    kind, nearest = min(known, key=lambda one: math.dist(one[1], at))
    left = [point for k, point in known if k == kind and point != nearest]
    rows[kind].SetData("; ".join(f"{x:g},{y:g}" for x, y in left))
