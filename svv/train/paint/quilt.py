"""A style picture as paint on surfaces: pieces of it, laid such that strokes follow the form and continue one another.

Image quilting (Efros & Freeman 2001) with the pieces of lapped textures (Praun, Finkelstein & Hoppe 2000): a seed gets
a piece whose strokes run along the surface, from the place that best continues the paint already laid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from svv.errors import Progress
from svv.train.paint.quilt_kernels import REACH, misfits, nearest, paint, places
from svv.train.paint.surface_form import Floats, Form, tangents

RADIUS = 30.0
"""Radius of a piece, in pixels of the style picture at its painted size: room for an eddy, a crest or a few tiles."""

SPACING = 0.62
"""Minimum distance of seeds, in radii."""

TURNING = 0.8
"""Distance added per unit of difference between two normals, in radii: it separates the two sides of thin sheets."""

CANDIDATES = 256
"""Number of places in the picture that are tried for each piece."""

OVERLAP = 160
"""Maximum number of points compared in the overlap."""

NEIGHBOURS = 14
"""Number of pieces considered for a point's colour."""

DECIDED = 0.12
"""Distinctness of form times coherence of strokes from which a piece is turned; below it, the piece stays upright."""

INK = 0.12
"""How far strokes extend across the borders of pieces."""

LIGHT = np.array([-0.45, 0.75, 0.5])
"""Direction to the light that determines light and dark in a painting: from the upper left, the painters' custom."""


@dataclass(frozen=True)
class Guides:
    """Weights of the criteria for a piece; its misfit to the paint already laid, in the picture's variance, has 1."""

    tone: float = 1.0
    """Weight of the squared difference in brightness rank: light parts of the picture suit lit places of the form."""
    turned: float = 0.02
    """Weight of the squared angle, in radians, by which a piece is turned."""
    used: float = 0.5
    """Weight of how often a part of the picture has been used, relative to the mean."""
    along_form: bool = True
    """Whether pieces are turned along the form; otherwise all stay upright."""


class Manner:
    """A prepared style picture (H, W, 3): where it has strokes, in which direction they run, and how bright it is.

    The picture is at its painted size; ``mask`` (H, W) is the part to learn from, by default all of it.
    """

    def __init__(self, picture: Floats, mask: NDArray[np.bool_] | None = None) -> None:
        self.picture = np.ascontiguousarray(picture, np.float32)
        height, width = picture.shape[:2]
        self.mean = picture.reshape(-1, 3).mean(0) if mask is None else picture[mask].mean(0)
        away = np.linalg.norm(picture - self.mean, axis=2)
        self.spread = float(max(away.mean(), 1e-3))
        self.variance = float(max(np.square(away).mean(), 1e-4))
        reach = min(RADIUS / 3.0, min(height, width) / 4.0)
        tensor = np.zeros((3, height, width))
        for channel in np.moveaxis(gaussian_filter(picture, (0.7, 0.7, 0)), 2, 0):
            down, across = np.gradient(channel)
            tensor += (across * across, down * down, -across * down)  # up is positive, as on the surface
        xx, yy, xy = (gaussian_filter(t, reach) for t in tensor)
        self.angle = 0.5 * np.arctan2(2 * xy, xx - yy) + 0.5 * np.pi
        """Anticlockwise angle of the strokes from the horizontal, in radians. (H, W)"""
        self.coherence = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-6)
        """How consistently strokes run in one direction, in [0, 1]. (H, W)"""
        tone = gaussian_filter(picture @ np.array([0.299, 0.587, 0.114]), reach)
        inside = np.ones((height, width), bool) if mask is None else mask
        order = np.sort(tone[inside])
        self.rank = np.searchsorted(order, tone) / max(len(order), 1)
        """Fraction of the picture that is darker. (H, W)"""
        margin = int(min(0.6 * RADIUS, min(height, width) / 4))
        allowed = inside.copy()
        allowed[:margin] = allowed[height - margin :] = False
        allowed[:, :margin] = allowed[:, width - margin :] = False
        self.places = np.argwhere(allowed if allowed.any() else inside)
        """Rows and columns at which a piece may have its centre. (M, 2)"""


