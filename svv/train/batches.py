"""Training rays: drawn from the pixels of a view set in which something is visible, and from just around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from torch import Tensor

from svv.core.box import Box
from svv.fields.rendering import RayCaster, Rays
from svv.io.viewset import ViewSet

MARGIN = 9
"""Side of the square, in pixels, by which the visible part of an image is widened: its outline must be learned, too."""


@dataclass(frozen=True)
class Batch:
    """R rays and what the views show there."""

    rays: Rays
    colour: Tensor
    """Straight RGB in [0, 1]. (R, 3)"""
    alpha: Tensor
    """(R,)"""
    pixels: Tensor
    """Which pixels these are, of all views. (R,) int64"""

    @property
    def premultiplied(self) -> Tensor:
        """Colour over black: with the error of alpha it says all that random backgrounds would, without their noise."""
        return self.colour * self.alpha[:, None]


class RayBudget:
    """How many rays a step draws: fewer where they give many samples, for those are what a step costs."""

    def __init__(self, most: int, samples: int) -> None:
        """At most ``most`` rays and at least a quarter of them, so as not to exceed about ``samples`` samples."""
        self.rays, self._most, self._samples = most, most, samples

    def adjust(self, number: int, rays: int, samples: int) -> None:
        """Take note of what ``rays`` rays gave in step ``number``; every 16th step counts."""
        if number % 16 == 0:
            ideal = self._samples * rays / max(samples, 1)
            self.rays = int(np.clip(ideal, self._most // 4, self._most))


class RayPool:
    """Draws batches of rays; batch k of a seed is always the same, so a resumed run goes on as if uninterrupted."""

    def __init__(self, views: ViewSet, box: Box, seed: int, device: torch.device) -> None:
        self._caster = RayCaster(views.cameras, box, device)
        self._pixels = views.images.reshape(-1, 4)
        size = views.images.shape[1] * views.images.shape[2]
        # Tens of millions of numbers: of half the size where that is enough.
        kind = np.int32 if len(self._pixels) <= np.iinfo(np.int32).max else np.int64
        near = (np.flatnonzero(maximum_filter(image[..., 3] > 0, MARGIN)) for image in views.images)
        self._pool: NDArray[np.integer] = np.concatenate([(p + k * size).astype(kind) for k, p in enumerate(near)])
        self._seed = seed

    def batch(self, number: int, rays: int) -> Batch:
        """Batch ``number`` (>= 0) of ``rays`` rays."""
        generator = np.random.default_rng((self._seed, number))
        pixels = self._pool[generator.integers(0, len(self._pool), rays)].astype(np.int64)
        rgba = torch.from_numpy(self._pixels[pixels].astype(np.float32) / np.float32(255.0)).to(self._caster.device)
        which = torch.from_numpy(pixels)
        return Batch(self._caster.rays(which), rgba[:, :3], rgba[:, 3], which)

    def axes(self, batch: Batch) -> Tensor:
        """Unit vectors along the axis of each ray's camera, backwards. (R, 3)"""
        return self._caster.axes(batch.pixels)

    def visible_colours(self, most: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Straight RGB (N, 3) and alpha (N,) in [0, 1] of at most ``most`` evenly drawn visible pixels."""
        generator = np.random.default_rng(self._seed)
        chosen = self._pool if len(self._pool) <= most else generator.choice(self._pool, most, replace=False)
        rgba = self._pixels[chosen].astype(np.float32) / np.float32(255.0)
        rgba = rgba[rgba[:, 3] > 0]
        return rgba[:, :3], rgba[:, 3]
