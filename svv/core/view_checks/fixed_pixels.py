"""What stands still on the screen while the cameras move: colour bars, axes, logos and text.

Such pixels are filled in all views, in the same place, and yet every point along their rays is seen somewhere empty by
other views. What passes this test, such as a ball about the centre, is an object.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, find_objects, label, maximum_filter

from svv.core.view_checks.silhouettes import Views

Array = NDArray[np.float64]
Images = NDArray[np.uint8]
Mask = NDArray[np.bool_]

VISIBLE = 2
"""Level of alpha above which a pixel is filled."""

SAME = 6
"""Levels by which a pixel may differ between views and still count as the same."""

JOINED = 2
"""Pixels over which letters and ticks are joined to one thing."""

IN_VIEWS = 0.95
"""Fraction of the views in which something that stands still is there, and in which a point of an object is seen."""

LARGEST = 0.25
"""Fraction of the image that something on the screen takes at most."""

SMALLEST = 12
"""Filled pixels below which a thing is not looked at."""

RAYS, DEPTHS, FROM = 24, 96, 6
"""Rays of a thing and points of each that are looked at, and from how many views."""

NEAREST, FARTHEST = 0.1, 2.5
"""Depths between which an object may be, relative to that of the point where the lines of sight meet."""

OBJECT = 0.5
"""Fraction of its rays with a point that all views see from which on a thing is an object."""


def fixed_pixels(images: Sequence[Images], views: Views, step: int = 1) -> Mask:
    """Return the pixels of things that stand still on the screen. (height, width)

    ``images``: RGBA, every ``step``-th pixel from ``step // 2`` on, n x (height, width, 4); ``views``: their cameras,
    in pixels of the whole image.
    """
    filled = np.stack([image[..., 3] > VISIBLE for image in images])
    found = np.zeros(filled.shape[1:], bool)
    ever = filled.any(axis=0)
    if len(images) < 3 or not ever.any():
        return found
    same = np.logical_and.reduce(filled)
    same[same] = np.ptp([image[same] for image in images], axis=0).max(axis=-1) <= SAME
    seen: _Seen | None = None
    for mask in (same, ever & ~same):
        numbers, _ = label(binary_dilation(mask, np.ones((3, 3)), JOINED), np.ones((3, 3)))
        for number, place in enumerate(find_objects(numbers), start=1):
            thing = np.zeros_like(found)
            thing[place] = mask[place] & (numbers[place] == number)
            there = (filled[:, place[0], place[1]] & thing[place]).any(axis=(1, 2)).mean()
            size = int(thing.sum())
            if size < SMALLEST or size > LARGEST * thing.size or there < IN_VIEWS:
                continue
            if mask is not same and (filled & thing).sum() > OBJECT * filled.sum():
                continue  # what moves within its place, as axes that turn do, is not the object itself
            seen = seen or _Seen(filled, views, step)
            if seen.of_thing(thing) < OBJECT:
                found |= thing
    return found


class _Seen:
    """Tells whether a pixel's ray has a point that all views see."""

    def __init__(self, filled: Mask, views: Views, step: int) -> None:
        self._filled, self._views, self._step = filled, views, step
        self._near = np.stack([maximum_filter(mask, 3) for mask in filled])  # half a pixel off is no miss
        back, position = views.matrices[:, :3, 2], views.matrices[:, :3, 3]
        away = np.eye(3) - back[:, :, None] * back[:, None]
        meeting = np.linalg.lstsq(away.sum(0), np.einsum("nab,nb->a", away, position), rcond=None)[0]
        self._depth = np.abs(((position - meeting) * back).sum(axis=1))

    def of_thing(self, thing: Mask) -> float:
        """Return the fraction of its rays that have such a point."""
        rows, columns = np.nonzero(thing)
        some = np.linspace(0, len(rows) - 1, min(len(rows), RAYS)).astype(int)
        parts = []
        for view in np.linspace(0, len(self._filled) - 1, min(len(self._filled), FROM)).astype(int):
            own = self._filled[view, rows[some], columns[some]]
            if own.any():
                parts.append(self._along(int(view), rows[some][own], columns[some][own]))
        return float(np.concatenate(parts).mean()) if parts else 1.0

    def _along(self, view: int, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Mask:
        """Return which rays of a view have a point that nearly all views see that have it in their image."""
        v, step = self._views, self._step
        pixel = np.stack([columns, rows], 1) * step + step // 2 + 0.5
        offset = (pixel - v.centres[view]) * (1.0, -1.0) / v.focal[view]
        depth = self._depth[view] * np.linspace(NEAREST, FARTHEST, DEPTHS)
        across = offset[:, None] * (np.ones_like(depth) if v.parallel[view] else depth)[:, None]  # (rays, depths, 2)
        local = np.concatenate([across, np.broadcast_to(-depth[:, None], (*across.shape[:2], 1))], axis=2)
        points = local @ v.matrices[view, :3, :3].T + v.matrices[view, :3, 3]
        hits, inside = np.zeros(points.shape[:2]), np.zeros(points.shape[:2])
        height, width = self._filled.shape[1:]
        for k, mask in enumerate(self._near):
            own = (points - v.matrices[k, :3, 3]) @ v.matrices[k, :3, :3]
            front = own[..., 2] < 0.0
            divisor = np.ones_like(own[..., 2]) if v.parallel[k] else np.where(front, -own[..., 2], 1.0)
            column = (v.centres[k, 0] + v.focal[k] * own[..., 0] / divisor) // step
            row = (v.centres[k, 1] - v.focal[k] * own[..., 1] / divisor) // step
            within = front & (column >= 0) & (column < width) & (row >= 0) & (row < height)
            at = np.where(within, row, 0).astype(int), np.where(within, column, 0).astype(int)
            hits += within & mask[at]
            inside += within
        # A point that few views have in their image could be anything.
        seen = (hits >= IN_VIEWS * inside) & (inside >= OBJECT * len(self._near))
        return np.asarray(seen.any(axis=1), np.bool_)


def places_of(fixed: Mask) -> str:
    """Say where on the screen pixels are: "at the right, at the lower left"."""
    numbers, _ = label(binary_dilation(fixed, np.ones((3, 3)), 4 * JOINED), np.ones((3, 3)))
    said = []
    for rows, columns in find_objects(numbers):
        y = (rows.start + rows.stop) / 2 / fixed.shape[0]
        x = (columns.start + columns.stop) / 2 / fixed.shape[1]
        up, side = ("upper", "", "lower")[int(y * 3)], ("left", "", "right")[int(x * 3)]
        alone = {"upper": "top", "lower": "bottom", "": "centre"}[up]
        said.append(f"at the {up} {side}" if up and side else f"at the {side or alone}")
    return ", ".join(dict.fromkeys(said))
