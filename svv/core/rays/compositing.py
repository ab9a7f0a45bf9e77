"""Compositing along rays: the reference that the compiled kernels must match in value and gradient.

Letters: R rays, S samples, C channels.
"""

from __future__ import annotations

import torch
from torch import Tensor

LEAST_ALPHA = 1.0 / 512.0
"""Half an 8-bit step: a pixel whose alpha does not exceed it counts as empty."""


def composite_samples(
    sigma: Tensor, values: Tensor, skipped: Tensor, start: Tensor, count: Tensor, tail: Tensor, step: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Return sums of weight times value (R, C), transmittance (R,) and weights (S,) of rays whose samples lie in a row.

    w_i = T_i (1 - exp(-sigma_i step)), T_i = exp(-sum_{j<i} sigma_j step - sum_{j<=i} skipped_j)

    (Mildenhall et al. 2020, eq. 3; optical model of Max 1995.) ``sigma`` >= 0: extinction in 1 / box unit (S,);
    ``values`` (S, C); ``skipped`` (S,): optical depth before each sample; ``start`` and ``count`` (R,) int64: first
    sample and number of samples of each ray; ``tail`` (R,): optical depth behind the last; ``step``: sample spacing in
    box units.
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
