"""Brush strokes as primitives: curved bands on surfaces, and the paint that they leave at any position.

A stroke is a row of points with normals and half widths. The frame of the point nearest to a position gives coordinates
along and across the stroke, and these its outline, the marks of bristles and the relief. Strokes lie over one another
in order (Hertzmann 1998), and on the surface (Meier 1996). :mod:`svv.core.strokes.stroke_reference` defines what they
look like. Letters: N strokes, K points of strokes, P positions. Lengths are in box units.
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

WET = 0.5
"""Number of bristle marks below which a brush is full of water: it leaves no marks, does not run dry, and flows."""

FLOW, SHRUNK = 0.9, 0.8
"""Size of the irregularities of wet paint, in median widths of strokes, and how far they narrow it, in half widths."""

RIM = 0.22
"""Width of the darker rim of dried washes, in half median widths of strokes."""

STEEP = 1.6
"""How sharply the tooth of paper separates peaks, which take chalk, from valleys."""

LEAST_PIGMENT = 0.05
"""Least density of a glaze relative to its usual one."""

SPREAD = (73_856_093, 19_349_663, 83_492_791)
"""Factors that spread the cells of space over :data:`NOISE` (Teschner et al. 2003)."""

USES = {"sides": 0, "end": 131, "phase": 257, "coarse": 401, "fine": 563, "mixed": 719, "paper": 887}
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
    """How much darker the rims of washes are, as of watercolour; negative for lighter ones."""
    light: tuple[float, float, float] = (-0.447, 0.744, 0.496)
    """Unit vector to the light on the relief."""
    body: float = 1.0
    """How far paint covers what is below, in [0, 1]; 0 is a glaze, which filters it: colours multiply."""
    grain: float = 0.0
    """How strongly the tooth of the paper shows, in [0, 1]: glazes settle in its valleys, chalk leaves them bare."""
    tooth: float = 0.3
    """Size of the tooth, in median widths of strokes, > 0."""
    flow: float = 0.0
    """How irregularly wet paint runs, in [0, 1]: its outline, and its density within."""
    feather: float = 0.0
    """Width of soft edges, in half widths, at least 0."""
    blunt: float = 0.0
    """Ends of strokes: from 0, lifted and ragged, to 1, as round as they begin."""
    ground: tuple[float, float, float] | None = None
    """Colour of the bare ground, RGB in [0, 1], such as paper; None for the nearest stroke's, a little darker."""

    @classmethod
    def from_json(cls, told: Mapping[str, Any]) -> Brush:
        """Return the brush of plain values; raises KeyError, TypeError or ValueError if they are not numbers."""
        relief, dry, mixed, rim = (float(told[name]) for name in ("relief", "dry", "mixed", "rim"))
        x, y, z = (float(value) for value in told["light"])
        # Scenes of earlier versions have none of these: all of their paint is oil.
        names = ("body", "grain", "tooth", "flow", "feather", "blunt")
        body, grain, tooth, flow, feather, blunt = (float(told.get(name, getattr(cls, name))) for name in names)
        ground = None
        if told.get("ground") is not None:
            red, green, blue = (float(value) for value in told["ground"])
            ground = red, green, blue
        numbers = [relief, dry, mixed, rim, x, y, z, body, grain, tooth, flow, feather, blunt, *(ground or ())]
        if not np.isfinite(numbers).all():
            raise ValueError("a brush is not finite")
        if not all(0.0 <= part <= 1.0 for part in (body, grain, flow, blunt, *(ground or ()))):
            raise ValueError("a brush is out of range")
        if not tooth > 0.0 or feather < 0.0:
            raise ValueError("a brush is out of range")
        return cls(relief, dry, mixed, rim, (x, y, z), body, grain, tooth, flow, feather, blunt, ground)

    @property
    def paper(self) -> tuple[float, float, float]:
        """Colour that glazes filter where there is no other paint: the ground's, white by default."""
        return self.ground or (1.0, 1.0, 1.0)


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
    """Number of coarse bristle marks across each stroke. Below :data:`WET`, the brush is wet, and strokes of the same
    number that follow one another flow into one wash: 1/8, 2/8 or 3/8. (N,)"""
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
    def unit(self) -> float:
        """Median width of the strokes, in box units; of wet ones if there are any: lines may lie over washes."""
        wet = self.bristles[self.stroke] < WET
        return 2.0 * float(np.median(self.radius[wet] if wet.any() else self.radius))

    @cached_property
    def length(self) -> Floats:
        """Length of each stroke. (N,)"""
        return self.frames[1][self.start[1:] - 1]

    def packed(self) -> dict[str, NDArray[np.generic]]:
        """Return tables of bytes for a file: positions to a 65535th of the box, directions and colours to a 127th.

        >>> strokes = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05)
        >>> bool(np.allclose(Strokes.unpacked(strokes.packed()).where, strokes.where, atol=1e-5))
        True
        """
        across = np.stack([self.radius, self.inner, self.outer], 1)
        scale = float(across.max(initial=1e-9))
        where = np.rint(self.where.clip(0.0, 1.0) * 65535.0).astype(np.int64)
        # The largest component is 127, so that unpacked tables are packed as they were.
        largest = np.maximum(np.abs(self.normal).max(1, keepdims=True), 1e-9)
        points = [where >> 8, where & 255, np.rint(self.normal / largest * 127.0) + 128.0]
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
    def unpacked(cls, arrays: Mapping[str, NDArray[np.generic]]) -> Strokes:
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
    >>> len(stroke), round(float(stroke.length[0]), 3)
    (1, 0.6)
    """
    part = np.linspace(0.0, 1.0, points)[:, None]
    same = np.full(points, radius, np.float32)
    tint = np.array([colour], np.float32)
    return Strokes(
        ((1.0 - part) * np.array(start) + part * np.array(end)).astype(np.float32),
        np.tile(np.array(normal, np.float32), (points, 1)), same, same, same,
        np.array([0, points]), tint, tint, np.ones(1, np.float32), np.zeros(1, np.int64),
    )  # fmt: skip
