"""How far two correct orders of sums can take one training step apart.

A gradient is a sum over samples. Two orders of it differ by at most a part of the sum of the magnitudes of what is
added (:mod:`svv.core.rounding`), so that sum is measured: by the same step, in which each parameter adds up magnitudes.
What Adam makes of the difference follows from its formulas, with moments m and v, age n and rate r:

    m' = b1 m + (1 - b1) g,  v' = b2 v + (1 - b2) g^2,  p' = p - r / (1 - b1^n) m' / (sqrt(v' / (1 - b2^n)) + epsilon)
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from svv.core.rounding import ROUNDOFF, sums_apart
from svv.fields.radiance.encodings import HashGrid, SparseLattice
from svv.fields.radiance.networks import Layers, PaletteColours
from tests import ranked

U = ROUNDOFF[torch.float32]
BETAS = 0.9, 0.99
"""Adam's constants, those of all stages."""
OPERATIONS = 200
"""Products and sums that make one sample's part of a gradient, which a CPU may round in vectors other than alone: up to
a hundred forward, as many backward."""


class _Magnitudes(torch.autograd.Function):
    """A linear layer whose weights get the sum of the magnitudes of the samples' parts as their gradient."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor) -> Tensor:
        ctx.save_for_backward(x, weight)
        return x @ weight.T

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, Tensor]:
        x, weight = ctx.saved_tensors
        return upstream @ weight, upstream.abs().T @ x.abs()


def magnitudes(path: Path) -> tuple[ranked.Results, int]:
    """Take a step that was kept; returns sums of magnitudes, named as gradients, and how many numbers make a sum."""
    counts: list[int] = []
    of_colours: list[Tensor] = []
    adding = {kind: kind.add_gradient for kind in (SparseLattice, HashGrid)}
    mix = PaletteColours.diffuse

    def layers(self: Layers, x: Tensor) -> Tensor:
        counts.append(len(x))
        for layer in self:
            x = _Magnitudes.apply(x, layer.weight) if isinstance(layer, nn.Linear) else layer(x.clone())
        return x

    def add(self: Any, x: Tensor, gradient: Tensor) -> None:
        counts.append(len(x))
        adding[type(self)](self, x, gradient.abs())

    def diffuse(self: PaletteColours, colours: Tensor) -> Tensor:
        colours.register_hook(lambda gradient: of_colours.append(gradient.abs().sum(dim=0)))
        return mix(self, colours)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Layers, "forward", layers)
        for kind in adding:
            patch.setattr(kind, "add_gradient", add)
        patch.setattr(PaletteColours, "diffuse", diffuse)
        found = ranked.step_again(path)
    sums = {name: value.double() for name, value in found.items() if name.endswith(".gradient")}
    if of_colours:  # and the palette's own loss, which is what the gradient has besides, so no more than both
        sums["colours.gradient"] = 2.0 * of_colours[0].double() + sums["colours.gradient"].abs()
    return sums, max(counts) + ranked.BASE.rays + OPERATIONS  # a loss may be divided by a sum over the rays


def bounds(right: ranked.Results, sums: ranked.Results, count: int) -> ranked.Results:
    """Return how far gradients, moments and parameters may be from those of a step taken in another order.

    Args:
        right: The step (:func:`tests.ranked.step_again`).
        sums: Sums of magnitudes (:func:`magnitudes`).
        count: Numbers that make a sum.

    Returns:
        Bounds under the names of ``right``; those of parameters are infinite where a gradient is hardly more than what
        it may differ by: there Adam's step may go anywhere.
    """
    found: ranked.Results = {}
    for name in (name.removesuffix(".gradient") for name in sums):
        mean, square, age, rate = (right[f"{name}.{what}"].double() for what in ("first", "second", "age", "rate"))
        of_gradient = sums_apart(count) * sums[f"{name}.gradient"]
        most = (square / (1.0 - BETAS[1])).sqrt()  # |g| is no more, and neither is |m| before the step (Cauchy-Schwarz)
        of_mean = (1.0 - BETAS[0]) * of_gradient + 16.0 * U * most
        of_square = (1.0 - BETAS[1]) * (2.0 * most + of_gradient) * of_gradient + 16.0 * U * square
        root = square.sqrt()
        part = torch.where(square > 0.0, of_square / square, torch.inf)
        scale = rate / (1.0 - BETAS[0] ** age) * (1.0 - BETAS[1] ** age).sqrt()
        # 1 / sqrt(v) differs by no more than the part by which v does, up to a half: 1 / sqrt(1 - x) <= 1 + x.
        of_step = scale / root * (of_mean * (1.0 + part) + mean.abs() * (part + 32.0 * U))
        of_step = torch.where((age == 0.0) | ((square == 0.0) & (of_gradient == 0.0)), 0.0, of_step)
        value = of_step + 4.0 * U * right[f"{name}.value"].double().abs()
        found[f"{name}.gradient"], found[f"{name}.first"], found[f"{name}.second"] = of_gradient, of_mean, of_square
        found[f"{name}.value"] = torch.where((part <= 0.5) | (of_step == 0.0), value, torch.inf)
    return found
