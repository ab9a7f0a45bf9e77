"""Samples of rays through a scene that is cut open, or in which regions are hidden.

What cuts of all regions leave of a ray is one piece or several. Each piece is marched as a ray of its own, so that its
first sample lies right behind the cut, and nothing that was cut off ends it; the samples of all pieces are then put in
order. Letters: R rays, S samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from svv.core.geometry.cuts import Cut, clip_rays
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.kernels.types import Samples


@dataclass(frozen=True)
class OpenCells:
    """The cells of a scene in which some regions are cut off or hidden."""

    there: Occupancy
    """Those in which something may be left."""
    kept: Tensor
    """Cells in which nothing is cut off or hidden. (X, Y, Z) bool"""


@torch.no_grad()
def march_uncut(
    rays: Rays, occupancy: Occupancy, density: SparseLattice | None, how: Marching, cuts: Sequence[Cut],
    opened: OpenCells | None,
) -> Samples:  # fmt: skip
    """Sample the parts of rays that no cut of all regions takes away, as :func:`march` does.

    Cuts, in world units, of some regions only, and hidden regions, are left to who knows the regions of the samples;
    ``opened`` are the cells for these. Only what is certainly shown ends a ray.
    """
    whole = [cut.in_box(occupancy.box) for cut in cuts if not cut.regions]
    if not whole:
        return _march(rays, occupancy, density, how, opened)
    begins, ends = clip_rays(whole, rays.origins, rays.directions)
    depth = torch.zeros_like(begins[:, 0])
    tail, pieces, numbers = torch.zeros_like(depth), [], []
    for begin, end in zip(begins.unbind(1), ends.unbind(1), strict=True):
        there = end > begin
        if density is not None and how.fade > 0.0:
            there &= how.fade * depth <= how.stop
        which = there.nonzero()[:, 0]
        if not len(which):
            continue
        start, directions = begin[which], rays.directions[which]
        part = Rays(rays.origins[which] + start[:, None] * directions, directions)
        piece = _march(part, occupancy, density, how, opened)
        own: Tensor = piece.ray.long()
        ray = which[own]
        along = ((piece.position - rays.origins[ray]) * rays.directions[ray]).sum(1)
        share = ((end[ray] - along) / how.step + 0.5).clamp(max=1.0)  # of a sample's step, up to the cut
        kept = share > 0.0
        endless = end[which].isinf()
        tail[which] = torch.where(endless, piece.tail, 0.0)  # behind a cut, it may be of what was cut off
        position = piece.position[kept]
        ray, sigma, skipped = ray[kept], (piece.sigma * share)[kept], piece.skipped[kept]
        depth.index_add_(0, ray, _shown(skipped + sigma * how.step, position, occupancy, opened))
        pieces.append((position, sigma, skipped))
        numbers.append(ray)
    pieces.append((rays.origins[:0], depth[:0], depth[:0]))
    position, sigma, skipped = (torch.cat(parts) for parts in zip(*pieces, strict=True))
    ray = torch.cat([*numbers, torch.zeros(0, dtype=torch.int64, device=depth.device)])
    order = ray.argsort(stable=True)
    count = torch.bincount(ray, minlength=len(rays))
    return Samples(
        position[order], sigma[order], skipped[order], ray[order].int(), count.cumsum(0) - count, count, tail, how.step
    )


def _march(
    rays: Rays, occupancy: Occupancy, density: SparseLattice | None, how: Marching, opened: OpenCells | None
) -> Samples:
    """March rays, which end at what is certainly shown; without open cells, all is."""
    if opened is None:
        return march(rays, occupancy, density, how)
    samples = march(rays, opened.there, density, replace(how, fade=0.0))
    if density is None or how.fade == 0.0:
        return samples
    own = _shown(samples.skipped + samples.sigma * how.step, samples.position, occupancy, opened)
    total = own.cumsum(0, dtype=torch.float64)
    ray: Tensor = samples.ray.long()
    most = torch.cat([total.new_zeros(1), total])[samples.start] + how.stop / how.fade
    left = total - own <= most[ray]
    if bool(left.all()):
        return samples
    rows = left.nonzero()[:, 0]
    count = torch.bincount(ray[rows], minlength=len(rays))
    return Samples(
        samples.position[rows], samples.sigma[rows], samples.skipped[rows], samples.ray[rows], count.cumsum(0) - count,
        count, samples.tail, samples.step,
    )  # fmt: skip


def _shown(depth: Tensor, position: Tensor, occupancy: Occupancy, opened: OpenCells | None) -> Tensor:
    """Return the optical depth of samples (S,) at positions (S, 3) where it is certainly shown, else 0. (S,)"""
    if opened is None:
        return depth
    cell = (position * occupancy.cells).long()
    x, y, z = (v.clamp(0, n - 1) for v, n in zip(cell.unbind(1), opened.kept.shape, strict=True))
    return depth * opened.kept[x, y, z]
