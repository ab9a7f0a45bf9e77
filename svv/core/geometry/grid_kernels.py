"""Filters of values on a grid and directions of tensors, compiled with numba.

Each value is computed by one thread without any shared sum, so results do not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH


@njit(fastmath=FAST_MATH, inline="always")
def _add(row, weight, sign, above, below):  # type: ignore[no-untyped-def]
    """Add ``weight`` (``above`` + ``sign`` ``below``) to a row."""
    for k in range(row.shape[0]):
        row[k] += weight * (above[k] + sign * below[k])


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def filtered(values, weights, signs, beyond, out):  # type: ignore[no-untyped-def]
    """Write the correlation of a grid (X, Y, Z) with three filters, one along each axis; all numbers are float32.

    ``weights`` (3, N): the middle of each filter and what follows it; ``signs`` (3,): 1 if it is even, or -1 if it is
    odd: equal values then cancel exactly; ``beyond``: factor of the nearest values, which are beyond the grid: 1 or 0.
    """
    nx, ny, nz = values.shape
    reach = weights.shape[1] - 1
    for x in prange(nx):
        plane, line = np.empty((ny, nz), np.float32), np.empty(nz + 2 * reach, np.float32)
        middle = line[reach : reach + nz]
        for y in range(ny):
            plane[y] = weights[0, 0] * values[x, y]
            for j in range(1, reach + 1):
                after, before = min(x + j, nx - 1), max(x - j, 0)
                if beyond > 0.0 or (x + j < nx and x >= j):
                    _add(plane[y], weights[0, j], signs[0], values[after, y], values[before, y])
                elif x + j < nx:
                    plane[y] += weights[0, j] * values[after, y]
                elif x >= j:
                    plane[y] += weights[0, j] * signs[0] * values[before, y]
        for y in range(ny):
            middle[:] = weights[1, 0] * plane[y]
            for j in range(1, reach + 1):
                after, before = min(y + j, ny - 1), max(y - j, 0)
                if beyond > 0.0 or (y + j < ny and y >= j):
                    _add(middle, weights[1, j], signs[1], plane[after], plane[before])
                elif y + j < ny:
                    middle += weights[1, j] * plane[after]
                elif y >= j:
                    middle += weights[1, j] * signs[1] * plane[before]
            line[:reach], line[reach + nz :] = beyond * middle[0], beyond * middle[nz - 1]
            row = out[x, y]
            row[:] = weights[2, 0] * middle
            for j in range(1, reach + 1):
                _add(row, weights[2, j], signs[2], line[reach + j :], line[reach - j :])


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def principal_directions(tensors, least, squarings, out):  # type: ignore[no-untyped-def]
    """Write the unit eigenvector of the largest eigenvalue of symmetric matrices, of either sign. (N, 3)

    ``tensors`` (6, N): entries xx, xy, yy, xz, yz, zz of matrices without negative eigenvalues, float32; ``least``:
    trace up to which the result is zero; ``squarings``: those that leave of a matrix only that direction.
    """
    for i in prange(tensors.shape[1]):
        xx, xy, yy = np.float64(tensors[0, i]), np.float64(tensors[1, i]), np.float64(tensors[2, i])
        xz, yz, zz = np.float64(tensors[3, i]), np.float64(tensors[4, i]), np.float64(tensors[5, i])
        if xx + yy + zz <= least:
            out[i, 0] = out[i, 1] = out[i, 2] = 0.0
            continue
        for _ in range(squarings):
            part = 1.0 / (xx + yy + zz)
            xx, xy, yy, xz, yz, zz = part * xx, part * xy, part * yy, part * xz, part * yz, part * zz
            xx, xy, yy, xz, yz, zz = (
                xx * xx + xy * xy + xz * xz, xx * xy + xy * yy + xz * yz, xy * xy + yy * yy + yz * yz,
                xx * xz + xy * yz + xz * zz, xy * xz + yy * yz + yz * zz, xz * xz + yz * yz + zz * zz,
            )  # fmt: skip
        if xx >= yy and xx >= zz:
            a, b, c = xx, xy, xz
        elif yy >= zz:
            a, b, c = xy, yy, yz
        else:
            a, b, c = xz, yz, zz
        length = np.sqrt(a * a + b * b + c * c)
        out[i, 0], out[i, 1], out[i, 2] = a / length, b / length, c / length
