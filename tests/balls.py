"""A scene of an orange and a blue ball, and presets with which painting takes only a moment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS, MatchSettings, StylizeSettings

DRAFT = PRESETS["draft"]
SHORT = replace(
    DRAFT,
    reconstruct=replace(DRAFT.reconstruct, iterations=100, rays=1024, samples=8192, cells=32, doublings=0),
    recolour=replace(DRAFT.recolour, iterations=300, rays=1024, samples=8192),
    stylize=StylizeSettings(style_views=6, style_size=64),
)
STEPS = MatchSettings(distil_iterations=50, distil_views=12, distil_rays=1024, network_rate=0.02, style_iterations=4,
                      style_views=4, style_size=64)  # fmt: skip
MATCHED = replace(
    SHORT,
    stylize=STEPS,
)
"""The same, painted by matching features as in the paper."""


def two_balls(camera: Camera) -> np.ndarray:
    """An orange and a blue ball side by side, flat, straight alpha. (H, W, 4) uint8"""
    origins, directions = camera.rays()
    nearest, image = np.full(directions.shape[:2], np.inf), np.zeros((*directions.shape[:2], 4))
    for x, colour in ((-0.35, (0.9, 0.5, 0.1, 1.0)), (0.35, (0.1, 0.2, 0.9, 1.0))):
        towards = np.array([x, 0.0, 0.0]) - origins
        along = (towards * directions).sum(-1)
        inside = 0.3**2 - ((towards - along[..., None] * directions) ** 2).sum(-1)
        t = along - np.sqrt(np.maximum(inside, 0.0))
        hit = (inside > 0) & (t < nearest)
        image[hit], nearest = colour, np.where(hit, t, nearest)
    return (image * 255.0).round().astype(np.uint8)


def balls_views() -> ViewSet:
    """Views of the balls from all around."""
    cameras = sphere_cameras(24, (0.0, 0.0, 0.0), 4.0, np.radians(30), 56)
    names = tuple(f"r_{k:04d}" for k in range(len(cameras)))
    return ViewSet(tuple(cameras), np.stack([two_balls(c) for c in cameras]), names)


def balls_scene() -> Scene:
    """The scene, trained for a few seconds."""
    return train_scene(balls_views(), SHORT)[0]
