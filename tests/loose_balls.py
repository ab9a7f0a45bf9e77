"""Balls of one region, defined by a formula, side by side or joined by bars: a region that has parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, CameraRig, look_at
from svv.core.rays.extinction import LEAST_LOG_EXTINCTION
from svv.fields.radiance.networks import BaseField, FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene

CELLS, RADIUS, DENSEST = 32, 0.13, 5.0
LEFT, RIGHT, TOP = (0.22, 0.5, 0.5), (0.78, 0.5, 0.5), (0.5, 0.8, 0.5)
"""Centres of balls, in the unit box."""


def loose_balls(centres: Sequence[Sequence[float]] = (LEFT, RIGHT), bar: float | None = None) -> Scene:
    """Grey balls, lit by nothing, in front of the second palette colour of a scene in which it shows nowhere.

    Args:
        centres: Centres of the balls, box coordinates.
        bar: Logarithm of the extinction of a bar through the box along x at half height; None for no bar.
    """
    torch.manual_seed(0)
    field = FieldSettings(resolutions=(8, CELLS), width=16, lighting="none")

    def logarithm(place: np.ndarray) -> np.ndarray:
        outside = np.min([np.linalg.norm(place - c, axis=-1) for c in centres], axis=0) - RADIUS
        found = np.clip(-outside * CELLS * 4.0, LEAST_LOG_EXTINCTION, DENSEST)
        if bar is not None:
            away = np.linalg.norm(place[..., 1:] - 0.5, axis=-1) - 2.0 / CELLS
            within = np.abs(place[..., 0] - 0.5) < 0.3
            found = np.maximum(found, np.where(within, np.clip(-away * CELLS * 4.0, LEAST_LOG_EXTINCTION, bar), -6.0))
        return found

    middle = (np.stack(np.meshgrid(*[np.arange(CELLS)] * 3, indexing="ij"), -1) + 0.5) / CELLS
    shifts = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3, indexing="ij"), -1).reshape(-1, 3) / CELLS
    occupied = np.any([logarithm(middle + s) > LEAST_LOG_EXTINCTION for s in shifts], axis=0).astype(np.uint8)
    occupancy = Occupancy(Box((-0.5,) * 3, 1.0, (1.0,) * 3), CELLS, occupied)
    base = BaseField(field, occupancy)
    assert base.density is not None
    with torch.no_grad():
        base.density.table.zero_()
        place = base.density.places_of_level(1, occupied, CELLS)
        base.density.table[base.density.rows_of_level(1)] = torch.from_numpy(logarithm(place)).float()[:, None]
    colours = ((0.5, 0.5, 0.5), (0.9, 0.2, 0.1))
    palette = PaletteField(field, occupancy, base.geometry_width, torch.tensor(colours))
    rig = CameraRig((0.0, 0.0, 0.0), 3.0, 0.4, (64, 64))
    networks = base.requires_grad_(False), palette.requires_grad_(False)
    regions = tuple(Region(colour, share) for colour, share in zip(colours, (1.0, 0.0), strict=True))
    # Samples are neither joined nor left out behind others: what is hidden in one scene is missing in another.
    how = Marching(1 / 64, stop=50.0)
    scene = Scene(field, occupancy, how, *networks, regions=regions, camera_rig=rig, joined=1e-6)
    return Scene.from_bytes(scene.to_bytes())  # as a file holds it


def from_front(size: int = 64) -> Camera:
    """The box from the front: x to the right, y upwards."""
    return Camera(look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)), 0.4, size, size)


def from_left(size: int = 64) -> Camera:
    """The box along x: the left ball hides the right one."""
    return Camera(look_at((-3.0, 0.0, 0.0), (0.0, 0.0, 0.0)), 0.4, size, size)


def in_world(centre: Sequence[float]) -> tuple[float, float, float]:
    """World coordinates of a place in the unit box."""
    x, y, z = (value - 0.5 for value in centre)
    return x, y, z
