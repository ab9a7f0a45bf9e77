"""Training rays, drawn from the visible pixels of a view set and from their immediate surroundings."""

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
from svv.train import ranks

MARGIN = 9
"""Side in pixels of the square by which the visible part of an image is dilated: its outline must be learned, too."""


@dataclass(frozen=True)
class Batch:
    """R rays and the colours of their pixels in the views."""

    rays: Rays
    """The rays."""
    colour: Tensor
    """Straight RGB in [0, 1]. (R, 3)"""
    alpha: Tensor
    """Alpha in [0, 1]. (R,)"""
    pixels: Tensor
    """Flat indices of the pixels among all views. (R,) int64"""
    first: int = 0
    """Number of the first ray, if these are a part of a batch."""
    share: float = 1.0
    """The fraction of the whole batch that these are."""

    @property
    def premultiplied(self) -> Tensor:
        """Colour over black. With the error of alpha it tells as much as random backgrounds do, but without noise."""
        return self.colour * self.alpha[:, None]


class RayBudget:
    """The number of rays per step: fewer when they give many samples, because samples determine the cost of a step."""

    def __init__(self, most: int, samples: int) -> None:
        """Allow at most ``most`` rays, and at least a quarter of that, for about ``samples`` samples."""
        self.rays, self._most, self._samples = most, most, samples

    def adjust(self, number: int, samples: float) -> None:
        """Adapt to the samples that this rank's part of the rays gave in step ``number``; every 16th step counts."""
        if number % 16 == 0:
            ideal = self._samples * self.rays / max(int(ranks.total(samples)), 1)
            self.rays = int(np.clip(ideal, self._most // 4, self._most))


class RayPool:
    """Draws batches of rays; batch k of a seed is always the same, so a resumed run continues as if uninterrupted."""

    def __init__(self, views: ViewSet, box: Box, seed: int, device: torch.device, headlight: str = "point") -> None:
        self._caster = RayCaster(views.cameras, box, device, headlight)
        self._pixels = views.images.reshape(-1, 4)
        size = views.images.shape[1] * views.images.shape[2]
        # Tens of millions of numbers: use the smaller type if it suffices.
        kind = np.int32 if len(self._pixels) <= np.iinfo(np.int32).max else np.int64
        near = (np.flatnonzero(maximum_filter(image[..., 3] > 0, MARGIN)) for image in views.images)
        self._pool: NDArray[np.integer] = np.concatenate([(p + k * size).astype(kind) for k, p in enumerate(near)])
        self._seed = seed

    def batch(self, number: int, rays: int, part: slice | None = None) -> Batch:
        """Return batch ``number`` (>= 0) of ``rays`` rays, or a part of it."""
        generator = np.random.default_rng((self._seed, number))
        part = part or slice(0, rays)
        pixels = self._pool[generator.integers(0, len(self._pool), rays)[part]].astype(np.int64)
        rgba = torch.from_numpy(self._pixels[pixels].astype(np.float32) / np.float32(255.0)).to(self._caster.device)
        which = torch.from_numpy(pixels)
        share = len(pixels) / rays
        return Batch(self._caster.rays(which), rgba[:, :3], rgba[:, 3], which, part.start, share)

    def visible_colours(self, most: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return straight RGB (N, 3) and alpha (N,) in [0, 1] of at most ``most`` visible pixels, drawn uniformly."""
        generator = np.random.default_rng(self._seed)
        chosen = self._pool if len(self._pool) <= most else generator.choice(self._pool, most, replace=False)
        rgba = self._pixels[chosen].astype(np.float32) / np.float32(255.0)
        rgba = rgba[rgba[:, 3] > 0]
        return rgba[:, :3], rgba[:, 3]
