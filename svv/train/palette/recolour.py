"""Stage 2: the palette colour network (StyleRF-VolVis, section PCN)."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour.palette import Palette, PaletteSettings, extract_palette
from svv.core.volumes.classified import ValueGrid
from svv.fields.radiance.encodings import LatticeAdam, SparseLattice
from svv.fields.radiance.networks import BaseField, PaletteField, encode_directions, learning
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.of_values import colours_of
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Marching, Rays, composite, march, not_hidden
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU, kernels_for
from svv.kernels.recorded import StepNumbers
from svv.kernels.types import Owned, Room, Samples, TrainingKernels
from svv.train.base.from_values import palette_given, sample_transfer_function
from svv.train.palette.ranges import Labelled, shares_of
from svv.train.palette.unmix import Unmixing
from svv.train.run import ranks
from svv.train.run.batches import Batch, RayBudget, RayPool
from svv.train.run.config import RecolourSettings
from svv.train.run.gradients import sum_gradients
from svv.train.run.loop import Loop, Running, falling, groups_of, growing, network_adam, recorded_steps
from svv.train.run.network_adam import Group
from svv.train.run.sample_room import SampleRoom

SETTLED_AT, SETTLED_IN = 4096, 100
"""Points of a step towards regions that a trained network is told, and the number of these steps."""

PALETTE_PIXELS = 400_000
"""Maximum number of visible pixels from which the palette is extracted."""

PALETTE_WEIGHT = 0.001
"""Weight of the palette's squared distance to its initial colours."""

PHONG_SHADE_WEIGHT = 0.0003
"""Weight of (m - 1)^2 for an explicit light, which is less expressive and so needs more freedom."""

PHONG_RATE = 0.03
"""Learning rate of an explicit light's coefficients."""

NORMAL_RATE = 0.1
"""Learning rate of normals that start from the extinction's, in that of features: with 1, a step changes them by a
third, and a fifth of them turn over, which shows as creases."""

OWNER_WEIGHT = 0.1
"""Weight of -ln w of a sample's own range, averaged over the samples of each range and over the ranges. Without
a volume, for a palette made by hand or of more than three colours: weight of the cross entropy of their shares in
a pixel, averaged over the colours."""

PENALTIES = 3
"""Weights among a step's numbers: of offsets, of the shade's deviation from 1, and of mixed palette weights."""

FUNCTION_WEIGHT = 0.1
"""Weight of the mean squared difference of a value's colour to the transfer function's."""


