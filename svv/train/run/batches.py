"""Training rays, drawn from the pixels of a view set (:mod:`svv.train.run.pixels`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry.box import Box
from svv.fields.radiance.rendering import RayCaster, Rays
from svv.io.views.viewset import ViewSet
from svv.kernels import reference
from svv.kernels.constants import moved, moved_at_once, numbers_on, on_device
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import PixelSource, Target
from svv.train.run import ranks
from svv.train.run.pixels import pixels_of, steps_to_draw
from svv.train.run.pixels_kernels import read
from svv.train.run.views_there import views_on


@dataclass(frozen=True)
class Batch:
    """R rays and the colours of their pixels in the views."""

    rays: Rays
    """The rays."""
    shown: Tensor
    """Premultiplied RGBA of the pixels in [0, 1]. Errors of colour over black and of alpha together tell as much as
    random backgrounds do, but without noise. (R, 4)"""
    pixels: Tensor
    """Flat indices of the pixels among all views. (R,) int64"""
    weight: Tensor
    """Weights with which a sum over the rays of all parts is, on average, the mean over all pixels. (R,)"""
    first: int = 0
    """Number of the first ray, if these are a part of a batch."""
    share: float = 1.0
    """The fraction of the whole batch that these are."""

    @property
    def target(self) -> Target:
        """What the rays should show, as kernels take it."""
        return Target(self.rays.lit_along, self.shown, self.weight)

    @property
    def premultiplied(self) -> Tensor:
        """Colour over black. (R, 3)"""
        return self.shown[:, :3]

    @property
    def alpha(self) -> Tensor:
        """Alpha in [0, 1]. (R,)"""
        return self.shown[:, 3]

    def loss(self, out: Tensor, transmittance: Tensor, each: Sequence[float], alpha: bool) -> tuple[Tensor, Tensor]:
        """Return the loss of what is composited, and the mean squared error of colour.

        Of ``each``, the first three weigh the squared errors of RGB, the first of ``out`` (R, C); the others its other
        values as they are, or with ``alpha`` the squared error of alpha.
        """
        factors, fused = numbers_on(each, out.device), kernels_for(out).TRAINING
        run = reference.loss if fused is None else fused.loss
        return run(out, transmittance, self.shown, self.weight, factors, alpha)


SAME = 1.0 / 16.0
"""Relative difference of numbers of rays that counts as none."""


class RayBudget:
    """The number of rays per step: fewer when they give many samples, because samples determine the cost of a step.

    Early steps take a part of them: far from the goal, many inexact steps get further than few exact ones.
    """

    def __init__(self, most: int, samples: int) -> None:
        """Allow at most ``most`` rays, and at least a quarter of that, for about ``samples`` samples."""
        self.rays, self._most, self._samples = most, most, samples

    def part(self, part: float) -> int:
        """Return the number of rays of a step that takes a ``part`` of the largest batch, at least 1."""
        return max(1, int(self.rays * part))

    def adjust(self, number: int, samples: float, rays: int) -> None:
        """Adapt to the samples of this rank's of ``rays`` in every 16th step; small differences record nothing anew."""
        if number % 16 == 0:
            ideal = self._samples * rays / max(int(ranks.total(samples)), 1)
            rays = int(np.clip(ideal, self._most // 4, self._most))
            if abs(rays - self.rays) > SAME * self.rays:
                self.rays = rays


SEED_STEP = 7919
"""Apart from each other, the seeds of batches of two runs whose seeds differ by one."""


class RayPool:
    """Draws batches of rays; batch k of a seed is always the same, so a resumed run continues as if uninterrupted."""

    def __init__(self, views: ViewSet, box: Box, seed: int, device: torch.device, headlight: str = "point") -> None:
        self._caster = RayCaster(views.cameras, box, device, headlight)
        self._levels, self._views = np.ascontiguousarray(views.images).reshape(-1, 4), views
        self._seed = seed
        self._there = views_on(views, device)
        self._sources: dict[float, PixelSource] = {}

    def seed_of(self, number: int) -> int:
        """Return the seed of the pixels of a batch that a GPU draws."""
        return (SEED_STEP * self._seed + number) % (1 << 31)

    def batch(
        self, number: int, rays: int, part: slice | None = None, by_contrast: float = 0.0,
        seed: int | Tensor | None = None,
    ) -> Batch:  # fmt: skip
        """Return batch ``number`` (>= 0) of ``rays`` rays, or a part of it.

        A fraction ``by_contrast`` is drawn by contrast (:meth:`svv.train.run.pixels.Pixels.drawn`), the others evenly.
        A GPU that draws them reads the ``seed``, by default :meth:`seed_of` the number.
        """
        part, device = part or slice(0, rays), self._caster.device
        if self._there is not None:
            source = self._source(by_contrast)
            seed = self.seed_of(number) if seed is None else seed
            count = part.stop - part.start
            drawn, weights, colours = kernels_for(source.index).draw_pixels(source, seed, part.start, count, rays)
            return Batch(self._caster.rays(drawn), colours, drawn, weights, part.start, count / rays)
        pixels, weight = pixels_of(self._views).drawn(np.random.default_rng((self._seed, number)), rays, by_contrast)
        pixels, weight = pixels[part], weight[part] / np.float32(rays)
        shown = np.empty((len(pixels), 4), np.float32)
        read(self._levels, pixels, shown)
        which = moved(pixels, device)
        colours, weights = moved_at_once((shown, weight), device)
        return Batch(self._caster.rays(which), colours, which, weights, part.start, len(pixels) / rays)

    def _source(self, by_contrast: float) -> PixelSource:
        """Return the pixels on the GPU, always at the same addresses."""
        assert self._there is not None
        if by_contrast not in self._sources:
            there, device = self._there, self._caster.device
            share, ends, first = steps_to_draw(there.counts, by_contrast)
            steps = on_device(first.astype(np.int64), device), on_device(ends, device), on_device(share, device)
            self._sources[by_contrast] = PixelSource(there.index, there.levels.view(-1, 4), *steps)
        return self._sources[by_contrast]

    def visible_colours(self, most: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return RGB (N, 3) and alpha (N,) in [0, 1] of visible pixels, of too many a stratified sample."""
        there, generator = self._there, np.random.default_rng(self._seed)
        count = len(pixels_of(self._views) if there is None else there.index)
        chosen = np.arange(min(count, most))
        if count > most:
            places = (chosen + generator.random(most)) * (count / most)
            chosen = np.minimum(places.astype(np.int64), count - 1)
        if there is None:
            levels = self._levels[pixels_of(self._views).ranked(chosen)]
        else:
            levels = there.levels.view(-1, 4)[there.index[moved(chosen, there.index.device)].long()].cpu().numpy()
        rgba = levels.astype(np.float32) / np.float32(255.0)
        rgba = rgba[rgba[:, 3] > 0]
        return rgba[:, :3], rgba[:, 3]
