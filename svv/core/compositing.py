"""Compositing along rays: the reference that the compiled kernels must match in value and gradient.

Letters: ... rays, S samples on a ray.
"""

from __future__ import annotations

import torch
from torch import Tensor


def ray_weights(sigma: Tensor, delta: Tensor) -> tuple[Tensor, Tensor]:
    """Weight of each sample on a ray, ordered front to back.

    w_i = T_i (1 - exp(-sigma_i delta_i)),  T_i = exp(-sum_{j<i} sigma_j delta_j)
    (Mildenhall et al. 2020, eq. 3; optical model of Max 1995).

    Args:
        sigma: Extinction, >= 0, in 1 / box unit. (..., S)
        delta: Sample spacing, >= 0, in box units. (..., S)

    Returns:
        Weights in [0, 1], (..., S), and the transmittance behind the last
        sample, (...,). Together they sum to 1.
    """
    depth = torch.cumsum(sigma * delta, dim=-1)
    before = torch.cat([torch.zeros_like(depth[..., :1]), depth[..., :-1]], dim=-1)
    return torch.exp(-before) * -torch.expm1(-sigma * delta), torch.exp(-depth[..., -1])
