"""Points of a mask, set in the view that shows the picture: the buttons under StyleRF Stylize's Point in the picture.

Client code, as in :mod:`svv.pv.undo`: the point that is dragged or picked is in the view, and what comes of it is the
text of a region's points, which the panel then shows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

KINDS = {"AddInside": "Positive", "AddOutside": "Negative"}
"""What each button adds to."""
REMOVE = "RemovePoint"

_watched: set[str] = set()


def watch_points(filter: Any) -> None:
    """Let a filter's buttons work, from now on.

    Args:
        filter: StyleRF Stylize, as ParaView's Python has it.
    """
    proxy = filter.SMProxy
    key = f"{id(proxy.GetSession()):x} {proxy.GetGlobalIDAsString()}"
    if key not in _watched:
        _watched.add(key)
        proxy.AddObserver("UpdatePropertyEvent", _pressed)


def pixel_at(place: Sequence[float], sizes: Sequence[int]) -> tuple[int, int]:
    """The pixel of a picture's file, x from the left and y from the top, at a place in the image that shows it.

    Args:
        place: In the image's coordinates, whose rows count from the bottom.
        sizes: Width and height of the image, and of the file.
    """
    width, height, own_width, own_height = sizes
    column, row = place[0] + 0.5, height - place[1] - 0.5  # a pixel of the image stands at its middle
    x, y = math.floor(column * own_width / width), math.floor(row * own_height / height)
    return min(max(x, 0), own_width - 1), min(max(y, 0), own_height - 1)


def _pressed(proxy: Any, event: str, name: str) -> None:
    from paraview import servermanager

    if name not in (*KINDS, REMOVE):
        return
    paint = servermanager._getPyProxy(proxy)
    paint.UpdatePropertyInformation()
    sizes = [int(n) for n in (paint.GetProperty("PictureSize").GetData() or "").split()]
    if not sizes:
        return  # no picture is shown yet, so there is no place in it
    at = pixel_at(paint.Place, sizes)
    rows = {kind: paint.GetProperty(f"Region{paint.ShownMask}{kind}") for kind in KINDS.values()}
    if name == REMOVE:
        _without_nearest(rows, at)
    else:
        row = rows[KINDS[name]]
        row.SetData("; ".join(filter(str.strip, [row.GetData() or "", f"{at[0]},{at[1]}"])))
    if paint.PreviewOnly:  # else painting would begin; the panel waits for Apply
        proxy.UpdateVTKObjects()
        _render()


_pressed.CallDataType = "string0"  # type: ignore[attr-defined]


def _without_nearest(rows: dict[str, Any], at: tuple[int, int]) -> None:
    """Take the point that is nearest to a place out of the texts."""
    from svv.pv.masks import points_in

    known = [(kind, point) for kind, row in rows.items() for point in points_in(row.GetData() or "", kind)]
    if not known:
        return
    kind, nearest = min(known, key=lambda one: math.dist(one[1], at))
    left = [point for k, point in known if k == kind and point != nearest]
    rows[kind].SetData("; ".join(f"{x:g},{y:g}" for x, y in left))


def _render() -> None:
    from paraview import simple

    simple.RenderAllViews()
