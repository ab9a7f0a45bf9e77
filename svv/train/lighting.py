"""Whether a scene shows any lighting, so that its palette colour network has to learn some."""

from __future__ import annotations

import numpy as np
import torch

from svv.fields.networks import encode_directions
from svv.fields.rendering import RayCaster, composite, march
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet

RAYS = 16384
"""Rays that are looked at."""

TURN = 0.35
"""Angle in radians by which the direction of looking is turned: near enough for other views to have seen the same."""

LEAST = 2.0 / 255.0
"""Change of colour, root of the mean square over the visible light, from which on there is lighting."""


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
    shading = views.meta.get("shading")
    if isinstance(shading, dict):
        if shading.get("on") and (shading.get("diffuse") or shading.get("specular")):
            return True, "the views were drawn with shading, so there is a lighting network"
        return False, "the views were drawn without shading: no lighting network"
    change = change_aside(scene, views, seed)
    text = f"seen from {np.degrees(TURN):.0f} degrees aside, colours change by {255 * change:.1f} of 255 levels"
    if change < LEAST:
        return False, f"{text}: no lighting network"
    return True, f"{text}, so there is a lighting network"


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
