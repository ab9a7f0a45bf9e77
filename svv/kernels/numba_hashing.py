"""The multiresolution hash grid (Müller et al. 2022), compiled with numba.

Letters: S samples, L levels, F features per level, V rows (over all levels).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(inline="always")
def row(x, y, z, resolution, entries):  # type: ignore[no-untyped-def]
    """Return the row of a vertex in its level: direct if all vertices fit, hashed otherwise (eq. 4)."""
    side = resolution + 1
    if side * side * side <= entries:
        return (x * side + y) * side + z
    h = (x ^ (y * 2654435761) ^ (z * 805459861)) & 0xFFFFFFFF
    return h % entries


@njit(parallel=True, fastmath=True, cache=True)
def encode(x, resolutions, offsets, table, out):  # type: ignore[no-untyped-def]
    """Compute the features of all levels, concatenated: x (S, 3) in [0, 1] -> out (S, L * F)."""
    levels, features = resolutions.shape[0], table.shape[1]
    for i in prange(x.shape[0]):
        for level in range(levels):
            r = resolutions[level]
            first, entries = offsets[level], offsets[level + 1] - offsets[level]
            fx, fy, fz = x[i, 0] * r, x[i, 1] * r, x[i, 2] * r
            ix, iy, iz = min(int(fx), r - 1), min(int(fy), r - 1), min(int(fz), r - 1)
            wx, wy, wz = fx - ix, fy - iy, fz - iz
            for f in range(features):
                out[i, level * features + f] = 0.0
            for corner in range(8):
                a, b, c = corner >> 2 & 1, corner >> 1 & 1, corner & 1
                w = np.float32((wx if a else 1.0 - wx) * (wy if b else 1.0 - wy) * (wz if c else 1.0 - wz))
                v = first + row(ix + a, iy + b, iz + c, r, entries)
                for f in range(features):
                    out[i, level * features + f] += w * table[v, f]


@njit(parallel=True, fastmath=True, cache=True)
def encode_backward(x, g_out, resolutions, offsets, g_table, used):  # type: ignore[no-untyped-def]
    """Add the gradient of :func:`encode` with respect to the table to ``g_table`` (V, F); mark rows in ``used``."""
    levels, features = resolutions.shape[0], g_table.shape[1]
    for level in prange(levels):
        r = resolutions[level]
        first, entries = offsets[level], offsets[level + 1] - offsets[level]
        for i in range(x.shape[0]):
            fx, fy, fz = x[i, 0] * r, x[i, 1] * r, x[i, 2] * r
            ix, iy, iz = min(int(fx), r - 1), min(int(fy), r - 1), min(int(fz), r - 1)
            wx, wy, wz = fx - ix, fy - iy, fz - iz
            for corner in range(8):
                a, b, c = corner >> 2 & 1, corner >> 1 & 1, corner & 1
                w = np.float32((wx if a else 1.0 - wx) * (wy if b else 1.0 - wy) * (wz if c else 1.0 - wz))
                v = first + row(ix + a, iy + b, iz + c, r, entries)
                used[v] = 1
                for f in range(features):
                    g_table[v, f] += w * g_out[i, level * features + f]
