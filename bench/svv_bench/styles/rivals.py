"""Other ways to stylize a scene, as modes of the same trainer, for comparison with ours.

They share features, loss, views and schedule (:data:`svv_bench.styles.modes.SCHEDULE`), so only the methods differ.
None has the palette's regions, laid paint or lighting: their fields have the same colour from every side.

- **ARF-like** (Zhang et al. 2022): one style on the whole scene. A field of the scene's original colours, mapped by
  ARF's linear colour transfer, is optimised towards the style view by view, and its colours are transferred once more
  at the end. ARF's content loss is not used.
- **SNeRF-like** (Nguyen-Phuoc et al. 2022): the views' images are stylized one by one and the field is refitted to
  them, alternately.

Modes that stylize frames and have no field are in :mod:`svv_bench.styles.rival_frames`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from svv.core.images.nnfm import colour_statistics, colour_transfer
from svv.errors import Progress, part
from svv.fields.radiance.networks import UnrestrictedField, encode_directions
from svv.fields.radiance.rendering import Rays, composite, march
from svv.fields.scene.scene import Scene
from svv.kernels.types import Samples
from svv.train.match.distil import DISTILLATION_SIZE, Distillation
from svv.train.match.style_loss import StyleTarget
from svv.train.match.stylize import Stylization
from svv.train.palette.ranges import LOOKED_AT
from svv.train.run.config import MatchSettings
from svv.train.run.loop import Loop
from svv_bench.styles.rival_frames import stylized

ROUNDS = 3
"""Number of times that the SNeRF-like mode stylizes its images and refits its field."""

PASSES = 5
"""Passes over all views in each refit of the SNeRF-like mode. After only one pass, its pictures are even blander."""

FLAT = 1e-3
"""Variance added to each channel before the colour transfer, to avoid amplifying a scene of one colour."""

Transfer = tuple[Tensor, Tensor]
"""A linear map of colours: A (3, 3) and b (3,), c -> A c + b."""


class WholeDistillation(Distillation):
    """Distillation of the base network's colours, averaged over directions, as one region without light."""

    def __init__(self, scene: Scene, transfer: Transfer | None, settings: MatchSettings, seed: int) -> None:
        """Start from the base network's features; ``transfer`` maps the colours, None leaves them unchanged."""
        assert scene.palette_network is not None
        super().__init__(scene, scene.palette_network.colours, settings, seed)
        with torch.no_grad():  # the base field's levels come first; the palette has no influence
            self.field.encoding.table[: len(scene.base.encoding.table)] = scene.base.encoding.table
        self.transfer = transfer

    def truth(self, samples: Samples, rays: Rays) -> Tensor:
        """Return colours along the rays, transferred. (S, 3)"""
        colours = base_colours(self.scene, samples, rays)
        return colours if self.transfer is None else colours @ self.transfer[0].T + self.transfer[1]


class Recoloured(WholeDistillation):
    """Distillation of a field's colours under a linear map into a copy of the field."""

    def __init__(
        self, scene: Scene, field: UnrestrictedField, transfer: Transfer, settings: MatchSettings, seed: int
    ) -> None:
        super().__init__(scene, transfer, settings, seed)
        self.field.load_state_dict(field.state_dict())
        self.source, self.linear = field, transfer

    def truth(self, samples: Samples, rays: Rays) -> Tensor:
        """Return the old field's colours, transferred. (S, 3)"""
        colours: Tensor = self.source(samples.position)
        return colours @ self.linear[0].T + self.linear[1]


class Refit(Stylization):
    """Stylization of the views' images one by one, followed by a fit of the field to them."""

    pictures: list[Tensor]
    """Target picture of each view: the region over the style's background. (3, h, w)"""

    def paint(self, steps: int, progress: Progress) -> None:
        """Optimise an image of every view, starting from the field's current rendering."""
        target = self.targets[0]
        self.pictures = []
        for number, view in enumerate(self.views):
            progress(number / len(self.views), f"image {number + 1} of {len(self.views)}")
            with torch.no_grad():
                colours = torch.cat([self.field(p) for p in view.position.split(self.piece)])
                image, mask = view.image(colours, 0, target.background)
            behind = target.background * (1.0 - mask)
            straight = ((image - behind) / mask.clamp_min(1e-3)).clamp(0.0, 1.0)
            painted = stylized(straight.cpu(), mask.cpu(), target, steps).to(mask.device)
            self.pictures.append(painted * mask + behind)
        progress(1.0, "images")

    def losses(self, index: int, colours: Tensor) -> Iterator[Tensor]:
        """Yield the mean squared difference of the view from its picture, over what is visible."""
        image, mask = self.views[index].image(colours, 0, self.targets[0].background)
        yield ((image - self.pictures[index]).square().mean(0) * mask).sum() / mask.sum()


