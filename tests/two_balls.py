"""Two opaque balls with exact depths: what the measures of consistency ask of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from svv.core.geometry.cameras import Camera, CameraRig
from svv.fields.scene.scene import Rendering


def two_balls(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """An opaque red and an opaque blue ball without light: straight RGBA (H, W, 4) uint8, and distances (H, W)."""
    origins, directions = camera.rays()
    nearest, image = np.full(directions.shape[:2], np.inf), np.zeros((*directions.shape[:2], 4))
    for centre, colour in (((-0.35, 0, 0), (0.9, 0.1, 0.1)), ((0.35, 0, 0), (0.1, 0.2, 0.9))):
        towards = np.array(centre) - origins
        along = (towards * directions).sum(-1)
        inside = 0.3**2 - ((towards - along[..., None] * directions) ** 2).sum(-1)
        distance = along - np.sqrt(np.maximum(inside, 0.0))
        hit = (inside > 0) & (distance < nearest)
        image[hit], nearest = (*colour, 1.0), np.where(hit, distance, nearest)
    return np.asarray((image * 255).round(), np.uint8), np.where(np.isfinite(nearest), nearest, np.nan)


@dataclass(frozen=True)
class Balls:
    """What the measures ask of a scene, with exact depths."""

    stride: float = 1.0
    joined: float = 0.0
    rig: ClassVar = CameraRig((0.0, 0.0, 0.0), 4.0, float(np.radians(30)))

    def render(self, camera: Camera, network: str) -> Rendering:
        rgba, depth = two_balls(camera)
        region = np.where(np.isfinite(depth), 0, -1).astype(np.int16)
        return Rendering(rgba / np.float32(255), depth.astype(np.float32), region)

    def resolving(self, camera: Camera) -> Balls:
        return self
