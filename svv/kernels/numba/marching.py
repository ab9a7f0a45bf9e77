"""Marching through occupied cells and compositing along rays, compiled with numba.

Letters: R rays, S samples, C channels, (X, Y, Z) cells of the occupancy grid, L levels of a lattice.
All positions are box coordinates (:mod:`svv.core.geometry.box`), all lengths are box units.

The compiled functions use one thread per block of rays and write disjoint ranges, so their results do not depend
on the number of threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from svv.core.fast_math import FAST_MATH
from svv.kernels.numba.bricks import value_in_brick
from svv.kernels.numba.leaping import octant
from svv.kernels.numba.trilinear import NEXT_ROW, ONE32, ask_for, cell_at

RAYS_A_BLOCK = 64
"""Number of rays in a block, which one thread marches; the samples of a block are written contiguously."""


@njit(fastmath=FAST_MATH)
def interpolate_scalar(x, y, z, shapes, scales, bases, index, table):  # type: ignore[no-untyped-def]
    """Return the sum over levels of the trilinear interpolation of a one-channel table."""
    total = np.float32(0.0)
    for level in range(shapes.shape[0]):
        a, b, c, d, wx, wy, wz = cell_at(x, y, z, level, shapes, scales, bases, index)
        ux, uy, uz = ONE32 - wx, ONE32 - wy, ONE32 - wz
        near = uy * (uz * table[a] + wz * table[a + NEXT_ROW]) + wy * (uz * table[b] + wz * table[b + NEXT_ROW])
        far = uy * (uz * table[c] + wz * table[c + NEXT_ROW]) + wy * (uz * table[d] + wz * table[d + NEXT_ROW])
        total += ux * near + wx * far
    return total


@njit(fastmath=FAST_MATH)
def ask_for_values(x, y, z, extent, shapes, scales, bases, index, table):  # type: ignore[no-untyped-def]
    """Ask for the values at the corners of a position's cells, without waiting for them."""
    x = min(max(x, np.float32(0.0)), extent[0])
    y = min(max(y, np.float32(0.0)), extent[1])
    z = min(max(z, np.float32(0.0)), extent[2])
    for level in range(shapes.shape[0]):
        for row in cell_at(x, y, z, level, shapes, scales, bases, index)[:4]:
            ask_for(table, row)


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


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def march(  # type: ignore[no-untyped-def]  # long: one loop, whose state is registers
    origins,
    directions,
    distance,
    cells,
    extent,
    step,
    jitter_seed,
    first_ray,
    shapes,
    scales,
    bases,
    index,
    table,
    slots,
    bricks,
    ceiling,
    least_weight,
    keep,
    stop,
    fade,
    merge,
    position,
    skipped,
    sigma,
    ray,
    start,
    count,
    tail,
    full,
):
    """March rays through the occupied cells and keep the samples that matter.

    ``distance`` (8, X, Y, Z) tells how far a ray may leap, 0 for occupied cells (:func:`svv.core.rays.cells.leaps`).
    Every ray is sampled with a fixed step (shifted by a random fraction of it if ``jitter_seed`` > 0, by half a step
    otherwise; ``first_ray`` is the number of the first ray in its batch, for its random numbers). A sample whose weight
    is below ``least_weight`` is kept only with probability ``keep``; the optical
    depth of samples left out is accumulated in ``skipped`` of the next kept one (or ``tail`` of the ray), so that
    transmittance stays exact. With ``merge``, it becomes part of the next sample instead, as soon as both together
    weigh enough: there are few samples, and no part of the pixel is lost. Optical depth is multiplied by ``fade`` when
    it dims a sample and when it ends a ray (above ``stop``), because extinctions may be scaled later by factors of
    ``fade`` or more. With 0, no ray ends.

    Where there are bricks (:mod:`svv.kernels.numba.bricks`), they have the values of ``table``.

    The samples of block k are written from ``k * capacity`` on, where capacity is ``len(sigma) // blocks``. A
    block that needs more room marks itself in ``full`` (blocks,) and stops.
    """
    rays = origins.shape[0]
    blocks = (rays + RAYS_A_BLOCK - 1) // RAYS_A_BLOCK
    capacity = sigma.shape[0] // blocks
    nx, ny, nz = distance.shape[1:]
    side, rate = np.float32(1.0) / cells, np.float32(1.0) / step
    in_bricks, scale = slots.size > 0, scales[0]
    cell = np.int32(shapes[0, 0] - 2), np.int32(shapes[0, 1] - 2), np.int32(shapes[0, 2] - 2)  # the last one
    for block in prange(blocks):
        n = block * capacity
        end = n + capacity
        for r in range(block * RAYS_A_BLOCK, min(rays, (block + 1) * RAYS_A_BLOCK)):
            start[r] = n
            ox, oy, oz = origins[r, 0], origins[r, 1], origins[r, 2]
            dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
            near, far = clip_to_box(origins, directions, r, extent)
            left_out = np.float32(0.0)  # optical depth since the last kept sample
            tau = np.float32(0.0)  # optical depth since the start of the ray
            front = ONE32  # upper bound of the transmittance in front of the next sample
            if near < far:
                ix_, iy_, iz_ = inverse(dx), inverse(dy), inverse(dz)
                ahead = octant(dx, dy, dz)
                shift = np.float32(0.5)
                if jitter_seed > 0:
                    shift = uniform(jitter_seed, first_ray + r, 0)
                i = int(math.ceil(near / step - shift))
                last = int(math.floor(far / step - shift))
                while i <= last:
                    t = (np.float32(i) + shift) * step
                    x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
                    cx = min(max(int(x * cells), 0), nx - 1)
                    cy = min(max(int(y * cells), 0), ny - 1)
                    cz = min(max(int(z * cells), 0), nz - 1)
                    empty = int(distance[ahead, cx, cy, cz])
                    if empty > 0:
                        # Go to the first sample behind the cube of empty cells around this one.
                        tx = leap(cx, empty, dx, ox, ix_, side)
                        ty = leap(cy, empty, dy, oy, iy_, side)
                        tz = leap(cz, empty, dz, oz, iz_, side)
                        i = max(i + 1, int(math.ceil(min(tx, min(ty, tz)) * rate - shift)))
                        continue
                    if jitter_seed > 0:
                        # Neighbouring rays of a training come from all views: what the last one needed is of no use.
                        u = (np.float32(i + 1) + shift) * step
                        ask_for_values(
                            ox + u * dx, oy + u * dy, oz + u * dz, extent, shapes, scales, bases, index, table
                        )
                    x = min(max(x, np.float32(0.0)), extent[0])
                    y = min(max(y, np.float32(0.0)), extent[1])
                    z = min(max(z, np.float32(0.0)), extent[2])
                    if in_bricks:
                        raw = value_in_brick(x, y, z, scale, cell, slots, bricks)
                    else:
                        raw = interpolate_scalar(x, y, z, shapes, scales, bases, index, table)
                    s = np.exp(min(raw, ceiling))
                    thickness = s * step
                    before = left_out if merge else np.float32(0.0)
                    weight = (thickness + before) * front  # an upper bound, which saves most exponentials
                    if weight >= least_weight:
                        front = np.exp(fade * (before - tau))
                        weight = front * (ONE32 - np.exp(-thickness - before))
                    if n == end:
                        full[block] = 1
                        break
                    if weight >= least_weight or (keep > 0 and uniform(jitter_seed, first_ray + r, i + 1) < keep):
                        position[n, 0], position[n, 1], position[n, 2] = x, y, z
                        skipped[n] = left_out - before
                        sigma[n] = s + before * rate
                        ray[n] = r
                        n += 1
                        left_out = np.float32(0.0)
                    else:
                        left_out += thickness
                    tau += thickness
                    if fade * tau > stop:
                        break
                    i += 1
            count[r] = n - start[r]
            tail[r] = left_out


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