def arf_like(
    scene: Scene, target: StyleTarget, settings: MatchSettings, seed: int, progress: Progress
) -> tuple[Scene, dict[str, float]]:
    """Paint one style on the whole scene by matching features view by view.

    Args:
        scene: A scene with a palette network, which only the file format requires.
        target: The style.
        settings: Settings of stage 3.
        seed: Seed of networks and rays.
        progress: Called several times per second; the work stops if it raises.

    Returns:
        A scene whose network ``styled`` is the result, and the seconds of each part.
    """
    transfer = _transfer(scene, target, seed, lambda samples, rays: base_colours(scene, samples, rays))
    distillation, seconds = _distilled(scene, transfer, settings, seed, part(progress, 0.0, 0.25))
    field = distillation.field
    work = Stylization(scene, field, {0: target}, settings, part(progress, 0.25, 0.3), whole=True)
    loop = Loop(settings.style_iterations, None, part(progress, 0.3, 0.85), "stylization")
    seconds["stylize"] = loop.run(work.step)
    transfer = _transfer(scene, target, seed, lambda samples, rays: field(samples.position))
    last = Recoloured(scene, field, transfer, settings, seed + 1)
    loop = Loop(settings.distil_iterations // 2, None, part(progress, 0.85, 1.0), "colour transfer")
    seconds["recolour"] = loop.run(last.step)
    return flat(scene, last.field, "ARF-like"), seconds


def snerf_like(
    scene: Scene, target: StyleTarget, settings: MatchSettings, seed: int, progress: Progress
) -> tuple[Scene, dict[str, float]]:
    """Stylize images one by one and refit the field to them, alternately; see :func:`arf_like`.

    An image gets as many steps in total as a frame that is optimised separately (``style_iterations``), in ``ROUNDS``
    equal rounds. Each refit sees every view at least ``PASSES`` times, so the field is fitted, as SNeRF's is.
    """
    distillation, seconds = _distilled(scene, None, settings, seed, part(progress, 0.0, 0.1))
    work = Refit(scene, distillation.field, {0: target}, settings, part(progress, 0.1, 0.15), whole=True)
    steps = max(1, settings.style_iterations // ROUNDS)
    seconds |= {"images": 0.0, "refit": 0.0}
    for number in range(ROUNDS):
        each = part(progress, 0.15 + 0.85 * number / ROUNDS, 0.15 + 0.85 * (number + 1) / ROUNDS)
        begin = time.monotonic()
        work.paint(steps, part(each, 0.0, 0.8))
        seconds["images"] += time.monotonic() - begin
        refit = Loop(max(steps, PASSES * len(work.views)), None, part(each, 0.8, 1.0), "refit")
        seconds["refit"] += refit.run(work.step)
    return flat(scene, distillation.field, "SNeRF-like"), seconds


def flat(scene: Scene, field: UnrestrictedField, name: str) -> Scene:
    """Return a scene that shows a colour field unchanged in all regions, without light."""
    field.requires_grad_(False)
    regions = tuple(replace(r, style=name, strength=1.0, edited_colour=None, lighting=0.0) for r in scene.regions)
    return replace(scene, styled=field, regions=regions)


@torch.no_grad()
def base_colours(scene: Scene, samples: Samples, rays: Rays) -> Tensor:
    """Return the base network's colours of samples, seen along their rays. (S, 3)"""
    _, geometry = scene.base.geometry(samples)
    colours: Tensor = scene.base(geometry, encode_directions(rays.lit_along, samples.ray))
    return colours


def _transfer(scene: Scene, target: StyleTarget, seed: int, colours_of: Callable[[Samples, Rays], Tensor]) -> Transfer:
    """Return ARF's colour transfer: the map that gives the scene's visible pixels the style's mean and covariance."""
    views = 42
    cameras = scene.rig.sphere(views, DISTILLATION_SIZE)
    pixels = np.random.default_rng(seed).integers(0, views * DISTILLATION_SIZE**2, LOOKED_AT)
    rays = scene.caster(cameras).rays(torch.from_numpy(pixels))
    samples = march(rays, scene.occupancy, scene.base.density, scene.marching)
    colours = colours_of(samples, rays)
    out, transmittance, _ = composite(samples, scene.base.extinction(samples), colours)
    alpha = 1.0 - transmittance
    source = colour_statistics(out / alpha.clamp_min(1e-3)[:, None], alpha)
    return colour_transfer(source, target.statistics, FLAT)


def _distilled(
    scene: Scene, transfer: Transfer | None, settings: MatchSettings, seed: int, progress: Progress
) -> tuple[WholeDistillation, dict[str, float]]:
    distillation = WholeDistillation(scene, transfer, settings, seed)
    loop = Loop(settings.distil_iterations, None, progress, "distillation")
    return distillation, {"distil": loop.run(distillation.step)}
