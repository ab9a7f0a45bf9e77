"""The paint of brush strokes at positions: the definition, and a plain reference for the compiled kernels.

Paint with body covers what is below; glazes filter it (Beer's law: their density is an exponent of what they let
through). Strokes of wet brushes flow into one wash, with one outline, whose rim dries darker (Curtis et al. 1997). The
tooth of the paper is noise in space. Letters: N strokes, P positions. Lengths are in box units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.core.strokes.strokes import (
    FADES,
    FINER,
    FLOW,
    LEAST_PIGMENT,
    NOISE,
    OPAQUE,
    RAGGED,
    RIM,
    SHRUNK,
    SPREAD,
    STEEP,
    TAPER,
    USES,
    WAVE,
    WAVY,
    WET,
    Brush,
    Strokes,
)  # fmt: skip


def noise(x: NDArray[np.floating], first: NDArray[np.integer] | int) -> NDArray[np.float64]:
    """Return smooth noise in [-1, 1] at x, for a sequence that begins at ``first`` in :data:`NOISE`."""
    low = np.floor(x)
    part = x - low
    part = part * part * (3.0 - 2.0 * part)
    index = low.astype(np.int64) + first
    left, right = NOISE[index % len(NOISE)], NOISE[(index + 1) % len(NOISE)]
    return np.asarray(left + (right - left) * part, np.float64)


def rough(place: NDArray[np.floating], first: NDArray[np.integer] | int) -> NDArray[np.float64]:
    """Return smooth noise in [-1, 1] at places (P, 3), with one value for each unit cube, for a sequence. (P,)"""
    low = np.floor(place)
    part = place - low
    part = part * part * (3.0 - 2.0 * part)
    index = low.astype(np.int64)
    total = np.zeros(len(place))
    for corner in np.ndindex(2, 2, 2):
        share = np.where(np.array(corner) == 1, part, 1.0 - part).prod(1)
        a, b, c = (index + np.array(corner)).T
        total += share * NOISE[((a * SPREAD[0]) ^ (b * SPREAD[1]) ^ (c * SPREAD[2])) + first & (len(NOISE) - 1)]
    return total


def twice(place: NDArray[np.floating], size: float, soft: float, first: int) -> NDArray[np.float64]:
    """Return noise of two octaves at places (P, 3), of ``size`` and half of it, which fade if finer than ``soft``."""
    coarse, fine = (float(np.clip(s / soft - 0.5, 0.0, 1.0)) for s in (size, 0.5 * size))
    return coarse * rough(place / size, first) + 0.5 * fine * rough(place / (0.5 * size) + 0.37, first + 77)


def paint_at(strokes: Strokes, brush: Brush, position: ArrayLike, soft: float) -> NDArray[np.float64]:
    """Return colour times coverage, and coverage, in [0, 1], at box coordinates (P, 3), stroke by stroke. (P, 4)

    ``soft``: width of the soft edges, the cell or pixel in which the paint is shown; finer marks fade out.

    >>> from svv.core.strokes.strokes import straight_stroke
    >>> stroke = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05)
    >>> paint_at(stroke, Brush(0, 0, 0), [[0.5, 0.5, 0.5]], 0.01).round(2).tolist()
    [[1.0, 0.0, 0.0, 1.0]]
    """
    place = np.asarray(position, np.float64)
    paper = twice(place, brush.tooth * strokes.unit, soft, USES["paper"]) if brush.grain > 0.0 else np.zeros(len(place))
    laid, nearer = _Laid(brush, soft, strokes.unit, paper), np.full(len(place), 1e-6)
    for q in range(len(strokes) - 1, -1, -1):
        mark = _one(strokes, brush, q, place, soft, paper)
        here = (mark.alpha > 0.0) & (laid.through.max(1) > 1.0 - OPAQUE)
        nearer = np.where(here, np.maximum(nearer, mark.fade), nearer)
        wash = float(strokes.bristles[q])
        laid.finish(here & (laid.wash != wash))
        if wash < WET:
            laid.flow(here, wash, mark)
        else:
            density = np.maximum(1.0 + brush.grain * paper, LEAST_PIGMENT)
            laid.lay(here, mark.colour, mark.alpha, mark.gain, density)
    laid.finish(np.ones(len(place), bool))
    paint = laid.paint + (laid.through - laid.bare[:, None]) * np.array(brush.paper)
    found = np.concatenate([paint, 1.0 - laid.bare[:, None]], 1)
    return np.asarray(found * (np.minimum(found[:, 3] / nearer, 1.0) / np.maximum(found[:, 3], 1e-6))[:, None])


@dataclass(frozen=True)
class _Mark:
    """One stroke's paint at positions."""

    colour: NDArray[np.float64]
    """(P, 3)"""
    alpha: NDArray[np.float64]
    """Coverage. (P,)"""
    fade: NDArray[np.float64]
    """How near it is in depth. (P,)"""
    gain: NDArray[np.float64]
    """How much lighter its relief is. (P,)"""
    inside: NDArray[np.float64]
    """Distance from its outline. (P,)"""
    run: NDArray[np.float64]
    """Density of wet paint. (P,)"""
    radius: NDArray[np.float64]
    """(P,)"""


