"""Brush strokes on a surface: its bends, the directions on it, where strokes begin, and streamlines along them.

A surface is as in :mod:`svv.train.paint.ink_kernels`. Letters: S points, N strokes, M places along one. Numba, CPU.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.train.paint.ink_kernels import look

SAME_SIDE = 0.2
"""Cosine of two normals above which points belong to the same side of a surface."""


@njit(cache=True)
def _range(p, side, reach, size):  # type: ignore[no-untyped-def]
    return max(int((p - reach) / side), 0), min(int((p + reach) / side) + 1, size)


@njit(cache=True)
def _height_left(s, found, near, points, normals, right, upward, reach):  # type: ignore[no-untyped-def]
    """Return the weighted sum of squared heights of a point's neighbours over the paraboloid that was fitted there."""
    rough = 0.0
    for o in near:
        away, x, y, h = 0.0, 0.0, 0.0, 0.0
        for f in range(3):
            d = points[o, f] - points[s, f]
            away += d * d
            x += d * right[s, f]
            y += d * upward[s, f]
            h += d * normals[s, f]
        w = (1.0 - away / (reach * reach)) ** 2
        h += 0.5 * (found[0] * x * x + 2.0 * found[1] * x * y + found[2] * y * y)
        rough += w * h * h
    return rough


@njit(parallel=True, cache=True)
def bend(side, slot, points, normals, right, upward, reach, out):  # type: ignore[no-untyped-def]
    """Fit the shape operator at each point of the surface: how normals change around it.

    Least squares over neighbours on the same side within ``reach``, in the basis ``right``, ``upward`` (S, 3): normals
    change by ``[[a, b], [b, c]]`` times the displacement, which is positive where the surface is convex. ``out`` (S, 5)
    receives a, b, c and the root mean squares of what the fit leaves: of normals, in radians, and of heights.
    """
    for s in prange(len(points)):
        xx, xy, yy, xr, xu, yr, yu, total, squares = 1e-12, 0.0, 1e-12, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        i0, i1 = _range(points[s, 0], side, reach, slot.shape[0])
        j0, j1 = _range(points[s, 1], side, reach, slot.shape[1])
        k0, k1 = _range(points[s, 2], side, reach, slot.shape[2])
        near, count = np.empty(max(i1 - i0, 0) * max(j1 - j0, 0) * max(k1 - k0, 0), np.int32), 0
        for i in range(i0, i1):
            for j in range(j0, j1):
                for k in range(k0, k1):
                    o = slot[i, j, k]
                    if o < 0 or o == s:
                        continue
                    away, facing, x, y, r, u = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                    for f in range(3):
                        d = points[o, f] - points[s, f]
                        away += d * d
                        facing += normals[o, f] * normals[s, f]
                    if away > reach * reach or facing < SAME_SIDE:
                        continue
                    near[count] = o
                    count += 1
                    for f in range(3):
                        d = points[o, f] - points[s, f]
                        m = normals[o, f] - normals[s, f]
                        x += d * right[s, f]
                        y += d * upward[s, f]
                        r += m * right[s, f]
                        u += m * upward[s, f]
                    w = (1.0 - away / (reach * reach)) ** 2
                    xx += w * x * x
                    xy += w * x * y
                    yy += w * y * y
                    xr += w * x * r
                    xu += w * x * u
                    yr += w * y * r
                    yu += w * y * u
                    squares += w * (r * r + u * u)
                    total += w
        # Normal equations of a, b and c; a small multiple of the identity keeps a row of points from being singular.
        e = 0.02 * (xx + yy)
        m = np.array([[xx + e, xy, 0.0], [xy, xx + yy + e, xy], [0.0, xy, yy + e]])
        v = np.array([xr, yr + xu, yu])
        found = np.linalg.solve(m, v)
        out[s, 0], out[s, 1], out[s, 2] = found[0], found[1], found[2]
        left = squares - (found[0] * v[0] + found[1] * v[1] + found[2] * v[2])
        out[s, 3] = np.sqrt(max(left, 0.0) / max(total, 1e-9))
        rough = _height_left(s, found, near[:count], points, normals, right, upward, reach)
        out[s, 4] = np.sqrt(rough / max(total, 1e-9))


