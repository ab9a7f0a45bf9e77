"""What stands around the networks in an image, fused and without gradients: features, material, light, compositing.

Each function does in one pass over the samples what :mod:`svv.fields` says in a dozen torch operations, whose time goes
into memory. Letters: S samples, R rays, P palette colours, L levels, F features a level, H spherical harmonics.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from svv.kernels.marching import BLOCK
from svv.kernels.trilinear import ONE, cell_at, mean_of, weights_of


@njit(fastmath=True, inline="always")
def softplus(x):  # type: ignore[no-untyped-def]
    """log(1 + e^x), as torch has it."""
    return x if x > 20.0 else np.log1p(np.exp(x))


@njit(parallel=True, fastmath=True, cache=True)
def features(x, ray, harmonics, shapes, scales, bases, index, tables, width, lit, plain):  # type: ignore[no-untyped-def]
    """Inputs of the lighting MLP, ``lit`` (S, L F + H), and of the palette MLP, ``plain`` (S, L F).

    ``tables`` (V, 2 F) holds the geometry's features and the material's, so each vertex is fetched once. ``width``: see
    :func:`svv.kernels.lattice.encode`.
    """
    levels, own, count = shapes.shape[0], len(width), harmonics.shape[1]
    for i in prange(x.shape[0]):
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        for level in range(levels):
            a, b, c, d, wx, wy, wz = cell_at(px, py, pz, level, shapes, scales, bases, index)
            w = weights_of(wx, wy, wz)
            for f in range(own):
                g, m = np.uint64(f), np.uint64(own + f)
                one, other = mean_of(tables, a, b, c, d, w, g), mean_of(tables, a, b, c, d, w, m)
                lit[i, level * own + f] = one
                plain[i, level * own + f] = other
        r = ray[i]
        for k in range(count):
            lit[i, levels * own + k] = harmonics[r, k]


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