class _Laid:
    """Paint of all strokes so far, from the top down, at positions."""

    def __init__(self, brush: Brush, soft: float, unit: float, paper: NDArray[np.float64]) -> None:
        self.brush, self.sharp, self.soft, self.grain = brush, max(0.5 * RIM * unit, soft), soft, brush.grain * paper
        self.rim = brush.rim * 0.5 * RIM * unit / self.sharp
        count = len(paper)
        self.paint, self.through, self.bare = np.zeros((count, 3)), np.ones((count, 3)), np.ones(count)
        self.wash, self.weights, self.colours = np.zeros(count), np.zeros(count), np.zeros((count, 3))
        self.covers, self.deepest, self.runs = np.zeros(count), np.zeros(count), np.zeros(count)

    def lay(
        self, here: NDArray[np.bool_], colour: NDArray[np.float64], alpha: NDArray[np.float64],
        gain: NDArray[np.float64], density: NDArray[np.float64],
    ) -> None:  # fmt: skip
        """Lay a colour under what is above, where ``here``."""
        body, gain, alpha = self.brush.body, gain[:, None], np.where(here, alpha, 0.0)[:, None]
        lighter = colour + gain * (0.6 * (1.0 - colour) + 0.3 * colour)
        shown = np.where(gain < 0.0, colour * (1.0 + gain), lighter).clip(0.0, 1.0)
        self.paint += self.through * alpha * body * shown
        self.through *= 1.0 - alpha + alpha * (1.0 - body) * colour ** density[:, None]
        self.bare *= 1.0 - alpha[:, 0]

    def flow(self, here: NDArray[np.bool_], wash: float, mark: _Mark) -> None:
        """Let a wet stroke flow into its wash: colours mix, and only the whole has an outline."""
        weight = np.where(here, mark.alpha * (np.minimum(mark.inside / mark.radius, 1.0) ** 2 + 0.01), 0.0)
        self.wash[here] = wash
        self.weights += weight
        self.colours += weight[:, None] * mark.colour
        self.runs += weight * mark.run
        self.covers[here] = np.maximum(self.covers, mark.alpha)[here]
        self.deepest[here] = np.maximum(self.deepest, mark.inside)[here]

    def finish(self, done: NDArray[np.bool_]) -> None:
        """Lay the wash so far, where ``done``."""
        done = done & (self.weights > 0.0)
        weights = np.maximum(self.weights, 1e-12)
        dark = self.rim * np.exp(-self.deepest / self.sharp)
        density = np.maximum(1.0 + dark + self.brush.flow * self.runs / weights + self.grain, LEAST_PIGMENT)
        self.lay(done, self.colours / weights[:, None], self.covers, -dark, density)
        for state in (self.weights, self.colours, self.runs, self.covers, self.deepest, self.wash):
            state[done] = 0.0


