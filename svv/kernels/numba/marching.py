"""What marching takes, and compositing along rays, compiled with numba.

Letters: R rays, S samples, C channels, (X, Y, Z) cells of the occupancy grid, L levels of a lattice.
All positions are box coordinates (:mod:`svv.core.geometry.box`), all lengths are box units.

The compiled functions use one thread per block of rays and write disjoint ranges, so their results do not depend
on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.kernels.numba.trilinear import ONE32

RAYS_A_BLOCK = 64
"""Number of rays in a block, which one thread marches; the samples of a block are written contiguously."""


@njit(fastmath=FAST_MATH)
def clip_to_box(origins, directions, r, extent):  # type: ignore[no-untyped-def]
    """Return the distances at which ray r enters and leaves the box; the first is larger if it misses the box."""
    near, far = np.float32(0.0), np.float32(1e30)
    for k in range(3):
        o, d, e = origins[r, k], directions[r, k], extent[k]
        if abs(d) < 1e-9:
            if o < 0.0 or o > e:
                far = np.float32(-1.0)
        else:
            a, b = -o / d, (e - o) / d
            near, far = max(near, min(a, b)), min(far, max(a, b))
    return near, far


@njit(fastmath=FAST_MATH)
def uniform(seed, a, b):  # type: ignore[no-untyped-def]
    """Return a random number in [0, 1) from three integers (counter-based, so threads need no state)."""
    h = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(a) * np.uint64(0xBF58476D1CE4E5B9)
    h ^= np.uint64(b) * np.uint64(0x94D049BB133111EB)
    h ^= h >> np.uint64(31)
    h *= np.uint64(0x9E3779B97F4A7C15)
    h ^= h >> np.uint64(29)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(32)
    return np.float32(h >> np.uint64(40)) * np.float32(1.0 / 16777216.0)


@njit(fastmath=FAST_MATH)
def inverse(d):  # type: ignore[no-untyped-def]
    """Return 1 / d, or 0 for a ray parallel to the planes normal to the axis."""
    return np.float32(0.0) if abs(d) < 1e-9 else np.float32(1.0) / d


@njit(fastmath=FAST_MATH)
def leap(cell, empty, d, o, inverse_d, side):  # type: ignore[no-untyped-def]
    """Return where a ray leaves the slab of ``empty`` cells that begins with a cell, along one axis."""
    if inverse_d == 0.0:
        return np.float32(1e30)
    return (np.float32(cell + empty if d > 0 else cell + 1 - empty) * side - o) * inverse_d


@njit(parallel=True, cache=True)
def gather(start, count, offset, position, skipped, sigma, ray, position_, skipped_, sigma_, ray_):  # type: ignore[no-untyped-def]
    """Move the samples of every ray to ``offset`` to close the gaps; ``start`` becomes ``offset``."""
    for r in prange(start.shape[0]):
        a, b = start[r], offset[r]
        for j in range(count[r]):
            position_[b + j, 0] = position[a + j, 0]
            position_[b + j, 1] = position[a + j, 1]
            position_[b + j, 2] = position[a + j, 2]
            skipped_[b + j] = skipped[a + j]
            sigma_[b + j] = sigma[a + j]
            ray_[b + j] = ray[a + j]
        start[r] = b


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def composite(sigma, skipped, values, start, count, tail, step, out, transmittance, weights):  # type: ignore[no-untyped-def]
    """Composite ``values`` (S, C) front to back: out_r = sum_i w_i v_i, and the transmittance behind the ray."""
    channels = values.shape[1]
    for r in prange(start.shape[0]):
        t = np.float32(1.0)
        for c in range(channels):
            out[r, c] = 0.0
        for j in range(start[r], start[r] + count[r]):
            t *= np.exp(-skipped[j])
            e = np.exp(-sigma[j] * step)
            w = t * (np.float32(1.0) - e)
            weights[j] = w
            for c in range(channels):
                out[r, c] += w * values[j, c]
            t *= e
        transmittance[r] = t * np.exp(-tail[r])


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def composite_backward(  # type: ignore[no-untyped-def]
    sigma, skipped, values, weights, start, count, step, out, transmittance, g_out, g_transmittance, g_sigma, g_values
):
    """Compute the gradients of :func:`composite` with respect to extinction (S,) and values (S, C)."""
    channels = values.shape[1]
    for r in prange(start.shape[0]):
        behind = transmittance[r] * g_transmittance[r]
        for c in range(channels):
            behind += g_out[r, c] * out[r, c]
        t = np.float32(1.0)
        for j in range(start[r], start[r] + count[r]):
            t *= np.exp(-skipped[j])
            e = np.exp(-sigma[j] * step)
            dot = np.float32(0.0)
            for c in range(channels):
                dot += g_out[r, c] * values[j, c]
                g_values[j, c] = weights[j] * g_out[r, c]
            behind -= weights[j] * dot
            g_sigma[j] = step * (t * e * dot - behind)
            t *= e


@njit(parallel=True, cache=True)
def cut(skipped, own, start, count, every, shift, begin, end, taken):  # type: ignore[no-untyped-def]
    """Find the cuts through the weights of a ray's samples; see :func:`svv.fields.radiance.rendering.representatives`.

    Writes the cumulative weight before each sample, ``begin``, and behind it, ``end`` (S,), in units of ``every`` and
    shifted by the ray's ``shift`` (R,), and the number of samples ``taken`` on each ray (R,).
    """
    for r in prange(start.shape[0]):
        tau, number = np.float64(0.0), 0
        for j in range(start[r], start[r] + count[r]):
            tau += np.float64(skipped[j] + own[j])
            begin[j] = np.float32(-np.expm1(own[j] - tau)) / every + shift[r]
            end[j] = np.float32(-np.expm1(-tau)) / every + shift[r]
            number += np.floor(end[j]) > np.floor(begin[j])
        taken[r] = max(number, min(count[r], 1))


@njit(parallel=True, cache=True)
def choose(start, count, begin, end, first, rows, place):  # type: ignore[no-untyped-def]
    """Write the samples into which a cut falls, ``rows`` (K,), and each sample's ``place`` in them (S,).

    ``first`` (R,): place of each ray's first chosen sample.
    """
    for r in prange(start.shape[0]):
        at, last = first[r] - 1, start[r] + count[r] - 1
        waiting = start[r]  # samples from here on do not have a place yet
        for j in range(start[r], last + 1):
            if np.floor(end[j]) > np.floor(begin[j]) or (j == last and at < first[r]):
                at += 1
                rows[at] = j
                coming = np.floor(begin[j]) + ONE32
                for i in range(waiting, j):
                    middle = np.float32(0.5) * (begin[i] + end[i])
                    nearer = at > first[r] and middle - np.floor(end[rows[at - 1]]) < coming - middle
                    place[i] = at - 1 if nearer else at
                place[j] = at
                waiting = j + 1
        for i in range(waiting, last + 1):
            place[i] = at
