"""Whether a scene shows any lighting, so that its palette colour network has to learn some, and which kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from svv.errors import part
from svv.fields.networks import FieldSettings, encode_directions
from svv.fields.phong import Beams
from svv.fields.rendering import RayCaster, composite, march
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet
from svv.train.batches import RayPool
from svv.train.config import RecolourSettings
from svv.train.loop import Running
from svv.train.ranges import Owners, regions_for
from svv.train.recolour import recolour
from svv.train.unmix import Unmixing

RAYS = 16384
"""Rays that are looked at."""

TURN = 0.35
"""Angle in radians by which the direction of looking is turned: near enough for other views to have seen the same."""

LEAST = 2.0 / 255.0
"""Change of colour, root of the mean square over the visible light, from which on there is lighting."""

HELD_OUT = 8
"""One view of so many takes no part in a trial."""

TRIAL = 0.25
"""Part of the steps of stage 2 that each trial has."""

MARGIN = 1.0
"""dB by which the lighting network may be better in a trial and yet not be taken: a light that moves is worth them."""


def shows_light(scene: Scene, views: ViewSet, seed: int) -> tuple[bool, str]:
    """Whether colours depend on the direction from which one looks, and why it was decided so.

    Views drawn of a volume say how they were shaded. Of others the base field decides: points keep their place, and
    its network is only told that they are seen from somewhat aside. What was drawn without shading, as ParaView does
    by default, has the same colours from everywhere.

    Args:
        scene: With a trained base field.
        views: The training views.
        seed: Of rays and turns.
    """
    shading = views.meta.shading
    if shading is not None:
        if shading.seen:
            return True, "the views were drawn with shading, so there is a lighting network"
        return False, "the views were drawn without shading: no lighting network"
    change = change_aside(scene, views, seed)
    text = f"seen from {np.degrees(TURN):.0f} degrees aside, colours change by {255 * change:.1f} of 255 levels"
    if change < LEAST:
        return False, f"{text}: no lighting network"
    return True, f"{text}, so there is a lighting network"


def with_explicit_light(settings: FieldSettings, views: ViewSet) -> FieldSettings:
    """The settings with an explicit light, which is where the views were lit from.

    VTK's ray caster on CPUs takes a headlight for parallel to the camera's axis, for which views carry its name;
    on GPUs, and others, for a point at the camera.
    """
    headlight = "axis" if views.meta.mapper == "cpu" else "point"
    return replace(settings, lighting="phong", headlight=headlight)


def light_by_trial(
    scene: Scene,
    views: ViewSet,
    palette: NDArray[np.floating],
    settings: RecolourSettings,
    running: Running,
    owners: Owners | None = None,
    given: Unmixing | None = None,
) -> tuple[Scene, str]:
    """The scene with an explicit light where that draws held-out views as well as the network does, and why.

    Both are trained for :data:`TRIAL` of the steps without every :data:`HELD_OUT` th view, and asked for that; the
    explicit light is taken unless the network is better by more than :data:`MARGIN`.

    Args:
        scene: Without a palette network; its settings have the explicit light.
        views: Training views.
        palette: Colours of the regions. (P, 3)
        settings: Of stage 2.
        running: Seed of both trials, seconds for both together, and progress.
        owners: The region that each point belongs to, where that is known.
        given: What the pixels say of the palette, where that is needed.
    """
    count = len(views.cameras)
    held = list(range(0, count, HELD_OUT))
    seen, unseen = views.take([k for k in range(count) if k not in held]), views.take(held)
    short = replace(settings, iterations=max(1, round(settings.iterations * TRIAL)))
    found = {}
    for number, lighting in enumerate(("phong", "network")):
        fields = replace(scene.settings, lighting=lighting)
        lit, half = replace(scene, settings=fields), part(running.progress, 0.5 * number, 0.5 * number + 0.5)
        limit = None if running.limit is None else 0.5 * running.limit
        network, shares, _ = recolour(seen, lit, palette, short, Running(running.seed, limit, half), owners, given)
        lit = replace(lit, palette_network=network, regions=regions_for(network, shares))
        found[lighting] = accuracy(lit, unseen, running.seed)
    taken = "phong" if found["phong"] >= found["network"] - MARGIN else "network"
    reason = (
        f"an explicit light (Blinn-Phong) draws {len(held)} held-out views with {found['phong']:.2f} dB after "
        f"{short.iterations} steps, the lighting network with {found['network']:.2f} dB: "
    ) + (
        f"not more than {MARGIN:g} dB behind, so it is taken and can be moved"
        if taken == "phong"
        else f"more than {MARGIN:g} dB behind, so the network is taken"
    )
    return replace(scene, settings=replace(scene.settings, lighting=taken)), reason


@torch.no_grad()
def accuracy(scene: Scene, views: ViewSet, seed: int) -> float:
    """PSNR in dB of the palette network's colours over black, on random pixels of views."""
    batch = RayPool(views, scene.occupancy.box, seed, scene.device).batch(0, RAYS)
    samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
    facing = (
        RayCaster(views.cameras, scene.occupancy.box, scene.device).axes(batch.pixels)
        if scene.settings.headlight == "axis"
        else -batch.rays.directions
    )
    colour, _, sigma = scene.shade(samples, batch.rays, "pcn", Beams.headlight(facing))
    error = (composite(samples, sigma, colour)[0] - batch.premultiplied).square().mean()
    return float(-10.0 * torch.log10(error.clamp(min=1e-12)))


@torch.no_grad()
def change_aside(scene: Scene, views: ViewSet, seed: int) -> float:
    """Change of the base network's colours when the direction is turned: root of the mean square over what is seen."""
    cameras = views.cameras
    device, generator = scene.device, np.random.default_rng(seed)
    pixels = generator.integers(0, len(cameras) * cameras[0].width * cameras[0].height, RAYS)
    rays = RayCaster(cameras, scene.occupancy.box, device).rays(torch.from_numpy(pixels))
    samples = march(rays, scene.occupancy, scene.base.density, scene.marching)
    sigma, geometry = scene.base.geometry(samples)
    aside = torch.from_numpy(generator.normal(size=(RAYS, 3)).astype(np.float32)).to(device)
    across = torch.nn.functional.normalize(torch.linalg.cross(rays.directions, aside), dim=1)
    turned = np.cos(TURN) * rays.directions + np.sin(TURN) * across
    seen, other = (
        composite(samples, sigma, scene.base(geometry, encode_directions(directions, samples.ray)))
        for directions in (rays.directions, turned)
    )
    change, weight = float((seen[0] - other[0]).square().mean(dim=1).sum()), float((1.0 - seen[1]).sum())
    return float(np.sqrt(change / max(weight, 1e-9)))
