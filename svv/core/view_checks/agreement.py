"""How well cameras agree with pictures, by the silhouettes of whatever is denser or brighter than some levels.

The silhouette of everything visible may say nothing: a ball about the centre looks the same from everywhere. What is
opaque inside of it, or bright, has a silhouette, too, which must agree with the cameras if it is seen from all sides.
A level whose silhouettes disagree is no proof by itself: in fog, what is dense along one ray may be thin along another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from svv.core.view_checks.silhouettes import Silhouettes, Views, differences

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

    @classmethod
    def of(cls, images: Images) -> Outlines:
        """Find the silhouettes of RGBA pictures. (n, height, width, 4)"""
        chosen, thin, step = thinned(images)
        masks: list[NDArray[np.bool_]] = []
        for values, levels in ((thin[..., 3], OPACITIES), (_contrast(thin), CONTRASTS)):
            masks += [values > level for level in levels]
        masks += [uniform_filter((thin[..., 3] > level).astype(np.float32), (0, 3, 3)) > 0.5 for level in CLEANED]
        of_alpha = np.ones(len(masks), bool)
        of_alpha[len(OPACITIES) : len(OPACITIES) + len(CONTRASTS)] = False
        different = [k for k, m in enumerate(masks) if not any(np.array_equal(m, other) for other in masks[:k])]
        silhouettes = {k: Silhouettes.of(list(masks[k]), step) for k in different}
        found = {k: s for k, s in silhouettes.items() if s.usable.sum() > 2}
        return cls(chosen, tuple(found.values()), np.array([_reach(s) for s in found.values()]), of_alpha[list(found)])

    def fewer(self, views: int, levels: int, tangents: int = 1) -> Outlines:
        """Return some of the views at some of the levels, spread evenly, with every so many-th tangent."""
        own = _spread(len(self.chosen), views)
        which = _spread(len(self.levels), levels)
        taken = tuple(self.levels[k].take(own, tangents) for k in which)
        return Outlines(self.chosen[own], taken, self.reach[which], self.of_alpha[which])

    def residuals(self, views: Views, most: int = MOST_PAIRS) -> tuple[Array, NDArray[np.intp]]:
        """Return by how many pixels the silhouettes of each level differ with these cameras.

        Args:
            views: Cameras of the chosen views.
            most: Most pairs of views that are compared.

        Returns:
            Medians in pixels, infinite where fewer than :data:`LEAST_FOUND` can be compared, and how many can.
            (levels,), (levels,)
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


def thinned(images: Images) -> tuple[NDArray[np.intp], Images, int]:
    """Return some views, spread evenly, and every so many-th of their pixels: indices, pixels, and how many-th."""
    chosen = _spread(len(images), MOST_VIEWS)
    step = max(1, round(max(images.shape[1:3]) / LONG_SIDE))
    return chosen, images[chosen, step // 2 :: step, step // 2 :: step], step


def _spread(count: int, most: int) -> NDArray[np.intp]:
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)


def _contrast(images: Images) -> Images:
    """Return how much pixels differ from the background: that of empty pixels, or black if alpha has many levels."""
    alpha = images[..., 3]
    if np.isin(alpha[:, ::4, ::4], (0, 255)).all():
        empty = images[..., :3][alpha == 0]
        background = np.median(empty[:: max(1, len(empty) // 10000)], axis=0) if len(empty) else np.zeros(3)
        apart = np.abs(images[..., :3].astype(np.int16) - background.astype(np.int16)).max(axis=-1)
        return np.where(alpha > 0, apart, 0).astype(np.uint8)
    return (images[..., :3].max(axis=-1).astype(np.uint16) * alpha // 255).astype(np.uint8)


def _reach(silhouettes: Silhouettes) -> float:
    points = silhouettes.points[silhouettes.usable]
    return float(np.median(0.5 * (points.max(axis=1) - points.min(axis=1)).max(axis=1)))
