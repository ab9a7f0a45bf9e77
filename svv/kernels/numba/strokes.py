"""Paint of brush strokes at positions: :func:`svv.core.strokes.stroke_reference.paint_at` through a grid of bins.

Every bin lists the stroke points whose paint may reach into it, the topmost stroke first, so a position looks at few
strokes and stops where they are opaque. Letters: P positions, N strokes, K points, B entries of bins. Compiled with
numba for the CPU.
"""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
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
)  # fmt: skip

SIDES, END, PHASE, COARSE, FINE, MIXED, PAPER = (
    USES[name] for name in ("sides", "end", "phase", "coarse", "fine", "mixed", "paper")
)
SPREAD0, SPREAD1, SPREAD2 = SPREAD
LAST = len(NOISE) - 1
HALF, FAR = np.float32(0.5), np.float32(np.inf)
"""In single precision, as the search for a stroke's nearest point is: with Python floats, it would be in double."""

SLACK, FLAT = 1e-6, 1e-9
"""Of the bins that a point reaches into: what rounding may lose, and the slope of a plane along a column of bins."""

PIECES = 16
"""Pieces of the bins that threads fill."""


def surroundings(where, normal, tangent, bend, radius, inner, outer, soft):  # type: ignore[no-untyped-def]
    """Return what decides whether a position is near each point, one line of the CPU's cache for each. (K, 16)

    Place, normal, greatest and least height, tangent, greatest distance along the stroke (twice that across it),
    direction across it, and half its bend. Letters and parameters as in :func:`paint`.
    """
    columns = [
        where, normal, outer[:, None], -inner[:, None], tangent, 2.0 * (1.2 * radius + soft)[:, None],
        np.cross(normal, tangent), 0.5 * bend[:, None],
    ]  # fmt: skip
    return np.ascontiguousarray(np.concatenate(columns, axis=1), np.float32)


@njit(cache=True)
def _bounds(around, wider, side, size, bounds):  # type: ignore[no-untyped-def]
    """Write the first and last bin along each axis that each point's paint may reach into. (K, 6)"""
    for k in range(len(around)):
        long = float(around[k, 11]) + wider
        bend = around[k, 15] * long * long
        left, right = -0.5 * long + min(bend, 0.0), 0.5 * long + max(bend, 0.0)
        for axis in range(3):
            n, t, b = float(around[k, 3 + axis]), float(around[k, 8 + axis]), float(around[k, 12 + axis])
            low = around[k, axis] + min(around[k, 7] * n, around[k, 6] * n) - long * abs(t) + min(left * b, right * b)
            high = around[k, axis] + max(around[k, 7] * n, around[k, 6] * n) + long * abs(t) + max(left * b, right * b)
            bounds[k, 2 * axis] = min(max(int((low - SLACK) / side), 0), size - 1)
            bounds[k, 2 * axis + 1] = min(max(int((high + SLACK) / side), 0), size - 1)


@njit(cache=True)
def _narrow(v0, v1, v2, x, y, z, low, high, side, first, last):  # type: ignore[no-untyped-def]
    """Return the first and last bin of a column that reach into a slab, of those between ``first`` and ``last``.

    The slab is where the dot product with v is from ``low`` to ``high``; x, y: of the column's axis; z: of its end.
    """
    half = 0.5 * side * (abs(v0) + abs(v1) + abs(v2)) + SLACK
    base = v0 * x + v1 * y + v2 * z
    low, high = low - half - base, high + half - base
    if abs(v2) < FLAT:
        return (first, last) if low <= 0.0 <= high else (1, 0)
    ends = low / (v2 * side) - 0.5, high / (v2 * side) - 0.5
    near, far = max(min(ends[0], ends[1]), float(first)), min(max(ends[0], ends[1]), float(last))
    return (int(np.ceil(near)), int(np.floor(far))) if near <= far else (1, 0)


@njit(cache=True)
def _column(around, k, wider, side, i, j, first, last):  # type: ignore[no-untyped-def]
    """Return the first and last of the bins i, j, ``first`` to ``last`` that a point's paint may reach into."""
    x, y, z = (i + 0.5) * side - around[k, 0], (j + 0.5) * side - around[k, 1], -float(around[k, 2])
    long = float(around[k, 11]) + wider
    bend = around[k, 15] * long * long
    v0, v1, v2 = float(around[k, 3]), float(around[k, 4]), float(around[k, 5])
    first, last = _narrow(v0, v1, v2, x, y, z, around[k, 7], around[k, 6], side, first, last)
    if first <= last:
        v0, v1, v2 = float(around[k, 8]), float(around[k, 9]), float(around[k, 10])
        first, last = _narrow(v0, v1, v2, x, y, z, -long, long, side, first, last)
    if first <= last:
        v0, v1, v2 = float(around[k, 12]), float(around[k, 13]), float(around[k, 14])
        low, high = -0.5 * long + min(bend, 0.0), 0.5 * long + max(bend, 0.0)
        first, last = _narrow(v0, v1, v2, x, y, z, low, high, side, first, last)
    return first, last


