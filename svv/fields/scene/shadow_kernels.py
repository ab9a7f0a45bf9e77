"""Transmittance towards a light that is far away, compiled with numba."""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.lanes import LANES, exp, load, splat, store

EVEN = 0.01
"""How much neighbours count that are not in front of a surface: a sheet has no front, and takes light of both sides."""

SHARES = (1.0, 0.5, 0.25, 0.125)
"""How much neighbours count that lie apart along so many axes."""


@njit(parallel=True, cache=True)
def transmittance_in_columns(field, p, q, first, nearer, found):  # type: ignore[no-untyped-def]
    """Write the transmittance between points of sheared columns and the light, ``found`` (U, K, V).

    ``field`` (K, I, J): optical depth of one step along a column, at vertices; the light is on the side of slice 0.
    Point k of column (u, v) lies in slice k at i = u + first[0] - k p and j = v + first[1] - k q, so a column is a ray
    to the light. ``nearer`` (M,): weights of the point itself and of those between it and the light that count in part.
    """
    depths, rows, columns = field.shape
    for u in prange(found.shape[0]):
        own = np.zeros((depths, found.shape[2]), np.float32)
        for k in range(depths):
            x, y = u + first[0] - k * p, first[1] - k * q
            i, j = int(np.floor(x)), int(np.floor(y))
            f, g = np.float32(x - i), np.float32(y - j)
            for side in range(2):
                row, share = i + side, f if side else np.float32(1.0) - f
                if 0 <= row < rows:
                    for offset in range(2):  # of neighbours along the row
                        begin, end = max(0, -j - offset), min(found.shape[2], columns - j - offset)
                        part = share * (g if offset else np.float32(1.0) - g)
                        there, sums = field[k, row, begin + j + offset :], own[k, begin:end]
                        for v in range(len(sums)):
                            sums[v] += part * there[v]
        total = np.zeros(found.shape[2], np.float32)
        for k in range(depths):
            if k >= len(nearer):
                total += own[k - len(nearer)]
            found[u, k] = total
            for m in range(min(len(nearer), k + 1)):
                found[u, k] += nearer[m] * own[k - m]
            at, whole = (u * depths + k) * found.shape[2], found.shape[2] // LANES * LANES
            for v in range(at, at + whole, LANES):
                store(found, v, exp(splat(np.float32(0.0)) - load(found, v)))
            for v in range(whole, found.shape[2]):
                found[u, k, v] = np.exp(-found[u, k, v])


@njit(parallel=True, cache=True)
def add_transmittance(columns, p, q, first, share, found):  # type: ignore[no-untyped-def]
    """Add ``share`` of the transmittance to the light to ``found`` (K, I, J), at vertices.

    ``columns`` (U, K, V), ``p``, ``q`` and ``first`` are those of :func:`transmittance_in_columns`. Between optical
    depths, a little of a column through deep matter would be darkness already: a shadow would be wider by half a cell.
    """
    one = np.float32(1.0)
    for k in prange(found.shape[0]):
        x, y = k * p - first[0], k * q - first[1]
        a, b = int(np.floor(x)), int(np.floor(y))
        f, g = np.float32(x - a), np.float32(y - b)
        for i in range(found.shape[1]):
            low, high, own = columns[i + a, k, b:], columns[i + a + 1, k, b:], found[k, i]
            for j in range(len(own)):
                arrives = (one - f) * ((one - g) * low[j] + g * low[j + 1])
                own[j] += share * (arrives + f * ((one - g) * high[j] + g * high[j + 1]))


@njit(parallel=True, cache=True)
def carry_inside(light, clear, light_after, clear_after):  # type: ignore[no-untyped-def]
    """Let vertices that are not clear take part of the ``light`` (X, Y, Z) of clearer ones in front of their surface.

    ``clear`` (X, Y, Z): how far a vertex keeps its own, in [0, 1], and how much it counts for others; both are 0 where
    nothing is known, or wanted. ``light_after`` and ``clear_after`` come to hold what to call it again with: each call
    reaches one vertex deeper into matter. Neighbours count half as much for each axis along which they lie apart, and
    with the squared cosine to where it becomes clear, so that an edge between a bright and a dark side stays sharp.
    """
    for x in prange(1, light.shape[0] - 1):
        for y in range(1, light.shape[1] - 1):
            for z in range(1, light.shape[2] - 1):
                own = clear[x, y, z]
                light_after[x, y, z], clear_after[x, y, z] = light[x, y, z], own
                if 0.0 < own < 0.99:
                    a, b, c, around = 0.0, 0.0, 0.0, 0.0
                    for i in range(-1, 2):
                        for j in range(-1, 2):
                            for k in range(-1, 2):
                                weight = clear[x + i, y + j, z + k] * SHARES[abs(i) + abs(j) + abs(k)]
                                a, b, c, around = a + i * weight, b + j * weight, c + k * weight, around + weight
                    total, weights = 0.0, 0.0
                    for i in range(-1, 2):
                        for j in range(-1, 2):
                            for k in range(-1, 2):
                                weight = clear[x + i, y + j, z + k] * SHARES[abs(i) + abs(j) + abs(k)]
                                ahead = max(a * i + b * j + c * k, 0.0)
                                weight *= ahead * ahead / max(i * i + j * j + k * k, 1) + EVEN * around * around
                                total += weight * light[x + i, y + j, z + k]
                                weights += weight
                    light_after[x, y, z] = own * light[x, y, z] + (1.0 - own) * total / weights
                    clear_after[x, y, z] = own + (1.0 - own) * around / 8.0
