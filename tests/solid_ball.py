"""A ball of one region, defined by a formula, and large enough in its views for strokes to fit on it."""

from __future__ import annotations

import numpy as np
import torch

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import CameraRig
from svv.core.rays.extinction import LEAST_LOG_EXTINCTION
from svv.fields.radiance.networks import BaseField, FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene

CELLS, RADIUS = 32, 0.4


def solid_ball(densest: float = 5.0, hollow: float = 0.0) -> Scene:
    """A grey ball about the middle of the unit box, lit by nothing.

    Args:
        densest: Logarithm of its extinction: opaque at 5, fog that one sees through at 0.
        hollow: Radius of the hole inside that makes it a shell.
    """
    torch.manual_seed(0)
    field = FieldSettings(resolutions=(8, CELLS), width=16, lighting="none")
    middle = (np.stack(np.meshgrid(*[np.arange(CELLS)] * 3, indexing="ij"), -1) + 0.5) / CELLS - 0.5
    occupied = (np.linalg.norm(middle, axis=-1) < RADIUS + 1.5 / CELLS).astype(np.uint8)
    occupancy = Occupancy(Box((-0.5,) * 3, 1.0, (1.0,) * 3), CELLS, occupied)
    base = BaseField(field, occupancy)
    assert base.density is not None
    with torch.no_grad():
        base.density.table.zero_()
        place = base.density.places_of_level(1, occupied, CELLS)
        away = np.linalg.norm(place - 0.5, axis=1)
        outside = np.maximum(away - RADIUS, hollow - away if hollow else -1.0)
        logarithm = np.clip(-outside * CELLS * 4.0, LEAST_LOG_EXTINCTION, densest).astype(np.float32)
        base.density.table[base.density.rows_of_level(1)] = torch.from_numpy(logarithm)[:, None]
    palette = PaletteField(field, occupancy, base.geometry_width, torch.tensor([[0.5, 0.5, 0.5]]))
    rig = CameraRig((0.0, 0.0, 0.0), 3.0, 0.32, (64, 64))
    networks = base.requires_grad_(False), palette.requires_grad_(False)
    return Scene(field, occupancy, Marching(1 / 64), *networks, regions=(Region((0.5,) * 3, 1.0),), camera_rig=rig)
