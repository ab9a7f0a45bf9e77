"""The structure tensor of a picture: in which direction its strokes run, and how consistently.

Source: Förstner and Gülch 1987; for pictures of several channels, the sum of the channels' tensors (Di Zenzo 1986).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

LEAST_ENERGY = 1e-6
"""Mean squared gradient below which a neighbourhood has no direction."""


@dataclass(frozen=True)
class StructureTensor:
    """Directions in a picture, all (H, W)."""

    angle: NDArray[np.float32]
    """Anticlockwise angle of the strokes from the horizontal, in radians, in [0, pi)."""
    coherence: NDArray[np.float32]
    """How consistently strokes run in one direction, in [0, 1]; 0 where nothing varies."""
    energy: NDArray[np.float32]
    """Mean squared gradient of the neighbourhood, in squared units of the picture a pixel."""


def structure_tensor(picture: NDArray[np.floating], inner: float, outer: float) -> StructureTensor:
    """Return the directions of a picture (H, W) or (H, W, C), both sides at least 2 pixels.

    ``inner`` and ``outer``: standard deviations in pixels of the Gaussians by which the picture is smoothed before it
    is derived, and over which squared gradients are averaged.

    >>> stripes = np.tile(np.sin(np.arange(64.0)), (64, 1))  # vertical stripes
    >>> tensor = structure_tensor(stripes, 1.0, 4.0)
    >>> [round(float(values[32, 32]), 2) for values in (tensor.angle, tensor.coherence)]
    [1.57, 1.0]
    """
    values = np.asarray(picture, np.float32)
    values = values[..., None] if values.ndim == 2 else values
    xx, yy, xy = np.zeros((3, *values.shape[:2]), np.float32)
    for channel in np.moveaxis(values, 2, 0):
        down, across = np.gradient(gaussian_filter(channel, inner))
        xx += across * across
        yy += down * down
        xy -= across * down  # rows count downwards, angles upwards
    xx, yy, xy = (gaussian_filter(entry, outer) for entry in (xx, yy, xy))
    energy = xx + yy
    angle = (0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi) % np.pi
    coherence = np.hypot(xx - yy, 2.0 * xy) / np.maximum(energy, LEAST_ENERGY)
    return StructureTensor(angle.astype(np.float32), coherence.astype(np.float32), energy)
