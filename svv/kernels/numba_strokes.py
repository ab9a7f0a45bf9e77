"""Paint of brush strokes at positions: :func:`svv.core.strokes.paint_at` through a grid of bins.

Every bin lists the stroke points whose paint may reach into it, the topmost stroke first, so a position looks at few
strokes and stops where they are opaque. Letters: P positions, N strokes, K points, B entries of bins. Compiled with
numba for the CPU.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from svv.core.fast_math import FAST_MATH
from svv.core.strokes import FADES, FINER, NOISE, OPAQUE, RAGGED, TAPER, USES, WAVE, WAVY

SIDES, END, PHASE, COARSE, FINE, MIXED = (USES[name] for name in ("sides", "end", "phase", "coarse", "fine", "mixed"))
LAST = len(NOISE) - 1


@njit(cache=True)
def _reach(k, axis, where, normal, tangent, radius, inner, outer, soft, side, size, out):  # type: ignore[no-untyped-def]
    """Write the first and last bin along an axis that a point's paint may reach into."""
    n, t = normal[k, axis], tangent[k, axis]
    r = 1.2 * radius[k] + soft
    b2 = max(1.0 - n * n - t * t, 0.0)
    wide = 2.0 * r * abs(t) + r * np.sqrt(b2)
    low = where[k, axis] - wide - max(inner[k] * n, -outer[k] * n)
    high = where[k, axis] + wide + max(outer[k] * n, -inner[k] * n)
    out[0] = min(max(int(low / side), 0), size - 1)
    out[1] = min(max(int(high / side), 0), size - 1)


@njit(cache=True)
def sort_into_bins(where, normal, tangent, radius, inner, outer, soft, side, size, start, entries):  # type: ignore[no-untyped-def]
    """List the points in the bins of a grid of size^3, whose side is ``side``; the last points come first.

    With ``entries`` empty, ``start`` (size^3 + 1,) receives the number of entries before each bin; afterwards,
    ``entries`` (B,) receives the points.
    """
    x, y, z = np.empty(2, np.int64), np.empty(2, np.int64), np.empty(2, np.int64)
    counting = len(entries) == 0
    for k in range(len(where) - 1, -1, -1):
        _reach(k, 0, where, normal, tangent, radius, inner, outer, soft, side, size, x)
        _reach(k, 1, where, normal, tangent, radius, inner, outer, soft, side, size, y)
        _reach(k, 2, where, normal, tangent, radius, inner, outer, soft, side, size, z)
        for i in range(x[0], x[1] + 1):
            for j in range(y[0], y[1] + 1):
                for m in range(z[0], z[1] + 1):
                    b = (i * size + j) * size + m
                    if counting:
                        start[b + 1] += 1
                    else:
                        entries[start[b]] = k
                        start[b] += 1
    if counting:
        for b in range(size * size * size):
            start[b + 1] += start[b]
    else:  # the entries have moved every start to the next bin's
        for b in range(size * size * size, 0, -1):
            start[b] = start[b - 1]
        start[0] = 0


@njit(cache=True, fastmath=FAST_MATH)
def _noise(table, x, first):  # type: ignore[no-untyped-def]
    low = np.floor(x)
    part = x - low
    part = part * part * (3.0 - 2.0 * part)
    index = int(low) + first
    left, right = table[index & LAST], table[(index + 1) & LAST]
    return left + (right - left) * part


