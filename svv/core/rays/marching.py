"""Sampling of rays through occupied cells: the reference that the fast kernels must match.

Letters: R rays, N steps of the longest ray, (X, Y, Z) cells. Positions are box coordinates, lengths are box units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

LEAST_DEPTH = 1.0 / 4096.0
"""Optical depth above which a ray of an image has a sample, however little it weighs: an eighth of what shows."""

FAR_DISTANCE = 1e30
"""Distance beyond any box."""

PARALLEL_COMPONENT = 1e-9
"""Direction component below which a ray counts as parallel to the planes normal to that axis."""

_MIX = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)


def uniform(seed: int, a: Tensor, b: Tensor) -> Tensor:
    """Return random numbers in [0, 1) from three integers: counter-based, so every device draws the same.

    Products wrap at 64 bits, as int64 does; shifts are unsigned (Steele et al. 2014, SplitMix64).
    """
    first, second, third = (m - (1 << 64) for m in _MIX)  # the same bits as signed numbers
    mixed = seed * _MIX[0] % (1 << 64)
    signed = torch.tensor(mixed - (1 << 64) if mixed >> 63 else mixed, device=a.device)
    h = signed ^ a.long() * second ^ b.long() * third
    for shift, factor in ((31, first), (29, second), (32, 1)):
        h = (h ^ (h >> shift & (1 << (64 - shift)) - 1)) * factor
    return (h >> 40 & 0xFFFFFF).float() * (1.0 / 16777216.0)


def box_span(origins: Tensor, directions: Tensor, extent: Tensor) -> tuple[Tensor, Tensor]:
    """Return where rays (R, 3) enter and leave the box from 0 to ``extent`` (3,); enter > leave for a miss. (R,)"""
    along = directions.abs() < PARALLEL_COMPONENT
    inverse = 1.0 / torch.where(along, 1.0, directions)
    a, b = -origins * inverse, (extent - origins) * inverse
    outside = (origins < 0) | (origins > extent)
    near = torch.where(along, 0.0, torch.minimum(a, b)).amax(1).clamp(min=0.0)
    far = torch.where(along, torch.where(outside, -1.0, FAR_DISTANCE), torch.maximum(a, b)).amin(1)
    return near, far


def march(  # noqa: PLR0913  (the kernels, whose reference this is, take the same)
    origins: Tensor, directions: Tensor, occupied: Tensor, cells: int, extent: Sequence[float], step: float,
    extinction: Callable[[Tensor], Tensor], least_weight: float, keep: float, stop: float, fade: float, merge: bool,
    seed: int = 0, first_ray: int = 0, ahead: int = 0, pieces: tuple[Tensor, Tensor] | None = None,
    shown: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:  # fmt: skip
    """Sample rays at a fixed step in occupied cells and keep the samples that matter.

    For the rules of keeping, merging and skipping samples see :func:`svv.kernels.numba.packets.march`.

    Args:
        origins: Starting points of R rays. (R, 3)
        directions: Unit vectors. (R, 3)
        occupied: Cells to sample, bool. (X, Y, Z)
        cells: Cells per box unit.
        extent: Sides of the box.
        step: Sample spacing.
        extinction: Function from positions (P, 3) to extinction in 1 / box unit (P,).
        least_weight: Smallest weight of a sample that is kept; see :class:`svv.fields.radiance.rendering.Marching`.
        keep: Share of the samples of less weight that is kept all the same.
        stop: Optical depth at which a ray ends.
        fade: Smallest factor by which extinctions will be scaled later.
        merge: Whether samples of less weight are merged into the next one, or all of a ray into its heaviest.
        seed: > 0 shifts each ray's samples by a random fraction of the step; 0 shifts them by half a step.
        first_ray: Number of the first ray, for ``ray`` and for its random numbers.
        ahead: Number of rays before these in a batch of which these are a part; it changes only the random numbers.
        pieces: Where the pieces of rays that are marched begin and end, (R, M) each; by default, or with M = 0, all.
        shown: Cells whose optical depth dims and ends rays, bool (X, Y, Z); by default all.

    Returns:
        Position (S, 3), extinction (S,), optical depth skipped before each sample (S,), ray (S,) int32, number of
        samples per ray (R,) int64, and optical depth behind the last sample of each ray (R,).
    """
    ends = origins.new_tensor(extent)
    ray = torch.arange(first_ray, first_ray + len(origins), device=origins.device)
    drawn = ahead + ray
    shift = uniform(seed, drawn, torch.zeros_like(ray)) if seed > 0 else torch.full_like(origins[:, 0], 0.5)
    near, far = box_span(origins, directions, ends)
    near, far = torch.where(near < far, near, 1.0), torch.where(near < far, far, 0.0)
    if pieces is None or pieces[0].shape[1] == 0:
        first, last = torch.ceil(near / step - shift).long(), torch.floor(far / step - shift).long()
        number = first[:, None] + torch.arange(max(1, int((last - first).max()) + 1), device=origins.device)  # (R, N)
        t, there = (number + shift[:, None]) * step, number <= last[:, None]
        covers = torch.ones_like(t)
    else:
        t, there, covers = _in_pieces(near, far, pieces, step)
        number = t.long()  # not used: without a seed, no sample is kept by chance
    x = origins[:, None] + t[:, :, None] * directions[:, None]
    cell = [(x[:, :, k] * cells).long().clamp(0, n - 1) for k, n in enumerate(occupied.shape)]
    there = there & occupied[cell[0], cell[1], cell[2]]
    counted = torch.ones_like(there) if shown is None else shown[cell[0], cell[1], cell[2]]
    x = torch.minimum(x.clamp(min=0.0), ends)
    sigma = torch.zeros_like(x[:, :, 0])
    sigma[there] = extinction(x[there]) * covers[there]
    kept, skipped = torch.zeros_like(there), torch.zeros_like(sigma)
    # Optical depth left out since the last kept sample, and total since the start of the ray. (R,)
    left_out, tau = torch.zeros_like(near), torch.zeros_like(near)
    going = torch.ones_like(there[:, 0])
    most, where = torch.zeros_like(near), torch.zeros_like(ray)  # largest optical depth of a step, and which it is
    for k in range(number.shape[1]):
        here = there[:, k] & going
        thickness = torch.where(here, sigma[:, k] * step, 0.0)
        before = left_out if merge else torch.zeros_like(left_out)
        where = torch.where(thickness > most, k, where)
        most = torch.maximum(thickness, most)
        weight = 1.0 - torch.exp(-thickness - before)
        weight = torch.where(weight >= least_weight, weight * torch.exp(fade * (before - tau).clamp(max=0.0)), weight)
        chosen = weight >= least_weight
        if keep > 0:
            chosen |= uniform(seed, drawn, number[:, k] + 1) < keep
        kept[:, k] = chosen & here
        skipped[:, k] = left_out - before
        sigma[:, k] += before / step
        left_out = torch.where(kept[:, k], 0.0, left_out + thickness)
        tau = tau + torch.where(counted[:, k], thickness, 0.0)
        going = going & ~(fade * tau > stop)
    if merge:
        alone = torch.nonzero(~kept.any(dim=1) & (left_out > LEAST_DEPTH))[:, 0]
        sample = alone, where[alone]
        kept[sample], skipped[sample], sigma[sample], left_out[alone] = True, 0.0, left_out[alone] / step, 0.0
    rays = (ray[:, None].expand(kept.shape)[kept]).int()
    return x[kept], sigma[kept], skipped[kept], rays, kept.sum(1), left_out


def _in_pieces(
    near: Tensor, far: Tensor, pieces: tuple[Tensor, Tensor], step: float
) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
    """Return the distances of samples in pieces of rays, which are there, and how much of a step each covers. (R, N)

    Samples are whole steps apart, the first one half a step behind the start of a piece. One across the end of a piece
    is in the middle of what it covers of it.
    """
    found = []
    for begin, end in zip(*(each.unbind(1) for each in pieces), strict=True):
        there = (end > begin) & (begin < far) & (end > near)
        begin = torch.where(there, begin, 0.0)
        whole = torch.floor(begin / step)
        shift = begin / step - whole + 0.5
        first = torch.maximum(whole, torch.ceil(near / step - shift))
        across = torch.ceil(end / step - shift + 0.5) - 1.0
        last = torch.minimum(torch.floor(far / step - shift), torch.where(end < far, across, torch.inf))
        last = torch.where(there, last, first - 1.0)
        number = first[:, None] + torch.arange(max(1, int((last - first).max()) + 1), device=near.device)
        t, stop = (number + shift[:, None]) * step, end[:, None]
        covers = ((stop - t) / step + 0.5).clamp(max=1.0)
        found.append((torch.minimum(t, 0.5 * (t - 0.5 * step + stop)), number <= last[:, None], covers))
    t, there, covers = (torch.cat(parts, 1) for parts in zip(*found, strict=True))
    return t, there, covers
