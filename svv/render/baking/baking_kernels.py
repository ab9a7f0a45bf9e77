"""Volumes of colours and codes, compiled with numba: their empty points, hidden regions, halves and sums."""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit


@njit(parallel=True, cache=True)
def extend_colours(rgba, near):  # type: ignore[no-untyped-def]
    """Give each empty point beside visible ones their mean colour, so that interpolation between both keeps it.

    ``rgba`` (Z, Y, X, 4) uint8 is changed in place; a point is empty if its fourth byte is 0. ``near`` (N,): flat
    indices of the points to look at. Only empty points are written and only others are read.
    """
    depth, height, width = rgba.shape[:3]
    for i in prange(near.shape[0]):
        z, rest = divmod(near[i], height * width)
        y, x = divmod(rest, width)
        if rgba[z, y, x, 3] == 0:
            count = red = green = blue = 0
            for c in range(max(z - 1, 0), min(z + 2, depth)):
                for b in range(max(y - 1, 0), min(y + 2, height)):
                    for a in range(max(x - 1, 0), min(x + 2, width)):
                        if rgba[c, b, a, 3] > 0:
                            count += 1
                            red += rgba[c, b, a, 0]
                            green += rgba[c, b, a, 1]
                            blue += rgba[c, b, a, 2]
            if count > 0:
                half = count // 2
                rgba[z, y, x, 0] = np.uint8((red + half) // count)
                rgba[z, y, x, 1] = np.uint8((green + half) // count)
                rgba[z, y, x, 2] = np.uint8((blue + half) // count)


@njit(parallel=True, cache=True)
def soften_edges(codes, places, own, drop, out):  # type: ignore[no-untyped-def]
    """Compute codes for the hidden points beside visible ones.

    ``codes`` (Z, Y, X) uint8; ``places`` (N,): flat indices of hidden points; ``own`` (N,) uint8: their codes if they
    were visible; ``drop``: how far below the mean of its visible neighbours along the axes a point lies. Writes ``out``
    (N,) uint8: 0 for points without such neighbours.
    """
    depth, height, width = codes.shape
    for i in prange(places.shape[0]):
        z, rest = divmod(places[i], height * width)
        y, x = divmod(rest, width)
        count = total = 0
        for axis in range(3):
            for side in (-1, 1):
                c, b, a = z + side * (axis == 0), y + side * (axis == 1), x + side * (axis == 2)
                if 0 <= c < depth and 0 <= b < height and 0 <= a < width and codes[c, b, a] > 0:
                    count += 1
                    total += codes[c, b, a]
        out[i] = max(min(total // count, own[i]) - drop, 0) if count > 0 else 0


@njit(parallel=True, cache=True)
def halve(fine, roots, first, out, root):  # type: ignore[no-untyped-def]
    """Filter a volume for a grid of half its resolution.

    Each point of the coarse grid has a weighted mean of the 27 fine points around it, whose weights along each axis are
    1/4, 1/2, 1/4.

    ``fine`` (Z, Y, X, 4) uint8: colours and codes; ``roots`` (256,): square root of the extinction of each code;
    ``first`` (3,): index, z, y, x, in ``fine`` of the first coarse point, which may be negative. Writes the means of
    the roots, ``root`` (z, y, x) float32, and of the colours, weighted by extinction, into ``out`` (z, y, x, 4) uint8,
    the colour of the fine point itself where there is none; the fourth byte is left.
    """
    depth, height, width = fine.shape[:3]
    for z in prange(out.shape[0]):
        for y in range(out.shape[1]):
            for x in range(out.shape[2]):
                k, j, i = 2 * z + first[0], 2 * y + first[1], 2 * x + first[2]
                total = red = green = blue = weights = 0.0
                for c in range(max(k - 1, 0), min(k + 2, depth)):
                    for b in range(max(j - 1, 0), min(j + 2, height)):
                        for a in range(max(i - 1, 0), min(i + 2, width)):
                            code = fine[c, b, a, 3]
                            if code > 0:
                                share = 1.0 / (1 << (3 + abs(c - k) + abs(b - j) + abs(a - i)))
                                total += share * roots[code]
                                weight = share * roots[code] * roots[code]
                                red += weight * fine[c, b, a, 0]
                                green += weight * fine[c, b, a, 1]
                                blue += weight * fine[c, b, a, 2]
                                weights += weight
                root[z, y, x] = total
                if weights > 0.0:
                    out[z, y, x, 0] = np.uint8(red / weights + 0.5)
                    out[z, y, x, 1] = np.uint8(green / weights + 0.5)
                    out[z, y, x, 2] = np.uint8(blue / weights + 0.5)
                elif 0 <= k < depth and 0 <= j < height and 0 <= i < width:
                    out[z, y, x, :3] = fine[k, j, i, :3]


@njit(parallel=True, cache=True)
def longest(volume):  # type: ignore[no-untyped-def]
    """Return the greatest length of a point's vector of all four bytes; ``volume`` (Z, Y, X, 4) uint8."""
    found = np.zeros(volume.shape[0], np.int64)
    for z in prange(volume.shape[0]):
        for y in range(volume.shape[1]):
            for x in range(volume.shape[2]):
                square = np.int64(0)
                for n in range(4):
                    square += np.int64(volume[z, y, x, n]) ** 2
                found[z] = max(found[z], square)
    return np.sqrt(found.max())


@njit(parallel=True, cache=True)
def add_up(volumes, tables, first, step, out, total):  # type: ignore[no-untyped-def]
    """Add the extinctions of volumes on another grid, and mix their colours by them.

    ``volumes``: tuple of K volumes (Z, Y, X, 4) uint8, colours and codes; ``tables`` (K, 256): extinction of each code;
    ``first`` (K, 3): where the grid's first point is in each volume, in its points, z, y, x; ``step`` (K,): distance
    between points of the grid in points of each volume. Writes the extinctions into ``total`` (z, y, x) float32 and the
    colours into the first three bytes of ``out`` (z, y, x, 4) uint8.
    """
    for z in prange(out.shape[0]):
        mixed = np.zeros((out.shape[1], out.shape[2], 3), np.float32)
        for k in range(len(volumes)):
            _add(volumes[k], tables[k], first[k], step[k], z, mixed, total)
        for y in range(out.shape[1]):
            for x in range(out.shape[2]):
                if total[z, y, x] > 0.0:
                    for c in range(3):
                        out[z, y, x, c] = np.uint8(mixed[y, x, c] / total[z, y, x] + 0.5)


@njit(cache=True)
def _add(volume, table, first, step, z, mixed, total):  # type: ignore[no-untyped-def]
    """Add one volume to a slice of the grid; see :func:`add_up`."""
    depth, height, width = volume.shape[:3]
    w, found = first[0] + z * step, np.zeros(4)
    if not -1e-3 < w < depth - 1 + 1e-3:
        return
    k = min(max(int(np.floor(w)), 0), depth - 1)
    w = min(max(w - k, 0.0), 1.0)
    for y in range(mixed.shape[0]):
        v = first[1] + y * step
        if not -1e-3 < v < height - 1 + 1e-3:
            continue
        j = min(max(int(np.floor(v)), 0), height - 1)
        v = min(max(v - j, 0.0), 1.0)
        for x in range(mixed.shape[1]):
            u = first[2] + x * step
            if not -1e-3 < u < width - 1 + 1e-3:
                continue
            i = min(max(int(np.floor(u)), 0), width - 1)
            u = min(max(u - i, 0.0), 1.0)
            found[:] = 0.0
            for c in range(2):
                for b in range(2):
                    for a in range(2):
                        weight = (w if c else 1.0 - w) * (v if b else 1.0 - v) * (u if a else 1.0 - u)
                        if weight > 0.0:
                            for n in range(4):
                                found[n] += weight * volume[min(k + c, depth - 1), min(j + b, height - 1),
                                                            min(i + a, width - 1), n]  # fmt: skip
            code = min(int(found[3]), 254)
            extinction = table[code] + (found[3] - code) * (table[code + 1] - table[code])
            total[z, y, x] += extinction
            for n in range(3):
                mixed[y, x, n] += extinction * found[n]
