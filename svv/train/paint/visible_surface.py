"""The visible surface of a region: where strokes lie, how deep one sees into it, how it bends, and how it is lit.

A region's samples along a ray without a gap are one sheet, which is seen at its mean position. S points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from svv.train.paint import ink_kernels as numba_inking
from svv.train.paint import tracing_kernels as numba_tracing
from svv.train.paint.quilt import LIGHT
from svv.train.paint.styled_views import StyledView
from svv.train.paint.surface_form import Floats, Form, in_cubes, slots_of, tangents

SIDE = 0.4
"""Side of the cubes with at most one point each, in widths of a stroke."""

GAP = 0.8
"""Distance of two samples along a ray that separates sheets, in widths of a stroke."""

LEAST_SEEN = 0.05
"""Weight in a pixel from which a sheet is painted."""

BENT = 1.7
"""Distance over which bends are measured, in widths of a stroke: strokes do not follow finer relief."""

AROUND, NEIGHBOURS = 2.2, 28
"""Distance over which values are averaged, in widths of a stroke, and largest number of neighbours used."""

THROUGH = 1.2
"""Distance of two opposite sides, in deviations of the visible depth, below which they are one sheet seen from both."""

MOST_CELLS = 128
"""Largest number of cells along the box in which values of both sides are averaged: fine strokes would fill memory."""

SKY = 32
"""Number of directions of which those above a point show how open it is."""

SUN, OPEN, RAISED = 0.6, 0.7, 0.5
"""Weights of the light, of openness to the sky and of curvature in a point's tone, in their standard deviations."""

COUNTER = 0.45
"""Strength of the light from the opposite side."""

