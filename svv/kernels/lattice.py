"""Interpolation on sparse vertex lattices and its optimiser, compiled with numba.

Letters: S samples, L levels, F features a level, V stored vertices (over all levels).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(parallel=True, fastmath=True, cache=True)
def encode(x, shapes, scales, bases, index, table, out):  # type: ignore[no-untyped-def]
    """Trilinear features of all levels, side by side: x (S, 3) -> out (S, L * F)."""
    levels, features = shapes.shape[0], table.shape[1]
    for i in prange(x.shape[0]):
        for level in range(levels):
            s = scales[level]
            fx, fy, fz = x[i, 0] * s, x[i, 1] * s, x[i, 2] * s
            ix = min(int(fx), shapes[level, 0] - 2)
            iy = min(int(fy), shapes[level, 1] - 2)
            iz = min(int(fz), shapes[level, 2] - 2)
            wx, wy, wz = fx - ix, fy - iy, fz - iz
            ny, nz = shapes[level, 1], shapes[level, 2]
            at = bases[level] + (ix * ny + iy) * nz + iz
            a, b = index[at], index[at + nz]
            c, d = index[at + ny * nz], index[at + ny * nz + nz]
            ux, uy, uz = np.float32(1.0) - wx, np.float32(1.0) - wy, np.float32(1.0) - wz
            w0, w1, w2, w3 = ux * uy * uz, ux * uy * wz, ux * wy * uz, ux * wy * wz
            w4, w5, w6, w7 = wx * uy * uz, wx * uy * wz, wx * wy * uz, wx * wy * wz
            for f in range(features):
                out[i, level * features + f] = (
                    w0 * table[a, f] + w1 * table[a + 1, f] + w2 * table[b, f] + w3 * table[b + 1, f]
                    + w4 * table[c, f] + w5 * table[c + 1, f] + w6 * table[d, f] + w7 * table[d + 1, f]
                )


@njit(parallel=True, fastmath=True, cache=True)
def encode_backward(x, g_out, shapes, scales, bases, index, g_table, used):  # type: ignore[no-untyped-def]
    """Gradient of :func:`encode` with respect to the table, added to ``g_table`` (V, F); marks ``used`` (V,).

    Threads share no level, so no two write the same vertex and the sum has a fixed order.
    """
    levels, features = shapes.shape[0], g_table.shape[1]
    for level in prange(levels):
        s = scales[level]
        ny, nz = shapes[level, 1], shapes[level, 2]
        for i in range(x.shape[0]):
            fx, fy, fz = x[i, 0] * s, x[i, 1] * s, x[i, 2] * s
            ix = min(int(fx), shapes[level, 0] - 2)
            iy = min(int(fy), shapes[level, 1] - 2)
            iz = min(int(fz), shapes[level, 2] - 2)
            wx, wy, wz = fx - ix, fy - iy, fz - iz
            at = bases[level] + (ix * ny + iy) * nz + iz
            a, b = index[at], index[at + nz]
            c, d = index[at + ny * nz], index[at + ny * nz + nz]
            ux, uy, uz = np.float32(1.0) - wx, np.float32(1.0) - wy, np.float32(1.0) - wz
            used[a] = used[a + 1] = used[b] = used[b + 1] = 1
            used[c] = used[c + 1] = used[d] = used[d + 1] = 1
            for f in range(features):
                g = g_out[i, level * features + f]
                g_table[a, f] += ux * uy * uz * g
                g_table[a + 1, f] += ux * uy * wz * g
                g_table[b, f] += ux * wy * uz * g
                g_table[b + 1, f] += ux * wy * wz * g
                g_table[c, f] += wx * uy * uz * g
                g_table[c + 1, f] += wx * uy * wz * g
                g_table[d, f] += wx * wy * uz * g
                g_table[d + 1, f] += wx * wy * wz * g


@njit(parallel=True, fastmath=True, cache=True)
def adam(  # type: ignore[no-untyped-def]
    table, gradient, used, first, second, age, rate, beta1, beta2, epsilon, pull, finer
):
    """One Adam step (Kingma & Ba 2015) on the vertices that the batch used; clears their gradient and mark.

    ``pull`` times the value is added to the gradient of the vertices from ``finer`` on.

    ``age`` counts the steps of each vertex, so the bias correction of one that is rarely seen is right.
    """
    features = table.shape[1]
    for v in prange(table.shape[0]):
        if used[v]:
            used[v] = 0
            age[v] += 1
            n = np.float32(min(age[v], 10000))
            a = rate / (np.float32(1.0) - np.exp(n * np.log(beta1)))
            b = np.float32(1.0) / (np.float32(1.0) - np.exp(n * np.log(beta2)))
            back = pull if v >= finer else np.float32(0.0)
            for f in range(features):
                g = gradient[v, f] + back * table[v, f]
                gradient[v, f] = 0.0
                first[v, f] += (np.float32(1.0) - beta1) * (g - first[v, f])
                second[v, f] += (np.float32(1.0) - beta2) * (g * g - second[v, f])
                table[v, f] -= a * first[v, f] / (np.sqrt(second[v, f] * b) + epsilon)
