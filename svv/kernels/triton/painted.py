"""Strokes in images on the GPU: Triton. See :class:`svv.kernels.types.StrokeKernels`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product

import torch
import triton
from torch import Tensor

from svv.kernels.triton import sheets as triton_sheets
from svv.kernels.triton import strokes as triton_strokes
from svv.kernels.types import Samples, StrokeTables

BLOCK = 32
"""Rays or sheets per program: one warp, whose lanes go from stroke to stroke together."""
SAMPLE_BLOCK = 128


def over(
    samples: Samples, region: Tensor, chosen: Tensor, apart: Tensor, tables: Sequence[StrokeTables], below: Tensor,
    flat: bool,
) -> Tensor:  # fmt: skip
    """Find the sheets, lay the strokes of one region after the other on them, and these on the samples."""
    own, where, ends = sheets(samples, region, chosen, apart)
    rays, covered = len(samples.start), torch.empty(len(samples), 4, device=region.device)
    for number, table in enumerate(tables):
        lay(table, where, ends, number * rays - 1, (number + 1) * rays - 1, covered)
    out = torch.empty(len(samples), 3, device=region.device)
    if len(samples):
        triton_sheets.cover[(triton.cdiv(len(samples), SAMPLE_BLOCK),)](
            own, region, covered, below, out, len(samples), flat,
            SAMPLE_BLOCK,
        )  # fmt: skip
    return out


def sheets(samples: Samples, region: Tensor, chosen: Tensor, apart: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return each sample's sheet, -1 for none (S,), mean positions (P, 3), and how many there are up to each ray's.

    Sheets are numbered region by region. There is room for a sheet for each sample; only the first ones are filled.

    Returns:
        The last is int64, for all rays of the first of the ``chosen`` regions, then those of the second. (G R,)
    """
    rays, device = len(samples.start), region.device
    number = torch.zeros(len(chosen), rays, dtype=torch.int32, device=device)
    own = torch.full((len(samples),), -1, dtype=torch.int64, device=device)
    where, ends = torch.empty(len(samples), 3, device=device), own  # not read while they are counted
    for writes in (False, True):
        if len(samples):
            triton_sheets.sheets[triton.cdiv(rays, BLOCK), len(chosen)](
                samples.position, samples.sigma, samples.skipped, samples.step, samples.start, samples.count, region,
                chosen, apart, rays, number, ends, own, where, writes, BLOCK, num_warps=1,
            )  # fmt: skip
        if not writes:
            ends = number.view(-1).cumsum(0)
    return own, where, ends


def lay(table: StrokeTables, where: Tensor, ends: Tensor, before: int, until: int, covered: Tensor) -> None:
    """Compute the paint (P, 4) of the sheets from number ends[before] to ends[until], with the ground among strokes."""
    grid = (triton.cdiv(len(where), BLOCK),)
    if len(where):
        triton_strokes.paint[grid](
            where, ends, before, until, table.size, table.start, table.entries, table.stroke, table.around,
            table.points, table.strokes, table.seeds, table.noise, table.look, covered,
            table.washes, table.tooth, BLOCK, num_warps=1,
        )  # fmt: skip
        triton_strokes.ground[grid](
            where, ends, before, until, table.cells, table.near, table.first, table.inside, _steps(where.device),
            table.stroke, table.around, table.strokes, table.brightness, table.bare,
            table.look if table.tint is None else table.tint, covered, table.tint is not None, BLOCK, num_warps=1,
        )  # fmt: skip


@cache
def _steps(device: torch.device) -> Tensor:
    """Return steps to the cells around one, and the square of their least distance from it, ascending, int32. (729, 4)

    A place whose cell or one of its neighbours has a point is at most twice the diagonal of a cell away from that, so
    the nearest point is at most four cells away along each axis.
    """
    least = {step: sum(max(abs(k) - 1, 0) ** 2 for k in step) for step in product(range(-4, 5), repeat=3)}
    rows = [(*step, least[step]) for step in sorted(least, key=lambda step: least[step])]
    return torch.tensor(rows, dtype=torch.int32, device=device)
