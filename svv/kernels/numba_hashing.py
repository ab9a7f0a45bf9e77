"""The multiresolution hash grid (Müller et al. 2022), compiled with numba.

Letters: S samples, L levels, F features per level, V rows (over all levels).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(inline="always")
def corners(x, y, z, resolution, entries, rows, weights):  # type: ignore[no-untyped-def]
    """Set the rows (8,) and weights (8,) of the vertices around a point; a large level hashes its rows (eq. 4)."""
    fx, fy, fz = x * resolution, y * resolution, z * resolution
    ix, iy, iz = min(int(fx), resolution - 1), min(int(fy), resolution - 1), min(int(fz), resolution - 1)
    wx, wy, wz = np.float32(fx - ix), np.float32(fy - iy), np.float32(fz - iz)
    one, side = np.float32(1.0), resolution + 1
    direct = side * side * side <= entries
    last = entries - 1  # a hashed level has a power of two of rows
    for corner in range(8):
        a, b, c = corner >> 2 & 1, corner >> 1 & 1, corner & 1
        weights[corner] = (wx if a else one - wx) * (wy if b else one - wy) * (wz if c else one - wz)
        if direct:
            rows[corner] = ((ix + a) * side + iy + b) * side + iz + c
        else:
            rows[corner] = ((ix + a) ^ ((iy + b) * 2654435761) ^ ((iz + c) * 805459861)) & last


@njit(parallel=True, fastmath=True, cache=True)
def encode(x, resolutions, offsets, table, out):  # type: ignore[no-untyped-def]
    """Compute the features of all levels, concatenated: x (S, 3) in [0, 1] -> out (S, L * F)."""
    levels, features = resolutions.shape[0], table.shape[1]
    for level in prange(levels):  # one after another, because the caches hold the table of one level but not of all
        first, entries = offsets[level], offsets[level + 1] - offsets[level]
        rows, weights = np.empty(8, np.int64), np.empty(8, np.float32)
        for i in range(x.shape[0]):
            corners(x[i, 0], x[i, 1], x[i, 2], resolutions[level], entries, rows, weights)
            for f in range(features):
                total = np.float32(0.0)
                for corner in range(8):
                    total += weights[corner] * table[first + rows[corner], f]
                out[i, level * features + f] = total


@njit(parallel=True, fastmath=True, cache=True)
def encode_backward(x, g_out, resolutions, offsets, g_table, used):  # type: ignore[no-untyped-def]
    """Add the gradient of :func:`encode` with respect to the table to ``g_table`` (V, F); mark rows in ``used``."""
    levels, features = resolutions.shape[0], g_table.shape[1]
    for level in prange(levels):
        first, entries = offsets[level], offsets[level + 1] - offsets[level]
        rows, weights = np.empty(8, np.int64), np.empty(8, np.float32)
        for i in range(x.shape[0]):
            corners(x[i, 0], x[i, 1], x[i, 2], resolutions[level], entries, rows, weights)
            for corner in range(8):
                v = first + rows[corner]
                used[v] = 1
                for f in range(features):
                    g_table[v, f] += weights[corner] * g_out[i, level * features + f]