@njit(parallel=True, cache=True, fastmath=FAST_MATH)
def paint(  # type: ignore[no-untyped-def]  # long: one loop, whose state would be a dozen parameters
    place, side, size, start, entries, table, where, normal, tangent, arc, bend, widen, radius, inner, outer, stroke,
    length, colour, second, bristles, seed, relief, dry, mixed, rim, light, soft, out,
):  # fmt: skip
    """Compute the paint at positions (P, 3); ``out`` (P, 4) receives colour times coverage, and coverage."""
    for p in prange(len(place)):
        a = min(max(int(place[p, 0] / side), 0), size - 1)
        b = min(max(int(place[p, 1] / side), 0), size - 1)
        c = min(max(int(place[p, 2] / side), 0), size - 1)
        cell = (a * size + b) * size + c
        i, end = start[cell], start[cell + 1]
        left, red, green, blue, nearer = 1.0, 0.0, 0.0, 0.0, 0.0
        while i < end and left > 1.0 - OPAQUE:
            q = stroke[entries[i]]
            best, nearest, u, v, deep = np.inf, -1, 0.0, 0.0, 0.0
            while i < end:
                k = entries[i]
                if stroke[k] != q:
                    break
                i += 1
                x, y, z = place[p, 0] - where[k, 0], place[p, 1] - where[k, 1], place[p, 2] - where[k, 2]
                n0, n1, n2 = normal[k, 0], normal[k, 1], normal[k, 2]
                height = x * n0 + y * n1 + z * n2
                if height > outer[k] or height < -inner[k]:
                    continue
                t0, t1, t2 = tangent[k, 0], tangent[k, 1], tangent[k, 2]
                along = x * t0 + y * t1 + z * t2
                reach = 1.2 * radius[k] + soft
                if abs(along) >= 2.0 * reach:
                    continue
                across = x * (n1 * t2 - n2 * t1) + y * (n2 * t0 - n0 * t2) + z * (n0 * t1 - n1 * t0)
                across -= 0.5 * bend[k] * along * along
                if abs(across) >= reach:
                    continue
                away = along * along + across * across
                # Points are visited from the last to the first: of two equally near ones, the first counts.
                if away <= best:
                    best, nearest, u, v, deep = away, k, along, across, height
            if nearest < 0:
                continue
            k = nearest
            r = max(radius[k] + widen[k] * u, 1e-6)
            u += arc[k]
            first = seed[q]
            wide = r * (1.0 + WAVY * _noise(table, WAVE * u / r, first + SIDES))
            set_down = min(u / r + 1.0, 1.0)
            if set_down <= 0.0:
                continue
            lifted = (length[q] - u) / r + 1.0 + RAGGED * _noise(table, 2.5 * v / r + 7.3, first + END)
            lifted = min(lifted / TAPER, 1.0)
            if lifted <= 0.0:
                continue
            taper = min(np.sqrt(max(set_down * (2.0 - set_down), 0.0)), np.sqrt(lifted))
            alpha = min(max(0.5 + (wide * taper - abs(v)) / soft, 0.0), 1.0)
            if alpha <= 0.0:
                continue
            fade = min((1.0 - (deep / outer[k] if deep > 0.0 else -deep / inner[k])) / FADES, 1.0)
            if fade <= 0.0:
                continue
            nearer = max(nearer, fade)
            alpha *= fade
            n = bristles[q]
            x = v / wide + 0.2 * _noise(table, 0.3 * u / r, first + PHASE)
            coarse = min(max(r / (n * soft) - 0.5, 0.0), 1.0)
            fine = min(max(r / (FINER * n * soft) - 0.5, 0.0), 1.0)
            marks, slope = 0.0, 0.0
            if coarse > 0.0:
                marks = coarse * _noise(table, n * x, first + COARSE)
                slope = _noise(table, n * x + 0.3, first + COARSE) - _noise(table, n * x - 0.3, first + COARSE)
            if fine > 0.0:
                marks += 0.5 * fine * _noise(table, FINER * n * x, first + FINE)
            run = min(max(u / max(length[q], 1e-6), 0.0), 1.0)
            alpha *= 1.0 - min(max(dry * (0.25 + run) * (0.5 - marks), 0.0), 1.0)
            streak = min(max(0.5 + 0.8 * _noise(table, 0.6 * n * x + 17.0, first + MIXED), 0.0), 1.0) * mixed
            edge = min(max((abs(v) / wide - 0.45) / 0.55, 0.0), 1.0)
            edge = edge if v > 0.0 else -edge
            n0, n1, n2 = normal[k, 0], normal[k, 1], normal[k, 2]
            t0, t1, t2 = tangent[k, 0], tangent[k, 1], tangent[k, 2]
            toward = light[0] * (n1 * t2 - n2 * t1) + light[1] * (n2 * t0 - n0 * t2) + light[2] * (n0 * t1 - n1 * t0)
            gain = relief * (toward * (0.7 * edge - 0.6 * coarse * slope) + 0.35 * marks) - rim * edge * edge
            here = left * alpha
            for f in range(3):
                value = colour[q, f] + streak * (second[q, f] - colour[q, f])
                if gain < 0.0:
                    value *= 1.0 + gain
                else:
                    value += gain * (0.6 * (1.0 - value) + 0.3 * value)
                value = min(max(value, 0.0), 1.0)
                if f == 0:
                    red += here * value
                elif f == 1:
                    green += here * value
                else:
                    blue += here * value
            left *= 1.0 - alpha
        cover = 1.0 - left
        whole = min(cover / max(nearer, 1e-6), 1.0)
        scale = whole / max(cover, 1e-6)
        out[p, 0], out[p, 1], out[p, 2], out[p, 3] = scale * red, scale * green, scale * blue, whole