@njit(parallel=True, cache=True)
def neighbours(side, slot, points, normals, reach, near, weight):  # type: ignore[no-untyped-def]
    """List neighbours of each point on the same side within ``reach``, evenly thinned to M of them.

    ``near`` (S, M) receives their numbers, -1 for none, and ``weight`` (S, M) their weights, which sum to 1; the point
    itself is one of them.
    """
    for s in prange(len(points)):
        found, away_of = np.empty(4096, np.int32), np.empty(4096)
        i0, i1 = _range(points[s, 0], side, reach, slot.shape[0])
        j0, j1 = _range(points[s, 1], side, reach, slot.shape[1])
        k0, k1 = _range(points[s, 2], side, reach, slot.shape[2])
        count = 0
        for i in range(i0, i1):
            for j in range(j0, j1):
                for k in range(k0, k1):
                    o = slot[i, j, k]
                    if o < 0 or o == s or count >= len(found):
                        continue
                    away, facing = 0.0, 0.0
                    for f in range(3):
                        away += (points[o, f] - points[s, f]) ** 2
                        facing += normals[o, f] * normals[s, f]
                    if away <= reach * reach and facing >= SAME_SIDE:
                        found[count] = o
                        away_of[count] = away
                        count += 1
        most = near.shape[1]
        near[s, :] = -1
        near[s, 0], weight[s, 0] = s, 1.0
        total, taken = 1.0, min(count, most - 1)
        for m in range(taken):
            e = m * count // taken
            w = (1.0 - away_of[e] / (reach * reach)) ** 2
            near[s, m + 1], weight[s, m + 1] = found[e], w
            total += w
        for m in range(most):
            weight[s, m] = weight[s, m] / total if near[s, m] >= 0 else 0.0


@njit(parallel=True, cache=True)
def average(near, weight, values, out):  # type: ignore[no-untyped-def]
    """Average values (S, F) over neighbours. ``out`` (S, F)"""
    for s in prange(len(near)):
        out[s] = 0.0
        for m in range(near.shape[1]):
            o = near[s, m]
            if o < 0:
                break
            for f in range(values.shape[1]):
                out[s, f] += weight[s, m] * values[o, f]


@njit(parallel=True, cache=True)
def thickness(side, slot, points, normals, reach, out):  # type: ignore[no-untyped-def]
    """Find how far below each point the surface's other side lies, at most ``reach``. ``out`` (S,)"""
    steps = int(reach / side) + 1
    for s in prange(len(points)):
        best = reach
        for m in range(steps + 1):
            x = int((points[s, 0] - m * side * normals[s, 0]) / side)
            y = int((points[s, 1] - m * side * normals[s, 1]) / side)
            z = int((points[s, 2] - m * side * normals[s, 2]) / side)
            for i in range(max(x - 1, 0), min(x + 2, slot.shape[0])):
                for j in range(max(y - 1, 0), min(y + 2, slot.shape[1])):
                    for k in range(max(z - 1, 0), min(z + 2, slot.shape[2])):
                        o = slot[i, j, k]
                        if o < 0:
                            continue
                        away, facing, depth = 0.0, 0.0, 0.0
                        for f in range(3):
                            d = points[o, f] - points[s, f]
                            away += d * d
                            depth -= d * normals[s, f]
                            facing += normals[o, f] * normals[s, f]
                        if facing < -SAME_SIDE and away - depth * depth < side * side and 0.0 <= depth < best:
                            best = depth
            if best < m * side:
                break
        out[s] = best


@njit(parallel=True, cache=True)
def light(points, normals, directions, extinction, cells, away, step, steps, out):  # type: ignore[no-untyped-def]
    """March from points to directions (D, 3) through the extinction of cells; ``out`` (S, D) receives what passes.

    The march begins ``away`` from the point along its normal and takes ``steps`` steps of ``step`` box units; the
    extinction is per box unit. Nothing passes from directions below the surface.
    """
    for s in prange(len(points)):
        for d in range(len(directions)):
            facing = 0.0
            for f in range(3):
                facing += directions[d, f] * normals[s, f]
            if facing <= 0.0:
                out[s, d] = 0.0
                continue
            depth = 0.0
            for m in range(steps):
                at = (m + 0.5) * step
                x = int((points[s, 0] + away * normals[s, 0] + at * directions[d, 0]) * cells)
                y = int((points[s, 1] + away * normals[s, 1] + at * directions[d, 1]) * cells)
                z = int((points[s, 2] + away * normals[s, 2] + at * directions[d, 2]) * cells)
                if not (0 <= x < extinction.shape[0] and 0 <= y < extinction.shape[1] and 0 <= z < extinction.shape[2]):
                    break
                depth += step * extinction[x, y, z]
                if depth > 4.0:
                    break
            out[s, d] = np.exp(-depth) if depth <= 4.0 else 0.0