MARCH, FAR = 0.016, 0.32
"""Step of shadows, and how far they reach, in box units."""


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """Points of a region's surface, at most one in each cube of side ``side``; lengths are in box units."""

    side: float
    slot: NDArray[np.int32]
    """Number of the point in each cube, -1 for none. (X, Y, Z)"""
    points: Floats
    """Box coordinates. (S, 3)"""
    normals: Floats
    """Unit normals towards the viewers. (S, 3)"""
    depth: Floats
    """Deviation of what is visible along rays: how deep one sees into the sheet. (S,)"""
    alpha: Floats
    """Mean opacity of the sheet in the pixels that show it. (S,)"""
    seen: Floats
    """How many pixels of the views show the point, weighted by its opacity there. (S,)"""
    up: NDArray[np.float64]
    """The world's up direction. (3,)"""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def grid(self) -> tuple[float, NDArray[np.int32], Floats, Floats]:
        """Arguments of the kernels."""
        return self.side, self.slot, self.points, self.normals

    @cached_property
    def tree(self) -> cKDTree:
        """The points, for the nearest one to a position."""
        return cKDTree(self.points)

    @cached_property
    def frames(self) -> tuple[Floats, Floats]:
        """Right and up as seen by a viewer who faces each point, both (S, 3)."""
        right, upward = tangents(self.normals.astype(np.float64), self.up)
        return right.astype(np.float32), upward.astype(np.float32)

    @cached_property
    def _neighbours(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        near = np.empty((len(self), NEIGHBOURS), np.int32)
        weight = np.empty((len(self), NEIGHBOURS), np.float32)
        numba_tracing.neighbours(*self.grid, AROUND / SIDE * self.side, near, weight)
        return near, weight

    def average(self, values: NDArray[np.floating], rounds: int = 1) -> NDArray[np.float64]:
        """Average values (S,) or (S, F) over neighbours on the same side, within :data:`AROUND` widths of a stroke."""
        found = np.asarray(values, np.float64).reshape(len(self), -1)
        for _ in range(rounds):
            out = np.empty_like(found)
            numba_tracing.average(*self._neighbours, found, out)
            found = out
        return found.reshape(values.shape)

    def spread(self, values: NDArray[np.floating], reach: float) -> NDArray[np.float64]:
        """Average values (S,) over all that is visible within about ``reach`` box units, whichever way it faces."""
        cells = min(max(int(2.0 / reach), 1), MOST_CELLS)  # cells of half a standard deviation
        at = np.minimum((self.points * cells).astype(np.int64), cells - 1)
        cell = np.ravel_multi_index(tuple(at.T), (cells, cells, cells))
        sums = [
            gaussian_filter(
                np.bincount(cell, weight, cells**3).reshape(cells, cells, cells), reach * cells, mode="constant"
            )
            for weight in (self.seen, self.seen * values)
        ]
        where = self.points.T * cells - 0.5
        weight, total = (map_coordinates(grid, where, order=1, mode="nearest") for grid in sums)
        return np.asarray(total / np.maximum(weight, 1e-12))

    def bends(self, reach: float) -> Bends:
        """Return how the surface bends over a distance."""
        out = np.zeros((len(self), 5))
        numba_tracing.bend(*self.grid, *self.frames, reach, out)
        a, b, c, left, rough = out.T
        mean, span = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
        turn = 0.5 * np.arctan2(2.0 * b, a - c)  # towards the larger of mean + span and mean - span
        turn = np.where(mean < 0.0, turn, turn + 0.5 * np.pi)  # towards that of the smaller absolute value
        right, upward = self.frames
        weakest = np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * upward
        return Bends(mean, np.abs(mean) + span, np.abs(np.abs(mean) - span), weakest, left, rough)

    def thickness(self, reach: float) -> NDArray[np.float64]:
        """Return how far below each point the surface's other side lies, at most ``reach``. (S,)"""
        out = np.empty(len(self))
        numba_tracing.thickness(*self.grid, reach, out)
        return out

    def tones(self, opacity: Floats, cells: int, width: float, mean: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how light each point is, ranked among all that is visible, from 0 (darkest) to 1. (S,)

        Two opposite lights with their shadows, openness to the surroundings and signed curvature, the ``mean`` (S,),
        count in standard deviations. ``opacity`` (X, Y, Z) is that of the scene's cells along a side of theirs.
        """
        sun = LIGHT / np.linalg.norm(LIGHT)
        sky = _directions(SKY)
        out = np.empty((len(self), SKY + 2))
        directions = np.concatenate([sky, sun[None], -sun[None]])
        away, steps = max(1.5 * width, 3.0 / cells), int(FAR / MARCH)
        extinction = (-cells * np.log(np.maximum(1.0 - opacity, 1e-6))).astype(np.float32)
        numba_tracing.light(self.points, self.normals, directions, extinction, cells, away, MARCH, steps, out)
        facing = (self.normals @ sky.T).clip(0.0)
        opened = (out[:, :-2] * facing).sum(1) / np.maximum(facing.sum(1), 1e-6)
        # A volume is seen from below as well, so a weaker light from the other side keeps the dark side readable.
        towards = self.normals @ sun
        lit = np.where(towards > 0.0, towards, -COUNTER * towards) * (0.35 + 0.65 * (out[:, -2] + out[:, -1]))
        raised = (mean * width).clip(-1.0, 1.0)
        tone = sum(weight * _standard(v) for weight, v in ((SUN, lit), (OPEN, opened), (RAISED, raised)))
        fine = self.ranked(np.asarray(tone))
        smooth = self.average(fine)
        return self.ranked(0.5 * fine + 0.5 * smooth)

    def ranked(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fraction of all that is visible that has smaller values. (S,)"""
        order = np.argsort(values, kind="stable")
        seen = self.seen.astype(np.float64) + 0.05 * max(float(self.seen.mean()), 1e-9)
        out = np.empty(len(values))
        out[order] = (np.cumsum(seen[order]) - 0.5 * seen[order]) / seen.sum()
        return out


@dataclass(frozen=True)
class Bends:
    """How a surface bends at its points, all (S,); curvatures are per box unit."""

    mean: NDArray[np.float64]
    """Mean curvature: positive where the surface is convex."""
    strongest: NDArray[np.float64]
    """Absolute value of the stronger principal curvature."""
    weakest: NDArray[np.float64]
    """Absolute value of the weaker one."""
    axis: NDArray[np.float64]
    """Direction of the weaker one, a unit vector of either sign. (S, 3)"""
    left: NDArray[np.float64]
    """How far normals deviate from this shape, in radians: large where the surface is crumpled."""
    rough: NDArray[np.float64]
    """How far points lie above or below it, in box units."""


def visible_surface(
    views: Sequence[StyledView], region: int, form: Form, width: float, most: int = 60_000
) -> VisibleSurface | None:
    """Return the visible surface of a region with a form's normals, for a width of strokes, or None if it is unseen."""
    found = [s for s in (_sheets(view, region, GAP * width, most) for view in views) if s is not None]
    if not found:
        return None
    middle, front, depth, weight = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    # In the middle of a thin sheet the opacity has no gradient: its side towards the viewer has.
    normals = form.normals(front.astype(np.float32))
    side = max(SIDE * width, 1.0 / 400.0)
    kept, cube = in_cubes(middle, side)
    count = np.bincount(cube, weight).astype(np.float64)
    depth, alpha = (np.bincount(cube, weight * a) / np.maximum(count, 1e-12) for a in (depth, weight))
    points, normals = middle[kept].astype(np.float32), normals[kept]
    surface = surface_of(points, normals, depth, alpha, count, side, form.up)
    # Points at several depths move to their mean depth, and normals to their mean.
    out = np.empty((len(points), 10))
    tangent, none = surface.frames[0], np.zeros(len(points), np.float32)
    numba_inking.settle(side, surface.slot, surface.points, surface.normals, tangent, none, out)
    fine = np.isfinite(out).all(1) & (np.abs(out[:, 3:6]).sum(1) > 0.5)
    place, facing = out[:, :3].clip(0.0, 1.0).astype(np.float32), out[:, 3:6].astype(np.float32)
    again, cube = in_cubes(place[fine], side)
    own = np.flatnonzero(fine)[again]
    total = np.bincount(cube, surface.seen[fine]).astype(np.float64)
    surface = surface_of(place[own], facing[own], surface.depth[own], surface.alpha[own], total, side, form.up)
    return _one_sided(surface)


def _one_sided(surface: VisibleSurface) -> VisibleSurface:
    """Drop the less visible side of sheets that are seen from both sides at once: strokes span them."""
    most = min(THROUGH * float(surface.depth.max(initial=0.0)), 10.0 * surface.side)
    below = surface.thickness(max(most, surface.side))
    thin = below < np.maximum(THROUGH * surface.depth, 0.5 * surface.side)
    if not thin.any() or thin.all():
        return surface
    inside = np.flatnonzero(thin)
    near = surface.tree.query(surface.points[inside], min(12, len(surface)))[1].reshape(len(inside), -1)
    facing = np.einsum("skd,sd->sk", surface.normals[near], surface.normals[inside])
    opposite = np.where(facing < -numba_tracing.SAME_SIDE, surface.seen[near], 0.0).sum(1)
    same = np.where(facing > numba_tracing.SAME_SIDE, surface.seen[near], 0.0).sum(1)
    left = np.ones(len(surface), bool)
    left[inside[opposite > same]] = False
    s = surface
    return surface_of(s.points[left], s.normals[left], s.depth[left], s.alpha[left], s.seen[left], s.side, s.up)


def surface_of(
    points: NDArray[np.floating], normals: NDArray[np.floating], depth: NDArray[np.floating],
    alpha: NDArray[np.floating], seen: NDArray[np.floating], side: float, up: NDArray[np.float64],
) -> VisibleSurface:  # fmt: skip
    """Return a surface through points (S, 3), at most one in each cube of side ``side``; see its fields.

    >>> flat = np.array([[0.2, 0.5, 0.5], [0.3, 0.5, 0.5]])
    >>> up = np.array([0.0, 1.0, 0.0])
    >>> len(surface_of(flat, np.tile([0.0, 0.0, 1.0], (2, 1)), np.zeros(2), np.ones(2), np.ones(2), 0.05, up))
    2
    """
    place, facing, deep, opaque, count = (
        np.ascontiguousarray(a, np.float32) for a in (points, normals, depth, alpha, seen)
    )
    return VisibleSurface(side, slots_of(points, side), place, facing, deep, opaque, count, up)


def _sheets(
    view: StyledView, region: int, gap: float, most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
    """Return middles (T, 3), points at their front (T, 3), depths (T,) and weights (T,) of a view's sheets."""
    own = (view.region == region).cpu().numpy()
    if not own.any():
        return None
    pixel, weight = view.pixel.cpu().numpy()[own], view.weight.cpu().numpy()[own].astype(np.float64)
    where = view.position.cpu().numpy()[own].astype(np.float64)
    step = np.linalg.norm(np.diff(where, axis=0, prepend=where[:1]), axis=1)
    first = np.diff(pixel, prepend=-1) != 0
    first |= step > gap
    sheet = np.cumsum(first) - 1
    total = np.asarray(np.bincount(sheet, weight), np.float64)
    along = np.linalg.norm(where - where[first][sheet], axis=1)
    mean, square = (np.bincount(sheet, weight * along**power) / total for power in (1, 2))
    middle = np.stack([np.bincount(sheet, weight * where[:, f]) for f in range(3)], 1) / total[:, None]
    depth = np.sqrt(np.maximum(square - mean**2, 0.0))
    away = where[first] - middle
    length = np.linalg.norm(away, axis=1)
    front = middle + away * np.minimum(depth / np.maximum(length, 1e-9), 1.0)[:, None]
    seen = np.flatnonzero(total > LEAST_SEEN)
    if len(seen) > most:
        seen = seen[:: -(-len(seen) // most)]
    return (middle[seen], front[seen], depth[seen], total[seen]) if len(seen) else None


def _standard(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return (values - values.mean()) / max(float(values.std()), 1e-3)


def _directions(count: int) -> NDArray[np.float64]:
    """Return evenly spread unit vectors (Fibonacci's spiral). (count, 3)"""
    k = np.arange(count) + 0.5
    height = 1.0 - 2.0 * k / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(turn), height, across * np.sin(turn)], 1)
