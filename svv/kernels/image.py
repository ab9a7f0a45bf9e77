"""What stands around the networks in an image, fused and without gradients: features, material, light, compositing.

Each function does in one pass over the samples what :mod:`svv.fields` says in a dozen torch operations, whose time goes
into memory. Letters: S samples, R rays, P palette colours, L levels, F features a level, H spherical harmonics.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from svv.kernels.marching import BLOCK

ONE = np.float32(1.0)


@njit(fastmath=True, inline="always")
def softplus(x):  # type: ignore[no-untyped-def]
    """log(1 + e^x), as torch has it."""
    return x if x > 20.0 else np.log1p(np.exp(x))


@njit(parallel=True, fastmath=True, cache=True)
def features(x, ray, harmonics, shapes, scales, bases, index, geometry, material, lit, plain):  # type: ignore[no-untyped-def]
    """Inputs of the lighting MLP, ``lit`` (S, L F + H), and of the palette MLP, ``plain`` (S, L F).

    The tables ``geometry`` and ``material`` (V, F) have one layout, so the vertices of a sample are found once.
    """
    levels, width, count = shapes.shape[0], geometry.shape[1], harmonics.shape[1]
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
            ux, uy, uz = ONE - wx, ONE - wy, ONE - wz
            w0, w1, w2, w3 = ux * uy * uz, ux * uy * wz, ux * wy * uz, ux * wy * wz
            w4, w5, w6, w7 = wx * uy * uz, wx * uy * wz, wx * wy * uz, wx * wy * wz
            for f in range(width):
                lit[i, level * width + f] = (
                    w0 * geometry[a, f] + w1 * geometry[a + 1, f] + w2 * geometry[b, f] + w3 * geometry[b + 1, f]
                    + w4 * geometry[c, f] + w5 * geometry[c + 1, f] + w6 * geometry[d, f] + w7 * geometry[d + 1, f]
                )
                plain[i, level * width + f] = (
                    w0 * material[a, f] + w1 * material[a + 1, f] + w2 * material[b, f] + w3 * material[b + 1, f]
                    + w4 * material[c, f] + w5 * material[c + 1, f] + w6 * material[d, f] + w7 * material[d + 1, f]
                )
        for k in range(count):
            lit[i, levels * width + k] = harmonics[ray[i], k]


@njit(parallel=True, fastmath=True, cache=True)
def material(raw, colours, shift, floor, region, diffuse):  # type: ignore[no-untyped-def]
    """Diffuse colour I sum_i w_i (P_i + delta_i) (S, 3) and region (S,) of what the palette MLP says (S, 1 + 4 P)."""
    count = colours.shape[0]
    for i in prange(raw.shape[0]):
        red = green = blue = total = largest = np.float32(0.0)
        for p in range(count):
            w = softplus(raw[i, 1 + p]) + floor
            at = 1 + count + 3 * p
            red += w * (colours[p, 0] + raw[i, at])
            green += w * (colours[p, 1] + raw[i, at + 1])
            blue += w * (colours[p, 2] + raw[i, at + 2])
            total += w
            if w > largest:
                largest = w
                region[i] = p
        scale = softplus(raw[i, 0] + shift) / total
        diffuse[i, 0], diffuse[i, 1], diffuse[i, 2] = scale * red, scale * green, scale * blue


@njit(parallel=True, fastmath=True, cache=True)
def light(raw, factors, region, shift, colour):  # type: ignore[no-untyped-def]
    """Light diffuse ``colour`` (S, 3), in place, as the lighting MLP says (S, 1 or 2) and each region's factor (P,)."""
    for i in prange(raw.shape[0]):
        factor, shade = factors[region[i]], ONE
        if raw.shape[1] > 1:
            shade = max(ONE + factor * (np.float32(2.0) / (ONE + np.exp(-raw[i, 1])) - ONE), np.float32(0.0))
        specular = factor * softplus(raw[i, 0] + shift)
        for c in range(3):
            colour[i, c] = colour[i, c] * shade + specular


@njit(parallel=True, fastmath=True, cache=True)
def composite(  # type: ignore[no-untyped-def]
    position, sigma, skipped, colour, region, opacity, origins, start, count, tail, step, size, faint, rgba, depth, seen
):
    """Pixels of rays: straight ``rgba`` (R, 4) in [0, 1], ``depth`` (R,) and the region that is ``seen`` (R,) int16.

    A pixel whose alpha is not above ``faint`` stays as it is. ``opacity`` (P,) scales each region's extinction; its
    region is that which holds most of a pixel's weight. ``size``: world units of a box unit.
    """
    rays, regions = start.shape[0], opacity.shape[0]
    for block in prange((rays + BLOCK - 1) // BLOCK):
        shares = np.zeros(regions, np.float32)
        for r in range(block * BLOCK, min(rays, (block + 1) * BLOCK)):
            t, red, green, blue, far = ONE, np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
            shares[:] = 0.0
            for j in range(start[r], start[r] + count[r]):
                t *= np.exp(-skipped[j])
                e = np.exp(-sigma[j] * opacity[region[j]] * step)
                w = t * (ONE - e)
                red += w * colour[j, 0]
                green += w * colour[j, 1]
                blue += w * colour[j, 2]
                x = position[j, 0] - origins[r, 0]
                y = position[j, 1] - origins[r, 1]
                z = position[j, 2] - origins[r, 2]
                far += w * math.sqrt(x * x + y * y + z * z)
                shares[region[j]] += w
                t *= e
            alpha = ONE - t * np.exp(-tail[r])
            if alpha > faint:
                back = ONE / alpha
                rgba[r, 0] = min(max(red * back, np.float32(0.0)), ONE)
                rgba[r, 1] = min(max(green * back, np.float32(0.0)), ONE)
                rgba[r, 2] = min(max(blue * back, np.float32(0.0)), ONE)
                rgba[r, 3] = alpha
                depth[r] = far * back * size
                seen[r] = np.argmax(shares)
