"""Samples of rays through a scene that is cut open.

Cuts divide a ray into pieces. Each piece is marched as a ray of its own, so that its first sample lies right behind the
cut, and nothing that was cut off ends it; the samples of all pieces are then put in order. Letters: R rays, S samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from svv.core.geometry.cuts import Cut, divide_rays
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.kernels.types import Samples


@dataclass(frozen=True)
class OpenCells:
    """The cells in which some regions are cut off or hidden."""

    there: Occupancy
    """Those of them in which something may be left."""
    kept: Tensor
    """Cells in which nothing is cut off or hidden. (X, Y, Z) bool"""


@torch.no_grad()
def march_uncut(
    rays: Rays, occupancy: Occupancy, density: SparseLattice | None, how: Marching, cuts: Sequence[Cut],
    opened: OpenCells | None,
) -> Samples:  # fmt: skip
    """Sample the parts of rays that no cut of all regions takes away, as :func:`march` does.

    Cuts, in world units, of some regions only, and hidden regions, are left to who knows the regions of the samples;
    ``opened`` are the cells that these reach. Only what is certainly shown ends a ray there.
    """
    whole = [cut.in_box(occupancy.box) for cut in cuts if not cut.regions]
    if not whole:
        if opened is None:
            return march(rays, occupancy, density, how)
        return _march_shown(rays, occupancy, density, how, opened)
    begins, ends, taken = divide_rays(whole, rays.origins, rays.directions)
    gone = taken.any(2)
    depth, tail = torch.zeros_like(begins[:, 0]), torch.zeros_like(begins[:, 0])
    pieces, numbers = [(rays.origins[:0], depth[:0], depth[:0])], [torch.zeros(0, dtype=torch.int64).to(depth.device)]
    for k in range(begins.shape[1]):
        there = (ends[:, k] > begins[:, k]) & ~gone[:, k]
        if density is not None and how.fade > 0.0:
            there &= how.fade * depth <= how.stop
        which = there.nonzero()[:, 0]
        if not len(which):
            continue
        part = Rays(rays.origins[which], rays.directions[which])
        piece, share = _march_part(part, begins[which, k], ends[which, k], occupancy, density, how, opened)
        tail[which] = torch.where(ends[which, k].isinf(), piece.tail, 0.0)  # else, it may be of what was cut off
        own = which[piece.ray.long()]
        ends_rays = share if opened is None else share * _looked_up(opened, occupancy, piece.position)
        depth.index_add_(0, own, (piece.skipped + piece.sigma * how.step) * ends_rays)
        pieces.append((piece.position, piece.sigma * share, piece.skipped))
        numbers.append(own)
    position, sigma, skipped = (torch.cat(parts) for parts in zip(*pieces, strict=True))
    ray = torch.cat(numbers)
    order = ray.argsort(stable=True)
    count = torch.bincount(ray, minlength=len(rays))
    return Samples(
        position[order], sigma[order], skipped[order], ray[order].int(), count.cumsum(0) - count, count, tail, how.step
    )


def _march_shown(
    rays: Rays, occupancy: Occupancy, density: SparseLattice | None, how: Marching, opened: OpenCells
) -> Samples:
    """Return the samples of whole rays where regions are hidden or cut off, up to where what is shown ends them."""
    piece = march(rays, opened.there, density, replace(how, fade=0.0))
    if density is None or how.fade == 0.0:
        return piece
    own = (piece.skipped + piece.sigma * how.step).mul_(_looked_up(opened, occupancy, piece.position))
    total = own.cumsum(0, dtype=torch.float64)
    before = total - own
    ray: Tensor = piece.ray.long()
    limit = torch.cat([total.new_zeros(1), total])[piece.start] + how.stop / how.fade
    left = before <= limit[ray]
    if bool(left.all()):
        return piece
    rows = left.nonzero()[:, 0]
    count = torch.bincount(ray[rows], minlength=len(rays))
    return Samples(
        piece.position[rows], piece.sigma[rows], piece.skipped[rows], piece.ray[rows], count.cumsum(0) - count, count,
        piece.tail, piece.step,
    )  # fmt: skip


def _march_part(
    rays: Rays, begin: Tensor, end: Tensor, occupancy: Occupancy, density: SparseLattice | None, how: Marching,
    opened: OpenCells | None,
) -> tuple[Samples, Tensor]:  # fmt: skip
    """Return the samples of parts of rays (R,), and the share of each sample's step that lies before the end. (S,)"""
    cells, way = (occupancy, how) if opened is None else (opened.there, replace(how, fade=0.0))
    starts = rays.origins + begin[:, None] * rays.directions
    piece = march(Rays(starts, rays.directions), cells, density, way)
    ray: Tensor = piece.ray.long()
    along = ((piece.position - rays.origins[ray]) * rays.directions[ray]).sum(1)
    share = ((end[ray] - along) / how.step + 0.5).clamp(max=1.0)
    left = share > 0.0
    if opened is not None and density is not None and how.fade > 0.0:
        sure = _looked_up(opened, occupancy, piece.position) * (piece.skipped + piece.sigma * how.step)
        total = sure.double().cumsum(0)
        before = total - sure - torch.cat([total.new_zeros(1), total])[piece.start][ray]
        left &= how.fade * before <= how.stop
    if bool(left.all()):
        return piece, share
    rows = left.nonzero()[:, 0]
    count = torch.bincount(ray[rows], minlength=len(begin))
    start = count.cumsum(0) - count
    kept = Samples(
        piece.position[rows], piece.sigma[rows], piece.skipped[rows], piece.ray[rows], start, count, piece.tail,
        piece.step,
    )  # fmt: skip
    return kept, share[rows]


def _looked_up(opened: OpenCells, occupancy: Occupancy, position: Tensor) -> Tensor:
    """Return 1 for samples (S, 3) in cells of which nothing is cut off or hidden, else 0. (S,)"""
    cell = (position * occupancy.cells).long()
    x, y, z = (v.clamp(0, n - 1) for v, n in zip(cell.unbind(1), opened.kept.shape, strict=True))
    return opened.kept[x, y, z].float()