@dataclass
class Recolouring:
    """Trains a palette colour network on a frozen base field."""

    base: BaseField
    """Frozen base field."""
    field: PaletteField
    """Palette colour network to train."""
    occupancy: Occupancy
    """Occupancy of the scene."""
    marching: Marching
    """Sampling of the rays."""
    pool: RayPool
    """Training rays."""
    settings: RecolourSettings
    """Settings of stage 2."""
    owners: Labelled | None = None
    """Region of each point, if it is known."""
    given: Unmixing | None = None
    """Palette shares in the pixels, for a palette made by hand or of more than three colours."""

    function_colours: tuple[Tensor, Tensor] | None = None
    """Values and their colours, if the network is a function of the values. (K,), (K, 3)"""

    def __post_init__(self) -> None:
        s = self.settings
        if s.joined > 0 and self.base.density is not None:
            self.marching = replace(self.marching, least_weight=s.joined, merge=True)
        own = [n for n in (self.field.lighting_mlp, self.field.palette_mlp) if n is not None]
        groups: list[Group] = groups_of(own, s.network_rate, s.muon)
        groups.append({"params": [self.field.colours], "full": s.palette_rate})
        encodings = [self.field.encoding]
        if self.field.phong is not None:
            groups.append({"params": [self.field.phong.raw], "full": PHONG_RATE})
            encodings.append(self.field.phong.normals)
        self.shade_weight = s.shade_weight if self.field.phong is None else PHONG_SHADE_WEIGHT
        self.start = self.field.colours.detach().clone()
        self.networks = network_adam(groups)
        self.tables = LatticeAdam([encoding for encoding in encodings if encoding.table.requires_grad])
        self.budget = RayBudget(s.rays, s.samples)
        self.drawn = self.budget.rays
        device = self.field.colours.device
        self.room, self.recorded, self.numbers = SampleRoom(device), recorded_steps(device), StepNumbers(device)

    def step(self, number: int, fraction: float) -> Tensor:
        """Take one step of the optimisers; returns the mean squared error of colour."""
        s = self.settings
        self.drawn = self.budget.part(growing(fraction, s.doublings, s.hold))
        rays, kernels = ranks.part(self.drawn), self._kernels()
        count, rate = rays.stop - rays.start, falling(fraction, s.decay, s.hold)
        there = kernels is not None and kernels.SPARE
        room = self.room.of(number, count) if there else None
        early = 1.0 + (s.offset_start - 1.0) * max(0.0, 1.0 - 2.0 * fraction)
        # If each point's region is known, weights need not be as little mixed.
        mixing = 0.0 if self.owners is not None and kernels is not None else s.mixing_weight
        penalties, rates = [s.offset_weight * early, self.shade_weight, mixing], [s.feature_rate * rate]
        rates += [group["full"] * rate for group in self.networks.param_groups]
        self.numbers.set(number, self.pool.seed_of(number), [*penalties, *rates], rays, there)
        if room is None:
            return self._take(number, rays, kernels, None)
        return self.recorded.take((count, room.samples), lambda: self._take(number, rays, kernels, room))

    def _take(self, number: int, rays: slice, kernels: TrainingKernels | None, room: Room | None) -> Tensor:
        """Take a step; with room for its samples, all that differs from step to step is read from the numbers."""
        numbers = self.numbers
        batch = self.pool.batch(number, self.drawn, rays, self.settings.by_contrast, numbers.pixels)
        samples = march(
            batch.rays, self.occupancy, self.base.density, self.marching, numbers.march, batch.first, room
        )  # fmt: skip
        if room is None:
            self.budget.adjust(number, len(samples), self.drawn)
            self.room.counted(len(samples), len(batch.rays))
        self.networks.zero_grad(set_to_none=True)
        if kernels is not None and len(samples):
            error = self._learn(kernels, samples, batch)
        else:
            error = self._learn_in_torch(samples, batch)
        trained = [p for group in self.networks.param_groups for p in group["params"]]
        error = sum_gradients(error, trained, self.tables.encodings)
        for k, group in enumerate(self.networks.param_groups, start=PENALTIES + 1):
            group["lr"] = numbers.other(k)
        self.networks.step()
        self._step_tables(numbers.other(PENALTIES))
        with torch.no_grad():
            self.field.colours.clamp_(0.0, 1.0)
        return error

    def _kernels(self) -> TrainingKernels | None:
        """Return the kernels that take a whole step, if there are any for these networks and penalties."""
        base, field, lighting = self.base, self.field, self.field.lighting_mlp
        alike = isinstance(base.encoding, SparseLattice) and isinstance(field.encoding, SparseLattice)
        unguided = self.given is None and self.function_colours is None
        if base.density is None or lighting is None or not (alike and unguided):
            return None
        if self.owners is not None and self.owners.shared:
            return None
        kernels = kernels_for(field.colours).TRAINING
        fit = kernels is not None and all(kernels.fits(n.weights) for n in (lighting, field.palette_mlp))
        return kernels if fit else None

    def _learn(self, kernels: TrainingKernels, samples: Samples, batch: Batch) -> Tensor:
        """Compute all gradients at once; returns the mean squared error of colour."""
        geometry, encoding, lighting = self.base.encoding, self.field.encoding, self.field.lighting_mlp
        assert isinstance(geometry, SparseLattice) and isinstance(encoding, SparseLattice) and lighting is not None
        networks, colours, owned = (lighting.weights, self.field.palette_mlp.weights), self.field.colours, None
        if self.owners is not None:
            owner, count = self.owners.of(samples.position), len(colours)
            owned = Owned(owner, ranks.summed(kernels.owned_by(samples, owner, count)), OWNER_WEIGHT / count)
        error, gradients = kernels.palette(
            samples, batch.target, (geometry.layout, geometry.table.detach()), learning(encoding), networks,
            colours.detach(), self.numbers.others[:PENALTIES], owned,
        )  # fmt: skip
        for parameter, gradient in zip([*networks[0], *networks[1], colours], gradients, strict=True):
            parameter.grad = gradient
        assert colours.grad is not None
        colours.grad.add_(colours.detach() - self.start, alpha=2.0 * PALETTE_WEIGHT * batch.share)
        return error

    def _learn_in_torch(self, samples: Samples, batch: Batch) -> Tensor:
        """Compute all gradients; returns the mean squared error of colour."""
        with torch.no_grad():
            lit = self.field.lighting_mlp is not None
            # Without a lighting network the geometry features are unused; only the number of samples matters.
            sigma, geometry = self.base.geometry(samples) if lit else (self.base.extinction(samples), samples.position)
            if self.base.density is None:
                samples, seen = not_hidden(samples, sigma, self.marching)
                sigma, geometry = sigma[seen], geometry[seen]
        values, weights = self._values(samples, geometry, batch.rays)
        out, transmittance, _ = composite(samples, sigma, values)
        out, mixtures = out[:, :6], out[:, 6:]
        penalties = [float(weight) for weight in self.numbers.others[:PENALTIES]]
        loss, error = batch.loss(out, transmittance, [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, *penalties], alpha=False)
        drift = (self.field.colours - self.start).square().sum()
        loss = loss + PALETTE_WEIGHT * batch.share * drift
        if self.owners is not None:
            loss = loss + self._foreign(self.owners, weights, samples.position)
        if self.given is not None:
            loss = loss + self._unmixing_penalty(self.given, mixtures, batch)
        if self.function_colours is not None:
            loss = loss + batch.share * self._transfer_function_penalty(*self.function_colours)
        loss.backward()
        return error

    def settle(self, number: int) -> None:
        """Take one step towards the regions of random points, without rays: where a trained network is told others."""
        assert self.owners is not None
        generator = np.random.default_rng(number)
        cells = np.argwhere(self.occupancy.occupied)
        cell = cells[generator.integers(0, len(cells), SETTLED_AT)]
        place = ((cell + generator.random(cell.shape)) / self.occupancy.cells).astype(np.float32)
        position = torch.minimum(torch.from_numpy(place), torch.tensor(self.occupancy.box.extent, dtype=torch.float32))
        position = position.to(self.field.colours.device)
        weights = self.field.material(position)[1]
        self.networks.zero_grad(set_to_none=True)
        loss = self._foreign(self.owners, weights, position) / OWNER_WEIGHT
        loss.backward()
        trained = [p for group in self.networks.param_groups for p in group["params"] if p.grad is not None]
        sum_gradients(loss.detach(), trained, self.tables.encodings)
        for group in self.networks.param_groups:
            group["lr"] = group["full"]
        self.networks.step()
        self._step_tables(self.settings.feature_rate)

    def _step_tables(self, rate: float | Tensor) -> None:
        """Take a step of the tables, at this learning rate of features."""
        phong = None if self.base.density is None else self.field.phong
        normals = None if phong is None else phong.normals
        self.tables.step([NORMAL_RATE * rate if each is normals else rate for each in self.tables.encodings])

    def _values(self, samples: Samples, geometry: Tensor, rays: Rays) -> tuple[Tensor, Tensor]:
        """Return what is composited: colours, penalties and given shares (S, 6 or 6 + P); and weights (S, P)."""
        along, field = rays.lit_along, self.field
        settled = self.owners is not None and not self.owners.shared
        beams = Beams.headlight(-along).at(samples.ray)
        parts = field(samples.position, geometry, encode_directions(along, samples.ray), beams)
        diffuse = parts.diffuse(field.colours + parts.offsets)
        colour = diffuse * parts.shade[:, None] + parts.specular[:, None]
        offsets = parts.offsets.square().sum(dim=(1, 2))
        mixed = torch.zeros_like(offsets) if settled else 1.0 - parts.weights.square().sum(dim=1)
        values = torch.cat([colour, torch.stack([offsets, (parts.shade - 1.0).square(), mixed], dim=1)], dim=1)
        if self.given is not None:
            light = (parts.intensity * parts.shade).detach()
            values = torch.cat([values, light[:, None] * parts.weights], dim=1)
        return values, parts.weights

    def _foreign(self, owners: Labelled, weights: Tensor, position: Tensor) -> Tensor:
        """Return the penalty of palette weights (S, P) at positions (S, 3) in other regions than their own, a scalar.

        It is a mean over regions, and over the samples of each on all ranks: a thin shell counts as much as thick fog.
        """
        count = weights.shape[1]
        if not len(position):
            ranks.summed(torch.zeros(count, dtype=torch.int64, device=weights.device))
            return weights.sum()
        owner, own = owners.assign(weights, position)
        each = 1.0 / ranks.summed(torch.bincount(owner, minlength=count)).clamp(min=1)[owner]
        return -OWNER_WEIGHT * (each * own.log()).sum() / count

    def _transfer_function_penalty(self, values: Tensor, colours: Tensor) -> Tensor:
        """Return the penalty of other colours than the transfer function's: views do not show hidden values."""
        return FUNCTION_WEIGHT * (colours_of(self.field, values)[0] - colours).square().mean()

    def _unmixing_penalty(self, given: Unmixing, mixtures: Tensor, batch: Batch) -> Tensor:
        """Return the penalty of palette shares in pixels, ``mixtures`` (R, P), other than those given, a scalar."""
        counts = batch.weight[:, None] * batch.premultiplied.amax(dim=1, keepdim=True)
        shares = given.shares(batch.premultiplied) * counts
        shown = mixtures / mixtures.sum(dim=1, keepdim=True).clamp_min(1e-6)
        total = ranks.summed(shares.sum(dim=0))  # here, too, a thin layer counts as much as a thick one
        told = (shares * shown.clamp_min(1e-4).log()).sum(dim=0) / total.clamp_min(1e-12)
        return -OWNER_WEIGHT * told.sum() / (total > 0).sum().clamp_min(1)

    @torch.no_grad()
    def shares(self, rays: int = 16384) -> NDArray[np.float64]:
        """Return each region's fraction of the visible light, estimated from random training rays. (P,)"""
        batch = self.pool.batch(0, rays)
        samples = march(batch.rays, self.occupancy, self.base.density, self.marching)
        sigma, _ = self.base.geometry(samples)
        _, weights, _ = self.field.material(samples.position)
        return shares_of(samples, sigma, weights.argmax(1), weights.shape[1])


