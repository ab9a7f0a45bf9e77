"""Stage 1: the base radiance field from the views (StyleRF-VolVis, section 3.1)."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.rays.extinction import LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.fields.radiance.encodings import LatticeAdam, SparseLattice
from svv.fields.radiance.networks import BaseField, FieldSettings, encode_directions, learning
from svv.fields.radiance.occupancy import FAINTEST, Occupancy, least_extinction, pruned_extinction
from svv.fields.radiance.rendering import Extinction, Marching, composite, march, not_hidden, representatives
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU, kernels_for
from svv.kernels.recorded import StepNumbers
from svv.kernels.types import Room, Samples, TrainingKernels
from svv.measure import trim_memory
from svv.train.base.first_colours import start_colours
from svv.train.base.first_extinction import (
    FAINT_PRUNE_LEAST,
    Beginning,
    known_volume,
    largest_extinction,
    log_extinction,
)
from svv.train.base.left_out import prune_unseen
from svv.train.base.tomography import mostly_opaque
from svv.train.run import ranks
from svv.train.run.batches import Batch, RayBudget, RayPool
from svv.train.run.config import ReconstructSettings
from svv.train.run.gradients import sum_gradients
from svv.train.run.loop import Loop, Running, falling, groups_of, growing, network_adam, recorded_steps
from svv.train.run.sample_room import SampleRoom

LEAST_GAIN = 0.1
"""Gain in dB over the last tenth at full learning rates from which a longer schedule is said to be worthwhile."""

REFINE_AT = 0.5
"""Fraction of the schedule after which the step and the density lattice become twice as fine."""

DENSITY_PULL = 3e-8
"""Loss weight of half the squared values in the density lattice's finer levels; it decays with the learning rates.
Where the views say little, as in a faint shell, the coarse level then prevails over noise."""

COLOUR_EVERY = 1.0 / 16.0
"""Fraction of a pixel's weight that shares one colour lookup; the density learns from all samples."""

TRANSLUCENT_DENSITY_RATE = 0.08
"""Learning rate of a density that was initialized by a tomography of translucent views, which is less exact."""

OPAQUE_DENSITY_RATE = 0.15
"""The same of views whose visible pixels are mostly opaque, which do not tell what lies behind them."""

ALPHA_WEIGHT = 1.0
"""Weight of the squared error of alpha, relative to that of colour."""

KEPT = 0.5
"""Part of the extinction below which cells of a known volume are empty at first that they may fall to by training."""

INITIAL_EXPONENT = 2.0
"""Initial log-extinction: a fog in which every sample is visible."""

DENSITY_COST = 0.25
"""Cost of a sample that only the density learns from, relative to a sample with a colour."""


