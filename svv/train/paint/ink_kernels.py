"""Pen strokes on a surface: placement of lines and dots, and how much of each place they cover. Numba, for the CPU.

A surface is a set of points with normals, tangents and tones, at most one in each cube of a grid. Distances between
strokes are measured along it, without the normal's component, so a stroke is the same throughout a shell. Letters: S
points of the surface, K points of strokes, C candidates for dots, V places to evaluate.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit

SAME_SIDE_COSINE = 0.3
"""Cosine of two normals above which they belong to the same side of a surface."""


@njit(cache=True)
def look(p, n, t, side, slot, points, normals, tangents, tones, out):  # type: ignore[no-untyped-def]
    """Average the surface around p where its normal is similar to n; tangents are aligned with t, up to their sign.

    ``slot`` (X, Y, Z) holds the point in each cube, whose side is ``side``, or -1. ``out`` (10,) receives p moved along
    the normal onto the surface, normal, tangent and tone, averaged within a distance of two sides. Returns the sum of
    the weights, 0 if there is no surface.
    """
    a, b, c = int(p[0] / side), int(p[1] / side), int(p[2] / side)
    reach, total = 4.0 * side * side, 0.0
    out[:] = 0.0
    for i in range(max(a - 2, 0), min(a + 3, slot.shape[0])):
        for j in range(max(b - 2, 0), min(b + 3, slot.shape[1])):
            for k in range(max(c - 2, 0), min(c + 3, slot.shape[2])):
                s = slot[i, j, k]
                if s < 0:
                    continue
                x, y, z = points[s, 0] - p[0], points[s, 1] - p[1], points[s, 2] - p[2]
                near = x * x + y * y + z * z
                facing = n[0] * normals[s, 0] + n[1] * normals[s, 1] + n[2] * normals[s, 2]
                if near >= reach or facing < SAME_SIDE_COSINE:
                    continue
                w = (1.0 - near / reach) ** 2 * facing
                along = t[0] * tangents[s, 0] + t[1] * tangents[s, 1] + t[2] * tangents[s, 2]
                sign = w if along >= 0.0 else -w
                out[0] += w * x
                out[1] += w * y
                out[2] += w * z
                for f in range(3):
                    out[3 + f] += w * normals[s, f]
                    out[6 + f] += sign * tangents[s, f]
                out[9] += w * tones[s]
                total += w
    if total <= 0.0:
        return 0.0
    out[9] /= total
    size = np.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    for f in range(3):
        out[3 + f] /= size
    up = (out[0] * out[3] + out[1] * out[4] + out[2] * out[5]) / total
    over = out[3] * out[6] + out[4] * out[7] + out[5] * out[8]
    for f in range(3):
        out[f] = p[f] + up * out[3 + f]
        out[6 + f] -= over * out[3 + f]
    size = max(np.sqrt(out[6] ** 2 + out[7] ** 2 + out[8] ** 2), 1e-12)
    for f in range(3):
        out[6 + f] /= size
    return total


@njit(parallel=True, cache=True)
def settle(side, slot, points, normals, tangents, tones, out):  # type: ignore[no-untyped-def]
    """Evaluate :func:`look` at each point of the surface. ``out`` (S, 10)"""
    for s in prange(len(points)):
        look(points[s], normals[s], tangents[s], side, slot, points, normals, tangents, tones, out[s])


@njit(cache=True)
def flat_distance(x, y, z, n, m, depth, thin):  # type: ignore[no-untyped-def]
    """Return the distance along the surface of a place with normal m at (x, y, z) from a stroke point with normal n.

    The component along n does not count up to ``depth``, or up to ``thin`` for the other side of a sheet; beyond that,
    the distance is infinite.
    """
    height = x * n[0] + y * n[1] + z * n[2]
    facing = n[0] * m[0] + n[1] * m[1] + n[2] * m[2]
    if abs(height) > (depth if facing >= SAME_SIDE_COSINE else thin if facing < -2.0 * SAME_SIDE_COSINE else -1.0):
        return np.inf
    return np.sqrt(max(x * x + y * y + z * z - height * height, 0.0))


@njit(cache=True)
def put(p, k, bin_side, head, following):  # type: ignore[no-untyped-def]
    """Add stroke point k at p to its bin, a linked list that begins in ``head`` (X, Y, Z)."""
    a = min(max(int(p[0] / bin_side), 0), head.shape[0] - 1)
    b = min(max(int(p[1] / bin_side), 0), head.shape[1] - 1)
    c = min(max(int(p[2] / bin_side), 0), head.shape[2] - 1)
    following[k] = head[a, b, c]
    head[a, b, c] = k


@njit(cache=True)
def put_all(where, bin_side, head, following):  # type: ignore[no-untyped-def]
    """Add all stroke points (K, 3) to their bins."""
    for k in range(len(where)):
        put(where[k], k, bin_side, head, following)


@njit(cache=True)
def is_free(p, n, distance, thin, bin_side, head, following, where, normal):  # type: ignore[no-untyped-def]
    """Return whether no stroke is nearer to p than ``distance``, which is at most the side of a bin."""
    a, b, c = int(p[0] / bin_side), int(p[1] / bin_side), int(p[2] / bin_side)
    for i in range(max(a - 1, 0), min(a + 2, head.shape[0])):
        for j in range(max(b - 1, 0), min(b + 2, head.shape[1])):
            for k in range(max(c - 1, 0), min(c + 2, head.shape[2])):
                s = head[i, j, k]
                while s >= 0:
                    x, y, z = p[0] - where[s, 0], p[1] - where[s, 1], p[2] - where[s, 2]
                    if flat_distance(x, y, z, normal[s], n, distance, thin) < distance:
                        return False
                    s = following[s]
    return True


@njit(cache=True)
def walk(  # type: ignore[no-untyped-def]
    first, step, steps, near, thin, least, skip, side, slot, points, normals, tangents, tones,
    bin_side, head, following, where, normal, own, done,
):  # fmt: skip
    """Follow the tangents from a place (10,), as :func:`look` writes it, until the line must end.

    It ends at light (a tone below ``least``), a rim, a sharp turn, another line nearer than ``near``, or itself more
    than ``skip`` points earlier. Points are appended to ``own`` (?, 10) from row ``done`` on; returns their new number.
    """
    here = first.copy()
    there = np.empty(10)
    p = np.empty(3)
    for _ in range(steps):
        if done >= len(own):
            break
        for f in range(3):
            p[f] = here[f] + step * here[6 + f]
        if look(p, here[3:6], here[6:9], side, slot, points, normals, tangents, tones, there) < 0.6:
            break
        turn = there[6] * here[6] + there[7] * here[7] + there[8] * here[8]
        if turn < 0.8 or there[9] < least:
            break
        if not is_free(there[:3], there[3:6], near, thin, bin_side, head, following, where, normal):
            break
        closed = False
        for s in range(done - skip):
            x, y, z = there[0] - own[s, 0], there[1] - own[s, 1], there[2] - own[s, 2]
            if flat_distance(x, y, z, own[s, 3:6], there[3:6], near, thin) < near:
                closed = True
                break
        if closed:
            break
        own[done] = there
        done += 1
        here[:] = there
    return done


@njit(cache=True)
def draw(  # type: ignore[no-untyped-def]  # long: one loop, whose state would be a dozen parameters
    order, least, longest, apart, near, thin, step, shortest, side, slot, points, normals, tangents, tones,
    bin_side, head, following, where, normal, tangent, tone, start, lines,
):  # fmt: skip
    """Add evenly spaced lines along the tangents (Jobard & Lefer 1997) to the existing ones.

    A line begins at a distance ``apart`` from another one or, in the given ``order``, at a point of the surface without
    lines nearby. It ends where it would come nearer than ``near`` to another; see :func:`walk`. ``least`` (N,) and
    ``longest`` (N,) are tones and numbers of points, used by the lines in turn; lines of fewer points than ``shortest``
    are left out. Points of line l are rows start[l] to start[l + 1] of ``where``, ``normal``, ``tangent`` (K, 3) and
    ``tone`` (K,); ``lines`` is their number so far. Returns the new number of lines; stops when the arrays are full.
    """
    own, back, seed = np.empty((4096, 10)), np.empty((4096, 10)), np.empty(10)
    place, n, t = np.empty(3), np.empty(3), np.empty(3)
    stride = max(1, int(apart / step))
    skip = int(2.0 * apart / step) + 2
    at, which, hand, queue = start[0], 0, 0, 0
    while True:
        if queue < lines:
            for f in range(3):
                n[f], t[f] = normal[at, f], tangent[at, f]
            sign = apart if hand == 0 else -apart
            place[0] = where[at, 0] + sign * (n[1] * t[2] - n[2] * t[1])
            place[1] = where[at, 1] + sign * (n[2] * t[0] - n[0] * t[2])
            place[2] = where[at, 2] + sign * (n[0] * t[1] - n[1] * t[0])
            hand += 1
            if hand == 2:
                hand, at = 0, at + stride
                if at >= start[queue + 1]:
                    queue += 1
                    at = start[queue]
        elif which < len(order):
            s = order[which]
            which += 1
            for f in range(3):
                place[f], n[f], t[f] = points[s, f], normals[s, f], tangents[s, f]
        else:
            return lines
        if look(place, n, t, side, slot, points, normals, tangents, tones, seed) < 0.6:
            continue
        low, room = least[lines % len(least)], 0.95 * apart
        if seed[9] < low:
            continue
        if not is_free(seed[:3], seed[3:6], room, thin, bin_side, head, following, where, normal):
            continue
        most = longest[lines % len(longest)]
        own[0] = seed
        forward = walk(seed, step, most, near, thin, low, skip, side, slot, points, normals, tangents, tones,
                       bin_side, head, following, where, normal, own, 1)  # fmt: skip
        # The backward half must not run into the forward half, so the forward half comes first.
        for s in range(forward):
            back[s] = own[forward - 1 - s]
            for f in range(6, 9):
                back[s, f] = -back[s, f]
        for f in range(6, 9):
            seed[f] = -seed[f]
        whole = walk(seed, step, most, near, thin, low, skip, side, slot, points, normals, tangents, tones,
                     bin_side, head, following, where, normal, back, forward)  # fmt: skip
        first = start[lines]
        if whole < shortest:
            continue
        if first + whole > len(where) or lines + 2 > len(start):
            return lines
        for s in range(whole):
            k = first + s
            for f in range(3):
                where[k, f], normal[k, f], tangent[k, f] = back[s, f], back[s, 3 + f], back[s, 6 + f]
            tone[k] = back[s, 9]
            put(where[k], k, bin_side, head, following)
        lines += 1
        start[lines] = first + whole
        if queue == lines - 1:
            at, hand = first, 0


@njit(cache=True)
def scatter(place, normal, distance, thin, bin_side, head, following, kept):  # type: ignore[no-untyped-def]
    """Choose dots among candidates in order, so that no two are nearer than the mean of their ``distance`` (C,).

    ``kept`` (C,) receives the numbers of the chosen dots; returns how many. No distance exceeds a bin's side.
    """
    count = 0
    for p in range(len(place)):
        free = True
        a, b, c = int(place[p, 0] / bin_side), int(place[p, 1] / bin_side), int(place[p, 2] / bin_side)
        for i in range(max(a - 1, 0), min(a + 2, head.shape[0])):
            for j in range(max(b - 1, 0), min(b + 2, head.shape[1])):
                for k in range(max(c - 1, 0), min(c + 2, head.shape[2])):
                    s = head[i, j, k]
                    while free and s >= 0:
                        apart = 0.5 * (distance[p] + distance[s])
                        x, y, z = place[p, 0] - place[s, 0], place[p, 1] - place[s, 1], place[p, 2] - place[s, 2]
                        free = flat_distance(x, y, z, normal[s], normal[p], apart, thin) >= apart
                        s = following[s]
        if free:
            put(place[p], p, bin_side, head, following)
            kept[count] = p
            count += 1
    return count


@njit(parallel=True, cache=True)
def cover(  # type: ignore[no-untyped-def]
    place, facing, depth, thin, soft, bin_side, head, following, where, normal, radius, out
):
    """Compute the ink coverage in [0, 1] of each place (V, 3) with normal ``facing``. ``out`` (V,)

    Points of strokes are discs of ``radius`` (K,) that extend ``depth`` to either side, with edges ``soft`` wide.
    """
    for v in prange(len(place)):
        a, b, c = int(place[v, 0] / bin_side), int(place[v, 1] / bin_side), int(place[v, 2] / bin_side)
        best = 0.0
        for i in range(max(a - 1, 0), min(a + 2, head.shape[0])):
            for j in range(max(b - 1, 0), min(b + 2, head.shape[1])):
                for k in range(max(c - 1, 0), min(c + 2, head.shape[2])):
                    s = head[i, j, k]
                    while s >= 0:
                        x, y, z = place[v, 0] - where[s, 0], place[v, 1] - where[s, 1], place[v, 2] - where[s, 2]
                        away = flat_distance(x, y, z, normal[s], facing[v], depth, thin)
                        best = max(best, 0.5 + (radius[s] - away) / soft)
                        s = following[s]
        out[v] = min(best, 1.0)
