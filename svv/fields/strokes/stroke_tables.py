"""Strokes on a GPU: the tables that its kernels read (:class:`svv.kernels.types.StrokeTables`).

What a place shows is defined by :class:`svv.fields.strokes.stroke_paint.StrokePaint`, which evaluates it on the CPU.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import torch
from numpy.typing import DTypeLike, NDArray
from torch import Tensor

from svv.core.strokes.strokes import FLOW, NOISE, RAGGED, RIM, TAPER, WET, Brush, Floats, Strokes
from svv.kernels.numba.strokes import FLAT, SLACK
from svv.kernels.types import StrokeTables


def look_of(brush: Brush, unit: float, soft: float, side: float) -> Floats:
    """Return a brush as the kernels take it; lengths are in box units, of which ``unit`` is the strokes' median width.

    Relief, dry, mixed, rim, body, grain, tooth, flow, feather, blunt, length and raggedness of lifted ends, size of the
    irregularities of wet paint, width of rims, soft edges, side of bins, light (3) and paper (3).
    """
    sharp = max(0.5 * RIM * unit, soft)
    numbers = [
        brush.relief, brush.dry, brush.mixed, brush.rim * 0.5 * RIM * unit / sharp, brush.body, brush.grain,
        brush.tooth * unit, brush.flow, brush.feather, brush.blunt, TAPER + brush.blunt * (1.0 - TAPER),
        RAGGED * (1.0 - brush.blunt), FLOW * unit, sharp, soft, side, *brush.light, *brush.paper,
    ]  # fmt: skip
    return np.array(numbers, np.float32)


def tables_of(
    strokes: Strokes, brush: Brush, around: Floats, bins: tuple[int, Tensor, Tensor], widths: tuple[float, float],
    ground: tuple[float, float], device: torch.device,
) -> StrokeTables:  # fmt: skip
    """Return the tables of N strokes of K points for a device.

    ``around`` (K, 16): see :func:`svv.kernels.numba.strokes.surroundings`; ``bins``: how many along the box, first
    entry of each, and the points (:func:`bins_of`); ``widths``: of soft edges, and how far from points there is ground,
    in box units; ``ground``: its brightness relative to the nearest stroke, and the coverage below which it shows.
    """
    size, soft, reach = bins[0], *widths
    _, arc, _, widen = strokes.frames
    cells, near, first, inside = _cells_of(strokes.where, reach)
    columns = strokes.colour, strokes.second, strokes.bristles[:, None], strokes.length[:, None]

    def there(array: NDArray[np.generic], kind: DTypeLike = np.float32) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, kind)).to(device)

    return StrokeTables(
        *bins, there(strokes.stroke, np.int32), there(around),
        there(np.stack([arc, widen, strokes.radius], 1)), there(np.concatenate(columns, 1)),
        there(strokes.seed, np.int32), _noise(device), there(look_of(brush, strokes.unit, soft, 1.0 / size)),
        bool((strokes.bristles < WET).any()), brush.grain > 0.0, cells, there(near, np.uint8), there(first, np.int64),
        there(inside, np.int32), None if brush.ground is None else there(np.array(brush.ground)), *ground,
    )  # fmt: skip


def bins_of(around: Floats, wider: float, size: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """List the points whose paint may reach into each bin of a grid, the last points first, on a device.

    The same as :func:`svv.kernels.numba.strokes.sort_into_bins`, which describes it, int64 and int32.
    """
    table = torch.from_numpy(around[::-1].copy()).to(device, torch.float64)
    side, where, long = 1.0 / size, table[:, :3], table[:, 11] + wider
    bend = table[:, 15] * long * long
    left, right = -0.5 * long + bend.clamp(max=0.0), 0.5 * long + bend.clamp(min=0.0)
    slabs = [(table[:, 3:6], table[:, 7], table[:, 6]), (table[:, 8:11], -long, long), (table[:, 12:15], left, right)]
    reach = [torch.stack([low[:, None] * v, high[:, None] * v]) for v, low, high in slabs]
    low, high = where + sum(r.amin(0) for r in reach), where + sum(r.amax(0) for r in reach)
    first, last = ((edge / side).to(torch.int64).clamp(0, size - 1) for edge in (low - SLACK, high + SLACK))
    sides = last - first + 1
    point, index = _spread(sides[:, 0] * sides[:, 1])
    column = torch.stack([first[point, 0] + index // sides[point, 1], first[point, 1] + index % sides[point, 1]], 1)
    at = torch.cat([(column + 0.5) * side - where[point, :2], -where[point, 2:]], 1)
    near, far = first[point, 2].double(), last[point, 2].double()
    for v, lowest, highest in slabs:
        v = v[point]
        half, base = 0.5 * side * v.abs().sum(1) + SLACK, (v * at).sum(1)
        ends = torch.stack([lowest[point] - half - base, highest[point] + half - base])
        within = (ends[0] <= 0.0) & (ends[1] >= 0.0)
        flat, ends = v[:, 2].abs() < FLAT, ends / (v[:, 2] * side) - 0.5
        near = torch.where(flat, near, torch.maximum(near, ends.amin(0).ceil()))
        far = torch.where(flat, torch.where(within, far, -1.0), torch.minimum(far, ends.amax(0).floor()))
    of, index = _spread((far - near + 1.0).clamp(min=0.0).long())
    which = (column[of, 0] * size + column[of, 1]) * size + near[of].long() + index
    order = which.sort(stable=True)[1]
    start = torch.zeros(size**3 + 1, dtype=torch.int64, device=device)
    torch.cumsum(torch.bincount(which, minlength=size**3), 0, out=start[1:])
    return start, (len(around) - 1 - point[of[order]]).int()


def _spread(counts: Tensor) -> tuple[Tensor, Tensor]:
    """Return which of N things each of so many items (N,) belongs to, and its number among those. (sum of counts,)"""
    of = torch.arange(len(counts), device=counts.device).repeat_interleave(counts)
    return of, torch.arange(len(of), device=of.device) - (counts.cumsum(0) - counts)[of]


def _cells_of(where: Floats, reach: float) -> tuple[int, NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    """Return the cells along the box, which are near points, and the points of each; see :class:`StrokeTables`."""
    cells, near = cells_near(where, reach)
    at = np.ravel_multi_index(tuple((where * cells).astype(np.int64).clip(0, cells).T), near.shape)
    first = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=near.size))])
    return cells, near.ravel(), first, np.argsort(at, kind="stable")


def cells_near(where: Floats, reach: float) -> tuple[int, NDArray[np.bool_]]:
    """Return cells along the box, and a grid, two larger, of those with points (K, 3) or beside such cells."""
    from scipy.ndimage import binary_dilation

    cells = max(int(1.0 / reach), 1)
    grid = np.zeros((cells + 2,) * 3, bool)
    grid[tuple((where * cells).astype(np.int64).clip(0, cells).T)] = True
    return cells, binary_dilation(grid, np.ones((3, 3, 3), bool))


@cache
def _noise(device: torch.device) -> Tensor:
    return torch.from_numpy(NOISE).to(device)
