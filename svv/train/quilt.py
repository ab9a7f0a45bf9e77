"""A style picture as paint on surfaces: pieces of it, laid so that strokes follow the form and go on into each other.

Image quilting (Efros & Freeman 2001) with the pieces of lapped textures (Praun, Finkelstein & Hoppe 2000): seeds are
spread over what is visible, each gets a piece of the picture, turned so that its strokes run along the surface's
direction (:class:`svv.train.form.Form`), and of all places in the picture the one that continues what lies there
already. Nothing is learnt and nothing is averaged: what one sees are the picture's own strokes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from svv.errors import Progress
from svv.kernels.numba_quilting import misfits, paint, places
from svv.train.form import Floats, Form, tangents

RADIUS = 30.0
"""Of a piece, in pixels of the style picture as it is painted: a piece holds an eddy, a crest or a few tiles."""

SPACING = 0.62
"""Distance of seeds at least, in radii."""

TURNING = 0.8
"""How far apart two normals count as a distance, in radii for each unit of difference: thin sheets have two sides."""

CANDIDATES = 256
"""Places in the picture that are tried for each piece."""

OVERLAP = 160
"""Points of the overlap that are compared at most."""

NEIGHBOURS = 14
"""Pieces that are asked for a point's colour."""

DECIDED = 0.12
"""Product of how decided form and strokes are from which on a piece is turned; else it stands upright."""

INK = 0.12
"""How far strokes reach over the borders of pieces."""

LIGHT = np.array([-0.45, 0.75, 0.5])
"""Direction to the light that dark and light of a painting go by, from the left above, as painters have it."""


@dataclass(frozen=True)
class Guides:
    """Weights of what a piece is chosen by, besides how well it continues what lies there.

    That is the mean squared difference, as a part of the picture's own variance.
    """

    tone: float = 1.0
    """Of the squared difference of ranks in brightness: light places of the picture for lit places of the form."""
    turned: float = 0.02
    """Of the squared angle in radians that a piece is turned by."""
    used: float = 0.5
    """Of how often a part of the picture was used already, against the mean."""
    along_form: bool = True
    """Whether pieces are turned at all; else all of them stand upright."""


class Manner:
    """A style picture made ready: where it has strokes, which way they run, how bright it is.

    Args:
        picture: (H, W, 3) sRGB in [0, 1], at the size it is painted in.
        mask: (H, W), true where it teaches; all of it if not given.
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
        """Of the strokes against the horizontal, anticlockwise, radians. (H, W)"""
        self.coherence = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-6)
        """How much strokes run one way, [0, 1]. (H, W)"""
        tone = gaussian_filter(picture @ np.array([0.299, 0.587, 0.114]), reach)
        inside = np.ones((height, width), bool) if mask is None else mask
        order = np.sort(tone[inside])
        self.rank = np.searchsorted(order, tone) / max(len(order), 1)
        """Share of the picture that is darker. (H, W)"""
        margin = int(min(0.6 * RADIUS, min(height, width) / 4))
        allowed = inside.copy()
        allowed[:margin] = allowed[height - margin :] = False
        allowed[:, :margin] = allowed[:, width - margin :] = False
        self.places = np.argwhere(allowed if allowed.any() else inside)
        """Rows and columns where a piece may have its middle. (M, 2)"""


class Quilt:
    """Pieces of one picture on one region."""

    def __init__(
        self, manner: Manner, form: Form, surface: Floats, pixel: float, seed: int, progress: Progress,
        guides: Guides | None = None, through: bool = False,
    ) -> None:  # fmt: skip
        """Lay it.

        Args:
            manner: The style picture.
            form: The scene's.
            surface: Box coordinates of points that are seen of the region, about evenly spread. (S, 3)
            pixel: Side of a pixel of the picture on the surface, in box units.
            seed: Another one is another layout.
            progress: Called after every few pieces.
            guides: What pieces are chosen by.
            through: Whether a piece goes on through a shell, both of whose sides are seen at once.
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
        """Share of the pieces that the form turns less to the light. (K,)"""
        self.centre = np.zeros((len(seeds), 2), np.float32)
        """Where in the picture each piece has its middle, across and down. (K, 2)"""
        self.turn = np.zeros(len(seeds), np.float32)
        """Radians that each is turned by, anticlockwise. (K,)"""
        self._tree = cKDTree(self.middle)
        self._lay(surface, normal, progress)

    def _lay(self, surface: Floats, normal: Floats, progress: Progress) -> None:
        """Choose all pieces, each with those before it on the surface already."""
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
        """Choose piece k's place in the picture, and note it in ``uses``, counts of blocks of the picture.

        ``at`` (N, 2), in radii, ``suits`` (N,) and ``colours`` (N, 3) are of points that are painted already.
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
        """Pieces, each beside one that was laid before wherever there is one."""
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
        """Colours of box coordinates (S, 3) -> (S, 3); the nearest piece's mean where no piece reaches."""
        out = np.empty((len(position), 3), np.float32)
        for first in range(0, len(position), 1 << 18):
            part = np.ascontiguousarray(position[first : first + (1 << 18)], np.float32)
            normal = self.form.frames(part)[0]
            _, near = self._tree.query(part, min(NEIGHBOURS, len(self.middle)), workers=-1)
            near = np.reshape(near, (len(part), -1)).astype(np.int64)
            colours = np.empty((len(part), 3), np.float32)
            colours[:] = self.manner.mean
            self._paint(part, normal, near, colours, np.empty(len(part), np.float32))
            out[first : first + len(part)] = colours
        return out


def spread(points: Floats, distance: float) -> NDArray[np.int64]:
    """Indices of points (S, D) no two of which are nearer than a distance, and to one of which every other is."""
    tree = cKDTree(points)
    left, chosen = np.ones(len(points), bool), []
    for k in range(len(points)):
        if left[k]:
            chosen.append(k)
            left[tree.query_ball_point(points[k], distance)] = False
    return np.array(chosen, np.int64)
