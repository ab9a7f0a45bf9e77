"""Strokes on a GPU: the tables that its kernels read (:class:`svv.kernels.types.StrokeTables`).

What a place shows is defined by :class:`svv.fields.strokes.stroke_paint.StrokePaint`, which evaluates it on the CPU.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import torch
from numpy.typing import DTypeLike, NDArray
from scipy.ndimage import binary_dilation
from torch import Tensor

from svv.core.strokes.strokes import FLOW, NOISE, RAGGED, RIM, TAPER, WET, Brush, Floats, Strokes
from svv.kernels.types import StrokeTables


def look_of(brush: Brush, unit: float, soft: float, side: float) -> Floats:
    """Return a brush as the kernels take it.

    Relief, dry, mixed, rim, body, grain, tooth, flow, feather, blunt, length and raggedness of lifted ends, size of the
    irregularities of wet paint, width of rims, soft edges, side of bins, light (3) and paper (3).

    Args:
        brush: The brush.
        unit: Median width of strokes.
        soft: Width of soft edges.
        side: Side of the bins. All in box units.
    """
    sharp = max(0.5 * RIM * unit, soft)
    numbers = [
        brush.relief, brush.dry, brush.mixed, brush.rim * 0.5 * RIM * unit / sharp, brush.body, brush.grain,
        brush.tooth * unit, brush.flow, brush.feather, brush.blunt, TAPER + brush.blunt * (1.0 - TAPER),
        RAGGED * (1.0 - brush.blunt), FLOW * unit, sharp, soft, side, *brush.light, *brush.paper,
    ]  # fmt: skip
    return np.array(numbers, np.float32)


def tables_of(
    strokes: Strokes, brush: Brush, around: Floats, widths: tuple[int, float, float], ground: tuple[float, float],
    device: torch.device,
) -> StrokeTables:  # fmt: skip
    """Return the tables of strokes for a device.

    Args:
        strokes: N strokes of K points.
        brush: How their paint looks.
        around: See :func:`svv.kernels.numba.strokes.surroundings`. (K, 16)
        widths: Bins along the box, and in box units the width of soft edges and how far from points there is ground.
        ground: Brightness of the ground relative to the nearest stroke, and the coverage below which it shows.
        device: Where they are used.
    """
    size, soft, reach = widths
    tangent, arc, _, widen = strokes.frames
    start, entries = bins_of(strokes, tangent, soft, size, device)
    cells, near, first, inside = _cells_of(strokes.where, reach)
    columns = strokes.colour, strokes.second, strokes.bristles[:, None], strokes.length[:, None]

    def there(array: NDArray[np.generic], kind: DTypeLike = np.float32) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, kind)).to(device)

    return StrokeTables(
        size, start, entries, there(strokes.stroke, np.int32), there(around),
        there(np.stack([arc, widen, strokes.radius], 1)), there(np.concatenate(columns, 1)),
        there(strokes.seed, np.int32), _noise(device), there(look_of(brush, strokes.unit, soft, 1.0 / size)),
        bool((strokes.bristles < WET).any()), brush.grain > 0.0, cells, there(near, np.uint8), there(first, np.int64),
        there(inside, np.int32), None if brush.ground is None else there(np.array(brush.ground)), *ground,
    )  # fmt: skip


def bins_of(strokes: Strokes, tangent: Floats, soft: float, size: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """List the points whose paint may reach into each bin of a grid, the last points first, on a device.

    The same as :func:`svv.kernels.numba.strokes.sort_into_bins`, which describes it.

    Returns:
        First entry of each bin (size^3 + 1,) int64, and entries (B,) int32.
    """
    backward = [a[::-1].copy() for a in (strokes.where, strokes.normal, tangent)]
    where, normal, along = (torch.from_numpy(a).to(device, torch.float64) for a in backward)
    columns = np.stack([strokes.radius, strokes.inner, strokes.outer], 1)[::-1].copy()
    radius, inner, outer = torch.from_numpy(columns).to(device, torch.float64).T[:, :, None]
    r = 1.2 * radius + soft
    wide = 2.0 * r * along.abs() + r * (1.0 - normal.square() - along.square()).clamp(min=0.0).sqrt()
    low = where - wide - torch.maximum(inner * normal, -outer * normal)
    high = where + wide + torch.maximum(outer * normal, -inner * normal)
    least, most = ((edge * size).to(torch.int32).clamp(0, size - 1) for edge in (low, high))
    sides = most - least + 1
    each = sides.prod(dim=1)
    point = torch.arange(len(where), dtype=torch.int32, device=device).repeat_interleave(each)
    index = torch.arange(len(point), dtype=torch.int32, device=device) - (each.cumsum(0) - each).int()[point]
    own, depth = sides[point], sides[point, 2]
    k, rest = index % depth, index // depth
    i, j = rest // own[:, 1], rest % own[:, 1]
    del index, rest, depth, own
    first = least[point]
    which = ((first[:, 0] + i) * size + first[:, 1] + j) * size + first[:, 2] + k
    del first, i, j, k
    order = which.sort(stable=True)[1]
    start = torch.zeros(size**3 + 1, dtype=torch.int64, device=device)
    torch.cumsum(torch.bincount(which, minlength=size**3), 0, out=start[1:])
    return start, (len(where) - 1 - point[order]).int()


def _cells_of(where: Floats, reach: float) -> tuple[int, NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    """Return the cells along the box, which are near points, and the points of each; see :class:`StrokeTables`."""
    cells, near = cells_near(where, reach)
    at = np.ravel_multi_index(tuple((where * cells).astype(np.int64).clip(0, cells).T), near.shape)
    first = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=near.size))])
    return cells, near.ravel(), first, np.argsort(at, kind="stable")


def cells_near(where: Floats, reach: float) -> tuple[int, NDArray[np.bool_]]:
    """Return the number of cells along the box, and which of them are, or are beside, cells with points (K, 3).

    Returns:
        Cells along the box, and a grid of two more along each axis.
    """
    cells = max(int(1.0 / reach), 1)
    grid = np.zeros((cells + 2,) * 3, bool)
    grid[tuple((where * cells).astype(np.int64).clip(0, cells).T)] = True
    return cells, binary_dilation(grid, np.ones((3, 3, 3), bool))


@cache
def _noise(device: torch.device) -> Tensor:
    return torch.from_numpy(NOISE).to(device)
