"""Scenes of several transfer functions of one volume, joined into one and shown alone or together.

Each member keeps its networks, and its regions become regions of the whole, so hiding and showing regions shows one
function or another. Together, extinctions add: the samples of all members along a ray are composited in the order of
their distances, so functions may overlap in space and in values.

Letters: R rays, S samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Generic, TypeVar, cast

import torch
from torch import Tensor

from svv.core.cameras import Camera
from svv.core.compositing import LEAST_ALPHA
from svv.errors import BadInput
from svv.fields.history import History
from svv.fields.phong import Beams
from svv.fields.rendering import RayCaster, Rays, composite
from svv.fields.variants import PaintedModel
from svv.kernels.types import Samples

Painted = TypeVar("Painted", bound=PaintedModel)

Shaded = tuple[Samples, Tensor, Tensor, Tensor]
"""S samples, their colours (S, 3), regions (S,) and edited extinctions (S,)."""

MOST = 8
"""Maximum number of joined scenes."""


def joined(scenes: Sequence[Painted]) -> Painted:
    """Return one scene of several, whose regions are those of all, in their order.

    Args:
        scenes: Scenes of the same volume. Each keeps its edits and the painting that it shows; histories are dropped,
            and all are lit by the light of the first.

    Raises:
        BadInput: There are fewer than two or more than ``MOST`` scenes, one has no palette network or parts that were
            split off, or they are of different places.
    """
    scenes = [member for scene in scenes for member in members(scene)]
    if not 2 <= len(scenes) <= MOST:
        raise BadInput(f"Give 2 to {MOST} scenes to join, not {len(scenes)}.")
    first = scenes[0]
    for scene in scenes:
        if scene.palette_network is None:
            raise BadInput("A scene without regions cannot be joined: train its palette network first.")
        if scene.parts is not None and scene.parts.active:
            raise BadInput("Scenes with parts that were split off cannot be joined: undo the splits first.")
        if not _near(first, scene):
            raise BadInput("The scenes are of different places: join scenes of one volume.")
    regions = tuple(replace(r, layer=k) for k, scene in enumerate(scenes) for r in scene.regions)
    layers = tuple(replace(s, regions=(), history=History(), others=(), parts=None) for s in scenes[1:])
    return replace(first, regions=regions, layers=layers, history=History(), others=(), parts=None)


def _near(first: PaintedModel, other: PaintedModel) -> bool:
    """Return whether the boxes of two scenes overlap."""
    low, high = (torch.tensor(scene.occupancy.box.bounds) for scene in (first, other))
    return bool((torch.minimum(low[1], high[1]) - torch.maximum(low[0], high[0]) > 0).all())


def members(scene: Painted) -> tuple[Painted, ...]:
    """Return the scenes that a scene was joined from, each with its own regions; the scene alone if it was not."""
    if not scene.layers:
        return (scene,)
    layers = cast("tuple[Painted, ...]", scene.layers)
    every = [replace(scene, layers=()), *(replace(s, steps=s.steps or scene.steps) for s in layers)]
    return tuple(
        replace(s, lamp=scene.lamp, history=History(), regions=tuple(r for r in scene.regions if r.layer == k))
        for k, s in enumerate(every)
    )


def with_members(scene: Painted, changed: Sequence[Painted]) -> Painted:
    """Return a joined scene with other networks of its members; its edits stay."""
    layers = tuple(replace(s, regions=(), steps=None) for s in changed[1:])
    return replace(changed[0], regions=scene.regions, lamp=scene.lamp, history=scene.history, layers=layers)


class Together(Generic[Painted]):
    """Draws the members of a joined scene from one camera."""

    def __init__(
        self,
        scene: Painted,
        camera: Camera,
        network: str,
        shaded: Callable[[Painted, Rays, Beams, str], Shaded | None],
    ) -> None:
        """Prepare the members that are visible; ``shaded`` returns what an image shows of one of them along rays."""
        self.camera, self.count, self.shaded = camera, len(scene.regions), shaded
        self.shown: list[tuple[int, Painted, RayCaster, str]] = []
        first = 0
        for member in members(scene):
            if network == "base" or any(r.seen_opacity > 0.0 for r in member.regions):
                caster = RayCaster([camera], member.occupancy.box, member.device)
                own = network if network in member.networks else member.networks[-1]
                self.shown.append((first, member, caster, own))
            first += len(member.regions)

    def in_sight(self) -> Tensor:
        """Return the pixels that may show something, ascending. (R,)"""
        found = [caster.in_sight(member.occupancy) for _, member, caster, _ in self.shown]
        return torch.cat(found).unique() if found else torch.zeros(0, dtype=torch.int64)

    @torch.no_grad()
    def draw(self, pixels: Tensor, rgba: Tensor, depth: Tensor, region: Tensor) -> None:
        """Draw pixels (R,) into RGBA (R, 4), depth (R,) and region (R,), all of them empty before."""
        parts: list[tuple[Tensor, ...]] = []
        tail = rgba.new_zeros(len(pixels))
        for first, member, caster, network in self.shown:
            rays = caster.rays(pixels)
            beams = Beams.of(member.lamp, self.camera, rays, member.settings.headlight)
            found = self.shaded(member, rays, beams, network)
            if found is None:
                continue
            samples, colour, of, sigma = found
            size = member.occupancy.box.size
            distance = size * (samples.position - rays.origins[samples.ray.long()]).norm(dim=1)
            parts.append((samples.ray, distance, samples.skipped, sigma * samples.step, colour, of + first))
            tail += samples.tail
        if not parts:
            return
        ray, distance, skipped, thickness, colour, of = (torch.cat(each) for each in zip(*parts, strict=True))
        order = distance.argsort(stable=True)
        order = order[ray[order].argsort(stable=True)]
        count = torch.bincount(ray, minlength=len(pixels))
        samples = Samples(
            colour[order], thickness[order], skipped[order], ray[order], count.cumsum(0) - count, count, tail, 1.0
        )
        regions = torch.nn.functional.one_hot(of[order], self.count).float()
        values = torch.cat([colour[order], distance[order, None], regions], dim=1)
        out, transmittance, _ = composite(samples, samples.sigma, values)
        alpha = 1.0 - transmittance
        seen = torch.nonzero(alpha > LEAST_ALPHA)[:, 0]
        mean = out[seen] / alpha[seen, None]
        rgba[seen, :3] = mean[:, :3].clamp(0.0, 1.0)
        rgba[seen, 3] = alpha[seen]
        depth[seen] = mean[:, 3]
        region[seen] = mean[:, 4:].argmax(1).to(torch.int16)