@njit(parallel=True, cache=True)
def _sort(around, wider, side, size, bounds, start, entries):  # type: ignore[no-untyped-def]
    counting = len(entries) == 0
    for piece in prange(PIECES):
        left, right = piece * size // PIECES, (piece + 1) * size // PIECES
        for k in range(len(around) - 1, -1, -1):
            for i in range(max(bounds[k, 0], left), min(bounds[k, 1] + 1, right)):
                for j in range(bounds[k, 2], bounds[k, 3] + 1):
                    first, last = _column(around, k, wider, side, i, j, bounds[k, 4], bounds[k, 5])
                    b = (i * size + j) * size
                    for m in range(b + first, b + last + 1):
                        if counting:
                            start[m + 1] += 1
                        else:
                            entries[start[m]] = k
                            start[m] += 1


def sort_into_bins(around: NDArray[np.float32], wider: float, size: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the first entry of each bin of a grid (size^3 + 1,), and the points whose paint may reach there (B,).

    The last points come first. ``around`` (K, 16): see :func:`surroundings`; ``wider``: how much farther along strokes,
    and half of it across them, paint may reach than that tells.
    """
    side, start = 1.0 / size, np.zeros(size**3 + 1, np.int64)
    bounds = np.empty((len(around), 6), np.int64)
    _bounds(around, wider, side, size, bounds)
    _sort(around, wider, side, size, bounds, start, np.empty(0, np.int32))
    np.cumsum(start, out=start)
    entries, ends = np.empty(int(start[-1]), np.int32), start.copy()
    _sort(around, wider, side, size, bounds, ends, entries)
    return start, entries


@njit(cache=True, fastmath=FAST_MATH)
def _noise(table, x, first):  # type: ignore[no-untyped-def]
    low = np.floor(x)
    part = x - low
    part = part * part * (3.0 - 2.0 * part)
    index = int(low) + first
    left, right = table[index & LAST], table[(index + 1) & LAST]
    return left + (right - left) * part


@njit(cache=True, fastmath=FAST_MATH)
def _rough(table, x, y, z, first):  # type: ignore[no-untyped-def]
    a, b, c = np.floor(x), np.floor(y), np.floor(z)
    x, y, z = x - a, y - b, z - c
    x, y, z = x * x * (3.0 - 2.0 * x), y * y * (3.0 - 2.0 * y), z * z * (3.0 - 2.0 * z)
    i, j, k = int(a), int(b), int(c)
    total = 0.0
    for m in range(2):
        for n in range(2):
            hashed = ((i + m) * SPREAD0) ^ ((j + n) * SPREAD1)
            low = table[(hashed ^ (k * SPREAD2)) + first & LAST]
            high = table[(hashed ^ ((k + 1) * SPREAD2)) + first & LAST]
            total += (x if m == 1 else 1.0 - x) * (y if n == 1 else 1.0 - y) * (low + (high - low) * z)
    return total


@njit(cache=True, fastmath=FAST_MATH)
def _twice(table, x, y, z, size, soft, first):  # type: ignore[no-untyped-def]
    coarse, fine = min(max(size / soft - 0.5, 0.0), 1.0), min(max(0.5 * size / soft - 0.5, 0.0), 1.0)
    found = 0.0
    if coarse > 0.0:
        found += coarse * _rough(table, x / size, y / size, z / size, first)
    if fine > 0.0:
        half = 0.5 * size
        found += 0.5 * fine * _rough(table, x / half + 0.37, y / half + 0.37, z / half + 0.37, first + 77)
    return found


@njit(cache=True, fastmath=FAST_MATH)
def _over(colour, alpha, gain, density, body, left, total):  # type: ignore[no-untyped-def]
    """Lay one channel of a colour under what is above: returns what that lets through, and the sum of paint."""
    kept = 1.0 - alpha
    if body < 1.0:
        kept += alpha * (1.0 - body) * colour**density
    if gain < 0.0:
        colour *= 1.0 + gain
    else:
        colour += gain * (0.6 * (1.0 - colour) + 0.3 * colour)
    return left * kept, total + left * min(max(colour, 0.0), 1.0) * alpha * body


@njit(parallel=True, cache=True, fastmath=FAST_MATH)
def paint(  # type: ignore[no-untyped-def]  # long: one loop, whose state would be a dozen parameters
    place, side, size, start, entries, table, around, normal, tangent, arc, widen, radius, inner, outer, stroke,
    length, colour, second, bristles, seed, look, light, ground, unit, soft, out,
):  # fmt: skip
    """Compute the paint at positions (P, 3); ``out`` (P, 4) receives colour times coverage, and coverage.

    ``around`` (K, 16): see :func:`surroundings`.
    ``look``: the brush's relief, dry, mixed, rim, body, grain, tooth, flow, feather and blunt (10,); ``ground``: its
    paper (3,); ``unit``: median width of strokes.
    """
    relief, dry, mixed, rim, body, grain = look[0], look[1], look[2], look[3], look[4], look[5]
    tooth, flow, feather, blunt = look[6] * unit, look[7], look[8], look[9]
    lift, ragged, run_size = TAPER + blunt * (1.0 - TAPER), RAGGED * (1.0 - blunt), FLOW * unit
    sharp = max(0.5 * RIM * unit, soft)
    rim *= 0.5 * RIM * unit / sharp
    for p in prange(len(place)):
        a = min(max(int(place[p, 0] / side), 0), size - 1)
        b = min(max(int(place[p, 1] / side), 0), size - 1)
        c = min(max(int(place[p, 2] / side), 0), size - 1)
        cell = (a * size + b) * size + c
        i, end = start[cell], start[cell + 1]
        bare, red, green, blue, nearer = 1.0, 0.0, 0.0, 0.0, 0.0
        left0, left1, left2 = 1.0, 1.0, 1.0
        paper = 0.0
        wash, weights, deepest, covers, runs, c0, c1, c2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if grain > 0.0:
            paper = _twice(table, place[p, 0], place[p, 1], place[p, 2], tooth, soft, PAPER)
        while i < end and (left0 > 1.0 - OPAQUE or left1 > 1.0 - OPAQUE or left2 > 1.0 - OPAQUE):
            q = stroke[entries[i]]
            best, nearest, u, v, above = FAR, -1, 0.0, 0.0, 0.0
            while i < end:
                k = entries[i]
                if stroke[k] != q:
                    break
                i += 1
                x, y, z = place[p, 0] - around[k, 0], place[p, 1] - around[k, 1], place[p, 2] - around[k, 2]
                height = x * around[k, 3] + y * around[k, 4] + z * around[k, 5]
                if height > around[k, 6] or height < around[k, 7]:
                    continue
                along = x * around[k, 8] + y * around[k, 9] + z * around[k, 10]
                if abs(along) >= around[k, 11]:
                    continue
                across = x * around[k, 12] + y * around[k, 13] + z * around[k, 14]
                across -= around[k, 15] * along * along
                if abs(across) >= HALF * around[k, 11]:
                    continue
                away = along * along + across * across
                # Points are visited from the last to the first: of two equally near ones, the first counts.
                if away <= best:
                    best, nearest, u, v, above = away, k, along, across, height
            if nearest < 0:
                continue
            k = nearest
            r = max(radius[k] + widen[k] * u, 1e-6)
            u += arc[k]
            first = seed[q]
            wet = bristles[q] < WET
            run, shrunk = 0.0, 0.0
            if wet and flow > 0.0:
                run = _twice(table, place[p, 0], place[p, 1], place[p, 2], run_size, soft, first)
                shrunk = SHRUNK * flow * min(max(0.5 + 1.2 * run, 0.0), 1.0)
            wide = r * (1.0 + WAVY * _noise(table, WAVE * u / r, first + SIDES)) * (1.0 - shrunk)
            set_down = min(u / r + 1.0 - shrunk, 1.0)
            if set_down <= 0.0:
                continue
            lifted = (length[q] - u) / r + 1.0 - shrunk + ragged * _noise(table, 2.5 * v / r + 7.3, first + END)
            lifted = min(lifted / lift, 1.0)
            if lifted <= 0.0:
                continue
            begins, ends = set_down * (2.0 - set_down), lifted * (1.0 + blunt * (1.0 - lifted))
            taper = max(min(begins, ends), 0.0)
            edge = wide * np.sqrt(taper) - abs(v)
            alpha = min(max(0.5 + (edge - 0.5 * feather * r) / (soft + feather * r), 0.0), 1.0)
            if alpha <= 0.0:
                continue
            fade = min((1.0 - (above / outer[k] if above > 0.0 else -above / inner[k])) / FADES, 1.0)
            if fade <= 0.0:
                continue
            part = min(max(u / max(length[q], 1e-6), 0.0), 1.0)
            marks, slope, coarse = 0.0, 0.0, 0.0
            if wet:
                streak = min(max(0.5 + 1.2 * run, 0.0), 1.0) * mixed
            else:
                n = bristles[q]
                x = v / wide + 0.2 * _noise(table, 0.3 * u / r, first + PHASE)
                coarse = min(max(r / (n * soft) - 0.5, 0.0), 1.0)
                fine = min(max(r / (FINER * n * soft) - 0.5, 0.0), 1.0)
                if coarse > 0.0:
                    marks = coarse * _noise(table, n * x, first + COARSE)
                    slope = _noise(table, n * x + 0.3, first + COARSE) - _noise(table, n * x - 0.3, first + COARSE)
                if fine > 0.0:
                    marks += 0.5 * fine * _noise(table, FINER * n * x, first + FINE)
                gaps = dry * (0.25 + part) * (0.5 - marks - grain * STEEP * paper)
                alpha *= 1.0 - min(max(gaps, 0.0), 1.0)
                streak = min(max(0.5 + 0.8 * _noise(table, 0.6 * n * x + 17.0, first + MIXED), 0.0), 1.0) * mixed
            if grain > 0.0:
                alpha = max(alpha - grain * body * min(max(0.5 + STEEP * paper, 0.0), 1.0), 0.0)
            if alpha <= 0.0:
                continue
            nearer = max(nearer, fade)
            alpha *= fade
            if weights > 0.0 and bristles[q] != wash:  # what is above has been another wash
                dark = rim * np.exp(-deepest / sharp)
                density = max(1.0 + dark + flow * runs / weights + grain * paper, LEAST_PIGMENT)
                left0, red = _over(c0 / weights, covers, -dark, density, body, left0, red)
                left1, green = _over(c1 / weights, covers, -dark, density, body, left1, green)
                left2, blue = _over(c2 / weights, covers, -dark, density, body, left2, blue)
                bare *= 1.0 - covers
                weights = 0.0
            value0 = colour[q, 0] + streak * (second[q, 0] - colour[q, 0])
            value1 = colour[q, 1] + streak * (second[q, 1] - colour[q, 1])
            value2 = colour[q, 2] + streak * (second[q, 2] - colour[q, 2])
            if wet:
                rate = 2.0 - 2.0 * set_down if begins < ends else (1.0 + blunt * (1.0 - 2.0 * lifted)) / lift
                rate = rate / r if taper < 1.0 else 0.0
                steep = np.sqrt(rate * rate + (2.0 * v / (wide * wide)) ** 2)
                inside = max(taper - (v / wide) ** 2, 0.0) / max(steep, 1.0 / wide)
                weight = alpha * (min(inside / r, 1.0) ** 2 + 0.01)
                if weights <= 0.0:
                    wash, deepest, covers, runs, c0, c1, c2 = bristles[q], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                weights += weight
                runs += weight * run
                c0, c1, c2 = c0 + weight * value0, c1 + weight * value1, c2 + weight * value2
                deepest, covers = max(deepest, inside), max(covers, alpha)
                continue
            edge = min(max((abs(v) / wide - 0.45) / 0.55, 0.0), 1.0)
            edge = edge if v > 0.0 else -edge
            n0, n1, n2 = normal[k, 0], normal[k, 1], normal[k, 2]
            t0, t1, t2 = tangent[k, 0], tangent[k, 1], tangent[k, 2]
            toward = light[0] * (n1 * t2 - n2 * t1) + light[1] * (n2 * t0 - n0 * t2) + light[2] * (n0 * t1 - n1 * t0)
            gain = relief * (toward * (0.7 * edge - 0.6 * coarse * slope) + 0.35 * marks)
            density = max(1.0 + grain * paper, LEAST_PIGMENT)
            left0, red = _over(value0, alpha, gain, density, body, left0, red)
            left1, green = _over(value1, alpha, gain, density, body, left1, green)
            left2, blue = _over(value2, alpha, gain, density, body, left2, blue)
            bare *= 1.0 - alpha
        if weights > 0.0:
            dark = rim * np.exp(-deepest / sharp)
            density = max(1.0 + dark + flow * runs / weights + grain * paper, LEAST_PIGMENT)
            left0, red = _over(c0 / weights, covers, -dark, density, body, left0, red)
            left1, green = _over(c1 / weights, covers, -dark, density, body, left1, green)
            left2, blue = _over(c2 / weights, covers, -dark, density, body, left2, blue)
            bare *= 1.0 - covers
        cover = 1.0 - bare
        whole = min(cover / max(nearer, 1e-6), 1.0)
        scale = whole / max(cover, 1e-6)
        out[p, 0] = scale * (red + (left0 - bare) * ground[0])
        out[p, 1] = scale * (green + (left1 - bare) * ground[1])
        out[p, 2] = scale * (blue + (left2 - bare) * ground[2])
        out[p, 3] = whole
