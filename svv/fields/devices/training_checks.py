"""Checks of the kernels of training steps against plain torch, as in :mod:`svv.fields.devices.kernel_checks`.

Letters: S samples, R rays, P palette colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from torch import Tensor

from svv.core.colour import palette_shading
from svv.core.rays.compositing import composite_samples
from svv.core.rays.encodings import lattice_features, spherical_harmonics
from svv.core.rays.networks import relu_layers
from svv.core.rounding import KERNELS, NETWORKS
from svv.fields.devices.kernel_checks import (
    CPU,
    Check,
    points_in,
    random_lattice,
    random_samples,
    relative_error,
    rounded_layers,
    weights_of,
)
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import learning
from svv.kernels.types import HARMONICS, Kernels, Owned, Samples, Target

SPARE = 37
"""Rows to spare behind the samples, which hold no numbers."""

LEVELS, FEATURES, WIDTH, ALPHA = 2, 4, 32, 0.7
"""Those of the lattices, width of networks, and weight of alpha."""

PENALTIES, OWNED = (0.5, 1.0, 2.0), 0.3
"""Weights of stage 2's penalties, and of regions other than a sample's own."""


def loss_in_torch(
    out: Tensor, transmittance: Tensor, shown: Tensor, weight: Tensor, each: Tensor, alpha: bool
) -> tuple[Tensor, Tensor]:
    """Do what :meth:`svv.kernels.types.TrainingKernels.loss` does, in plain torch."""
    missing = [(out[:, :3] - shown[:, :3]).square(), out[:, 3:]]
    missing += [(1.0 - transmittance - shown[:, 3]).square()[:, None] * float(alpha)]
    errors = (weight[:, None] * torch.cat(missing, dim=1)).sum(dim=0)
    return (errors * each).sum(), errors[:3].mean()


@dataclass(frozen=True)
class Inputs:
    """Rays of random samples on random lattices, and what they should show; the last ray is one without room."""

    seed: int
    counts: tuple[int, ...]

    @cached_property
    def lattices(self) -> tuple[SparseLattice, SparseLattice]:
        """Lattices of one feature and of several."""
        one, several = (random_lattice(self.seed, features)[0] for features in (1, FEATURES))
        return one, several

    @cached_property
    def samples(self) -> Samples:
        """Samples of all rays but the last."""
        samples, occupied = random_samples(self.counts, self.seed), random_lattice(self.seed, 1)[1]
        place = points_in(occupied, len(samples), self.seed)
        return replace(samples, position=place, sigma=4.0 * samples.sigma)

    @cached_property
    def target(self) -> Target:
        """What the rays should show, with weights that are about the inverse of their number."""
        generator, rays = torch.Generator().manual_seed(self.seed), len(self.counts) + 1
        along = torch.nn.functional.normalize(torch.randn(rays, 3, generator=generator), dim=1)
        shown, weight = torch.rand(rays, 4, generator=generator), torch.rand(rays, generator=generator) / rays
        return Target(along, shown, weight)

    def on(self, device: torch.device, spare: bool) -> tuple[Samples, Target]:
        """Return samples and target on a device, as if the CPU knew their number, or with rows to spare."""
        own, target = self.samples, self.target
        parts, rays = (target.along, target.shown, target.weight), len(self.counts)
        if not spare:
            along, shown, weight = (part[:rays].to(device) for part in parts)
            return own.to(device), Target(along, shown, weight)
        along, shown, weight = (part.to(device) for part in parts)

        def behind(tensor: Tensor, value: float, count: int) -> Tensor:
            return torch.cat([tensor, torch.full((count, *tensor.shape[1:]), value, dtype=tensor.dtype)])

        position, sigma, skipped = (behind(t, torch.nan, SPARE) for t in (own.position, own.sigma, own.skipped))
        start, count, tail = behind(own.start, 1 << 40, 1), behind(own.count, -1, 1), behind(own.tail, 0.5, 1)
        ray, total = behind(own.ray, 1 << 30, SPARE), torch.tensor([len(own)])
        there = Samples(position, sigma, skipped, ray, start, count, tail, own.step, total)
        return replace(there.to(device), total=total.to(device)), Target(along, shown, weight)

    def looked_up(self, lattice: SparseLattice, table: Tensor) -> Tensor:
        """Return the features of the samples, differentiable in their table. (S, L F)"""
        where = lattice.layout
        return lattice_features(
            self.samples.position, where.shapes, where.scales, where.bases[:-1], where.index, table
        )  # fmt: skip

    def with_harmonics(self, features: Tensor, rows: Tensor) -> Tensor:
        """Return features of rows beside the harmonics of their rays. (K, L F + 16)"""
        along = spherical_harmonics(self.target.along, 4)[self.samples.ray[rows].long()]
        return torch.cat([features[rows], along], dim=1)

    def loss(self, sigma: Tensor, values: Tensor, each: Tensor, alpha: bool) -> tuple[Tensor, Tensor]:
        """Return loss and mean squared error of colour of composited values (S, C)."""
        own, target, rays = self.samples, self.target, len(self.counts)
        out, transmittance, _ = composite_samples(
            sigma, values, own.skipped, own.start, own.count, own.tail, own.step
        )  # fmt: skip
        return loss_in_torch(out, transmittance, target.shown[:rays], target.weight[:rays], each, alpha)


def base_in_torch(
    at: Inputs, weights: Sequence[Tensor], rows: Tensor, place: Tensor, rounded: bool = True
) -> list[Tensor]:
    """Return what :meth:`svv.kernels.types.TrainingKernels.base` computes, given the representatives.

    ``rounded``: whether networks multiply in half precision, as on a GPU.
    """
    layers = rounded_layers if rounded else relu_layers
    tables = [lattice.table.detach().clone().requires_grad_() for lattice in at.lattices]
    networks = [weight.clone().requires_grad_() for weight in weights]
    exponent = at.looked_up(at.lattices[0], tables[0]).sum(dim=1)
    sigma = at.samples.sigma * torch.exp(exponent - exponent.detach())  # the marcher has computed its value
    inputs = at.with_harmonics(at.looked_up(at.lattices[1], tables[1]), rows)
    colour = torch.sigmoid(layers(inputs, networks))[place]
    each = torch.tensor([1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, ALPHA])
    loss, error = at.loss(sigma, colour, each, alpha=True)
    return [error.detach(), *torch.autograd.grad(loss, [*networks, *tables])]


def palette_in_torch(
    at: Inputs, networks: Sequence[list[Tensor]], colours: Tensor, owner: Tensor | None, rounded: bool = True
) -> list[Tensor]:  # fmt: skip
    """Return what :meth:`svv.kernels.types.TrainingKernels.palette` computes; ``rounded`` as above."""
    layers = rounded_layers if rounded else relu_layers
    geometry, lattice = at.lattices[1], at.lattices[1]
    table, palette = (t.detach().clone().requires_grad_() for t in (lattice.table, colours))
    lighting, mixing = ([w.clone().requires_grad_() for w in network] for network in networks)
    features = at.looked_up(geometry, geometry.table.detach())
    light = layers(at.with_harmonics(features, torch.arange(len(features))), lighting)
    intensity, weights, offsets = palette_shading.material(layers(at.looked_up(lattice, table), mixing))
    specular, shade = palette_shading.network_light(light)
    colour = palette_shading.diffuse(intensity, weights, palette + offsets) * shade[:, None] + specular[:, None]
    penalties = [offsets.square().sum(dim=(1, 2)), (shade - 1.0).square(), 1.0 - weights.square().sum(dim=1)]
    values = torch.cat([colour, torch.stack(penalties, dim=1)], dim=1)
    each = torch.tensor([1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, *PENALTIES, 0.0])
    loss, error = at.loss(at.samples.sigma, values, each, alpha=False)
    if owner is not None:
        own = weights.gather(1, owner[:, None])[:, 0]
        loss = loss - OWNED * (own.log() / torch.bincount(owner)[owner]).sum()
    return [error.detach(), *torch.autograd.grad(loss, [*lighting, *mixing, palette, table])]


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


def _compare(mine: Sequence[Tensor], theirs: Sequence[Tensor]) -> None:
    """Networks round to half precision, and what they say goes through the rest of the step."""
    for number, (own, expected) in enumerate(zip(mine, theirs, strict=True)):
        apart, most = relative_error(own.cpu(), expected), 2 * NETWORKS[torch.float16]
        assert apart <= most, f"result {number} of {len(theirs)} is off by {apart:.1e}"


def cleared(lattice: SparseLattice, device: torch.device) -> SparseLattice:
    """Return a lattice on a device, without a gradient."""
    lattice.to(device).gradient = None
    return lattice


def check_base(kernels: Kernels, device: torch.device, seed: int, counts: Sequence[int]) -> None:
    """Compare a step of stage 1 whose samples the CPU has counted, and one with rows to spare."""
    assert kernels.TRAINING is not None
    at, every = Inputs(seed, tuple(counts)), 1.0 / 16.0
    weights = weights_of((LEVELS * FEATURES + HARMONICS, WIDTH, 2, 3), seed)
    shift = torch.rand(len(counts) + 1, generator=torch.Generator().manual_seed(seed))
    rows, place = (t.cpu() for t in kernels.representatives(at.samples.to(device), every, shift[:-1].to(device)))
    expected = base_in_torch(at, weights, rows, place, kernels.TRAINING.SPARE)
    there = [w.to(device) for w in weights]
    for spare in (False, True) if kernels.TRAINING.SPARE else (False,):
        samples, target = at.on(device, spare)
        density, features = (cleared(lattice, device) for lattice in at.lattices)
        shifts = shift.to(device)[: len(samples.count)]
        error, gradients, colours = kernels.TRAINING.base(
            samples, target, (learning(density), learning(features)), there, every, shifts, ALPHA, not spare
        )  # fmt: skip
        assert colours == len(rows) or (spare and colours > len(rows)), "other colours are computed"
        tables = [lattice.buffers_for_gradient()[0] for lattice in (density, features)]
        _compare([error, *gradients, *tables], expected)
        for lattice in at.lattices:
            lattice.to(CPU)


def check_palette(
    kernels: Kernels, device: torch.device, seed: int, counts: Sequence[int], colours: int, outputs: int
) -> None:
    """Compare a step of stage 2 likewise, with and without regions that own the samples."""
    assert kernels.TRAINING is not None
    at, generator = Inputs(seed, tuple(counts)), torch.Generator().manual_seed(seed)
    lighting = weights_of((LEVELS * FEATURES + HARMONICS, WIDTH, 2, outputs), seed)
    mixing = weights_of((LEVELS * FEATURES, WIDTH, 1, 1 + 4 * colours), seed + 1)
    palette = torch.rand(colours, 3, generator=generator)
    owner = torch.randint(colours, (len(at.samples),), generator=generator)
    for spare, owns in ((False, True), (False, False), (True, True), (True, False)):
        if spare and not kernels.TRAINING.SPARE:
            continue
        samples, target = at.on(device, spare)
        expected = palette_in_torch(at, (lighting, mixing), palette, owner if owns else None, kernels.TRAINING.SPARE)
        lattice = cleared(at.lattices[1], device)
        of_all = torch.full((len(samples),), 1 << 40)
        of_all[: len(owner)] = owner
        of_all, owned = of_all.to(device), None
        if owns:
            owned = Owned(of_all, kernels.TRAINING.owned_by(samples, of_all, colours), OWNED)
        error, gradients = kernels.TRAINING.palette(
            samples, target, (lattice.layout, lattice.table.detach()), learning(lattice),
            ([w.to(device) for w in lighting], [w.to(device) for w in mixing]), palette.to(device), PENALTIES,
            owned,
        )  # fmt: skip
        _compare([error, *gradients, lattice.buffers_for_gradient()[0]], expected)
        lattice.to(CPU)


def training_checks(samples: int) -> dict[str, Check]:
    """Return these checks by name, with so many samples each."""
    counts = [k % 9 for k in range(max(8, samples // 4))]
    found: dict[str, Check] = {"step of stage 1": partial(check_base, counts=counts)}
    for colours, outputs in ((2, 2), (5, 1)):
        name = f"step of stage 2, {colours} colours, {outputs} of light"
        found[name] = partial(check_palette, counts=counts, colours=colours, outputs=outputs)
    found["loss with alpha"] = partial(check_loss, rays=samples, channels=3, alpha=True)
    found["loss with penalties"] = partial(check_loss, rays=samples, channels=6, alpha=False)
    return found
