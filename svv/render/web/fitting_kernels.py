"""Least squares at many places, for the light of pages.

Letters: V vertices, K functions of a direction, S directions of all vertices, one after the other.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit

PARTS = 64
"""Parts of the work, more than threads."""


@njit(parallel=True, cache=True)
def fit(end, weight, basis, first, second, ridge, out):  # type: ignore[no-untyped-def]
    """Fit two sets of values at each vertex by K functions, with weights, by Cholesky's decomposition.

    Args:
        end: End of each vertex's directions, ascending. (V,)
        weight: Weight of each direction, > 0. (S,)
        basis: Values of the functions; those beyond the first K are not used. (S, >= K)
        first: Values to fit. (S,)
        second: Others. (S,)
        ridge: Weight of the squared coefficients, > 0, float32.
        out: Coefficients of the first values and of the second. (V, 2 K)
    """
    count = out.shape[1] // 2
    for part in prange(PARTS):
        a = np.empty((count, count + 2), np.float32)
        for v in range(part * len(end) // PARTS, (part + 1) * len(end) // PARTS):
            a[:] = np.float32(0.0)
            for s in range(end[v - 1] if v else 0, end[v]):
                for i in range(count):
                    scaled = weight[s] * basis[s, i]
                    for j in range(i + 1):
                        a[i, j] += scaled * basis[s, j]
                    a[i, count] += scaled * first[s]
                    a[i, count + 1] += scaled * second[s]
            for i in range(count):
                a[i, i] += ridge
                for j in range(i + 1):
                    for k in range(j):
                        a[i, j] -= a[i, k] * a[j, k]
                    a[i, j] = a[i, j] / a[j, j] if j < i else np.sqrt(a[i, i])
                for side in range(2):
                    for k in range(i):
                        a[i, count + side] -= a[i, k] * a[k, count + side]
                    a[i, count + side] /= a[i, i]
            for side in range(2):
                for i in range(count - 1, -1, -1):
                    for k in range(i + 1, count):
                        a[i, count + side] -= a[k, i] * out[v, side * count + k]
                    out[v, side * count + i] = a[i, count + side] / a[i, i]
