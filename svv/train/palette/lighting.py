"""Decide whether a scene shows any lighting, which its palette colour network then has to learn, and of which kind."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from svv.errors import part
from svv.fields.radiance.networks import FieldSettings, encode_directions
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.palette.ranges import Labelled, regions_for
from svv.train.palette.recolour import recolour
from svv.train.palette.unmix import Unmixing
from svv.train.run import ranks
from svv.train.run.batches import RayPool
from svv.train.run.config import RecolourSettings
from svv.train.run.loop import Running

RAYS = 16384
"""Number of rays from which the decision is made."""

TURN = 0.35
"""Angle in radians by which viewing directions are turned: small enough that other views have seen the same points."""

LEAST = 2.0 / 255.0
"""Change of colour, as root mean square over the visible light, from which a scene counts as lit."""

HELD_OUT = 8
"""Spacing of held-out views: one of every eight is not trained on in a trial."""

TRIAL = 0.25
"""Fraction of the steps of stage 2 that each trial takes."""

FEW_VIEWS = 32
"""Number of views below which the light is chosen by a trial."""

FEW_STEPS = 100
"""Most steps of a trial on so few views: in more, the lighting network learns their images by heart."""

MARGIN = 1.0
"""Lead in dB of the network in a trial up to which the explicit light, which can be moved, is chosen."""


def shows_light(scene: Scene, views: ViewSet, seed: int) -> tuple[bool, str]:
    """Return whether colours depend on the viewing direction, and the reason: views of a volume record it.

    For others, the base network is asked for the colours of the same points from slightly different directions.
    """
    shading = views.meta.shading
    if shading is not None:
        if shading.seen:
            return True, "the views were drawn with shading, so there is a lighting network"
        return False, "the views were drawn without shading: no lighting network"
    change = change_aside(scene, views, seed)
    text = f"seen from {np.degrees(TURN):.0f} degrees to the side, colours change by {255 * change:.1f} of 255 levels"
    if change < LEAST:
        return False, f"{text}: no lighting network"
    return True, f"{text}, so there is a lighting network"


def headlight_of(views: ViewSet) -> str:
    """Return a headlight's direction: ``axis`` of the camera for VTK's CPU ray caster and ours, else ``point``."""
    return "axis" if views.meta.mapper in ("cpu", "bricks") else "point"


def light_for(views: ViewSet, settings: FieldSettings) -> str:
    """Return the light to train by default: ``network``, or ``auto`` for few views that were drawn from a volume.

    A network must see a surface from all directions; an explicit light is 8 dB better for smooth shapes in 16 views.
    """
    few = len(views.cameras) < FEW_VIEWS and views.meta.shading is not None
    return "auto" if few and settings.encoding == "lattice" else "network"


def light_by_trial(
    scene: Scene,
    views: ViewSet,
    palette: NDArray[np.floating],
    settings: RecolourSettings,
    running: Running,
    owners: Labelled | None = None,
    given: Unmixing | None = None,
) -> tuple[Scene, str]:
    """Return the scene with an explicit light if that renders held-out views as well as the network, and the reason.

    Both are trained for :data:`TRIAL` of the steps, without one of every :data:`HELD_OUT` views, and tested on those:
    the network must be better by more than :data:`MARGIN`. Of fewer than :data:`FEW_VIEWS`, none is held out: they tell
    nothing. Of two lights that explain all views within :data:`FEW_STEPS` steps, the one of a dozen numbers is the more
    likely.

    ``running`` has the seconds of both trials together; ``owners`` and ``given`` are as for :func:`recolour`.
    """
    count = len(views.cameras)
    steps = max(1, round(settings.iterations * TRIAL))
    held = list(range(0, count, HELD_OUT))
    seen, unseen = views.take([k for k in range(count) if k not in held]), views.take(held)
    told = f"{len(held)} held-out views"
    if count < FEW_VIEWS:
        seen, unseen, told = views, views, f"the {count} views"
        steps = min(steps, FEW_STEPS)
    short = replace(settings, iterations=steps)
    found = {}
    for number, lighting in enumerate(("phong", "network")):
        fields = replace(scene.settings, lighting=lighting)
        lit, half = replace(scene, settings=fields), part(running.progress, 0.5 * number, 0.5 * number + 0.5)
        limit = None if running.limit is None else 0.5 * running.limit
        network, shares, _ = recolour(seen, lit, palette, short, Running(running.seed, limit, half), owners, given)
        lit = replace(lit, palette_network=network, regions=regions_for(network, shares))
        found[lighting] = ranks.once(partial(accuracy, lit, unseen, running.seed))
    taken = "phong" if found["phong"] >= found["network"] - MARGIN else "network"
    reason = (
        f"an explicit light (Blinn-Phong) renders {told} with {found['phong']:.2f} dB after "
        f"{short.iterations} steps, the lighting network with {found['network']:.2f} dB: "
    ) + (
        f"at most {MARGIN:g} dB less, so the explicit light is chosen and can be moved"
        if taken == "phong"
        else f"more than {MARGIN:g} dB less, so the network is chosen"
    )
    return replace(scene, settings=replace(scene.settings, lighting=taken)), reason


@torch.no_grad()
def accuracy(scene: Scene, views: ViewSet, seed: int) -> float:
    """Return the PSNR in dB of the palette network's colours over black, on random pixels of views."""
    pool = RayPool(views, scene.occupancy.box, seed, scene.device, scene.settings.headlight)
    batch = pool.batch(0, RAYS)
    samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
    colour, _, sigma = scene.shade(samples, batch.rays, "pcn")
    error = (composite(samples, sigma, colour)[0] - batch.premultiplied).square().mean()
    return float(-10.0 * torch.log10(error.clamp(min=1e-12)))


@torch.no_grad()
def change_aside(scene: Scene, views: ViewSet, seed: int) -> float:
    """Return the root-mean-square change of the base network's visible colours when viewing directions are turned."""
    cameras = views.cameras
    device, generator = scene.device, np.random.default_rng(seed)
    pixels = generator.integers(0, len(cameras) * cameras[0].width * cameras[0].height, RAYS)
    rays = scene.caster(cameras).rays(torch.from_numpy(pixels))
    samples = march(rays, scene.occupancy, scene.base.density, scene.marching)
    sigma, geometry = scene.base.geometry(samples)
    aside = torch.from_numpy(generator.normal(size=(RAYS, 3)).astype(np.float32)).to(device)
    across = torch.nn.functional.normalize(torch.linalg.cross(rays.lit_along, aside), dim=1)
    turned = np.cos(TURN) * rays.lit_along + np.sin(TURN) * across
    seen, other = (
        composite(samples, sigma, scene.base(geometry, encode_directions(directions, samples.ray)))
        for directions in (rays.lit_along, turned)
    )
    change, weight = float((seen[0] - other[0]).square().mean(dim=1).sum()), float((1.0 - seen[1]).sum())
    return float(np.sqrt(change / max(weight, 1e-9)))
