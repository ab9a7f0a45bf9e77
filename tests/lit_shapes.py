"""Scenes of one plain region given by a formula, and a plain caster of shadow rays through the same extinction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.rays.extinction import LEAST_LOG_EXTINCTION
from svv.fields.radiance.networks import BaseField, FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene

Floats = NDArray[np.floating]
Shape = Callable[[Floats], Floats]
"""Logarithm of the extinction at box coordinates (..., 3)."""

LIFT = 0.75
"""How far outside of an opaque surface the caster's shadow rays start, along its normal, in cells."""

NEAR, FAR = 1.0, 2.0
"""Distances at which what is on the way begins to count and counts fully, in cells."""

NOTHING = -30.0
"""Logarithm of an extinction that is none."""


def solid(distance: Floats, cells: int, densest: float = 6.0) -> Floats:
    """Return the logarithm of the extinction from the distance to a surface in box units, negative inside."""
    return np.clip(densest - 6.0 * (1.0 + distance * cells), LEAST_LOG_EXTINCTION, densest)


def scene_of(shape: Shape, cells: int = 64) -> Scene:
    """A white scene of a shape in the unit cube around the origin, lit by nothing."""
    torch.manual_seed(0)
    field = FieldSettings(resolutions=(cells,), width=16, lighting="none")
    occupancy = Occupancy(Box((-0.5,) * 3, 1.0, (1.0,) * 3), cells, np.ones((cells,) * 3, np.uint8))
    base = BaseField(field, occupancy)
    assert base.density is not None
    place = base.density.places_of_level(0, occupancy.occupied, cells)
    with torch.no_grad():
        base.density.table.copy_(torch.from_numpy(shape(place.astype(np.float64)).astype(np.float32))[:, None])
    palette = PaletteField(field, occupancy, base.geometry_width, torch.ones(1, 3))
    with torch.no_grad():
        for p in (palette.encoding.table, *palette.palette_mlp.parameters()):
            p.zero_()
    rig = CameraRig((0.0, 0.0, 0.0), 3.0, 0.5, (64, 64))
    networks = base.requires_grad_(False), palette.requires_grad_(False)
    regions = (Region((1.0, 1.0, 1.0), 1.0),)
    return Scene(field, occupancy, Marching(0.25 / cells, 0.0), *networks, regions=regions, camera_rig=rig)


def factor_of(plain: Scene, shadowed: Scene, camera: Camera) -> Floats:
    """Return what remains of white light in each pixel under shadows, over a white background. (H, W)"""
    before, after = (scene.render(camera).rgba for scene in (plain, shadowed))
    remains = after[..., 1] / np.maximum(before[..., 1], 1e-6)
    return np.asarray(1.0 - before[..., 3] * (1.0 - remains))


def reference(
    shape: Shape, cells: int, camera: Camera, towards: Floats, softness: float, directions: int = 24
) -> Floats:
    """Return the same from rays to the light in steps of half a cell, with nothing between grid and ray. (H, W)"""
    at = np.stack(np.meshgrid(*[np.arange(cells + 1) / cells] * 3, indexing="ij"), -1)
    logs = shape(at).astype(np.float32)

    def extinction(x: Floats) -> Floats:
        return np.exp(map_coordinates(logs, x.reshape(-1, 3).T * cells, order=1, cval=NOTHING)).reshape(x.shape[:-1])

    origins, along = (v.reshape(-1, 3) for v in camera.rays())
    step = 0.5 / cells
    depth, kept_away = np.zeros((2, len(along)))
    rays = _cone(towards / np.linalg.norm(towards), softness, directions)
    for distance in np.arange(2.1, 3.9, step):
        own = extinction(origins + 0.5 + distance * along) * step
        weight = np.exp(-depth) * -np.expm1(-own)
        depth += own
        rows = np.flatnonzero(weight > 1e-3)
        start = origins[rows] + 0.5 + distance * along[rows]
        lift = LIFT / cells * -np.expm1(-2.0 * own[rows] / (step * cells))
        start += lift[:, None] * _normal(extinction, start, 0.5 / cells)
        for ray in rays if len(rows) else ():
            left = np.where(ray > 0.0, 1.0 - start, -start) / np.where(ray == 0.0, 1e-9, ray)
            steps = (np.arange(int(np.abs(left).min(1).max() / step) + 1) + 0.5) * step
            counts = np.clip((steps * cells - NEAR) / (FAR - NEAR), 0.0, 1.0) * step
            arrives = np.exp(-extinction(start[:, None] + steps[:, None] * ray) @ counts)
            kept_away[rows] += weight[rows] * (1.0 - arrives) / len(rays)
    return 1.0 - kept_away.reshape(camera.height, camera.width)


def _normal(extinction: Shape, x: Floats, away: float) -> Floats:
    """Return unit vectors towards less matter. (N, 3)"""
    ends = [[np.log(extinction(x + side * away * axis) + 1e-12) for side in (-1.0, 1.0)] for axis in np.eye(3)]
    normal = np.stack([low - high for low, high in ends], -1)
    return normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)


def _cone(towards: Floats, softness: float, count: int) -> Floats:
    """Return directions at random, but spread by strata, in a cone of an opening angle in degrees. (count, 3)"""
    if softness == 0.0:
        return towards[None]
    rng = np.random.default_rng(0)
    side = np.cross(towards, [0.3, 0.5, -0.8])
    side /= np.linalg.norm(side)
    radius = np.tan(np.radians(softness / 2)) * np.sqrt((np.arange(count) + rng.random(count)) / count)
    angle = 2 * np.pi * (np.arange(count) * 0.381966 + 0.2 * rng.random(count))
    across = np.stack([np.cos(angle), np.sin(angle)], 1) @ np.stack([side, np.cross(towards, side)])
    found = towards + radius[:, None] * across
    return found / np.linalg.norm(found, axis=1, keepdims=True)
