"""Samples of rays through a scene that is cut open.

What a cut leaves of a ray is one piece or several. Each piece is marched as a ray of its own, so that its first sample
lies right behind the cut, and nothing that was cut off ends it; the samples of all pieces are then put in order.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from svv.core.geometry.cuts import Cut, clip_rays
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.kernels.types import Samples


@torch.no_grad()
def march_uncut(
    rays: Rays, occupancy: Occupancy, density: SparseLattice | None, how: Marching, cuts: Sequence[Cut]
) -> Samples:
    """Sample the parts of rays that no cut of all regions takes away, as :func:`march` does.

    Cuts, in world units, of some regions only are left to who knows the regions of the samples: all are there for them.
    """
    whole = [cut.in_box(occupancy.box) for cut in cuts if not cut.regions]
    if not whole:
        return march(rays, occupancy, density, how)
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
        piece = march(Rays(rays.origins[which] + start[:, None] * directions, directions), occupancy, density, how)
        own: Tensor = piece.ray.long()
        ray = which[own]
        along = ((piece.position - rays.origins[ray]) * rays.directions[ray]).sum(1)
        share = ((end[ray] - along) / how.step + 0.5).clamp(max=1.0)  # of a sample's step, up to the cut
        kept = share > 0.0
        endless = end[which].isinf()
        tail[which] = torch.where(endless, piece.tail, 0.0)  # behind a cut, it may be of what was cut off
        ray, sigma, skipped = ray[kept], (piece.sigma * share)[kept], piece.skipped[kept]
        depth.index_add_(0, ray, skipped + sigma * how.step)
        pieces.append((piece.position[kept], sigma, skipped))
        numbers.append(ray)
    pieces.append((rays.origins[:0], depth[:0], depth[:0]))
    position, sigma, skipped = (torch.cat(parts) for parts in zip(*pieces, strict=True))
    ray = torch.cat([*numbers, torch.zeros(0, dtype=torch.int64, device=depth.device)])
    order = ray.argsort(stable=True)
    count = torch.bincount(ray, minlength=len(rays))
    return Samples(
        position[order], sigma[order], skipped[order], ray[order].int(), count.cumsum(0) - count, count, tail, how.step
    )
