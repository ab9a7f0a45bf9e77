"""Brush strokes as primitives: curved bands on surfaces, and the paint that they leave at any position.

A stroke is a row of points with normals and half widths. At a position near it, the nearest point's frame gives
coordinates along and across the stroke, from which follow its outline (round where the brush is set down, ragged where
it is lifted), the marks of bristles and the relief of thick paint. Strokes lie over one another in order, as in
Hertzmann (1998), and on the surface, as in Meier (1996), so they are the same from every side.

This module is the definition and a plain reference; :mod:`svv.kernels.numba_strokes` computes the same quickly.
Letters: N strokes, K points of strokes, P positions. Lengths are in box units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

NOISE = np.random.default_rng(20).uniform(-1.0, 1.0, 1024).astype(np.float32)
"""Values between which the irregularities of strokes are interpolated."""

WAVY, WAVE = 0.10, 0.7
"""How far the sides of strokes are off, in half widths, and how often, per half width."""

RAGGED = 0.6
"""How unevenly a brush is lifted, in half widths, for wholly visible bristles."""

TAPER = 1.8
"""Length of the lifted end, in half widths."""

FINER = 2.7
"""Number of fine bristle marks to each coarse one."""

FADES = 0.75
"""Share of the reach above and below a stroke in which its paint fades, relative to that of strokes whose sheet is
nearer: the two sides of a thin body keep their own strokes, and a sheet that lies deeper in one pixel than in the next
does not change its paint at once."""

OPAQUE = 0.99
"""Coverage from which nothing below is visible."""

USES = {"sides": 0, "end": 131, "phase": 257, "coarse": 401, "fine": 563, "mixed": 719}
"""Offsets in :data:`NOISE`, so that a stroke's irregularities are independent of each other."""


@dataclass(frozen=True)
class Brush:
    """How the paint of all strokes looks; it can be changed without laying them again."""

    relief: float = 0.3
    """How strongly the relief of thick paint is lit, from 0."""
    dry: float = 0.1
    """How far bristles of a brush that runs dry leave gaps towards the end, in [0, 1]."""
    mixed: float = 0.4
    """How far the two colours on a brush appear as streaks, in [0, 1]."""
    rim: float = 0.0
    """How much darker the rims of strokes are, as of watercolour; negative for lighter ones."""
    light: tuple[float, float, float] = (-0.447, 0.744, 0.496)
    """Unit vector to the light on the relief."""

    @classmethod
    def from_json(cls, told: Mapping[str, Any]) -> Brush:
        """Return the brush of plain values; raises KeyError, TypeError or ValueError if they are not numbers."""
        relief, dry, mixed, rim = (float(told[name]) for name in ("relief", "dry", "mixed", "rim"))
        x, y, z = (float(value) for value in told["light"])
        if not np.isfinite([relief, dry, mixed, rim, x, y, z]).all():
            raise ValueError("a brush is not finite")
        return cls(relief, dry, mixed, rim, (x, y, z))


