"""Everything but the networks in an image, compiled with numba: material, light, compositing.

Each loop does in one pass over the samples what would take a dozen torch operations, which are bound by memory: a sixth
of an image's time. The functions after the loops are those of :class:`svv.kernels.types.ImageKernels`, which describes
them.

Letters: S samples, R rays, P palette colours, L levels, F features per level, H spherical harmonics.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numba import prange
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour.light import LEAST_COSINE, NORMAL_SCALE, NORMAL_SOFTNESS, RIM_COSINE
from svv.core.colour.palette_shading import INTENSITY_SHIFT, SPECULAR_SHIFT, WEIGHT_FLOOR
from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import (
    LANES,
    exp,
    gather,
    lane_numbers,
    maximum,
    minimum,
    select,
    softplus,
    splat,
    store,
)
from svv.core.rays.compositing import LEAST_ALPHA
from svv.kernels.numba import recolouring
from svv.kernels.numba.looks import looks as looks
from svv.kernels.numba.marching import RAYS_A_BLOCK
from svv.kernels.numba.trilinear import ONE32, cell_at, mean_of, weights_of
from svv.kernels.types import Lattice, Samples, Surface

ZERO32, TWO32 = np.float32(0.0), np.float32(2.0)
RIM32, GRAZING32 = np.float32(RIM_COSINE), np.float32(LEAST_COSINE)
"""The constants in single precision; with Python floats, numba would compute in double precision."""


@njit(fastmath=FAST_MATH, inline="always")
def _softplus(x):  # type: ignore[no-untyped-def]
    """Return log(1 + e^x), computed as in torch."""
    return x if x > 20.0 else np.log1p(np.exp(x))


@njit(cache=True)
def _end(sigma, tail, start, count, step):  # type: ignore[no-untyped-def]
    """Move the optical depth behind each ray's last sample, ``tail`` (R,), into its extinction (S,), in place."""
    for r in range(len(tail)):
        if count[r] > 0:
            sigma[start[r] + count[r] - 1] += tail[r] / step
            tail[r] = 0.0


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _material(raw, colours, shift, floor, region, diffuse):  # type: ignore[no-untyped-def]
    """Write diffuse colour I sum_i w_i (P_i + delta_i) (S, 3) and region (S,) from the palette MLP (S, 1 + 4 P)."""
    count, columns, last = colours.shape[0], raw.shape[1], len(raw) - 1
    for block in prange((len(raw) + LANES - 1) // LANES):
        first = block * LANES
        out, most = np.empty((3, LANES), np.float32), np.empty(LANES, np.int32)
        row = minimum(lane_numbers() + first, splat(np.int32(last))) * columns
        red = green = blue = total = largest = splat(np.float32(0.0))
        which = splat(np.int32(0))
        for p in range(count):
            w = softplus(gather(raw, row + (1 + p))) + floor
            at = row + (1 + count + 3 * p)
            red = red + w * (gather(raw, at) + colours[p, 0])
            green = green + w * (gather(raw, at + 1) + colours[p, 1])
            blue = blue + w * (gather(raw, at + 2) + colours[p, 2])
            total = total + w
            which = select(w > largest, splat(np.int32(p)), which)
            largest = maximum(w, largest)
        scale = softplus(gather(raw, row) + shift) / total
        store(out, 0, scale * red)
        store(out, LANES, scale * green)
        store(out, 2 * LANES, scale * blue)
        store(most, 0, which)
        for lane in range(min(LANES, len(raw) - first)):
            region[first + lane] = most[lane]
            for c in range(3):
                diffuse[first + lane, c] = out[c, lane]


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _overpaint(paint, region, share, strokes, sigma, colour, followed):  # type: ignore[no-untyped-def]
    """Blend ``paint`` into ``colour`` (S, 3) in place, and write the extinction that follows its strokes (S,)."""
    for i in prange(paint.shape[0]):
        r = region[i]
        part = share[r]
        for c in range(3):
            colour[i, c] = part * paint[i, c] + (ONE32 - part) * colour[i, c]
        followed[i] = sigma[i]
        reach = strokes[r, 3]
        if reach > np.float32(0.0):
            slope = strokes[r, 1]
            pale = min(paint[i, 0], paint[i, 1], paint[i, 2])
            if slope < np.float32(0.0):
                pale = max(paint[i, 0], paint[i, 1], paint[i, 2])
            pale = min(max(pale, np.float32(0.0)), ONE32)
            change = min(max(slope * (strokes[r, 2] - pale), -reach), reach)
            followed[i] *= np.exp(strokes[r, 0] + change)


@njit(fastmath=FAST_MATH, inline="always")
def _lit(colour, i, factor, shade, specular):  # type: ignore[no-untyped-def]
    """Light a sample's diffuse ``colour`` (S, 3) in place, given f, a m and f (c_s - b).

    See :func:`svv.core.colour.palette_shading.lit`.
    """
    shade = max(ONE32 + factor * (shade - ONE32), np.float32(0.0))
    for c in range(3):
        colour[i, c] = colour[i, c] * shade + specular


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _light(raw, lights, region, shift, colour):  # type: ignore[no-untyped-def]
    """Light diffuse ``colour`` (S, 3) in place with the output of the lighting MLP (S, 1 or 2).

    ``lights`` (regions, 3): response of each region (:func:`svv.fields.scene.paint_light.lights_of`).
    """
    columns, one = raw.shape[1], splat(ONE32)
    for block in prange((len(raw) + LANES - 1) // LANES):
        first = block * LANES
        shades, gloss = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
        row = minimum(lane_numbers() + first, splat(np.int32(len(raw) - 1))) * columns
        store(gloss, 0, softplus(gather(raw, row) + shift))
        store(shades, 0, TWO32 / (exp(ZERO32 - gather(raw, row + 1)) + ONE32) if columns > 1 else one)
        for lane in range(min(LANES, len(raw) - first)):
            r = region[first + lane]
            _lit(
                colour,
                first + lane,
                lights[r, 0],
                lights[r, 1] * shades[lane],
                lights[r, 0] * (gloss[lane] - lights[r, 2]),
            )


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _phong(  # type: ignore[no-untyped-def]
    position, ray, facing, toward, half, intensity, shapes, scales, bases, index, normals, scale, soft, raw,
    coefficients, floor, lights, region, colour,
):  # fmt: skip
    """Light diffuse ``colour`` (S, 3) in place with an explicit light (:func:`svv.core.colour.light.blinn_phong`).

    ``facing``, ``toward``, ``half`` (R, 3): unit vectors of rays towards the viewer, the light and halfway between.
    ``normals`` (V, 3): values of the lattice, which become vectors when multiplied by ``scale``; those much shorter
    than ``soft`` stay unlit. ``raw`` (S, 1 + 4 P): output of the palette MLP, whose weights mix the ``coefficients``,
    of all samples (1, P, 4) or of each (S, P, 4). ``lights`` (regions, 3): see :func:`light`.
    """
    levels, count, each = shapes.shape[0], coefficients.shape[1], np.int64(coefficients.shape[0] > 1)
    for i in prange(position.shape[0]):
        row = np.int64(i) * each
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
            share = _softplus(raw[i, 1 + p]) + floor
            ambient += share * coefficients[row, p, 0]
            diffuse += share * coefficients[row, p, 1]
            specular += share * coefficients[row, p, 2]
            shininess += share * coefficients[row, p, 3]
            total += share
        r = ray[i]
        long = scale / math.sqrt(soft * soft + scale * scale * (nx * nx + ny * ny + nz * nz))
        aside = ONE32 - facing[r, 0] * toward[r, 0] - facing[r, 1] * toward[r, 1] - facing[r, 2] * toward[r, 2]
        rim = RIM32 * min(max(aside, np.float32(0.0)), ONE32)
        if long * (nx * facing[r, 0] + ny * facing[r, 1] + nz * facing[r, 2]) < -rim:
            long = -long
        cosine = max(long * (nx * toward[r, 0] + ny * toward[r, 1] + nz * toward[r, 2]), np.float32(0.0))
        highlight = np.float32(0.0)
        if cosine > np.float32(0.0):
            across = max(long * (nx * half[r, 0] + ny * half[r, 1] + nz * half[r, 2]), GRAZING32)
            highlight = intensity * specular / total * np.exp(shininess / total * np.log(across))
        k = region[i]
        shade = lights[k, 1] * (ambient + intensity * diffuse * cosine) / total
        _lit(colour, i, lights[k, 0], shade, lights[k, 0] * (highlight - lights[k, 2]))


@njit(fastmath=FAST_MATH)
def show(r, alpha, red, green, blue, far, shares, faint, rgba, depth, seen):  # type: ignore[no-untyped-def]
    """Write the pixel of a ray from its alpha, sums of weight times colour and distance, and the regions' weights."""
    if alpha > faint:
        back = ONE32 / alpha
        rgba[r, 0] = min(max(red * back, ZERO32), ONE32)
        rgba[r, 1] = min(max(green * back, ZERO32), ONE32)
        rgba[r, 2] = min(max(blue * back, ZERO32), ONE32)
        rgba[r, 3] = alpha
        depth[r] = far * back
        most = 0
        for k in range(1, len(shares)):  # np.argmax would have each process load SciPy's linear algebra
            if shares[k] > shares[most]:
                most = k
        seen[r] = most
    else:
        rgba[r] = ZERO32
        depth[r] = np.float32(np.nan)
        seen[r] = -1


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _composite(  # type: ignore[no-untyped-def]
    position, sigma, skipped, colour, region, opacity, origins, start, count, tail, step, size, faint, rgba, depth, seen
):
    """Write the pixels of rays: straight ``rgba`` (R, 4) in [0, 1], ``depth`` (R,) and region ``seen`` (R,) int16.

    A pixel whose alpha does not exceed ``faint`` shows nothing. ``opacity`` (regions,) scales each region's extinction.
    A pixel's region is the one with most of its weight. ``size``: world units per box unit.
    """
    rays, regions = start.shape[0], opacity.shape[0]
    for block in prange((rays + RAYS_A_BLOCK - 1) // RAYS_A_BLOCK):
        shares = np.zeros(regions, np.float32)
        for r in range(block * RAYS_A_BLOCK, min(rays, (block + 1) * RAYS_A_BLOCK)):
            t, red, green, blue, far = ONE32, np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
            shares[:] = 0.0
            for j in range(start[r], start[r] + count[r]):
                t *= np.exp(-skipped[j])
                e = np.exp(-sigma[j] * opacity[region[j]] * step)
                w = t * (ONE32 - e)
                red += w * colour[j, 0]
                green += w * colour[j, 1]
                blue += w * colour[j, 2]
                x = position[j, 0] - origins[r, 0]
                y = position[j, 1] - origins[r, 1]
                z = position[j, 2] - origins[r, 2]
                far += w * math.sqrt(x * x + y * y + z * z)
                shares[region[j]] += w
                t *= e
            show(r, ONE32 - t * np.exp(-tail[r]), red, green, blue, far * size, shares, faint, rgba, depth, seen)


def end(samples: Samples) -> None:
    _end(*_arrays(samples.sigma, samples.tail, samples.start, samples.count), np.float32(samples.step))


def material(raw: Tensor, colours: Tensor) -> Surface:
    surface = Surface(raw, torch.empty(len(raw), dtype=torch.int64), torch.empty(len(raw), 3))
    _material(
        *_arrays(raw, colours), np.float32(INTENSITY_SHIFT), np.float32(WEIGHT_FLOOR),
        *_arrays(surface.region, surface.colour),
    )  # fmt: skip
    return surface


def shift(raw: Tensor, column: int, colour: Tensor, change: Tensor, among: Tensor | None) -> None:
    chosen = np.zeros(0, np.bool_) if among is None else among.numpy()
    recolouring.shift(*_arrays(raw), column, *_arrays(colour, change), chosen)


def overpaint(surface: Surface, paint: Tensor, share: Tensor, strokes: Tensor, sigma: Tensor) -> Tensor:
    followed = torch.empty_like(sigma)
    _overpaint(*_arrays(paint.contiguous(), surface.region, share, strokes),
               *_arrays(sigma, surface.colour, followed))  # fmt: skip
    return followed


def light(surface: Surface, raw: Tensor, lights: Tensor) -> None:
    _light(*_arrays(raw, lights, surface.region), np.float32(SPECULAR_SHIFT), *_arrays(surface.colour))


def phong(
    surface: Surface, samples: Samples, beams: tuple[Tensor, Tensor, float], lattice: Lattice, table: Tensor,
    coefficients: Tensor, lights: Tensor,
) -> None:  # fmt: skip
    facing, toward, intensity = beams
    half = torch.nn.functional.normalize(facing + toward, dim=1)
    _phong(
        *_arrays(samples.position, samples.ray, facing.contiguous(), toward.contiguous(), half), np.float32(intensity),
        *_layout(lattice), *_arrays(table), np.float32(NORMAL_SCALE), np.float32(NORMAL_SOFTNESS),
        *_arrays(surface.raw, coefficients.view(-1, *coefficients.shape[-2:])), np.float32(WEIGHT_FLOOR),
        *_arrays(lights, surface.region, surface.colour),
    )  # fmt: skip


def composite(
    samples: Samples, sigma: Tensor, surface: Surface, opacity: Tensor, origins: Tensor, size: float,
    images: tuple[Tensor, Tensor, Tensor],
) -> None:  # fmt: skip
    _composite(
        *_arrays(samples.position, sigma, samples.skipped, surface.colour, surface.region, opacity, origins),
        *_arrays(samples.start, samples.count, samples.tail), np.float32(samples.step), np.float32(size),
        np.float32(LEAST_ALPHA), *_arrays(*images),
    )  # fmt: skip


def _layout(lattice: Lattice) -> tuple[NDArray[np.generic], ...]:
    return _arrays(lattice.shapes, lattice.scales, lattice.bases, lattice.index)


def _arrays(*tensors: Tensor) -> tuple[NDArray[np.generic], ...]:
    """Return arrays that share the tensors' memory."""
    return tuple(t.detach().numpy() for t in tensors)
