"""Sums over rays and the descent of :mod:`svv.train.palette.along_rays`, compiled with numba.

Each ray and each vertex is computed by one thread, in the order of its samples, and blocks of rays are as long whatever
the number of threads: so are results the same.

Letters: S samples, R rays, V vertices, P regions. Samples are in the order of their rays: those of ray r are
``first[r]`` to ``first[r + 1]``, of which ``vertex``, ``weight`` and ``cosine`` are those of
:class:`svv.kernels.types.RaySamples`. Indices are uint32: for a signed one, numba would check whether it counts
from the end. Other numbers are float32.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH

BLOCK = 512
"""Rays or vertices that a thread takes at a time."""

ONE = np.uint32(1)
ZERO32, ONE32 = np.float32(0.0), np.float32(1.0)


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def normal_equations(first, vertex, weight, cosine, pixel, region, sums):  # type: ignore[no-untyped-def]
    """Add up the normal equations of what regions reflect of light from everywhere and of a headlight.

    ``sums`` (B, 2 P, 2 P + 3): one sum per block of rays, zeros before: of products of what a ray sees of each of 2 P
    unknowns, of which the entries above the diagonal are left out, and of their products with its pixel.
    """
    size = sums.shape[1]
    for block in prange(sums.shape[0]):
        own, part = sums[block], np.zeros(size)
        for r in range(block * BLOCK, min((block + 1) * BLOCK, pixel.shape[0])):
            for s in range(first[r], first[r + 1]):
                p = region[vertex[s]]
                part[p] += weight[s]
                part[size // 2 + p] += weight[s] * cosine[s]
            for a in range(size):
                if part[a] != 0.0:
                    for b in range(a + 1):
                        own[a, b] += part[a] * part[b]
                    for c in range(3):
                        own[a, size + c] += part[a] * pixel[r, c]
            part[:] = 0.0


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def errors(first, vertex, weight, cosine, pixel, along, kept, light, member, error):  # type: ignore[no-untyped-def]
    """Write the ``error`` of pixels (R, 3); see :meth:`svv.kernels.types.RegionKernels.errors`.

    Two regions are added up at a time, in registers.
    """
    rays = np.uint32(pixel.shape[0])
    for block in prange((rays + BLOCK - 1) // BLOCK):
        for r in range(np.uint32(block * BLOCK), min(np.uint32((block + 1) * BLOCK), rays)):
            x, y, z = -pixel[r, 0], -pixel[r, 1], -pixel[r, 2]
            for pair in range(member.shape[1] // 2):
                p = np.uint32(2 * pair)
                q = p + ONE
                plain, lit, other_plain, other_lit = ZERO32, ZERO32, ZERO32, ZERO32
                for s in range(first[r], first[r + ONE]):
                    v, w = vertex[s], weight[s]
                    wc = w * cosine[s]
                    plain, lit = plain + w * member[v, p], lit + wc * member[v, p]
                    other_plain, other_lit = other_plain + w * member[v, q], other_lit + wc * member[v, q]
                x += plain * light[p, 0] + lit * light[p, 3] + other_plain * light[q, 0] + other_lit * light[q, 3]
                y += plain * light[p, 1] + lit * light[p, 4] + other_plain * light[q, 1] + other_lit * light[q, 4]
                z += plain * light[p, 2] + lit * light[p, 5] + other_plain * light[q, 2] + other_lit * light[q, 5]
            less = (ONE32 - kept) * (x * along[r, 0] + y * along[r, 1] + z * along[r, 2])
            error[r, 0], error[r, 1], error[r, 2] = (
                x - less * along[r, 0],
                y - less * along[r, 1],
                z - less * along[r, 2],
            )


@njit(fastmath=FAST_MATH, inline="always")
def excess(values, i, count):  # type: ignore[no-untyped-def]
    """Return what the first values of row i have too much each for memberships >= 0 with sum 1 (Michelot 1986).

    It is the mean excess of all values at first, and then of those that are above it. Branches that no one can predict
    would take longer than passes over values that are known already.
    """
    shift = -ONE32
    for p in range(count):
        shift += values[i, p]
    shift /= np.float32(count)
    for _ in range(count - ONE):
        total, above = -ONE32, ZERO32
        for p in range(count):
            one = ONE32 if values[i, p] > shift else ZERO32
            total += one * values[i, p]
            above += one
        shift = max(shift, total / max(above, ONE32))
    return shift


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def descend(  # type: ignore[no-untyped-def]
    first, ray, weight, lit, error, neighbours, root, least, light, step, smoothness, momentum, count, ahead, member,
    following,
):  # fmt: skip
    """Take a step down the slope of the errors; see :meth:`svv.kernels.types.RegionKernels.descend`.

    Here, samples are in the order of their vertices (:class:`svv.kernels.types.VertexSamples`). ``smoothness`` and
    ``momentum`` are the ``pace``; there are ``count`` regions, and nothing in a last one if P is the next even number.
    """
    vertices = np.uint32(member.shape[0])
    for block in prange((vertices + BLOCK - 1) // BLOCK):
        for i in range(np.uint32(block * BLOCK), min(np.uint32((block + 1) * BLOCK), vertices)):
            a, b, c, d, e, f = ZERO32, ZERO32, ZERO32, ZERO32, ZERO32, ZERO32
            for s in range(first[i], first[i + ONE]):
                r, w, wc = ray[s], step[i] * weight[s], step[i] * lit[s]
                a, b, c = a + w * error[r, 0], b + w * error[r, 1], c + w * error[r, 2]
                d, e, f = d + wc * error[r, 0], e + wc * error[r, 1], f + wc * error[r, 2]
            for pair in range(member.shape[1] // 2):
                p = np.uint32(2 * pair)
                q = p + ONE
                pull, other_pull = ZERO32, ZERO32
                for n in range(6):
                    m = neighbours[i, n]
                    w = root[i] * root[m] + least
                    pull += w * (ahead[m, p] - ahead[i, p])
                    other_pull += w * (ahead[m, q] - ahead[i, q])
                pull, other_pull = step[i] * smoothness * pull, step[i] * smoothness * other_pull
                slope = a * light[p, 0] + b * light[p, 1] + c * light[p, 2]
                slope += d * light[p, 3] + e * light[p, 4] + f * light[p, 5]
                following[i, p] = ahead[i, p] + pull - slope
                slope = a * light[q, 0] + b * light[q, 1] + c * light[q, 2]
                slope += d * light[q, 3] + e * light[q, 4] + f * light[q, 5]
                following[i, q] = ahead[i, q] + other_pull - slope
            shift = excess(following, i, count)
            for k in range(count):
                found = max(following[i, k] - shift, ZERO32)
                following[i, k] = found + momentum * (found - member[i, k])
                member[i, k] = found