def _one(
    strokes: Strokes, brush: Brush, q: int, place: NDArray[np.float64], soft: float, paper: NDArray[np.float64]
) -> _Mark:
    """Return the paint of one stroke."""
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
    wet = count < WET
    flows = wet and brush.flow > 0.0
    run = twice(place, FLOW * strokes.unit, soft, first) if flows else np.zeros(len(place))
    shrunk = SHRUNK * brush.flow * (0.5 + 1.2 * run).clip(0.0, 1.0) if flows else np.zeros(len(place))
    wide, alpha, inside = _outline(brush, u, v, r, shrunk, length, first, soft)
    alpha = np.where(np.isfinite(near[each, best]), alpha, 0.0)
    deep = height[each, best]
    deep = np.where(deep > 0.0, deep / strokes.outer[rows][best], -deep / strokes.inner[rows][best])
    fade = ((1.0 - deep) / FADES).clip(0.0, 1.0)
    part = (u / max(length, 1e-6)).clip(0.0, 1.0)
    marks, slope, coarse = np.zeros(len(place)), np.zeros(len(place)), np.zeros(len(place))
    streak = (0.5 + 1.2 * run).clip(0.0, 1.0)
    if not wet:
        x = v / wide + 0.2 * noise(0.3 * u / r, first + USES["phase"])
        coarse, fine = ((r / (n * soft) - 0.5).clip(0.0, 1.0) for n in (count, FINER * count))
        marks = coarse * noise(count * x, first + USES["coarse"])
        marks = marks + 0.5 * fine * noise(FINER * count * x, first + USES["fine"])
        slope = noise(count * x + 0.3, first + USES["coarse"]) - noise(count * x - 0.3, first + USES["coarse"])
        gaps = brush.dry * (0.25 + part) * (0.5 - marks - brush.grain * STEEP * paper)
        alpha = alpha * (1.0 - gaps.clip(0.0, 1.0))
        streak = (0.5 + 0.8 * noise(0.6 * count * x + 17.0, first + USES["mixed"])).clip(0.0, 1.0)
    alpha = (alpha - brush.grain * brush.body * (0.5 + STEEP * paper).clip(0.0, 1.0)).clip(0.0)
    colour = strokes.colour[q] + (brush.mixed * streak)[:, None] * (strokes.second[q] - strokes.colour[q])
    edge = np.sign(v) * ((np.abs(v) / wide - 0.45) / 0.55).clip(0.0, 1.0)
    toward = (sides[best] * np.array(brush.light)).sum(1)
    gain = brush.relief * (toward * (0.7 * edge - 0.6 * coarse * slope) + 0.35 * marks)
    return _Mark(colour, alpha * fade, fade, gain, inside, run, r)


def _outline(
    brush: Brush, u: NDArray[np.float64], v: NDArray[np.float64], r: NDArray[np.float64], shrunk: NDArray[np.float64],
    length: float, first: int, soft: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Return half widths, the coverage at coordinates along and across, and the distance from the outline, all (P,)."""
    wide = r * (1.0 + WAVY * noise(WAVE * u / r, first + USES["sides"])) * (1.0 - shrunk)
    lift, ragged = TAPER + brush.blunt * (1.0 - TAPER), RAGGED * (1.0 - brush.blunt)
    set_down = np.minimum(u / r + 1.0 - shrunk, 1.0)
    lifted = (length - u) / r + 1.0 - shrunk + ragged * noise(2.5 * v / r + 7.3, first + USES["end"])
    lifted = np.minimum(lifted / lift, 1.0)
    begins, ends = set_down * (2.0 - set_down), lifted * (1.0 + brush.blunt * (1.0 - lifted))
    taper = np.minimum(begins, ends).clip(0.0)
    edge = wide * np.sqrt(taper) - np.abs(v)
    feather = brush.feather * r
    alpha = (0.5 + (edge - 0.5 * feather) / (soft + feather)).clip(0.0, 1.0)
    # Distance to the outline taper = (v / wide)^2, to first order.
    rate = np.where(begins < ends, 2.0 - 2.0 * set_down, (1.0 + brush.blunt * (1.0 - 2.0 * lifted)) / lift)
    rate = np.where(np.minimum(begins, ends) >= 1.0, 0.0, rate) / r
    steep = np.sqrt(rate**2 + (2.0 * v / wide**2) ** 2)
    inside = (taper - (v / wide) ** 2).clip(0.0) / np.maximum(steep, 1.0 / wide)
    return wide, np.where((set_down > 0.0) & (lifted > 0.0), alpha, 0.0), inside
