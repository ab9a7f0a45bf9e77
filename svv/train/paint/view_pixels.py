"""Pixels of views, and what each shows of regions, before and behind others. S samples, P pixels, R regions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from svv.train.paint.styled_views import StyledView

SHOWN = 0.02
"""Weight in a pixel from which a region is seen there."""

Floats = NDArray[np.float64]


class ViewPixels:
    """Pixels of views, all or at most ``most`` of each of some regions, after edits' factors on extinction (R,)."""

    def __init__(
        self, views: Sequence[StyledView], opacity: Floats, regions: Sequence[int] | None = None, most: int = 0
    ) -> None:
        self.count = len(opacity)
        where, weight, region, pixel, first = [], [], [], [], 0
        for view in views:
            own = view.region.cpu().numpy().astype(np.int64), view.pixel.cpu().numpy().astype(np.int64)
            much = view.weight.cpu().numpy().astype(np.float64)
            total = view.height * view.width
            if regions is None:
                chosen = np.ones(total, bool)
            else:
                inside = _inside(*own, much, total, self.count)
                chosen = np.zeros(total, bool)
                for k in regions:
                    shown = np.flatnonzero(inside[:, k] > SHOWN)
                    chosen[shown[:: max(len(shown) // most, 1)]] = True
            kept = chosen[own[1]]
            where.append(view.position.cpu().numpy()[kept])
            weight.append(much[kept])
            region.append(own[0][kept])
            pixel.append(own[1][kept] + first)
            first += total
        self.where = np.ascontiguousarray(np.concatenate(where), np.float32)
        """Box coordinates of the samples. (S, 3)"""
        self.region: NDArray[np.int64] = np.concatenate(region)
        """Their regions. (S,)"""
        _, index = np.unique(np.concatenate(pixel), return_inverse=True)
        self.pixel: NDArray[np.int64] = index.reshape(-1).astype(np.int64)
        """Their pixels, in ascending order, front to back within each. (S,)"""
        self.pixels = int(self.pixel.max(initial=-1)) + 1
        self.whole: Floats = np.concatenate(weight)
        """Their weights without edits. (S,)"""
        self.weight = _edited(self.whole, self.pixel, opacity[self.region])
        """Their weights. (S,)"""

    @cached_property
    def inside(self) -> Floats:
        """Weight of each region in each pixel. (P, R)"""
        return _inside(self.region, self.pixel, self.weight, self.pixels, self.count)

    @cached_property
    def together(self) -> Floats:
        """Share of the pixels of one region in which another is seen too, of the two the larger. (R, R)"""
        there = (self.inside > SHOWN).astype(np.float64)
        pixels = np.maximum(there.sum(0), 1.0)
        return np.asarray(there.T @ there / np.minimum(pixels[:, None], pixels))

    @cached_property
    def encloses(self) -> NDArray[np.bool_]:
        """Whether one region encloses another: it lies before it in most of its pixels, and not the reverse. (R, R)"""
        index = self.pixel * self.count + self.region
        nearest = np.full(self.pixels * self.count, len(index))
        np.minimum.at(nearest, index, np.arange(len(index)))
        first = nearest.reshape(self.pixels, self.count)
        there = self.inside > SHOWN
        ahead = np.stack([
            (there & there[:, k : k + 1] & (first[:, k : k + 1] < first)).sum(0) for k in range(self.count)
        ])  # fmt: skip
        before = ahead / np.maximum(there.sum(0), 1)
        return np.asarray((before > 0.5) & (before > 1.5 * before.T))

    def mixed(self, region: int, colours: NDArray[np.floating]) -> Floats:
        """Return the colours that pixels show of a region alone (P, 3), 0 without it, from its samples' (s, 3)."""
        own = self.region == region
        pixel, weight = self.pixel[own], self.whole[own]
        total = np.bincount(pixel, weight, self.pixels)
        sums = np.stack([np.bincount(pixel, weight * channel, self.pixels) for channel in colours.T], 1)
        return np.asarray(sums / np.maximum(total, 1e-9)[:, None])


def _inside(
    region: NDArray[np.int64], pixel: NDArray[np.int64], weight: Floats, pixels: int, regions: int
) -> Floats:  # fmt: skip
    found = np.bincount(pixel * regions + region, weight, pixels * regions)
    return np.asarray(found.reshape(pixels, regions), np.float64)


def _edited(weight: Floats, pixel: NDArray[np.int64], opacity: Floats) -> Floats:
    """Return the weights of samples, front to back in each pixel, after factors on their extinction. (S,)"""
    if (opacity == 1.0).all():
        return weight
    before = _before(weight, pixel)
    tau = -np.log(np.maximum(1.0 - weight / np.maximum(1.0 - before, 1e-6), 1e-6)) * opacity
    return np.asarray(np.exp(-_before(tau, pixel)) * -np.expm1(-tau))


def _before(values: Floats, pixel: NDArray[np.int64]) -> Floats:
    """Return the sum of the values of earlier samples of the same pixel. (S,)"""
    total = np.cumsum(values) - values
    first = np.flatnonzero(np.diff(pixel, prepend=-1))
    return np.asarray(total - np.repeat(total[first], np.diff(np.append(first, len(pixel)))))
