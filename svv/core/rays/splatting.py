"""Pictures of Gaussian splats in plain PyTorch: what compiled kernels must match, in values and gradients.

Zwicker, Pfister, van Baar and Gross, "EWA Splatting", IEEE TVCG 2002; Kerbl et al., "3D Gaussian Splatting", ACM TOG
2023, with the constants of its program. Letters: N splats, K harmonics.
"""

from __future__ import annotations

import torch
from torch import Tensor

from svv.core.rays.encodings import spherical_harmonics

LOW_PASS = 0.3
"""Added to the variances of a splat in the picture, in square pixels."""

LEAST_ALPHA, MOST_ALPHA = 1.0 / 255.0, 0.99
"""Opacity of a splat in a pixel below which it is left out, and the largest that it has."""

LEAST_TRANSMITTANCE = 1e-4
"""A splat that would leave less of what lies behind is left out, with all behind it."""

NEAREST = 1e-3
"""Distance along the camera's axis up to which splats are left out."""


def turned(rotations: Tensor) -> Tensor:
    """Return the matrices of quaternions w, x, y, z of any length above 0. (N, 4) -> (N, 3, 3)"""
    w, x, y, z = torch.nn.functional.normalize(rotations, dim=1).unbind(1)
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(rows, dim=1).view(-1, 3, 3)


def splatted(
    splats: tuple[Tensor, Tensor, Tensor, Tensor, Tensor], camera: tuple[Tensor, Tensor, float], width: int, height: int
) -> Tensor:
    """Return the picture of splats: RGB times alpha, and alpha. (height, width, 4)

    ``splats``: centres (N, 3), standard deviations (N, 3), quaternions w, x, y, z (N, 4), opacities (N,) and harmonics
    (N, K, 3); ``camera``: the rows right, down and forward (3, 3), its position (3,), and its focal length in pixels;
    its axis goes through the middle of the picture.
    """
    centres, scales, rotations, opacities, harmonics = splats
    axes, eye, focal = camera
    seen = (centres - eye) @ axes.T
    ahead = torch.nonzero(seen[:, 2] > NEAREST)[:, 0]
    order = ahead[seen[ahead, 2].argsort(stable=True)]
    x, y, z = seen[order].unbind(1)
    none = torch.zeros_like(z)
    rows = [focal / z, none, -focal * x / z**2, none, focal / z, -focal * y / z**2]
    across = torch.stack(rows, dim=1).view(-1, 2, 3) @ axes @ (turned(rotations[order]) * scales[order, None])
    spread = across @ across.transpose(1, 2) + LOW_PASS * torch.eye(2, dtype=z.dtype)
    toward = torch.nn.functional.normalize(centres[order] - eye, dim=1)
    basis = spherical_harmonics(toward, int(harmonics.shape[1] ** 0.5))
    colours = (0.5 + (basis[:, :, None] * harmonics[order]).sum(dim=1)).clamp(min=0.0)

    columns = torch.arange(width, dtype=z.dtype) + 0.5
    lines = torch.arange(height, dtype=z.dtype)[:, None] + 0.5
    left = torch.ones(height, width, dtype=z.dtype)
    going, out = left > 0.0, torch.zeros(height, width, 3, dtype=z.dtype)
    for n in range(len(order)):
        dx = columns - (focal * x[n] / z[n] + 0.5 * width)
        dy = lines - (focal * y[n] / z[n] + 0.5 * height)
        (a, b), (_, c) = torch.linalg.inv(spread[n])
        alpha = opacities[order[n]] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
        alpha = torch.where(going & (alpha >= LEAST_ALPHA), alpha.clamp(max=MOST_ALPHA), 0.0)
        going = going & (left * (1.0 - alpha) >= LEAST_TRANSMITTANCE)
        alpha = torch.where(going, alpha, 0.0)
        out = out + (left * alpha)[..., None] * colours[n]
        left = left * (1.0 - alpha)
    return torch.cat([out, 1.0 - left[..., None]], dim=2)
