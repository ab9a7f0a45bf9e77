"""Checks of the kernels of training steps against plain torch, as in :mod:`svv.fields.radiance.kernel_checks`.

Letters: S samples, R rays, P palette colours.
"""

from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from svv.core.colour import palette_shading
from svv.core.rounding import KERNELS
from svv.fields.radiance.kernel_checks import CPU, Check
from svv.kernels.types import Kernels


def mixed_in_torch(raw: Tensor, light: Tensor, colours: Tensor, settled: bool) -> tuple[Tensor, Tensor]:
    """Do what :meth:`svv.kernels.types.TrainingKernels.mixed` does, in plain torch."""
    intensity, weights, offsets = palette_shading.material(raw)
    specular, shade = palette_shading.network_light(light)
    colour = palette_shading.diffuse(intensity, weights, colours + offsets) * shade[:, None] + specular[:, None]
    blend = torch.zeros_like(shade) if settled else 1.0 - weights.square().sum(dim=1)
    penalties = torch.stack([offsets.square().sum(dim=(1, 2)), (shade - 1.0).square(), blend], dim=1)
    return torch.cat([colour, penalties], dim=1), weights


def loss_in_torch(
    out: Tensor, transmittance: Tensor, shown: Tensor, weight: Tensor, each: Tensor, alpha: bool
) -> tuple[Tensor, Tensor]:
    """Do what :meth:`svv.kernels.types.TrainingKernels.loss` does, in plain torch."""
    missing = [(out[:, :3] - shown[:, :3]).square(), out[:, 3:]]
    missing += [(1.0 - transmittance - shown[:, 3]).square()[:, None] * float(alpha)]
    errors = (weight[:, None] * torch.cat(missing, dim=1)).sum(dim=0)
    return (errors * each).sum(), errors[:3].mean()


def check_mixed(kernels: Kernels, device: torch.device, seed: int, colours: int, outputs: int, count: int) -> None:
    """Compare equation 4 with its penalties in value and in all gradients."""
    assert kernels.TRAINING is not None
    generator = torch.Generator().manual_seed(seed)
    shapes = (count, 1 + 4 * colours), (count, outputs), (colours, 3), (count, 6), (count, colours)
    raw, light, palette, g, h = (torch.randn(shape, generator=generator) for shape in shapes)
    for settled in (False, True):
        ends = []
        for run, where in ((mixed_in_torch, CPU), (kernels.TRAINING.mixed, device)):
            leaves = [(2.0 * t).to(where).requires_grad_() for t in (raw, light, palette)]
            values, weights = run(leaves[0], leaves[1], leaves[2], settled)
            upstream = (values * g.to(where)).sum() + (weights * h.to(where)).sum()
            ends.append([t.detach().cpu() for t in (values, weights, *torch.autograd.grad(upstream, leaves))])
        for theirs, mine in zip(*ends, strict=True):
            # The palette's gradient is a sum over all samples.
            size = float(theirs.abs().max().clamp(min=1.0))
            torch.testing.assert_close(mine, theirs, atol=10 * KERNELS["value"] * size, rtol=1e-4)


def check_loss(kernels: Kernels, device: torch.device, seed: int, rays: int, channels: int, alpha: bool) -> None:
    """Compare a loss in value and gradient."""
    assert kernels.TRAINING is not None
    generator = torch.Generator().manual_seed(seed)
    shapes = (rays, channels), (rays,), (rays, 4), (rays,), (channels + 1,)
    values = [torch.rand(shape, generator=generator) for shape in shapes]
    values[3] /= rays
    if not alpha:
        values[4] = values[4][:-1]
    ends = []
    for run, where in ((loss_in_torch, CPU), (kernels.TRAINING.loss, device)):
        out, transmittance, shown, weight, each = (v.to(where) for v in values)
        if run is loss_in_torch and not alpha:
            each = torch.cat([each, each.new_zeros(1)])
        leaves = out.requires_grad_(), transmittance.requires_grad_()
        loss, error = run(*leaves, shown, weight, each, alpha)
        gradients = torch.autograd.grad(3.0 * loss, leaves if alpha else leaves[:1])
        ends.append([loss.detach().cpu(), error.detach().cpu(), *(rays * g.cpu() for g in gradients)])
    for theirs, mine in zip(*ends, strict=True):
        torch.testing.assert_close(mine, theirs, atol=10 * KERNELS["value"], rtol=1e-4)


def training_checks(samples: int) -> dict[str, Check]:
    """Return these checks by name, with so many samples each."""
    found: dict[str, Check] = {}
    for colours, outputs in ((2, 2), (5, 1)):
        name = f"mixed, {colours} colours, {outputs} of light"
        found[name] = partial(check_mixed, colours=colours, outputs=outputs, count=samples)
    found["loss with alpha"] = partial(check_loss, rays=samples, channels=3, alpha=True)
    found["loss with penalties"] = partial(check_loss, rays=samples, channels=6, alpha=False)
    return found
