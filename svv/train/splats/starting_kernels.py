"""Sums over the samples of cells, compiled with numba, for :mod:`svv.train.splats.starting`.

One thread adds up each cell, in the samples' order. Letters: S samples, C cells, K harmonics.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.train.splats.raster_kernels import basis_of

MOMENTS = 15
"""Sums of weight times 1, x, y, z, xx, xy, xz, yy, yz, zz, red, green, blue, the sum of their squares, and density."""


@njit(parallel=True, cache=True)
def order_keys(places, low, scale, levels, keys):  # type: ignore[no-untyped-def]
    """Write the Morton keys (S,) of cells of places (S, 3): the bits of their three numbers in turn, x the highest."""
    for s in prange(len(places)):
        key = np.int64(0)
        for k in range(3):
            cell = min(np.int64((places[s, k] - low[k]) * scale), (1 << levels) - 1)
            for bit in range(levels):
                key |= ((cell >> bit) & 1) << (3 * bit + 2 - k)
        keys[s] = key


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def add_moments(starts, places, weights, colours, densities, sums):  # type: ignore[no-untyped-def]
    """Write the moments of cells (C, MOMENTS) from those of their samples, which lie at ``starts`` (C + 1,)."""
    for c in prange(len(starts) - 1):
        own = np.zeros(MOMENTS)
        for s in range(starts[c], starts[c + 1]):
            w = np.float64(weights[s])
            x, y, z = np.float64(places[s, 0]), np.float64(places[s, 1]), np.float64(places[s, 2])
            own[0] += w
            own[1] += w * x
            own[2] += w * y
            own[3] += w * z
            own[4] += w * x * x
            own[5] += w * x * y
            own[6] += w * x * z
            own[7] += w * y * y
            own[8] += w * y * z
            own[9] += w * z * z
            for k in range(3):
                own[10 + k] += w * colours[s, k]
                own[13] += w * colours[s, k] * colours[s, k]
            own[14] += w * densities[s]
        sums[c] = own


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def add_harmonics(starts, directions, weights, colours, products, sides):  # type: ignore[no-untyped-def]
    """Write the normal equations of harmonics for the colours of cells: (C, K, K) and (C, K, 3)."""
    count = products.shape[1]
    for c in prange(len(starts) - 1):
        basis = np.zeros(16, np.float32)
        for s in range(starts[c], starts[c + 1]):
            if weights[s] == 0.0:
                continue
            basis_of(directions[s, 0], directions[s, 1], directions[s, 2], count, basis)
            for i in range(count):
                weighted = weights[s] * basis[i]
                for j in range(i + 1):
                    products[c, i, j] += weighted * basis[j]
                for k in range(3):
                    sides[c, i, k] += weighted * (colours[s, k] - np.float32(0.5))
        for i in range(count):
            for j in range(i):
                products[c, j, i] = products[c, i, j]


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def add_errors(starts, directions, weights, colours, harmonics, errors):  # type: ignore[no-untyped-def]
    """Write the weighted sum of squared differences between colours and harmonics (C, K, 3) of each cell. (C,)"""
    count = harmonics.shape[1]
    for c in prange(len(starts) - 1):
        basis, total = np.zeros(16, np.float32), 0.0
        for s in range(starts[c], starts[c + 1]):
            if weights[s] == 0.0:
                continue
            basis_of(directions[s, 0], directions[s, 1], directions[s, 2], count, basis)
            for k in range(3):
                apart = np.float32(0.5) - colours[s, k]
                for i in range(count):
                    apart += basis[i] * harmonics[c, i, k]
                total += weights[s] * apart * apart
        errors[c] = total
