"""Pieces of a picture on a surface: how well a piece would fit, and which of the pieces over a point is visible.

Pictures (H, W, 3) are mirrored at the border. Letters: P points, K pieces or candidates, N points of the overlap.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit

ABOVE = 1.2
"""How far above and below its plane a piece extends, in radii."""

REACH = 1.001 * float(np.hypot(1.0, ABOVE))
"""Distance from its middle up to which a piece may extend, in radii."""

SLACK = 1e-4
"""Score that rounding errors may add."""

TOGETHER = 32
"""Number of successive points that look for their nearest pieces among the same ones: they are neighbours."""


@njit(parallel=True, cache=True)
def nearest(position, middle, reach, near):  # type: ignore[no-untyped-def]
    """Find the nearest of pieces with middles (K, 3) within ``reach`` of points (P, 3), nearest first.

    Writes ``near`` (P, M), -1 where fewer are as near. Points that follow one another should be near one another.
    """
    count, most = len(position), near.shape[1]
    for block in prange((count + TOGETHER - 1) // TOGETHER):
        first, last = block * TOGETHER, min((block + 1) * TOGETHER, count)
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for i in range(first, last):
            for f in range(3):
                low[f], high[f] = min(low[f], position[i, f]), max(high[f], position[i, f])
        candidates, there = np.empty(len(middle), np.int64), 0
        for k in range(len(middle)):
            away = 0.0
            for f in range(3):
                away += max(low[f] - middle[k, f], middle[k, f] - high[f], 0.0) ** 2
            if away <= reach * reach:
                candidates[there] = k
                there += 1
        square = np.empty(most)
        for i in range(first, last):
            found, limit = 0, reach * reach
            near[i] = -1
            x, y, z = float(position[i, 0]), float(position[i, 1]), float(position[i, 2])
            for c in range(there):
                k = candidates[c]
                away = (x - middle[k, 0]) ** 2 + (y - middle[k, 1]) ** 2 + (z - middle[k, 2]) ** 2
                if away > limit or (found == most and away == limit):
                    continue
                m = min(found, most - 1)
                while m > 0 and square[m - 1] > away:
                    square[m], near[i, m] = square[m - 1], near[i, m - 1]
                    m -= 1
                square[m], near[i, m] = away, k
                found = min(found + 1, most)
                if found == most:
                    limit = square[most - 1]


@njit(cache=True)
def mirrored(i, n):  # type: ignore[no-untyped-def]
    """Bring an integer into [0, n) by mirroring at the ends."""
    if n == 1:
        return 0
    i = abs(i) % (2 * n - 2)
    return 2 * n - 2 - i if i >= n else i


@njit(cache=True)
def read(picture, u, v, out):  # type: ignore[no-untyped-def]
    """Interpolate the colour at pixel coordinates u (right) and v (down) bilinearly; integers are pixel centres."""
    h, w = picture.shape[0], picture.shape[1]
    u0, v0 = int(np.floor(u)), int(np.floor(v))
    fu, fv = np.float32(u - u0), np.float32(v - v0)
    a, b = mirrored(u0, w), mirrored(u0 + 1, w)
    c, d = mirrored(v0, h), mirrored(v0 + 1, h)
    for k in range(3):
        near = picture[c, a, k] + fu * (picture[c, b, k] - picture[c, a, k])
        far = picture[d, a, k] + fu * (picture[d, b, k] - picture[d, a, k])
        out[k] = near + fv * (far - near)


@njit(parallel=True, cache=True)
def misfits(picture, places, weights, colours, centres, turns, out):  # type: ignore[no-untyped-def]
    """Compute the mean squared difference between each candidate and the existing paint.

    ``places`` (N, 2): points right of and above the piece's centre, in pixels, with ``weights`` (N,) and ``colours``
    (N, 3). ``centres`` (K, 2): centres of candidates in the picture; ``turns`` (K,): rotation of each on the surface,
    in radians. ``out`` (K,).
    """
    h, w = picture.shape[0], picture.shape[1]
    total = np.float32(0.0)
    for i in range(len(weights)):
        total += weights[i]
    for k in prange(len(turns)):
        c, s = np.float32(np.cos(turns[k])), np.float32(np.sin(turns[k]))
        difference = np.float32(0.0)
        for i in range(len(weights)):
            x, y = places[i, 0], places[i, 1]
            u = mirrored(int(np.rint(centres[k, 0] + c * x + s * y)), w)
            v = mirrored(int(np.rint(centres[k, 1] + s * x - c * y)), h)
            for f in range(3):
                away = picture[v, u, f] - colours[i, f]
                difference += weights[i] * away * away
        out[k] = difference / max(total, np.float32(1e-9))


@njit(cache=True)
def place_on(dx, dy, dz, n, right, upward, normal, radius, through, out):  # type: ignore[no-untyped-def]
    """Find the place on a piece of a point at (dx, dy, dz) from the piece's centre with the normal n.

    Coordinates are projected along the piece's normal and stretched where the surface turns away, so that on a tube the
    arc counts rather than the chord. With ``through``, a normal and its opposite are equivalent, and a piece extends
    through a shell, whose inner half faces the other way. Returns how well the piece suits the point, at most 1;
    negative if it does not.
    """
    facing = n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2]
    side = -1.0 if through and facing < 0.0 else 1.0
    facing *= side
    if facing < 0.15:
        return -1.0
    x = dx * right[0] + dy * right[1] + dz * right[2]
    y = dx * upward[0] + dy * upward[1] + dz * upward[2]
    tx = side * (n[0] * right[0] + n[1] * right[1] + n[2] * right[2])
    ty = side * (n[0] * upward[0] + n[1] * upward[1] + n[2] * upward[2])
    sine = np.sqrt(tx * tx + ty * ty)
    if sine > 0.05:
        more = (np.arcsin(min(sine, 1.0)) / sine - 1.0) * (tx * x + ty * y) / (sine * sine)
        x, y = x + more * tx, y + more * ty
    off = dx * normal[0] + dy * normal[1] + dz * normal[2]
    out[0], out[1] = x / radius, y / radius
    away = out[0] * out[0] + out[1] * out[1]
    if away > 1.0 or abs(off) > ABOVE * radius:
        return -1.0
    return (1.0 - away) * (0.3 + 0.7 * facing)


@njit(cache=True)
def places(position, normal, middle, right, upward, outward, radius, through, at, suits):  # type: ignore[no-untyped-def]
    """Apply :func:`place_on` to points (P, 3) with normals (P, 3) and one piece: ``at`` (P, 2), ``suits`` (P,)."""
    for i in range(len(position)):
        dx, dy, dz = position[i, 0] - middle[0], position[i, 1] - middle[1], position[i, 2] - middle[2]
        suits[i] = place_on(dx, dy, dz, normal[i], right, upward, outward, radius, through, at[i])


@njit(parallel=True, cache=True)
def paint(  # type: ignore[no-untyped-def]
    position, normal, near, middle, right, upward, outward, centre, turn, picture, mean, spread, radius, pixels, ink,
    through, colours, suits,
):  # fmt: skip
    """Colour points by the piece that suits each best; strokes extend over the borders of pieces.

    ``near`` (P, M): pieces to consider, -1 for none. ``middle``, ``right``, ``upward``, ``outward`` (K, 3), ``centre``
    (K, 2) and ``turn`` (K,): those of the pieces. ``mean`` (3,) and ``spread``: those of the picture's colours.
    ``radius`` of a piece in box units and ``pixels`` in the picture; ``ink``: how far strokes extend over borders.
    Writes ``colours`` (P, 3) and ``suits`` (P,), which is negative where no piece suits; such colours are unchanged.
    """
    for i in prange(len(position)):
        at, found = np.empty(2, np.float32), np.empty(3, np.float32)
        best = np.float32(-1.0)
        n0, n1, n2 = normal[i, 0], normal[i, 1], normal[i, 2]
        for m in range(near.shape[1]):
            k = near[i, m]
            if k < 0:
                continue
            dx, dy, dz = position[i, 0] - middle[k, 0], position[i, 1] - middle[k, 1], position[i, 2] - middle[k, 2]
            # Stretching only moves a point outwards, so this is the most that the piece could score. Most pieces that
            # overlap are far behind what is in front.
            facing = n0 * outward[k, 0] + n1 * outward[k, 1] + n2 * outward[k, 2]
            facing = abs(facing) if through else facing
            x = dx * right[k, 0] + dy * right[k, 1] + dz * right[k, 2]
            y = dx * upward[k, 0] + dy * upward[k, 1] + dz * upward[k, 2]
            most = (1.0 - (x * x + y * y) / (radius * radius)) * (0.3 + 0.7 * facing) + SLACK
            if facing < 0.15 or most < 0.0 or most + ink * 2.0 * min(4.0 * most, 1.0) <= best:
                continue
            score = place_on(dx, dy, dz, normal[i], right[k], upward[k], outward[k], radius, through, at)
            if score < 0.0 or score + ink * 2.0 * min(4.0 * score, 1.0) <= best:
                continue
            c, s = np.cos(turn[k]), np.sin(turn[k])
            x, y = at[0] * pixels, at[1] * pixels
            read(picture, centre[k, 0] + c * x + s * y, centre[k, 1] + s * x - c * y, found)
            away = np.float32(0.0)
            for f in range(3):
                away += (found[f] - mean[f]) ** 2
            # At the edge of a piece even strokes fade, or every piece would end in a straight cut.
            score += ink * min(np.sqrt(away) / spread, 2.0) * min(4.0 * score, 1.0)
            if score > best:
                best = score
                for f in range(3):
                    colours[i, f] = found[f]
        suits[i] = best