@dataclass(frozen=True, eq=False)
class Strokes:
    """Strokes from the lowest to the topmost."""

    where: Floats
    """Box coordinates of the points. (K, 3)"""
    normal: Floats
    """Outward unit normals. (K, 3)"""
    radius: Floats
    """Half widths, > 0. (K,)"""
    inner: Floats
    """How deep the paint reaches below each point. (K,)"""
    outer: Floats
    """How far it reaches above. (K,)"""
    start: NDArray[np.int64]
    """Points of stroke n are rows start[n] to start[n + 1]; each stroke has at least two. (N + 1,)"""
    colour: Floats
    """Colour of each stroke, RGB in [0, 1]. (N, 3)"""
    second: Floats
    """Second colour on each brush. (N, 3)"""
    bristles: Floats
    """Number of coarse bristle marks across each stroke. (N,)"""
    seed: NDArray[np.int64]
    """Where each stroke's irregularities begin in :data:`NOISE`. (N,)"""

    def __len__(self) -> int:
        return len(self.start) - 1

    @cached_property
    def stroke(self) -> NDArray[np.int64]:
        """Stroke of each point. (K,)"""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    @cached_property
    def frames(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Unit tangents (K, 3), and arc length, curvature in the surface and change of radius per length, all (K,)."""
        first, last = self.start[:-1][self.stroke], self.start[1:][self.stroke] - 1
        index = np.arange(len(self.where))
        before, after = np.maximum(index - 1, first), np.minimum(index + 1, last)
        where = self.where.astype(np.float64)
        chord = where[after] - where[before]
        span = np.maximum(np.linalg.norm(chord, axis=1), 1e-9)
        tangent = chord - (chord * self.normal).sum(1, keepdims=True) * self.normal
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
        steps = np.linalg.norm(where[index] - where[np.maximum(index - 1, 0)], axis=1)
        run = np.cumsum(np.where(index == first, 0.0, steps))
        arc = run - run[first]
        side = np.cross(self.normal, tangent)
        turned = ((tangent[after] - tangent[before]) * side).sum(1) / span
        # At the ends, a one-sided difference would be as good, but strokes are short: the ends are straight.
        bend = np.where((index == first) | (index == last), 0.0, turned)
        widen = (self.radius[after] - self.radius[before]) / span
        return tuple(np.ascontiguousarray(a, np.float32) for a in (tangent, arc, bend, widen))  # type: ignore[return-value]

    @cached_property
    def length(self) -> Floats:
        """Length of each stroke. (N,)"""
        return self.frames[1][self.start[1:] - 1]

    def packed(self) -> dict[str, NDArray[Any]]:
        """Return tables of bytes for a file: positions to a 65535th of the box, directions and colours to a 127th.

        >>> strokes = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05)
        >>> bool(np.allclose(Strokes.unpacked(strokes.packed()).where, strokes.where, atol=1e-5))
        True
        """
        across = np.stack([self.radius, self.inner, self.outer], 1)
        scale = float(across.max(initial=1e-9))
        where = np.rint(self.where.clip(0.0, 1.0) * 65535.0).astype(np.int64)
        points = [where >> 8, where & 255, np.rint(self.normal * 127.0) + 128.0]
        points += [np.rint(np.sqrt(across / scale) * 255.0).clip(1, 255)]
        colours = np.rint(np.concatenate([self.colour, self.second], 1) * 255.0)
        marks = np.stack(
            [np.diff(self.start), np.rint(self.bristles * 8.0).clip(1, 255), self.seed >> 8, self.seed & 255]
        )
        return {
            "points": np.concatenate(points, 1).astype(np.uint8),
            "strokes": np.concatenate([colours, marks.T], 1).astype(np.uint8),
            "scale": np.array([scale], np.float32),
        }

    @classmethod
    def unpacked(cls, arrays: Mapping[str, NDArray[Any]]) -> Strokes:
        """Invert :meth:`packed`, to within its rounding; raises KeyError or ValueError if the arrays do not fit."""
        points, marks, scale = (np.asarray(arrays[name]).astype(np.float32) for name in ("points", "strokes", "scale"))
        if points.ndim != 2 or points.shape[1] != 12 or marks.ndim != 2 or marks.shape[1] != 10 or scale.shape != (1,):
            raise ValueError("the tables of strokes have other shapes")
        count = marks[:, 6].astype(np.int64)
        start = np.concatenate([[0], np.cumsum(count)])
        if start[-1] != len(points) or count.min(initial=2) < 2 or not len(marks) or not scale[0] > 0.0:
            raise ValueError("the tables of strokes do not fit each other")
        normal = points[:, 6:9] - 128.0
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1.0)
        radius, inner, outer = (np.square(points[:, k] / 255.0) * scale[0] for k in (9, 10, 11))
        if not (radius > 0.0).all():
            raise ValueError("a stroke has no width")
        colour, second = (np.ascontiguousarray(marks[:, k : k + 3] / 255.0) for k in (0, 3))
        seed = marks[:, 8].astype(np.int64) * 256 + marks[:, 9].astype(np.int64)
        where = (points[:, :3] * 256.0 + points[:, 3:6]) / np.float32(65535.0)
        bristles = np.maximum(marks[:, 7] / 8.0, 0.125)
        return cls(where, normal, radius, inner, outer, start, colour, second, bristles, seed)


def joined(parts: list[Strokes]) -> Strokes:
    """Return the strokes of several layers, the lowest first."""
    arrays = {f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Strokes) if f.name != "start"}
    counts = np.concatenate([np.diff(p.start) for p in parts])
    return Strokes(**arrays, start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64))


def straight_stroke(
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    radius: float,
    colour: tuple[float, float, float] = (1.0, 0.0, 0.0),
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0),
    points: int = 9,
) -> Strokes:
    """Return one straight stroke between two places: the simplest record, for tests and examples.

    >>> stroke = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05)
    >>> paint_at(stroke, Brush(0, 0, 0), [[0.5, 0.5, 0.5]], 0.01).round(2).tolist()
    [[1.0, 0.0, 0.0, 1.0]]
    """
    part = np.linspace(0.0, 1.0, points)[:, None]
    same = np.full(points, radius, np.float32)
    tint = np.array([colour], np.float32)
    return Strokes(
        ((1.0 - part) * np.array(start) + part * np.array(end)).astype(np.float32),
        np.tile(np.array(normal, np.float32), (points, 1)), same, same, same,
        np.array([0, points]), tint, tint, np.ones(1, np.float32), np.zeros(1, np.int64),
    )  # fmt: skip


def noise(x: NDArray[np.floating], first: NDArray[np.integer] | int) -> NDArray[np.float64]:
    """Return smooth noise in [-1, 1] at x, for a sequence that begins at ``first`` in :data:`NOISE`."""
    low = np.floor(x)
    part = x - low
    part = part * part * (3.0 - 2.0 * part)
    index = low.astype(np.int64) + first
    left, right = NOISE[index % len(NOISE)], NOISE[(index + 1) % len(NOISE)]
    return np.asarray(left + (right - left) * part, np.float64)


def paint_at(strokes: Strokes, brush: Brush, position: Any, soft: float) -> NDArray[np.float64]:
    """Return the paint at positions: a plain reference, stroke by stroke.

    Args:
        strokes: The strokes.
        brush: How their paint looks.
        position: Box coordinates. (P, 3)
        soft: Width of the soft edges: the cell or pixel in which the paint is shown. Finer marks fade out.

    Returns:
        Colour times coverage, and coverage, from 0 to 1. (P, 4)
    """
    place = np.asarray(position, np.float64)
    out, left, nearer = np.zeros((len(place), 4)), np.ones(len(place)), np.full(len(place), 1e-6)
    for q in range(len(strokes) - 1, -1, -1):
        colour, alpha, fade = _one(strokes, brush, q, place, soft)
        seen = (left > 1.0 - OPAQUE) & (alpha > 0.0)
        nearer = np.where(seen, np.maximum(nearer, fade), nearer)
        alpha = np.where(seen, alpha * fade, 0.0)
        out[:, :3] += (left * alpha)[:, None] * colour
        left *= 1.0 - alpha
    out[:, 3] = 1.0 - left
    return np.asarray(out * (np.minimum(out[:, 3] / nearer, 1.0) / np.maximum(out[:, 3], 1e-6))[:, None])


def _one(
    strokes: Strokes, brush: Brush, q: int, place: NDArray[np.float64], soft: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the colour (P, 3) of one stroke, its coverage (P,) and how near it is in depth (P,)."""
    rows = slice(int(strokes.start[q]), int(strokes.start[q + 1]))
    tangents, arcs, bends, widens = (a[rows].astype(np.float64) for a in strokes.frames)
    normals = strokes.normal[rows].astype(np.float64)
    sides = np.cross(normals, tangents)
    away = place[:, None] - strokes.where[rows]
    height, along, across = ((away * axis).sum(2) for axis in (normals, tangents, sides))
    across -= 0.5 * bends * along * along
    radius = strokes.radius[rows] + widens * along
    reach = 1.2 * strokes.radius[rows] + soft
    there = (height <= strokes.outer[rows]) & (height >= -strokes.inner[rows]) & (np.abs(across) < reach)
    there &= np.abs(along) < 2.0 * reach
    near = np.where(there, along**2 + across**2, np.inf)
    best = near.argmin(1)
    each = np.arange(len(place))
    u, v, r = arcs[best] + along[each, best], across[each, best], np.maximum(radius[each, best], 1e-6)
    first, count, length = int(strokes.seed[q]), float(strokes.bristles[q]), float(strokes.length[q])
    wide = r * (1.0 + WAVY * noise(WAVE * u / r, first + USES["sides"]))
    set_down = np.minimum(u / r + 1.0, 1.0)
    lifted = np.minimum(((length - u) / r + 1.0 + RAGGED * noise(2.5 * v / r + 7.3, first + USES["end"])) / TAPER, 1.0)
    there_too = (set_down > 0.0) & (lifted > 0.0) & np.isfinite(near[each, best])
    taper = np.minimum(np.sqrt((set_down * (2.0 - set_down)).clip(0.0)), np.sqrt(lifted.clip(0.0)))
    alpha = np.where(there_too, (0.5 + (wide * taper - np.abs(v)) / soft).clip(0.0, 1.0), 0.0)
    deep = height[each, best]
    deep = np.where(deep > 0.0, deep / strokes.outer[rows][best], -deep / strokes.inner[rows][best])
    fade = ((1.0 - deep) / FADES).clip(0.0, 1.0)
    x = v / wide
    x = x + 0.2 * noise(0.3 * u / r, first + USES["phase"])
    coarse, fine = ((r / (n * soft) - 0.5).clip(0.0, 1.0) for n in (count, FINER * count))
    marks = coarse * noise(count * x, first + USES["coarse"])
    marks = marks + 0.5 * fine * noise(FINER * count * x, first + USES["fine"])
    slope = noise(count * x + 0.3, first + USES["coarse"]) - noise(count * x - 0.3, first + USES["coarse"])
    alpha = alpha * (1.0 - (brush.dry * (0.25 + (u / max(length, 1e-6)).clip(0.0, 1.0)) * (0.5 - marks)).clip(0.0, 1.0))
    streak = (0.5 + 0.8 * noise(0.6 * count * x + 17.0, first + USES["mixed"])).clip(0.0, 1.0) * brush.mixed
    colour = strokes.colour[q] + streak[:, None] * (strokes.second[q] - strokes.colour[q])
    edge = np.sign(v) * ((np.abs(v) / wide - 0.45) / 0.55).clip(0.0, 1.0)
    toward = (sides[best] * np.array(brush.light)).sum(1)
    gain = brush.relief * (toward * (0.7 * edge - 0.6 * coarse * slope) + 0.35 * marks) - brush.rim * edge * edge
    gain = gain[:, None]
    lighter = colour + gain * (0.6 * (1.0 - colour) + 0.3 * colour)
    return np.where(gain < 0.0, colour * (1.0 + gain), lighter).clip(0.0, 1.0), alpha, fade
