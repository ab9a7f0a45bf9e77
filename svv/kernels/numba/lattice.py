"""Interpolation on sparse vertex lattices and their optimiser, compiled with numba.

Letters: S samples, L levels, F features per level, V stored vertices (over all levels).
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.kernels.numba.trilinear import NEXT_ROW, ONE32, ask_for, cell_at, mean_of, row_at, weights_of

AHEAD = 6
"""Samples before its own at which the memory of a sample's vertices is asked for: in training, it is rarely in the
cache, because neighbouring rays come from all views."""


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def encode(x, shapes, scales, bases, index, table, width, out):  # type: ignore[no-untyped-def]
    """Compute the trilinear features of all levels, concatenated: x (S, 3) -> out (S, L * F).

    ``width`` is a tuple of F numbers: a loop whose length is known at compile time takes half the time.
    """
    levels, features = shapes.shape[0], len(width)
    for i in prange(x.shape[0]):
        later = min(np.uint64(i + AHEAD), np.uint64(x.shape[0] - 1))
        for level in range(levels):
            for row in cell_at(x[later, 0], x[later, 1], x[later, 2], level, shapes, scales, bases, index)[:4]:
                ask_for(table, row * np.uint64(features))
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        for level in range(levels):
            a, b, c, d, wx, wy, wz = cell_at(px, py, pz, level, shapes, scales, bases, index)
            w = weights_of(wx, wy, wz)
            for f in range(features):
                out[i, level * features + f] = mean_of(table, a, b, c, d, w, np.uint64(f))


@njit(fastmath=FAST_MATH)
def _side_of_cell(fx, fy, fz, odd, level, shapes, bases, index):  # type: ignore[no-untyped-def]
    """Return rows and weights of a cell's corners with an even or ``odd`` x index, for a position in cells.

    Returns:
        Rows of the corners with the lower and the higher y, and the lower z; the weight of this side; and the offsets
        from the cell's first corner along y and z.
    """
    last = np.uint64(bases[shapes.shape[0]])
    nx, ny, nz = shapes[level, 0], shapes[level, 1], shapes[level, 2]
    words = (nz + 31) >> 5
    ix, iy, iz = min(int(fx), nx - 2), min(int(fy), ny - 2), min(int(fz), nz - 2)
    wx, wy, wz = fx - np.float32(ix), fy - np.float32(iy), fz - np.float32(iz)
    beyond = (ix ^ odd) & 1
    at = np.uint64(bases[level] + ((ix + beyond) * ny + iy) * words + (iz >> 5))
    before = (np.uint64(1) << np.uint64(iz & 31)) - np.uint64(1)
    a, b = row_at(index[at], before, last), row_at(index[at + np.uint64(words)], before, last)
    return a, b, wx if beyond else ONE32 - wx, wy, wz


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def encode_backward(x, g_out, shapes, scales, bases, index, width, g_table, used):  # type: ignore[no-untyped-def]
    """Add the gradient of :func:`encode` with respect to the table to ``g_table`` (V, F); mark rows in ``used`` (V,).

    A task handles the vertices of one level with even or with odd x indices, which is one side of every cell. No two
    tasks write the same vertex, and each vertex sums in the order of the samples, whatever the number of threads. Even
    a lattice of one level has work for two threads.
    """
    levels, features, samples = shapes.shape[0], len(width), x.shape[0]
    for task in prange(2 * levels):
        odd, level = task // levels, task % levels  # each of two threads gets all levels and so the same work
        scale, column = scales[level], level * features
        for i in range(samples):
            later = min(i + AHEAD, samples - 1)
            a, b, w, wy, wz = _side_of_cell(
                x[later, 0] * scale, x[later, 1] * scale, x[later, 2] * scale, odd, level, shapes, bases, index
            )
            for row in (a, b):
                ask_for(g_table, row * np.uint64(features))
                ask_for(used, row)
            a, b, w, wy, wz = _side_of_cell(
                x[i, 0] * scale, x[i, 1] * scale, x[i, 2] * scale, odd, level, shapes, bases, index
            )
            near, far = w * (ONE32 - wy), w * wy
            weights = near * (ONE32 - wz), near * wz, far * (ONE32 - wz), far * wz
            rows = (a, a + NEXT_ROW, b, b + NEXT_ROW)
            for k in range(4):
                used[rows[k]] = 1
                for f in range(features):
                    g_table[rows[k], np.uint64(f)] += weights[k] * g_out[i, column + f]


BIAS_CORRECTED_STEPS = 10000
"""Number of steps after which Adam's bias correction no longer changes."""


@njit(fastmath=FAST_MATH, cache=True)
def bias_corrections(beta1, beta2):  # type: ignore[no-untyped-def]
    """Return 1 - beta1^n and 1 / (1 - beta2^n) for n = 0 to :data:`BIAS_CORRECTED_STEPS`, float32; row 0 is unused.

    (BIAS_CORRECTED_STEPS + 1, 2)
    """
    out = np.ones((BIAS_CORRECTED_STEPS + 1, 2), np.float32)
    for age in range(1, BIAS_CORRECTED_STEPS + 1):
        n = np.float32(age)
        out[age, 0] = ONE32 - np.exp(n * np.log(beta1))
        out[age, 1] = ONE32 / (ONE32 - np.exp(n * np.log(beta2)))
    return out


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def adam(  # type: ignore[no-untyped-def]
    table, gradient, used, first, second, age, rate, beta1, beta2, epsilon, pull, corrections, finer
):
    """Take one Adam step (Kingma & Ba 2015) on the vertices that the batch used; clear their gradient and mark.

    ``pull`` times the value is added to the gradient of the vertices from ``finer`` on.

    ``age`` counts the steps of each vertex, so that the bias correction is right for rarely used vertices, too. The
    corrections come from :func:`bias_corrections`, because two exponentials per vertex would double the time of a step.
    """
    features = table.shape[1]
    for v in prange(table.shape[0]):
        if used[v]:
            used[v] = 0
            age[v] += 1
            n = min(age[v], BIAS_CORRECTED_STEPS)
            a, b = rate / corrections[n, 0], corrections[n, 1]
            back = pull if v >= finer else np.float32(0.0)
            for f in range(features):
                g = gradient[v, f] + back * table[v, f]
                gradient[v, f] = 0.0
                first[v, f] += (np.float32(1.0) - beta1) * (g - first[v, f])
                second[v, f] += (np.float32(1.0) - beta2) * (g * g - second[v, f])
                table[v, f] -= a * first[v, f] / (np.sqrt(second[v, f] * b) + epsilon)


@njit(cache=True)
def marked_rows(marks, out):  # type: ignore[no-untyped-def]
    """Write the indices of the N rows that are marked; ``marks`` (V,) holds N ones, otherwise zeros. -> out (N,)

    Every index is written, and overwritten unless its row is marked, because a branch would often be mispredicted.
    """
    n, v = 0, 0
    while n < len(out):
        out[n] = v
        n += int(marks[v])
        v += 1
