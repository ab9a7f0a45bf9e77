"""The check of recorded training steps: replayed with other numbers, they must do what other steps do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from svv.core.geometry.box import Box
from svv.core.rounding import NETWORKS
from svv.fields.devices.kernel_checks import EXTENT, MARCHES, random_lattice, rays_through, relative_error, weights_of
from svv.fields.radiance.encodings import LatticeAdam
from svv.fields.radiance.networks import learning
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.kernels.recorded import RecordedSteps, StepNumbers
from svv.kernels.types import HARMONICS, Kernels, Room, Target

RAYS, STEPS = (256, 192), 12
"""Rays of steps, which change half-way, and number of steps."""
ROOM = 64
"""Room for samples of each ray."""
RATES = 0.02, 0.01, 3e-8
"""Learning rates of density and features, and what pulls on the density, at first."""
LEVELS, FEATURES, WIDTH = 2, 4, 32


@dataclass(frozen=True)
class Ended:
    """What some steps lead to."""

    errors: list[float]
    """Mean squared error of each step."""
    tables: list[Tensor]
    """Tables of density and features."""


def take_steps(
    kernels: Kernels, device: torch.device, seed: int, recorded: RecordedSteps, counts: Sequence[int]
) -> Ended:
    """Take steps of stage 1, one of each number of rays, on random lattices, with other numbers each time."""
    assert kernels.TRAINING is not None
    base, numbers, how = kernels.TRAINING.base, StepNumbers(device), MARCHES["training"][0]
    (density, occupied), (features, _) = (random_lattice(seed, count) for count in (1, FEATURES))
    density, features = density.to(device), features.to(device)
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, EXTENT), 4, occupied)
    marching = Marching(how.step, how.least_weight, how.keep, how.stop, how.fade, how.merge)
    weights = [w.to(device) for w in weights_of((LEVELS * FEATURES + HARMONICS, WIDTH, 2, 3), seed)]
    generator, rays = torch.Generator().manual_seed(seed), max(counts)
    origins, directions = (a.to(device) for a in rays_through(rays, seed))
    shown, weight = (torch.rand(rays, *n, generator=generator).to(device) for n in ((4,), ()))
    tables, dropped = LatticeAdam([density, features]), torch.zeros(1, dtype=torch.int64, device=device)
    errors = []
    for number, count in enumerate(counts):
        own = Rays(origins[:count], directions[:count])
        target = Target(own.directions, shown[:count], weight[:count] / count)
        fall = 1.0 - number / len(counts)
        numbers.set(number, number, [rate * fall for rate in RATES], slice(0, count), True)

        def step(own: Rays = own, target: Target = target) -> Tensor:
            samples = march(own, occupancy, density, marching, numbers.march, 0, Room(ROOM * len(own), dropped))
            of = learning(density), learning(features)
            error, _, _ = base(samples, target, of, weights, 1.0 / 16.0, numbers.shift, 1.0, False)
            tables.step([numbers.other(0), numbers.other(1)], [numbers.other(2), 0.0])
            return error

        errors.append(float(recorded.take(count, step)))
    return Ended(errors, [lattice.table.detach().cpu() for lattice in (density, features)])


def check_recorded(
    kernels: Kernels, device: torch.device, seed: int, recorded: RecordedSteps | None = None,
    rays: Sequence[int] = RAYS, steps: int = STEPS,
) -> None:  # fmt: skip
    """Compare recorded steps with the same steps as they are; on a CPU, nothing is recorded unless that is given."""
    recorded = RecordedSteps(device.type == "cuda") if recorded is None else recorded
    counts = [rays[k * len(rays) // steps] for k in range(steps)]
    plain, mine = (take_steps(kernels, device, seed, own, counts) for own in (RecordedSteps(False), recorded))
    assert not recorded.notes, recorded.notes[0]
    most = 2 * NETWORKS[torch.float16]  # sums are in another order each time, and networks round them
    apart = np.abs(np.array(mine.errors) - plain.errors) / np.array(plain.errors)
    assert apart.max() <= most, f"step {apart.argmax()} of {steps} is off by {apart.max():.1e}"
    for name, theirs, own in zip(("density", "features"), plain.tables, mine.tables, strict=True):
        off = relative_error(own, theirs)
        assert off <= most, f"the {name} are off by {off:.1e}"