class Reconstruction:
    """Trains a base field step by step from views, starting from an extinction if one is known."""

    def __init__(
        self,
        views: ViewSet,
        beginning: Beginning,
        field: FieldSettings,
        settings: ReconstructSettings,
        seed: int = 0,
        device: torch.device = CPU,
    ) -> None:
        torch.manual_seed(seed)
        self.views = views
        self.settings, self.field_settings, self.device = settings, field, device
        known = beginning.density
        self.known = known is not None
        self.told = self.known and not beginning.measured
        """Whether the volume told the extinction."""
        self.density_rate = settings.density_rate
        self.prune_least = settings.prune_least
        if self.told:
            self.density_rate = settings.known_density_rate
        elif self.known and mostly_opaque(views):
            self.density_rate = OPAQUE_DENSITY_RATE
        elif self.known:
            self.density_rate, self.prune_least = TRANSLUCENT_DENSITY_RATE, FAINT_PRUNE_LEAST
        self.refined: Occupancy | None = None
        self.occupancy = occupancy = beginning.occupancy
        levels = None if known is None else known.resolutions
        self.field = BaseField(field, occupancy, levels)  # created on the CPU: the same numbers on every device
        if known is not None:
            assert self.field.density is not None
            with torch.no_grad():
                self.field.density.table.copy_(known.table)
        self.field.encoding.randomize(0.01, torch.Generator().manual_seed(seed))
        self.iterations = settings.iterations
        """Number of steps."""
        volume = known_volume(views, settings, field)
        if known is not None and volume is not None and beginning.values is None:
            if start_colours(self.field, occupancy, volume, views.meta.shading, seed, settings.iterations):
                self.iterations = max(1, round(settings.known_part * settings.iterations))
        self.field.to(device)
        density = self.field.density
        if density is not None and known is None:
            with torch.no_grad():
                density.table[density.rows_of_level(0)] = INITIAL_EXPONENT
        finest = field.resolutions[-1] if density is not None else 512
        if density is not None and settings.refine_known:
            finest = min(finest, density.resolutions[-1])  # finer steps would see the same cells of the density again
        self.marching = Marching(1.0 / finest, keep=settings.keep)
        self.pool = RayPool(views, occupancy.box, seed, device, field.headlight)
        self.budget = RayBudget(settings.rays, settings.samples)
        self.drawn = self.budget.rays
        """Rays of the step, of all ranks."""
        ranks.alike(self.field)
        self.trained = [p for n, p in self.field.named_parameters() if not n.endswith("table")]
        own = [n for n in (self.field.density_mlp, self.field.colour_mlp) if n is not None]
        self.networks = network_adam(groups_of(own, settings.network_rate, settings.muon))
        self.tables = LatticeAdam(self.field.encodings)
        self.room, self.recorded, self.numbers = SampleRoom(device), recorded_steps(device), StepNumbers(device)

    def step(self, number: int, fraction: float) -> Tensor:
        """Take one step of the optimisers; returns the mean squared error of colour."""
        s = self.settings
        if fraction >= REFINE_AT and self.refined is None and self.field.density is not None:
            self.refine()
        self.drawn = self.budget.part(growing(fraction, s.doublings, s.hold))
        rays, kernels = ranks.part(self.drawn), self._kernels()
        count, rates = rays.stop - rays.start, self._rates(falling(fraction, s.decay, s.hold))
        there = kernels is not None and kernels.SPARE
        room = self.room.of(number, count) if there else None
        self.numbers.set(number, self.pool.seed_of(number), rates, rays, there)
        if room is None:
            error = self._take(number, rays, kernels, None)
        else:
            error = self.recorded.take((count, room.samples), lambda: self._take(number, rays, kernels, room))
        if (number + 1) % s.prune_every == 0 and number >= 2 * s.prune_every:
            self.prune(grow=fraction < 0.25 and not self.known)
        return error

    def _take(self, number: int, rays: slice, kernels: TrainingKernels | None, room: Room | None) -> Tensor:
        """Take a step; with room for its samples, all that differs from step to step is read from the numbers."""
        numbers = self.numbers
        batch = self.pool.batch(number, self.drawn, rays, self.settings.by_contrast, numbers.pixels)
        marched = march(
            batch.rays, self.occupancy, self.field.density, self.marching, numbers.march, batch.first, room
        )  # fmt: skip
        self.networks.zero_grad(set_to_none=True)
        if kernels is not None and len(marched):
            error, cost = self._learn(kernels, marched, batch, counted=room is None)
        else:
            error, cost = self._learn_in_torch(marched, batch)
        if room is None:
            self.room.counted(len(marched), len(batch.rays))
            self.budget.adjust(number, cost, self.drawn)
        error = sum_gradients(error, self.trained, self.field.encodings)
        self._update()
        return error

    def _kernels(self) -> TrainingKernels | None:
        """Return the kernels that take a whole step, if there are any for this field."""
        density, encoding = self.field.density, self.field.encoding
        if density is None or self.field.facing or not encoding.table.requires_grad:
            return None
        kernels = kernels_for(density.table).TRAINING
        return kernels if kernels is not None and kernels.fits(self.field.colour_mlp.weights) else None

    def _learn(self, kernels: TrainingKernels, samples: Samples, batch: Batch, counted: bool) -> tuple[Tensor, float]:
        """Compute all gradients at once; returns as :meth:`_learn_in_torch`. The cost is true only if ``counted``."""
        density, encoding = self.field.density, self.field.encoding
        assert density is not None and isinstance(encoding, SparseLattice)
        weights, shift = self.field.colour_mlp.weights, self.numbers.shift
        target, tables = batch.target, (learning(density), learning(encoding))
        error, gradients, colours = kernels.base(
            samples, target, tables, weights, COLOUR_EVERY, shift, ALPHA_WEIGHT, counted
        )  # fmt: skip
        for weight, gradient in zip(weights, gradients, strict=True):
            weight.grad = gradient
        return error, colours + DENSITY_COST * len(samples)

    def _learn_in_torch(self, samples: Samples, batch: Batch) -> tuple[Tensor, float]:
        """Compute all gradients; returns the mean squared error of colour, and the cost of the samples in colours."""
        samples, sigma, colour, cost = self._look(samples, batch)
        out, transmittance, _ = composite(samples, sigma, colour)
        each = [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, ALPHA_WEIGHT]
        loss, error = batch.loss(out, transmittance, each, alpha=True)
        loss.backward()
        return error, cost

    def _look(self, samples: Samples, batch: Batch) -> tuple[Samples, Tensor, Tensor, float]:
        """Return the samples that can be seen, their extinction (S,) and colour (S, 3), and the cost in colours.

        A density with a lattice learns from all samples, colours from representative ones: fog has dozens along a ray.
        """
        rays = batch.rays
        if self.field.density is None or not len(samples):
            cost, (sigma, geometry) = float(len(samples)), self.field.geometry(samples)
            samples, seen = not_hidden(samples, sigma, self.marching)
            colour = self.field(geometry[seen], encode_directions(rays.lit_along, samples.ray))
            return samples, sigma[seen], colour, cost
        rows, place = representatives(samples, COLOUR_EVERY, self.numbers.shift)
        sigma = Extinction.apply(samples, self.field.density.table, self.field.density)
        geometry = self.field.encoding(samples.position[rows])
        colour = self.field(geometry, encode_directions(rays.lit_along, samples.ray[rows]))
        cost = len(rows) + DENSITY_COST * len(samples)
        return samples, sigma, colour.index_select(0, place), cost

    def _rates(self, rate: float) -> list[float]:
        """Return the learning rates of networks, density and features, and the weight that pulls on the density."""
        s = self.settings
        return [s.network_rate * rate, self.density_rate * rate, s.feature_rate * rate, DENSITY_PULL * rate]

    def _update(self) -> None:
        """Take a step of the optimisers at these rates."""
        network, density, features, pull = (self.numbers.other(k) for k in range(4))
        for group in self.networks.param_groups:
            group["lr"] = network
        self.networks.step()
        if self.field.density is None:
            self.tables.step([features])
        else:
            self.tables.step([density, features], [pull, 0.0])

    def refine(self) -> None:
        """Halve the step and add a density level twice as fine, of zeros, in the cells that pruning left.

        A density that starts from a known extinction has its finest level from the beginning, unless ``refine_known``.
        """
        density, encoding = self.field.density, self.field.encoding
        assert density is not None and isinstance(encoding, SparseLattice)
        where = self.occupancy.occupied, self.occupancy.cells
        self.tables.forget()  # before there are new tables beside theirs
        finer = () if self.known and not self.settings.refine_known else (2 * density.resolutions[-1],)
        self.field.density = density.restricted(*where, finer=finer)
        self.field.encoding = encoding.restricted(*where)
        del density, encoding
        self.tables.restart(self.field.encodings)
        self.marching = replace(self.marching, step=0.5 * self.marching.step)
        self.refined = self.occupancy
        self._forget()

    def _forget(self) -> None:
        """Forget what depends on the occupied cells and the lattices."""
        self.room.forget()
        self.recorded.forget()
        trim_memory()  # the holes that smaller tables leave among the others

    def prune(self, grow: bool) -> None:
        """Remove the cells in which nothing is visible any more."""
        exponent = partial(log_extinction, self.field)
        largest = largest_extinction(exponent, self.occupancy, self.device, shared=True, lattice=self.field.density)
        least = KEPT * FAINTEST if self.told else pruned_extinction(self.prune_least, self.marching.step)
        left = prune_unseen(self.views, self.occupancy, largest, least_extinction(least, float(largest.max())), grow)
        if left.occupied.any():
            self.occupancy.forget_distances()
            self.occupancy = left
            self._forget()

    def layout(self) -> dict[str, NDArray[np.generic]]:
        """Return what a checkpoint needs, besides the parameters, to restore their layout."""
        refined = np.zeros(0, np.uint8) if self.refined is None else self.refined.occupied
        return {"occupied": self.occupancy.occupied, "refined": refined, "rays": np.array(self.budget.rays)}

    def go_on_from(self, layout: dict[str, NDArray[np.generic]] | None) -> None:
        """Restore the layout of an interrupted run, if there is one."""
        if layout is None:
            return
        if layout["refined"].size:
            self.occupancy = replace(self.occupancy, occupied=layout["refined"].astype(np.uint8, copy=False))
            self.refine()
        self.occupancy = replace(self.occupancy, occupied=layout["occupied"].astype(np.uint8, copy=False))
        self.budget.rays = int(layout["rays"])

    def finish(self) -> tuple[BaseField, Occupancy]:
        """Return the trained field, frozen, with features only in cells that are left, and the occupancy."""
        self.tables.forget()
        if self.field.density is not None and isinstance(self.field.encoding, SparseLattice):
            where = self.occupancy.occupied, self.occupancy.cells
            self.field.density = self.field.density.summed(*where)
            with torch.no_grad():  # values beyond these look the same, but would cost precision in the scene file
                self.field.density.table.clamp_(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)
            self.field.encoding = self.field.encoding.restricted(*where)
        self.field.requires_grad_(False)
        return self.field, self.occupancy


