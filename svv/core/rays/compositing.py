"""Compositing along rays: the reference that the compiled kernels must match in value and gradient.

Letters: ... rays, S samples per ray.
"""

from __future__ import annotations

import torch
from torch import Tensor

LEAST_ALPHA = 1.0 / 512.0
"""Half an 8-bit step: a pixel whose alpha does not exceed it counts as empty."""


def ray_weights(sigma: Tensor, delta: Tensor) -> tuple[Tensor, Tensor]:
    """Return the weight of each sample on a ray, ordered front to back.

    w_i = T_i (1 - exp(-sigma_i delta_i)),  T_i = exp(-sum_{j<i} sigma_j delta_j)
    (Mildenhall et al. 2020, eq. 3; optical model of Max 1995).

    Args:
        sigma: Extinction, >= 0, in 1 / box unit. (..., S)
        delta: Sample spacing, >= 0, in box units. (..., S)

    Returns:
        Weights in [0, 1], (..., S), and the transmittance behind the last sample, (...,). Together they sum to 1.
    """
    behind = torch.cumsum(sigma * delta, dim=-1)  # optical depth behind each sample (..., S)
    before = torch.cat([torch.zeros_like(behind[..., :1]), behind[..., :-1]], dim=-1)
    return torch.exp(-before) * -torch.expm1(-sigma * delta), torch.exp(-behind[..., -1])


def composite_samples(
    sigma: Tensor, values: Tensor, skipped: Tensor, start: Tensor, count: Tensor, tail: Tensor, step: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Composite values along R rays whose S samples are stored one after another.

    Works as :func:`ray_weights`, with an optical depth ``skipped`` before each sample and ``tail`` behind the last.

    Args:
        sigma: Extinction, >= 0, in 1 / box unit. (S,)
        values: Values to composite. (S, C)
        skipped: Optical depth before each sample that contributes no value. (S,)
        start: Index of the first sample of each ray, int64. (R,)
        count: Number of samples of each ray, int64. (R,)
        tail: Optical depth behind the last sample of each ray. (R,)
        step: Sample spacing in box units.

    Returns:
        Sum of weight times value (R, C), transmittance behind the rays (R,), and weights (S,).
    """
    k = torch.arange(int(count.max()) if len(count) else 0, device=sigma.device)
    there = k < count[:, None]  # (R, longest ray)
    sample = (start[:, None] + k)[there]
    own, before = (torch.zeros(there.shape, device=sigma.device) for _ in range(2))
    own = own.masked_scatter(there, sigma[sample] * step)
    before = before.masked_scatter(there, skipped[sample])
    behind = torch.cumsum(own + before, dim=1)  # optical depth behind each sample (R, longest ray)
    w = (torch.exp(own - behind) * -torch.expm1(-own))[there]
    ray = torch.arange(len(count), device=sigma.device)[:, None].expand(there.shape)[there]
    out = values.new_zeros(len(count), values.shape[1]).index_add(0, ray, w[:, None] * values[sample])
    transmittance = torch.exp(-(own + before).sum(dim=1) - tail)
    return out, transmittance, torch.zeros_like(sigma).index_put((sample,), w)
