"""Other ways to stylize a scene, as modes of the same trainer: what ours is compared with.

They share our features, loss, views and schedule, so what differs is what each does with them. None has the palette's
regions, our painted start, the anchor that holds it, or lighting: their fields say one colour from every side.

- **ARF-like** (Zhang et al. 2022): one style on the whole scene. A field of the scene's own colours, moved by ARF's
  linear colour transfer, is drawn towards the style view after view, and its colours are transferred once more in the
  end. ARF's content loss is not taken over.
- **SNeRF-like** (Nguyen-Phuoc et al. 2022): the views' images are stylized one by one, the field is refitted to them,
  and so on in turn.

Modes that stylize frames and have no field are in :mod:`svv.bench.styles.rival_frames`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from svv.bench.styles.judge_features import stylized
from svv.core.nnfm import colour_statistics, colour_transfer
from svv.errors import Progress, part
from svv.fields.networks import UnrestrictedField, encode_directions
from svv.fields.rendering import RayCaster, Rays, composite, march
from svv.fields.scene import Scene
from svv.kernels.types import Samples
from svv.train.config import StylizeSettings
from svv.train.distil import DISTILLATION_SIZE, Distillation
from svv.train.loop import Loop
from svv.train.ranges import LOOKED_AT
from svv.train.style_loss import StyleLossSettings, StyleTarget
from svv.train.stylize import Stylization

ROUNDS = 3
"""How often the SNeRF-like mode stylizes its images and refits its field."""

PASSES = 5
"""How often each refit of the SNeRF-like mode sees every view. After one pass its pictures are blander yet."""

FLAT = 1e-3
"""Variance added to a channel's before the colour transfer, so that a scene of one colour is not blown up."""

Transfer = tuple[Tensor, Tensor]
"""A linear map of colours: A (3, 3) and b (3,), c -> A c + b."""


class WholeDistillation(Distillation):
    """Distils the base network's colours, as one region and without its light: their mean over the directions."""

    def __init__(self, scene: Scene, transfer: Transfer | None, settings: StylizeSettings, seed: int) -> None:
        """``transfer`` moves the colours; without it they stay."""
        assert scene.palette_network is not None
        super().__init__(scene, scene.palette_network.colours, settings, seed)
        with torch.no_grad():  # the base field's levels come first in it, and no palette went into it
            self.field.encoding.table[: len(scene.base.encoding.table)] = scene.base.encoding.table
        self.transfer = transfer

    def truth(self, samples: Samples, rays: Rays) -> Tensor:
        """Colours as the rays see them, transferred. (S, 3)"""
        colours = base_colours(self.scene, samples, rays)
        return colours if self.transfer is None else colours @ self.transfer[0].T + self.transfer[1]


class Recoloured(WholeDistillation):
    """Gives a field's colours a linear map, in the field itself."""

    def __init__(
        self, scene: Scene, field: UnrestrictedField, transfer: Transfer, settings: StylizeSettings, seed: int
    ) -> None:
        super().__init__(scene, transfer, settings, seed)
        self.field.load_state_dict(field.state_dict())
        self.source, self.linear = field, transfer

    def truth(self, samples: Samples, rays: Rays) -> Tensor:
        """The old field's colours, transferred. (S, 3)"""
        colours: Tensor = self.source(samples.position)
        return colours @ self.linear[0].T + self.linear[1]


class Refit(Stylization):
    """Stylizes the views' images one by one, and fits the field to them."""

    pictures: list[Tensor]
    """What each view is to look like: the region over the style's background, (3, h, w)."""

    def paint(self, steps: int, progress: Progress) -> None:
        """Optimise an image of every view, from how the field shows it now."""
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
        """Squared distance of the view to its picture, over what is visible."""
        image, mask = self.views[index].image(colours, 0, self.targets[0].background)
        yield ((image - self.pictures[index]).square().mean(0) * mask).sum() / mask.sum()


def unseeded(loss: StyleLossSettings) -> StyleLossSettings:
    """The loss without what is ours alone: the painted start, the anchor, and one colour along a ray."""
    return replace(loss, seeded=False, anchor=0.0, along_rays=0.0)


def arf_like(
    scene: Scene, target: StyleTarget, settings: StylizeSettings, seed: int, progress: Progress
) -> tuple[Scene, dict[str, float]]:
    """One style on the whole scene, by matching features from view to view.

    Args:
        scene: With a palette colour network, which only the file format asks for.
        target: The style, with an :func:`unseeded` loss.
        settings: Of stage 3.
        seed: Of networks and rays.
        progress: Called several times a second; stops the work when it raises.

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
    scene: Scene, target: StyleTarget, settings: StylizeSettings, seed: int, progress: Progress
) -> tuple[Scene, dict[str, float]]:
    """Images stylized one by one and the field refitted to them, in turn; see :func:`arf_like`.

    An image gets as many steps in all as a frame that is optimised alone (``style_iterations``), in ``ROUNDS`` equal
    rounds; each refit sees every view ``PASSES`` times at least, so the field is fitted, as SNeRF's is.
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
    """A scene that shows a colour field as it is, in all regions, without light."""
    field.requires_grad_(False)
    regions = tuple(replace(r, style=name, strength=1.0, edited_colour=None, lighting=0.0) for r in scene.regions)
    return replace(scene, styled=field, regions=regions)


@torch.no_grad()
def base_colours(scene: Scene, samples: Samples, rays: Rays) -> Tensor:
    """What the base network says of samples, seen along their rays. (S, 3)"""
    _, geometry = scene.base.geometry(samples)
    colours: Tensor = scene.base(geometry, encode_directions(rays.directions, samples.ray))
    return colours


def _transfer(scene: Scene, target: StyleTarget, seed: int, colours_of: Callable[[Samples, Rays], Tensor]) -> Transfer:
    """ARF's colour transfer: the map that gives the scene's visible pixels the style's mean and covariance."""
    views = 42
    cameras = scene.rig.sphere(views, DISTILLATION_SIZE)
    pixels = np.random.default_rng(seed).integers(0, views * DISTILLATION_SIZE**2, LOOKED_AT)
    rays = RayCaster(cameras, scene.occupancy.box, scene.device).rays(torch.from_numpy(pixels))
    samples = march(rays, scene.occupancy, scene.base.density, scene.marching)
    colours = colours_of(samples, rays)
    out, transmittance, _ = composite(samples, scene.base.extinction(samples), colours)
    alpha = 1.0 - transmittance
    source = colour_statistics(out / alpha.clamp_min(1e-3)[:, None], alpha)
    return colour_transfer(source, target.statistics, FLAT)


def _distilled(
    scene: Scene, transfer: Transfer | None, settings: StylizeSettings, seed: int, progress: Progress
) -> tuple[WholeDistillation, dict[str, float]]:
    distillation = WholeDistillation(scene, transfer, settings, seed)
    loop = Loop(settings.distil_iterations, None, progress, "distillation")
    return distillation, {"distil": loop.run(distillation.step)}