def reconstruct(
    views: ViewSet,
    field: FieldSettings,
    settings: ReconstructSettings,
    beginning: Beginning,
    running: Running,
    device: torch.device = CPU,
    kind: type[Reconstruction] = Reconstruction,
) -> tuple[BaseField, Occupancy, Marching, float, str]:
    """Train the base field, frozen in the end; ``kind`` is what takes the steps.

    Returns the field, the pruned occupancy, the sampling of rays, the seconds spent, and why training stopped.
    """
    begin = time.monotonic()
    work, checkpoint = kind(views, beginning, field, settings, running.seed, device), running.saved
    trim_memory()  # what the first colours have freed
    loop = Loop(work.iterations, running.limit, running.progress, "base NeRF", network=work.field, notes=running.notes)
    if checkpoint is not None:
        work.go_on_from(checkpoint.extra("base"))
        state = checkpoint.stage("base", work.field, work.networks, work.tables)
        if state.restored is not None:
            loop.done, loop.spent = state.restored
        loop.save = lambda done, spent: state.save(done, spent, work.layout())
    ready = time.monotonic()
    if running.limit is not None:
        loop.limit = max(0.1, running.limit - (ready - begin))
    seconds = loop.run(work.step)
    done = time.monotonic()
    running.notes.extend([*work.room.notes(), *work.recorded.notes])
    if loop.done:
        work.prune(grow=False)
    base, pruned = work.finish()
    trim_memory()
    seconds += ready - begin + time.monotonic() - done
    return base, pruned, Marching(work.marching.step), seconds, _why_there(loop, running.limit, settings)


def _why_there(loop: Loop, limit: float | None, settings: ReconstructSettings) -> str:
    """Return why the training stopped, and whether a longer one would help: few pixels of a step were used before."""
    whole = loop.done >= loop.iterations
    where = "as in the preset" if whole else f"at its limit of {limit:.0f} s"
    text = f"stage 1 stopped after {loop.done} steps, {where}"
    at, until = ("", 1.0) if settings.decay > 0.0 else (" at full rates", min(settings.hold, 1.0))
    gain = loop.last_gain(until)
    if gain is None:
        return text
    more = "a longer schedule would add to that" if gain >= LEAST_GAIN else "a longer schedule would add little"
    return f"{text}; the last tenth of them{at} gained {gain:.2f} dB: {more}"
