"""Compositing along rays: the reference that the compiled kernels must match in value and gradient.

Letters: ... rays, S samples per ray.
"""

from __future__ import annotations

import torch
from torch import Tensor

LEAST_ALPHA = 1.0 / 512.0
"""Half an 8-bit step: a pixel whose alpha does not exceed it counts as empty."""


def ray_weights(sigma: Tensor, delta: Tensor) -> tuple[Tensor, Tensor]:
    """Return the weights in [0, 1] of samples front to back (..., S), and the transmittance behind them (...,).

    w_i = T_i (1 - exp(-sigma_i delta_i)), T_i = exp(-sum_{j<i} sigma_j delta_j)

    (Mildenhall et al. 2020, eq. 3; optical model of Max 1995.) ``sigma``: extinction >= 0 in 1 / box unit; ``delta``:
    sample spacing >= 0 in box units. (..., S)
    """
    behind = torch.cumsum(sigma * delta, dim=-1)  # optical depth behind each sample (..., S)
    before = torch.cat([torch.zeros_like(behind[..., :1]), behind[..., :-1]], dim=-1)
    return torch.exp(-before) * -torch.expm1(-sigma * delta), torch.exp(-behind[..., -1])


def composite_samples(
    sigma: Tensor, values: Tensor, skipped: Tensor, start: Tensor, count: Tensor, tail: Tensor, step: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Return sums of weight times value (R, C), transmittance (R,) and weights (S,) of rays whose samples lie in a row.

    Works as :func:`ray_weights`. ``sigma`` >= 0 in 1 / box unit (S,); ``values`` (S, C); ``skipped`` (S,): optical
    depth before each sample; ``start`` and ``count`` (R,) int64: first sample and number of samples of each ray;
    ``tail`` (R,): optical depth behind the last; ``step``: sample spacing in box units.
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
