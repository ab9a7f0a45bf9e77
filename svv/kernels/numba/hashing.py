"""The multiresolution hash grid (Müller et al. 2022), compiled with numba.

Letters: S samples, L levels, F features per level, V rows (over all levels).
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH

PRIMES = (np.uint64(2654435761), np.uint64(805459861))
"""Factors of the hash for y and z."""

FLOATS_A_LINE = 16
"""Number of floats in a line of the CPU's cache."""

SAMPLES_A_READ = 16
"""Rows of a level per sample up to which reading the whole level first is worthwhile."""


@njit(inline="always")
def corners(x, y, z, resolution, first, entries):  # type: ignore[no-untyped-def]
    """Return the rows and weights of the eight vertices around a point; a large level hashes its rows (eq. 4).

    Rows are unsigned, so that they are not checked for counting from the end.
    """
    fx, fy, fz = x * resolution, y * resolution, z * resolution
    ix, iy, iz = min(int(fx), resolution - 1), min(int(fy), resolution - 1), min(int(fz), resolution - 1)
    wx, wy, wz = np.float32(fx - ix), np.float32(fy - iy), np.float32(fz - iz)
    kx, ky, kz, low = np.uint64(ix), np.uint64(iy), np.uint64(iz), np.uint64(first)
    side, next_ = np.uint64(resolution + 1), np.uint64(1)
    if side * side * side <= np.uint64(entries):
        low += (kx * side + ky) * side + kz
        high = low + side * side
        rows = (
            low, low + next_, low + side, low + side + next_, high, high + next_, high + side, high + side + next_,
        )  # fmt: skip
    else:
        last, jx = np.uint64(entries - 1), kx + next_  # a hashed level has a power of two of rows
        y0, z0 = ky * PRIMES[0], kz * PRIMES[1]
        y1, z1 = y0 + PRIMES[0], z0 + PRIMES[1]
        a, b, c, d = y0 ^ z0, y0 ^ z1, y1 ^ z0, y1 ^ z1
        rows = (
            low + ((kx ^ a) & last), low + ((kx ^ b) & last), low + ((kx ^ c) & last), low + ((kx ^ d) & last),
            low + ((jx ^ a) & last), low + ((jx ^ b) & last), low + ((jx ^ c) & last), low + ((jx ^ d) & last),
        )  # fmt: skip
    one = np.float32(1.0)
    vx, vy, vz = one - wx, one - wy, one - wz
    p, q, s, t = vy * vz, vy * wz, wy * vz, wy * wz
    return rows, (vx * p, vx * q, vx * s, vx * t, wx * p, wx * q, wx * s, wx * t)


@njit(inline="always")
def read(table, first, end):  # type: ignore[no-untyped-def]
    """Read a level once, in order, and return a sum of it.

    That brings the level into the cache at the full rate of the memory; the accesses to random rows that follow would
    wait for each line on its own.
    """
    total = np.float32(0.0)
    for v in range(first, end, max(1, FLOATS_A_LINE // table.shape[1])):
        total += table[v, 0]
    return total


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def encode(x, resolutions, offsets, table, out):  # type: ignore[no-untyped-def]
    """Compute the features of all levels, concatenated: x (S, 3) in [0, 1] -> out (S, L * F)."""
    levels, features = resolutions.shape[0], table.shape[1]
    for level in prange(levels):  # one after another, because the caches hold the table of one level but not of all
        first, end, column = offsets[level], offsets[level + 1], level * features
        if x.shape[0] * SAMPLES_A_READ > end - first:
            out[0, column] = read(table, first, end)  # written, so that the compiler does not leave it out
        for i in range(x.shape[0]):
            r, w = corners(x[i, 0], x[i, 1], x[i, 2], resolutions[level], first, end - first)
            for f in range(features):
                out[i, column + f] = (
                    w[0] * table[r[0], f] + w[1] * table[r[1], f] + w[2] * table[r[2], f] + w[3] * table[r[3], f]
                    + w[4] * table[r[4], f] + w[5] * table[r[5], f] + w[6] * table[r[6], f] + w[7] * table[r[7], f]
                )  # fmt: skip


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def encode_backward(x, g_out, resolutions, offsets, g_table, used):  # type: ignore[no-untyped-def]
    """Add the gradient of :func:`encode` with respect to the table to ``g_table`` (V, F); mark rows in ``used``."""
    levels, features = resolutions.shape[0], g_table.shape[1]
    unused = np.empty(levels, np.float32)
    for level in prange(levels):
        first, end, column = offsets[level], offsets[level + 1], level * features
        if x.shape[0] * SAMPLES_A_READ > end - first:
            unused[level] = read(g_table, first, end)
        for i in range(x.shape[0]):
            r, w = corners(x[i, 0], x[i, 1], x[i, 2], resolutions[level], first, end - first)
            used[r[0]] = used[r[1]] = used[r[2]] = used[r[3]] = 1
            used[r[4]] = used[r[5]] = used[r[6]] = used[r[7]] = 1
            for f in range(features):
                g = g_out[i, column + f]
                g_table[r[0], f] += w[0] * g
                g_table[r[1], f] += w[1] * g
                g_table[r[2], f] += w[2] * g
                g_table[r[3], f] += w[3] * g
                g_table[r[4], f] += w[4] * g
                g_table[r[5], f] += w[5] * g
                g_table[r[6], f] += w[6] * g
                g_table[r[7], f] += w[7] * g