def palette_of(
    views: ViewSet, occupancy: Occupancy, seed: int, settings: PaletteSettings | None = None, device: torch.device = CPU
) -> Palette:
    """Return the palette of the views' visible pixels, which the ``device`` may hold; raises BadInput without any."""
    pool = RayPool(views, occupancy.box, seed, device)
    return extract_palette(*pool.visible_colours(PALETTE_PIXELS), settings, seed)


def recolour(  # noqa: PLR0913 - what a stage is given, and where it starts
    views: ViewSet,
    scene: Scene,
    palette: NDArray[np.floating],
    settings: RecolourSettings,
    running: Running,
    owners: Labelled | None = None,
    given: Unmixing | None = None,
    values: ValueGrid | None = None,
    start: PaletteField | None = None,
) -> tuple[PaletteField, NDArray[np.float64], float]:
    """Train the palette colour network for a palette (P, 3), RGB in [0, 1], on a scene's frozen base field.

    ``owners`` are the regions of points, if they are known, and ``given`` palette shares in the pixels, for a palette
    made by hand or of more than three colours. With ``values``, the network is a function of the volume's
    (:mod:`svv.train.base.from_values`). It may ``start`` from a trained one of as many colours, which first learns its
    points' regions without rays.

    Returns the frozen network, each region's fraction of the visible light (P,), and the seconds spent.
    """
    begin = time.monotonic()
    base, occupancy, seed, checkpoint = scene.base, scene.occupancy, running.seed, running.saved
    torch.manual_seed(seed)
    network = PaletteField(
        scene.settings, occupancy, base.geometry_width, torch.as_tensor(palette, dtype=torch.float32)
    )
    network.encoding.randomize(0.01, torch.Generator().manual_seed(seed))
    device = base.encoding.table.device
    network.to(device).light_like(base)
    if network.phong is not None and base.density is not None:
        network.phong.start(base.density if values is None else None, occupancy, views.meta.shading, seed)
    if values is not None:
        palette_given(network, base)
    function_colours = None if values is None else sample_transfer_function(values, device)
    if start is not None:
        network.load_state_dict(start.state_dict())
    ranks.alike(network)
    pool = RayPool(views, occupancy.box, seed, device, scene.settings.headlight)
    work = Recolouring(base, network, occupancy, scene.marching, pool, settings, owners, given, function_colours)
    if start is not None and owners is not None:
        for number in range(SETTLED_IN):
            work.settle(number)
    loop = Loop(
        settings.iterations, running.limit, running.progress, "palette colour network",
        network=network, notes=running.notes,
    )  # fmt: skip
    if checkpoint is not None:
        state = checkpoint.stage("palette", network, work.networks, work.tables)
        if state.restored is not None:
            loop.done, loop.spent = state.restored
            work.budget.rays = int((checkpoint.extra("palette") or {})["rays"])
        loop.save = lambda done, spent: state.save(done, spent, {"rays": np.array(work.budget.rays)})
    ready = time.monotonic()
    seconds = loop.run(work.step)
    done = time.monotonic()
    running.notes.extend([*work.room.notes(), *work.recorded.notes])
    if network.phong is not None:
        network.phong.settle(occupancy)
    network.requires_grad_(False)
    shares = ranks.once(work.shares)
    return network, shares, seconds + ready - begin + time.monotonic() - done