@njit(cache=True)
def seeds(order, points, normals, tangents, along, across, side, kept):  # type: ignore[no-untyped-def]
    """Choose points as seeds of strokes by Poisson-disc sampling with ellipses along the strokes.

    Points are tried in ``order``; one is chosen if no seed lies within its ellipse with the semi-axes ``along`` (S,)
    and ``across`` (S,), both at most ``side``, the side of a bin. ``kept`` (S,) receives their numbers; returns how
    many there are.
    """
    size = int(np.ceil(1.0 / side)) + 1
    head = np.full((size, size, size), -1, np.int32)
    following = np.full(len(order), -1, np.int32)
    count = 0
    for s in order:
        a, b, c = int(points[s, 0] / side), int(points[s, 1] / side), int(points[s, 2] / side)
        free = True
        for i in range(max(a - 1, 0), min(a + 2, size)):
            for j in range(max(b - 1, 0), min(b + 2, size)):
                for k in range(max(c - 1, 0), min(c + 2, size)):
                    e = head[i, j, k]
                    while free and e >= 0:
                        o = kept[e]
                        x, facing, away = 0.0, 0.0, 0.0
                        for f in range(3):
                            d = points[o, f] - points[s, f]
                            away += d * d
                            x += d * tangents[s, f]
                            facing += normals[o, f] * normals[s, f]
                        rest = max(away - x * x, 0.0)
                        free = facing < SAME_SIDE or (x / along[s]) ** 2 + rest / across[s] ** 2 >= 1.0
                        e = following[e]
        if free:
            a, b, c = min(max(a, 0), size - 1), min(max(b, 0), size - 1), min(max(c, 0), size - 1)
            kept[count] = s
            following[count] = head[a, b, c]
            head[a, b, c] = count
            count += 1
    return count


@njit(parallel=True, cache=True)
def trace(  # type: ignore[no-untyped-def]
    seed, steps, step, turn, side, slot, points, normals, tangents, tones, most, out, first, count
):
    """Follow the tangents from seeds (N,) both ways: streamlines on the surface.

    A line takes up to ``steps`` (N, 2) steps of ``step`` (N,) each way. It ends at a rim, where its normal has turned
    by more than a brush follows, at a sharp turn (a cosine below ``turn``), and where the tone leaves the seed's by
    more than ``most``: strokes end at the border of light and shade. ``out`` (N, M, 6) receives positions and normals,
    from row ``first`` (N,) on, ``count`` (N,) of them; none if there is no surface at the seed.
    """
    for q in prange(len(seed)):
        s = seed[q]
        middle, here, there, p = np.empty(10), np.empty(10), np.empty(10), np.empty(3)
        count[q], first[q] = 0, steps[q, 0]
        if look(points[s], normals[s], tangents[s], side, slot, points, normals, tangents, tones, middle) <= 0.0:
            continue
        out[q, steps[q, 0]] = middle[:6]
        count[q] = 1
        for way in range(2):
            sign = -1.0 if way == 0 else 1.0
            here[:] = middle
            for m in range(steps[q, way]):
                for f in range(3):
                    p[f] = here[f] + sign * step[q] * here[6 + f]
                if look(p, here[3:6], here[6:9], side, slot, points, normals, tangents, tones, there) < 0.6:
                    break
                moved = 0.0
                for f in range(3):
                    moved += (there[f] - p[f]) ** 2
                aligned = there[6] * here[6] + there[7] * here[7] + there[8] * here[8]
                facing = there[3] * middle[3] + there[4] * middle[4] + there[5] * middle[5]
                if aligned < turn or facing < 0.35 or abs(there[9] - middle[9]) > most:
                    break
                if moved > 0.7 * step[q] * step[q]:  # the surface ends here and goes on at another depth
                    break
                row = steps[q, 0] - m - 1 if way == 0 else steps[q, 0] + m + 1
                out[q, row] = there[:6]
                if way == 0:
                    first[q] = row
                count[q] += 1
                here[:] = there
