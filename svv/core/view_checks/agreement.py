"""How well cameras agree with pictures, by the silhouettes of whatever is denser or brighter than some levels.

The silhouette of everything visible may say nothing, as that of a ball about the centre; what is opaque inside of it,
or bright, has one, too. A level whose silhouettes disagree is no proof by itself: in fog, what is dense along one ray
may be thin along another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.view_checks.outline_kernels import trace
from svv.core.view_checks.silhouettes import TANGENTS, Silhouettes, Views, differences, outermost

Array = NDArray[np.float64]
Images = NDArray[np.uint8]

MOST_VIEWS = 40
"""Views that are compared, spread evenly over the set."""

LONG_SIDE = 400
"""Pixels of the longer side to which pictures are thinned out."""

OPACITIES = (2, 16, 64, 128, 200, 250)
"""Levels of alpha above which a pixel belongs to a silhouette."""

CONTRASTS = (16, 48, 96, 160)
"""The same for the largest difference of a channel from that of the background."""

CLEANED = (16, 96)
"""Levels at which dust is removed: a pixel counts if most of the 3 x 3 around it do."""

LEVELS = len(OPACITIES) + len(CONTRASTS) + len(CLEANED)
"""Number of levels: those of alpha, those of contrast and those without dust."""

OUTLINE = len(OPACITIES) + len(CONTRASTS)
"""The level of everything visible, without dust."""

OF_ALPHA = np.repeat((True, False, True), (len(OPACITIES), len(CONTRASTS), len(CLEANED)))
"""Which are levels of alpha. (LEVELS,)"""

LEAST_FOUND = 20
"""Differences of a level below which it says nothing."""

MOST_PAIRS = 150
"""Pairs of views that are compared for one assumption about the cameras."""


@dataclass(frozen=True)
class Outlines:
    """Silhouettes of some views at several levels."""

    chosen: NDArray[np.intp]
    """Indices of the views. (n,)"""
    levels: tuple[Silhouettes, ...]
    """The silhouettes of these views at each level that has some."""
    reach: Array
    """Radius of a typical silhouette of each level in pixels. (levels,)"""
    of_alpha: NDArray[np.bool_]
    """Which are levels of alpha. The others are of brightness, which light from the camera moves over a surface, so
    they may disagree with right cameras. (levels,)"""
    inner: NDArray[np.bool_]
    """Which are only of what lies inside of outlines that frames cut off: what is denser than a level along rays, which
    may disagree with right cameras if it is not opaque. (levels,)"""
    cut: float
    """Fraction of the views whose frames cut off what is visible."""

    def fewer(self, views: int, levels: int, tangents: int = 1) -> Outlines:
        """Return some of the views at some of the levels, spread evenly, with every so many-th tangent."""
        own = _spread(len(self.chosen), views)
        which = _spread(len(self.levels), levels)
        taken = tuple(self.levels[k].take(own, tangents) for k in which)
        return Outlines(self.chosen[own], taken, self.reach[which], self.of_alpha[which], self.inner[which], self.cut)

    def residuals(self, views: Views, most: int = MOST_PAIRS) -> tuple[Array, NDArray[np.intp]]:
        """Return by how many pixels the silhouettes of each level differ with cameras of the chosen views.

        Compares at most ``most`` pairs of views. Returns medians in pixels, infinite where fewer than
        :data:`LEAST_FOUND` can be compared, and how many can. (levels,), (levels,)
        """
        medians, counts = np.full(len(self.levels), np.inf), np.zeros(len(self.levels), np.intp)
        for k, silhouettes in enumerate(self.levels):
            found = differences(views, silhouettes, most)
            found = np.abs(found[np.isfinite(found)])
            counts[k] = len(found)
            if len(found) >= LEAST_FOUND:
                medians[k] = np.median(found)
        return medians, counts

    def faced(self, views: Views) -> float:
        """Return the fraction of views that have the point where their lines of sight meet in front of them."""
        silhouettes = self.levels[0]  # of a set that has any
        usable = silhouettes.usable & ~views.parallel
        if not usable.any():
            return 1.0
        middle = silhouettes.points[usable].mean(axis=1) - views.centres[usable]
        ray = np.concatenate([middle * (1.0, -1.0) / views.focal[usable, None], -np.ones((len(middle), 1))], axis=1)
        ray = np.einsum("nab,nb->na", views.matrices[usable, :3, :3], ray)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        away = np.eye(3) - ray[:, :, None] * ray[:, None]
        position = views.matrices[usable, :3, 3]
        meeting = np.linalg.lstsq(away.sum(0), np.einsum("nab,nb->a", away, position), rcond=None)[0]
        return float((((meeting - position) * ray).sum(axis=1) > 0.0).mean())


class Tracing:
    """Finds the silhouettes of pictures, looking at each of them once."""

    def __init__(self, images: Images) -> None:
        """Look at nothing yet. RGBA pictures (n, height, width, 4)"""
        self._images, self._step = images, step_of(images)
        self._known: dict[tuple[int, tuple[int, ...]], _Traced] = {}

    def outlines(self, chosen: NDArray[np.intp]) -> Outlines:
        """Return the silhouettes of some of the pictures, given by their indices."""
        background = self._background(chosen)
        missing = np.array([k for k in chosen.tolist() if (k, background) not in self._known], np.intp)
        for k, one in zip(missing.tolist(), self._traced(missing, background), strict=True):
            self._known[k, background] = one
        traced = [self._known[k, background] for k in chosen.tolist()]
        # Levels are alike if they are in the code of every pixel.
        bits = np.unique(np.concatenate([one.codes for one in traced])) >> np.arange(LEVELS)[:, None] & 1
        different = [k for k in range(LEVELS) if not (bits[:k] == bits[k]).all(axis=1).any()]
        cut, found, inner = np.array([one.is_cut for one in traced]), {}, []
        for k in different:
            usable = np.array([one.whole[k] for one in traced])
            enough = bool((usable & ~cut).sum() > 2)
            if usable.sum() > 2:
                usable &= ~cut if enough else True
                found[k] = Silhouettes(np.stack([one.points[k] for one in traced]), usable)
                inner.append(not enough)
        reach = np.array([_reach(silhouettes) for silhouettes in found.values()])
        within, part = np.array(inner, np.bool_), float(cut.mean())
        return Outlines(chosen, tuple(found.values()), reach, OF_ALPHA[list(found)], within, part)

    def _traced(self, which: NDArray[np.intp], background: tuple[int, ...]) -> Iterator[_Traced]:
        """Look at some of the pictures."""
        height = len(range(self._images.shape[1])[self._step // 2 :: self._step])
        ends = np.empty((len(which), LEVELS, 2, height), np.int16)
        whole, codes = np.empty((len(which), LEVELS), np.bool_), np.zeros((len(which), 1 << LEVELS), np.bool_)
        trace(self._images, which, self._step, np.array(background), TABLES, ends, whole, codes)
        for n in range(len(which)):
            points = np.zeros((LEVELS, TANGENTS, 2))
            for k in range(LEVELS):
                sides, rows = np.nonzero(ends[n, k] >= 0)
                if len(rows):
                    points[k] = outermost(np.stack([ends[n, k, sides, rows], rows], 1), self._step)
            yield _Traced(points, whole[n], np.flatnonzero(codes[n]))

    def _background(self, chosen: NDArray[np.intp]) -> tuple[int, ...]:
        """Return from which RGB pixels differ: that of empty ones, or -1 for black if alpha has many levels."""
        first, step = self._step // 2, self._step
        some = self._images[:, first :: 4 * step, first :: 4 * step, 3]
        if not all(((some[k] == 0) | (some[k] == 255)).all() for k in chosen):
            return -1, -1, -1
        thin = self._images[:, first::step, first::step]
        counts = [thin[k, ..., 3].size - int(np.count_nonzero(thin[k, ..., 3])) for k in chosen]
        apart, done, parts = max(1, sum(counts) // 10000), 0, []  # ten thousand pixels, evenly among all
        for k, count in zip(chosen, counts, strict=True):
            empty = np.flatnonzero(thin[k, ..., 3] == 0)[-done % apart :: apart]
            parts.append(thin[k, empty // thin.shape[2], empty % thin.shape[2], :3])
            done += count
        return tuple(np.median(np.concatenate(parts), axis=0).astype(np.int64).tolist()) if done else (0, 0, 0)


@dataclass(frozen=True)
class _Traced:
    """What was found in one picture."""

    points: Array
    """Its silhouettes (:attr:`svv.core.view_checks.silhouettes.Silhouettes.points`). (LEVELS, TANGENTS, 2)"""
    whole: NDArray[np.bool_]
    """Which of them are there and wholly inside the picture. (LEVELS,)"""
    codes: NDArray[np.intp]
    """The codes of its pixels, in ascending order."""

    @property
    def is_cut(self) -> bool:
        """Whether the frame cuts off what is visible, apart from dust."""
        return not self.whole[OUTLINE] and bool(self.points[OUTLINE].any())


def step_of(images: Images) -> int:
    """Return every how many-th pixel of pictures is looked at, from half of that on. (n, height, width, 4)"""
    return max(1, min(round(max(images.shape[1:3]) / LONG_SIDE), *images.shape[1:3]))


def some_of(count: int) -> NDArray[np.intp]:
    """Return the indices of those of ``count`` views that are compared."""
    return _spread(count, MOST_VIEWS)


def _spread(count: int, most: int) -> NDArray[np.intp]:
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)


def _tables() -> NDArray[np.int64]:
    """Return the tables by which pixels are given their levels (:func:`trace`). (4, 256)"""
    values, numbers = np.arange(256), np.arange(LEVELS)[:, None]
    opaque, contrasting = np.array(OPACITIES)[:, None], np.array(CONTRASTS)[:, None]
    both = np.stack([values & 15, values >> 4])  # pixels of a square above either level of CLEANED
    bits = np.concatenate([values > opaque, values > contrasting, both > 4]) << numbers
    of_alpha, of_contrast, of_square = np.split(bits, np.cumsum([len(OPACITIES), len(CONTRASTS)]))
    of_pixel = (values > CLEANED[0]) + 16 * (values > CLEANED[1])
    return np.stack([of_alpha.sum(axis=0), of_contrast.sum(axis=0), of_pixel, of_square.sum(axis=0)])


TABLES = _tables()


def _reach(silhouettes: Silhouettes) -> float:
    points = silhouettes.points[silhouettes.usable]
    return float(np.median(0.5 * (points.max(axis=1) - points.min(axis=1)).max(axis=1)))