class Quilt:
    """Pieces of one picture on one region."""

    def __init__(
        self, manner: Manner, form: Form, surface: Floats, pixel: float, seed: int, progress: Progress,
        guides: Guides | None = None, through: bool = False,
    ) -> None:  # fmt: skip
        """Lay pieces of a picture on a region's visible points (S, 3); a pixel's side is in box units.

        A piece may extend ``through`` a shell whose two sides are visible at the same time.
        """
        self.manner, self.form, self.radius, self.through = manner, form, RADIUS * pixel, through
        self.guides = guides or Guides()
        self._generator = np.random.default_rng(seed)
        surface = surface[self._generator.permutation(len(surface))]
        normal, tangent, decided = form.frames(surface)
        sides = normal * (0.0 if through else TURNING * self.radius)
        seeds = spread(np.concatenate([surface, sides], 1), SPACING * self.radius)
        self.middle, self.outward = surface[seeds], normal[seeds]
        right, upward = tangents(self.outward.astype(np.float64), form.up)
        self.right, self.upward = right.astype(np.float32), upward.astype(np.float32)
        self._along = np.arctan2((tangent[seeds] * upward).sum(1), (tangent[seeds] * right).sum(1))
        self._decided = decided[seeds]
        lit = self.outward @ (LIGHT / np.linalg.norm(LIGHT))
        self._wanted = np.argsort(np.argsort(lit)) / max(len(lit) - 1, 1)
        """Fraction of the pieces that face the light less. (K,)"""
        self.centre = np.zeros((len(seeds), 2), np.float32)
        """Centre of each piece in the picture, across and down. (K, 2)"""
        self.turn = np.zeros(len(seeds), np.float32)
        """Anticlockwise turn of each piece in radians. (K,)"""
        self._tree = cKDTree(self.middle)
        self._lay(surface, normal, progress)

    def _lay(self, surface: Floats, normal: Floats, progress: Progress) -> None:
        """Choose all pieces one by one, each to continue those already on the surface."""
        size = np.array(self.manner.picture.shape[:2])
        uses = np.zeros(np.maximum(size // max(int(RADIUS // 2), 1), 1))
        tree = cKDTree(surface)
        colours, score = np.zeros((len(surface), 3), np.float32), np.full(len(surface), -1.0, np.float32)
        for number, k in enumerate(self._order()):
            if number % 16 == 0:
                progress(number / len(self.middle), "laying strokes")
            own = np.array(tree.query_ball_point(self.middle[k], 1.6 * self.radius), np.int64)
            at, suits = np.empty((len(own), 2), np.float32), np.empty(len(own), np.float32)
            frame = self.right[k], self.upward[k], self.outward[k], np.float32(self.radius)
            places(surface[own], normal[own], self.middle[k], *frame, self.through, at, suits)
            own, at, suits = own[suits >= 0], at[suits >= 0], suits[suits >= 0]
            there = (score[own] >= 0).nonzero()[0]
            if len(there) > OVERLAP:
                there = self._generator.choice(there, OVERLAP, replace=False)
            self._choose(k, at[there], suits[there], colours[own[there]], uses)
            if len(own):
                found, better = np.empty((len(own), 3), np.float32), np.empty(len(own), np.float32)
                self._paint(surface[own], normal[own], np.full((len(own), 1), k), found, better)
                wins = better > score[own]
                colours[own[wins]], score[own[wins]] = found[wins], better[wins]
        progress(1.0, "laying strokes")

    def _choose(self, k: int, at: Floats, suits: Floats, colours: Floats, uses: NDArray[np.float64]) -> None:
        """Choose piece k's place in the picture, and count it in ``uses``, the uses of each block of the picture.

        ``at`` (N, 2), in radii, ``suits`` (N,) and ``colours`` (N, 3) belong to points that are already painted.
        """
        manner, guides = self.manner, self.guides
        chosen = manner.places[self._generator.integers(0, len(manner.places), CANDIDATES)]
        row, column = chosen.T
        turns = (self._along[k] - manner.angle[row, column] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        turns[manner.coherence[row, column] * self._decided[k] < (DECIDED if guides.along_form else np.inf)] = 0.0
        cost = np.zeros(CANDIDATES, np.float32)
        if len(at):
            centres = np.ascontiguousarray(chosen[:, ::-1], np.float32)
            weights = np.float32(0.05) + suits
            misfits(manner.picture, np.float32(RADIUS) * at, weights, colours, centres, turns.astype(np.float32), cost)
        block = tuple((chosen * uses.shape // np.array(manner.picture.shape[:2])).T)
        cost = cost / manner.variance + guides.tone * np.square(manner.rank[row, column] - self._wanted[k])
        cost += guides.turned * np.square(turns) + guides.used * uses[block] / max(uses.mean(), 0.2)
        best = int(cost.argmin())
        uses[block[0][best], block[1][best]] += 1
        self.centre[k], self.turn[k] = chosen[best][::-1], turns[best]

    def _order(self) -> NDArray[np.int64]:
        """Return the order of the pieces: each lies next to an earlier one wherever possible."""
        count = len(self.middle)
        _, near = self._tree.query(self.middle, min(9, count))
        near = np.reshape(near, (count, -1))
        left, order, stack = np.ones(count, bool), [], []
        for first in self._generator.permutation(count):
            stack.append(int(first))
            while stack:
                k = stack.pop(0)
                if left[k]:
                    left[k] = False
                    order.append(k)
                    stack.extend(int(j) for j in near[k] if left[j])
        return np.array(order)

    def _paint(self, position: Floats, normal: Floats, near: NDArray[np.int64], colours: Floats, suits: Floats) -> None:
        paint(position, normal, near, self.middle, self.right, self.upward, self.outward, self.centre, self.turn,
              self.manner.picture, self.manner.mean.astype(np.float32), np.float32(self.manner.spread),
              np.float32(self.radius), np.float32(RADIUS), np.float32(INK), self.through,
              colours, suits)  # fmt: skip

    def __call__(self, position: Floats) -> Floats:
        """Return the colours at box coordinates (S, 3) -> (S, 3); the picture's mean colour where no piece reaches."""
        out = np.empty((len(position), 3), np.float32)
        for first in range(0, len(position), 1 << 18):
            part = np.ascontiguousarray(position[first : first + (1 << 18)], np.float32)
            normal = self.form.normals(part)
            near = np.empty((len(part), min(NEIGHBOURS, len(self.middle))), np.int64)
            nearest(part, self.middle, REACH * self.radius, near)
            colours = np.empty((len(part), 3), np.float32)
            colours[:] = self.manner.mean
            self._paint(part, normal, near, colours, np.empty(len(part), np.float32))
            out[first : first + len(part)] = colours
        return out


def spread(points: Floats, distance: float) -> NDArray[np.int64]:
    """Return indices of points (S, D) that are at least ``distance`` apart, with every other point nearer to one."""
    tree = cKDTree(points)
    left, chosen = np.ones(len(points), bool), []
    for k in range(len(points)):
        if left[k]:
            chosen.append(k)
            left[tree.query_ball_point(points[k], distance)] = False
    return np.array(chosen, np.int64)
