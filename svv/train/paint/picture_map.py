"""A picture mapped onto a surface, loosely: which part of it a place resembles, and in which direction it flows there.

Patches of the surface have places of the same tone; around these, distances are the picture's, so hues change as there,
and where the form gives no direction, strokes run as there. Letters: S points of the surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from svv.styles.hand import Hand
from svv.train.paint import tracing_kernels as numba_tracing
from svv.train.paint.visible_surface import Bends, VisibleSurface

PATCH = 9.0
"""Distance of patches, in widths of a stroke."""

CANDIDATES = 200
"""Number of places in the picture that are tried for a patch."""

BLOCKS = 6
"""Blocks of the picture along its long side: those that were used less are preferred."""

USED = 0.05
"""Weight of how often a block was used, against the squared difference in tone."""

BLENDED = 4
"""Number of patches that a point lies between."""

ROUNDS, PULL = 10, 4.0
"""Rounds of smoothing directions, and weight of the neighbours against a point's own direction."""

ONE_WAY = (0.2, 0.6)
"""How much stronger one curvature is than the other, relative to their sum, from which a form has a direction, and from
which it is wholly distinct: round bodies would get rings around their poles."""

FORM, STRONG, CRUMPLED = 3.0, 0.25, 0.35
"""Weight of a form's direction where it is distinct; curvature times width from which it is; and deviation of normals,
in radians, at which it no longer is."""


class PictureMap:
    """The picture's place and flow on one surface, whose points have a tone in [0, 1] (S,)."""

    def __init__(
        self, hand: Hand, surface: VisibleSurface, tone: NDArray[np.float64], width: float,
        generator: np.random.Generator,
    ) -> None:  # fmt: skip
        self.hand, self.surface, self.width = hand, surface, width
        order = generator.permutation(len(surface))
        kept = np.empty(len(surface), np.int64)
        apart = np.full(len(surface), PATCH * width)
        tangent = surface.frames[0]
        points, normals = surface.points, surface.normals
        count = numba_tracing.seeds(order, points, normals, tangent, apart, apart, PATCH * width, kept)
        self.patches = kept[:count]
        smooth = surface.average(tone, 2)
        self.span = np.maximum(np.array(hand.size[::-1]) / max(hand.size), 1e-6)
        """The picture's width and height, in units of its long side. (2,)"""
        self.centre = np.empty((count, 2))
        """Place of each patch in the picture."""
        tree = cKDTree(hand.places)
        local = hand.tones[tree.query(hand.places, min(24, len(hand.places)))[1]].reshape(len(hand.places), -1).mean(1)
        uses = np.zeros((BLOCKS, BLOCKS))
        for number, s in enumerate(self.patches):
            tried = generator.integers(0, len(hand.places), CANDIDATES)
            block = tuple(np.minimum(hand.places[tried] / self.span * BLOCKS, BLOCKS - 1).astype(np.int64).T)
            cost = np.square(local[tried] - smooth[s]) + USED * uses[block] / max(float(uses.mean()), 0.2)
            best = int(cost.argmin())
            uses[block[0][best], block[1][best]] += 1
            self.centre[number] = hand.places[tried[best]]
        self.tree = cKDTree(surface.points[self.patches])
        self.picture_tree = tree

    def places(self, points: NDArray[np.floating], patch: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return where points (S, 3) of given patches (S,) lie in the picture, in units of its long side. (S, 2)"""
        right, upward = self.surface.frames
        s = self.patches[patch]
        away = points - self.surface.points[s]
        scale = self.hand.width / max(self.hand.size) / self.width
        place = self.centre[patch] + scale * np.stack([(away * right[s]).sum(1), (away * upward[s]).sum(1)], 1)
        folded = np.mod(place, 2.0 * self.span)  # beyond its border, the picture is mirrored
        return np.asarray(np.where(folded > self.span, 2.0 * self.span - folded, folded))

    def flow(self, bends: Bends) -> NDArray[np.float32]:
        """Return strokes' directions, unit tangents of either sign: the form's if distinct, or the picture's. (S, 3)"""
        surface, width = self.surface, self.width
        one_way = (bends.strongest - bends.weakest) / np.maximum(bends.strongest + bends.weakest, 1e-9)
        low, high = ONE_WAY
        distinct = ((one_way - low) / (high - low)).clip(0.0, 1.0)
        distinct *= np.minimum(bends.strongest * width / STRONG, 1.0) * np.exp(-np.square(bends.left / CRUMPLED))
        own = FORM * distinct[:, None] * _outer(bends.axis)
        own += (1.0 - distinct)[:, None] * self._of_picture()
        field = own.copy()
        for _ in range(ROUNDS):
            field = (own + PULL * surface.average(field)) / (1.0 + PULL)
        right, upward = (axis.astype(np.float64) for axis in surface.frames)
        matrix = field.reshape(-1, 3, 3)
        a, b, d = (np.einsum("si,sij,sj->s", one, matrix, other)
                   for one, other in ((right, right), (right, upward), (upward, upward)))  # fmt: skip
        angle = 0.5 * np.arctan2(2.0 * b, a - d + 1e-9)
        return (np.cos(angle)[:, None] * right + np.sin(angle)[:, None] * upward).astype(np.float32)

    def _of_picture(self) -> NDArray[np.float64]:
        """Return the picture's flow as outer products, a blend of the nearest patches. (S, 9)"""
        surface, hand = self.surface, self.hand
        away, near = self.tree.query(surface.points, min(BLENDED, len(self.patches)))
        away, near = (np.reshape(a, (len(surface), -1)) for a in (away, near))
        right, upward = surface.frames
        out = np.zeros((len(surface), 9))
        total = np.full((len(surface), 1), 1e-9)
        for distance, patch in zip(away.T, near.T, strict=True):
            s = self.patches[patch]
            weight = np.exp(-np.square(distance / (0.5 * PATCH * self.width)))
            weight *= ((surface.normals * surface.normals[s]).sum(1) > 0.0) + 1e-3
            among = self.picture_tree.query(self.places(surface.points, patch), min(6, len(hand.places)))[1]
            turned = (hand.coherences * np.exp(2j * hand.angles))[among].reshape(len(surface), -1).mean(1)
            angle, sure = 0.5 * np.angle(turned), np.abs(turned)
            along = np.cos(angle)[:, None] * right[s] + np.sin(angle)[:, None] * upward[s]
            out += (weight * (0.2 + sure))[:, None] * _outer(along)
            total += weight[:, None]
        return out / total


def _outer(directions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return outer products of directions (S, 3) with themselves. (S, 9)"""
    return np.asarray(directions[:, :, None] * directions[:, None, :], np.float64).reshape(-1, 9)
