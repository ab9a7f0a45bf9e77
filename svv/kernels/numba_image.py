"""What stands around the networks in an image, fused and without gradients: features, material, light, compositing.

Each function does in one pass over the samples what :mod:`svv.fields` says in a dozen torch operations, whose time goes
into memory. Letters: S samples, R rays, P palette colours, L levels, F features a level, H spherical harmonics.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from svv.core.light import GRAZING, RIM
from svv.kernels.numba_marching import BLOCK
from svv.kernels.numba_trilinear import ONE, cell_at, mean_of, weights_of

SLACK, SMALLEST = np.float32(RIM), np.float32(GRAZING)
"""Of :mod:`svv.core.light`, in single precision: a float beside would make numba calculate in double."""


@njit(fastmath=True, inline="always")
def softplus(x):  # type: ignore[no-untyped-def]
    """log(1 + e^x), as torch has it."""
    return x if x > 20.0 else np.log1p(np.exp(x))


@njit(parallel=True, fastmath=True, cache=True)
def features(x, ray, harmonics, shapes, scales, bases, index, tables, width, lit, plain):  # type: ignore[no-untyped-def]
    """Inputs of the lighting MLP, ``lit`` (S, L F + H), and of the palette MLP, ``plain`` (S, L F).

    ``tables`` (V, 2 F) holds the geometry's features and the material's, so each vertex is fetched once. ``width``: see
    :func:`svv.kernels.numba_lattice.encode`.
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
def light(raw, lights, region, shift, colour):  # type: ignore[no-untyped-def]
    """Light diffuse ``colour`` (S, 3), in place, as the lighting MLP says (S, 1 or 2).

    ``lights`` (P, 3): what each region makes of it (:func:`svv.fields.paint_light.lights_of`).
    """
    for i in prange(raw.shape[0]):
        shade, r = ONE, region[i]
        if raw.shape[1] > 1:
            shade = np.float32(2.0) / (ONE + np.exp(-raw[i, 1]))
        shade = max(ONE + lights[r, 0] * (lights[r, 1] * shade - ONE), np.float32(0.0))
        specular = lights[r, 0] * (softplus(raw[i, 0] + shift) - lights[r, 2])
        for c in range(3):
            colour[i, c] = colour[i, c] * shade + specular


@njit(parallel=True, fastmath=True, cache=True)
def phong(  # type: ignore[no-untyped-def]
    position, ray, facing, toward, half, intensity, shapes, scales, bases, index, normals, scale, soft, raw,
    coefficients, floor, lights, region, colour,
):  # fmt: skip
    """Light diffuse ``colour`` (S, 3), in place, as an explicit light does (:func:`svv.core.light.blinn_phong`).

    ``facing``, ``toward``, ``half`` (R, 3): unit vectors of rays towards viewer, light and between both. ``normals``
    (V, 3) times ``scale``: what the lattice holds, of which lengths above ``soft`` count. ``raw`` (S, 1 + 4 P): what
    the palette MLP says, whose weights mix the ``coefficients`` (P, 4). ``lights`` (P, 3): see :func:`light`.
    """
    levels, count = shapes.shape[0], coefficients.shape[0]
    for i in prange(position.shape[0]):
        nx = ny = nz = np.float32(0.0)
        for level in range(levels):
            a, b, c, d, wx, wy, wz = cell_at(
                position[i, 0], position[i, 1], position[i, 2], level, shapes, scales, bases, index
            )
            w = weights_of(wx, wy, wz)
            nx += mean_of(normals, a, b, c, d, w, np.uint64(0))
            ny += mean_of(normals, a, b, c, d, w, np.uint64(1))
            nz += mean_of(normals, a, b, c, d, w, np.uint64(2))
        ambient = diffuse = specular = shininess = total = np.float32(0.0)
        for p in range(count):
            share = softplus(raw[i, 1 + p]) + floor
            ambient += share * coefficients[p, 0]
            diffuse += share * coefficients[p, 1]
            specular += share * coefficients[p, 2]
            shininess += share * coefficients[p, 3]
            total += share
        r = ray[i]
        long = scale / math.sqrt(soft * soft + scale * scale * (nx * nx + ny * ny + nz * nz))
        aside = ONE - facing[r, 0] * toward[r, 0] - facing[r, 1] * toward[r, 1] - facing[r, 2] * toward[r, 2]
        rim = SLACK * min(max(aside, np.float32(0.0)), ONE)
        if long * (nx * facing[r, 0] + ny * facing[r, 1] + nz * facing[r, 2]) < -rim:
            long = -long
        cosine = max(long * (nx * toward[r, 0] + ny * toward[r, 1] + nz * toward[r, 2]), np.float32(0.0))
        highlight = np.float32(0.0)
        if cosine > np.float32(0.0):
            across = max(long * (nx * half[r, 0] + ny * half[r, 1] + nz * half[r, 2]), SMALLEST)
            highlight = intensity * specular / total * np.exp(shininess / total * np.log(across))
        factor, part, less = lights[region[i], 0], lights[region[i], 1], lights[region[i], 2]
        shade = part * (ambient + intensity * diffuse * cosine) / total
        shade = max(ONE + factor * (shade - ONE), np.float32(0.0))
        for c in range(3):
            colour[i, c] = colour[i, c] * shade + factor * (highlight - less)


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
