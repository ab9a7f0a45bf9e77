"""Images whose colours are computed at the vertices of a grid and interpolated between these, compiled with numba.

A view has many more samples than vertices near them, so networks, edits and light cost little: what is left for each
sample is one look-up. The functions after the loops are those of :class:`svv.kernels.types.VertexKernels`.

Letters: S samples, R rays, V vertices that samples touch, (X, Y, Z) vertices of the grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numba import prange
from torch import Tensor

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import (
    LANES,
    as_floats,
    exp,
    gather,
    gather_pairs,
    lane_numbers,
    load,
    maximum,
    minimum,
    select,
    splat,
    store,
    truncated,
)
from svv.core.rays.compositing import LEAST_ALPHA
from svv.kernels.numba.image import show
from svv.kernels.numba.looks import light as light
from svv.kernels.numba.looks import unlit as unlit
from svv.kernels.numba.marching import RAYS_A_BLOCK
from svv.kernels.numba.trilinear import ONE32, ones_in
from svv.kernels.types import Samples

ZERO32, HALF32, LEAST_SHARE = np.float32(0.0), np.float32(0.5), np.float32(1e-6)

BITS, LEVELS = 11, 2046
"""Bits of a channel of a vertex's colour, and its highest level; blue, the last one, has one bit less. So a colour is
one word, of which a sample reads eight: .6 of the time of floats. An image is .03 levels of 255 off in the mean."""

MASK = (1 << BITS) - 1
"""The bits of a channel."""

DARKEST, BRIGHTEST = -1.0, 4.0
"""Colours beyond, which only an edited light makes, count as these: levels stay less than one of 255 apart."""


AT_ONCE = 1 << 10
"""Samples of which a thread marks the cells at a time."""

WORD, EACH_BYTE = 8, np.uint64(0x0101010101010101)
"""Marks in a word, and a word with the lowest bit of each of its bytes."""

ALONE = 1.5
"""Times as many vertices per position as are too many of all sets that are too many of the first: others share some."""


@njit(fastmath=FAST_MATH, inline="always")
def _cells(position, at, scale, last):  # type: ignore[no-untyped-def]
    """Return the cells of coordinates along an axis, and the offsets in them, of as many samples as there are lanes."""
    f = gather(position, at) * scale
    i = minimum(truncated(f), splat(last))
    return i, f - as_floats(i)


@njit(fastmath=FAST_MATH, inline="always")
def _cells_of(first, position, shape, wide, scale):  # type: ignore[no-untyped-def]
    """Return the places of the first vertices around as many samples, from ``first`` on, as there are lanes.

    Then follow the offsets in their cells along x, y and z. The last sample stands for those that do not exist;
    ``position``: as one row of numbers; ``wide``: places along z.
    """
    at = minimum(lane_numbers() + np.int32(first), splat(np.int32(len(position) // 3 - 1))) * 3
    i, wx = _cells(position, at, scale, np.int32(shape[0] - 2))
    j, wy = _cells(position, at + 1, scale, np.int32(shape[1] - 2))
    k, wz = _cells(position, at + 2, scale, np.int32(shape[2] - 2))
    return (i * shape[1] + j) * wide + k, wx, wy, wz


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _touch(position, shape, scale, wide, touched):  # type: ignore[no-untyped-def]
    """Mark the vertices of the cells of samples, a row of coordinates; threads may write the same marks.

    ``wide``: marks along z, of which the last ones are of no vertices; ``touched``: all marks, in raster order.
    """
    samples, far = len(position) // 3, shape[1] * wide
    for part in prange((samples + AT_ONCE - 1) // AT_ONCE):
        places = np.empty(AT_ONCE, np.int32)
        for n in range(0, AT_ONCE, LANES):
            place, _, _, _ = _cells_of(part * AT_ONCE + n, position, shape, wide, scale)
            store(places, n, place)
        for n in range(min(AT_ONCE, samples - part * AT_ONCE)):
            at = np.int64(places[n])
            if touched[at] < 2:  # 2: all eight are marked
                for corner in (
                    at + 1,
                    at + wide,
                    at + wide + 1,
                    at + far,
                    at + far + 1,
                    at + far + wide,
                    at + far + wide + 1,
                ):
                    touched[corner] = max(touched[corner], 1)
                touched[at] = 2


@njit(parallel=True, cache=True)
def _count(words, number):  # type: ignore[no-untyped-def]
    """Count the marked vertices of each slice in x, eight at a time: :data:`WORD` marks in the bytes of a word."""
    for x in prange(words.shape[0]):
        total = np.uint64(0)
        for y in range(words.shape[1]):
            for z in range(words.shape[2]):
                word = words[x, y, z]
                if word:
                    total += ones_in((word | (word >> np.uint64(1))) & EACH_BYTE)
        number[x] = total


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _number(words, touched, first, side, nz, places, position):  # type: ignore[no-untyped-def]
    """Write the ``places`` (V,) of the marked vertices of the grid in raster order, and their positions (V, 3)."""
    for x in prange(words.shape[0]):
        row = first[x]
        for y in range(words.shape[1]):
            for word in range(words.shape[2]):
                if words[x, y, word] == 0:
                    continue
                for z in range(WORD * word, min(WORD * (word + 1), nz)):
                    if touched[x, y, z] > 0:
                        places[row] = (x * words.shape[1] + y) * nz + z
                        position[row, 0] = np.float32(x) * side
                        position[row, 1] = np.float32(y) * side
                        position[row, 2] = np.float32(z) * side
                        row += 1


@njit(parallel=True, cache=True)
def _put(places, numbers, grid):  # type: ignore[no-untyped-def]
    """Write numbers (V,) to places (V,) of a grid."""
    for v in prange(len(places)):
        grid[places[v]] = numbers[v]


@njit(fastmath=FAST_MATH, inline="always")
def _code(x, low, rate, most):  # type: ignore[no-untyped-def]
    """Return the nearest level of a number."""
    return min(max(np.int64((x - low) * rate + HALF32), np.int64(0)), np.int64(most))


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _pack(colour, region, places, low, rate, words, regions):  # type: ignore[no-untyped-def]
    """Write colours (V, 3), in ``rate`` levels from ``low`` on, as one word each, and regions (V,), to their places."""
    for v in prange(len(places)):
        red, green = _code(colour[v, 0], low, rate, LEVELS), _code(colour[v, 1], low, rate, LEVELS)
        blue = _code(colour[v, 2], low, HALF32 * rate, LEVELS >> 1)
        words[places[v]] = (red << (2 * BITS - 1)) | (green << (BITS - 1)) | blue
        regions[places[v]] = region[v]


@njit(fastmath=FAST_MATH)
def _around(first, position, rows, scale, corner, weight):  # type: ignore[no-untyped-def]
    """Write the vertices around as many samples, from ``first`` on, as there are lanes.

    ``corner`` (4, LANES): those at (0, 0), (0, 1), (1, 0) and (1, 1) of the cell, whose neighbours in z have the next
    numbers; ``weight`` (6, LANES): theirs, and those of the neighbours in z.
    """
    ny, nz = rows.shape[1], rows.shape[2]
    place, wx, wy, wz = _cells_of(first, position, rows.shape, nz, scale)
    ux, uy = ONE32 - wx, ONE32 - wy
    a, b = gather(rows, place), gather(rows, place + nz)
    c, d = gather(rows, place + ny * nz), gather(rows, place + (ny * nz + nz))
    for n, each in enumerate((a, b, c, d)):
        store(corner, n * LANES, each)
    for n, each in enumerate((ux * uy, ux * wy, wx * uy, wx * wy, ONE32 - wz, wz)):
        store(weight, n * LANES, each)


@njit(fastmath=FAST_MATH, inline="always")
def _mean(table, width, from_, lane, corner, weight):  # type: ignore[no-untyped-def]
    """Return the mean of the numbers from a place ``from_`` of rows of a ``width`` on, over four corners of a cell."""
    out = splat(weight[0, lane]) * load(table, np.int64(corner[0, lane]) * width + from_)
    out = out + splat(weight[1, lane]) * load(table, np.int64(corner[1, lane]) * width + from_)
    out = out + splat(weight[2, lane]) * load(table, np.int64(corner[2, lane]) * width + from_)
    return out + splat(weight[3, lane]) * load(table, np.int64(corner[3, lane]) * width + from_)


@njit(fastmath=FAST_MATH, inline="always")
def _level(word, shift, mask):  # type: ignore[no-untyped-def]
    """Return the levels of a channel of colours."""
    return as_floats((word >> shift) & mask)


@njit(fastmath=FAST_MATH, inline="always")
def _add(words, opacities, place, offset, near, far, red, green, blue, total):  # type: ignore[no-untyped-def]
    """Add the levels and opacities of two neighbours in z, with their weights ``near`` and ``far``, to sums."""
    a, b = gather_pairs(words, place, offset)
    if len(opacities) > 0:
        opacity = gather_pairs(opacities, place, offset)
        near, far = near * opacity[0], far * opacity[1]
        total = total + near + far
    red = red + near * _level(a, 2 * BITS - 1, MASK) + far * _level(b, 2 * BITS - 1, MASK)
    green = green + near * _level(a, BITS - 1, MASK) + far * _level(b, BITS - 1, MASK)
    blue = blue + near * _level(a, 0, MASK >> 1) + far * _level(b, 0, MASK >> 1)
    return red, green, blue, total


@njit(fastmath=FAST_MATH, cache=True)
def _look_up(  # type: ignore[no-untyped-def]
    first, position, shape, scale, words, opacities, regions, low, level, found, of
):
    """Write red, green, blue and opacities around the samples from ``first`` on, ``found`` (4, N), and regions (N,)."""
    ny, nz, wide, none = shape[1], shape[2], len(of), splat(np.int32(0))
    for block in range(0, wide, LANES):
        place, wx, wy, wz = _cells_of(first + block, position, shape, nz, scale)
        ux, uy, uz = ONE32 - wx, ONE32 - wy, ONE32 - wz
        red = green = blue = total = splat(ZERO32)
        w = ux * uy
        red, green, blue, total = _add(words, opacities, place, 0, w * uz, w * wz, red, green, blue, total)
        w = ux * wy
        red, green, blue, total = _add(words, opacities, place, nz, w * uz, w * wz, red, green, blue, total)
        w = wx * uy
        red, green, blue, total = _add(words, opacities, place, ny * nz, w * uz, w * wz, red, green, blue, total)
        w = wx * wy
        red, green, blue, total = _add(words, opacities, place, ny * nz + nz, w * uz, w * wz, red, green, blue, total)
        scaled = splat(level)
        if len(opacities) > 0:
            scaled = level / maximum(total, splat(LEAST_SHARE))
            store(found, 3 * wide + block, total)
        store(found, block, low + scaled * red)
        store(found, wide + block, low + scaled * green)
        store(found, 2 * wide + block, low + (scaled + scaled) * blue)
        near = place + select(wz > HALF32, splat(np.int32(1)), none) + select(wy > HALF32, splat(np.int32(nz)), none)
        store(of, block, gather(regions, near + select(wx > HALF32, splat(np.int32(ny * nz)), none)))


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _interpolate(position, rows, scale, table, width, light, raw):  # type: ignore[no-untyped-def]
    """Write the means of rows of a ``width``, a multiple of the lanes: ``light`` (S, L), followed by ``raw`` (S, C)."""
    samples, lights = len(raw), light.shape[1]
    for part in prange((samples + RAYS_A_BLOCK - 1) // RAYS_A_BLOCK):
        begin, end = part * RAYS_A_BLOCK, min(samples, (part + 1) * RAYS_A_BLOCK)
        corner, weight = np.empty((4, LANES), np.int32), np.empty((6, LANES), np.float32)
        mean = np.empty(width, np.float32)
        for first in range(begin, end, LANES):
            _around(first, position, rows, scale, corner, weight)
            for lane in range(min(LANES, end - first)):
                for n in range(0, width, LANES):
                    below = splat(weight[4, lane]) * _mean(table, width, n, lane, corner, weight)
                    store(
                        mean, n, below + splat(weight[5, lane]) * _mean(table, width, width + n, lane, corner, weight)
                    )
                for f in range(lights):
                    light[first + lane, f] = mean[f]
                for f in range(raw.shape[1]):
                    raw[first + lane, f] = mean[lights + f]


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _composite(  # type: ignore[no-untyped-def]
    position, sigma, skipped, shape, scale, words, opacities, regions, low, level, count_of_regions, origins, start,
    count, tail, step, size, faint, rgba, depth, seen,
):  # fmt: skip
    """Write the pixels of rays as :func:`svv.kernels.numba.image._composite` does, from the vertices' ``words``.

    See :func:`composite`; ``opacities`` is empty if all are 1.
    """
    rays = start.shape[0]
    for block in prange((rays + RAYS_A_BLOCK - 1) // RAYS_A_BLOCK):
        begin, end = block * RAYS_A_BLOCK, min(rays, (block + 1) * RAYS_A_BLOCK)
        first = start[begin]
        total = start[end - 1] + count[end - 1] - first
        wide = -(-total // LANES) * LANES
        shares, found = np.zeros(count_of_regions, np.float32), np.empty((4, wide), np.float32)
        through, of = np.zeros(wide, np.float32), np.empty(wide, np.int32)
        _look_up(first, position, shape, scale, words, opacities, regions, low, level, found, of)
        for n in range(total):
            through[n] = -sigma[first + n] * step
        if len(opacities) > 0:
            for n in range(total):
                through[n] *= found[3, n]
        for n in range(0, wide, LANES):
            store(through, n, exp(load(through, n)))
        for r in range(begin, end):
            t, red, green, blue, far = ONE32, ZERO32, ZERO32, ZERO32, ZERO32
            shares[:] = ZERO32
            for n in range(start[r] - first, start[r] - first + count[r]):
                at = first + n
                if skipped[at] > ZERO32:
                    t *= np.exp(-skipped[at])
                w = t * (ONE32 - through[n])
                red += w * found[0, n]
                green += w * found[1, n]
                blue += w * found[2, n]
                x = position[3 * at] - origins[r, 0]
                y = position[3 * at + 1] - origins[r, 1]
                z = position[3 * at + 2] - origins[r, 2]
                far += w * math.sqrt(x * x + y * y + z * z)
                shares[of[n]] += w
                t *= through[n]
            show(r, ONE32 - t * np.exp(-tail[r]), red, green, blue, far * size, shares, faint, rgba, depth, seen)


def touched(
    positions: Sequence[Tensor], shape: tuple[int, int, int], scale: float, most: float
) -> tuple[Tensor, Tensor] | None:
    marks = np.zeros((*shape[:2], -(-shape[2] // WORD) * WORD), np.uint8)
    words, number, count = marks.view(np.uint64), np.empty(shape[0], np.int64), 0
    for n, each in enumerate(positions):
        _touch(each.numpy().ravel(), shape, np.float32(scale), marks.shape[2], marks.reshape(-1))
        count += len(each)
        last = n + 1 == len(positions)
        if n == 0 or last:
            _count(words, number)
            if number.sum() > (1.0 if last else ALONE) * most * count:
                return None
    places, position = torch.empty(int(number.sum()), dtype=torch.int32), torch.empty(int(number.sum()), 3)
    first = np.cumsum(number) - number
    _number(words, marks, first, np.float32(1.0 / scale), shape[2], places.numpy(), position.numpy())
    return places, position


def interpolate(
    position: Tensor, places: Tensor, shape: tuple[int, int, int], scale: float, light: Tensor, raw: Tensor
) -> tuple[Tensor, Tensor]:
    lights, total = light.shape[1], light.shape[1] + raw.shape[1]
    table = torch.zeros(len(raw), -(-total // LANES) * LANES)
    table[:, :lights], table[:, lights:total] = light, raw
    out = torch.empty(len(position), lights), torch.empty(len(position), raw.shape[1])
    rows = np.empty(shape, np.int32)
    _put(places.numpy(), np.arange(len(places), dtype=np.int32), rows.reshape(-1))
    _interpolate(
        position.numpy().ravel(), rows, np.float32(scale), table.numpy().ravel(), table.shape[1], out[0].numpy(),
        out[1].numpy(),
    )  # fmt: skip
    return out


def composite(
    pieces: Sequence[tuple[Samples, Tensor, tuple[Tensor, Tensor, Tensor]]], places: Tensor,
    shape: tuple[int, int, int], scale: float, colours: tuple[Tensor, Tensor | None, Tensor], regions: int, size: float,
) -> None:  # fmt: skip
    (colour, opacity, region), whole = colours, math.prod(shape)
    low, high = (float(end) for end in torch.aminmax(colour)) if len(colour) else (0.0, 1.0)
    low, high = max(min(low, 0.0), DARKEST), min(max(high, 1.0), BRIGHTEST)
    level = (high - low) / LEVELS
    words, of = np.empty(whole, np.int32), np.empty(whole, np.uint8)
    _pack(colour.numpy(), region.numpy(), places.numpy(), np.float32(low), np.float32(1.0 / level), words, of)
    opacities = np.empty(0 if opacity is None else whole, np.float32)
    if opacity is not None:
        _put(places.numpy(), opacity.numpy(), opacities)
    for samples, origins, images in pieces:
        _composite(
            samples.position.numpy().ravel(), samples.sigma.numpy(), samples.skipped.numpy(), shape, np.float32(scale),
            words, opacities, of, np.float32(low), np.float32(level), regions, origins.numpy(), samples.start.numpy(),
            samples.count.numpy(), samples.tail.numpy(), np.float32(samples.step), np.float32(size),
            np.float32(LEAST_ALPHA), *(image.numpy() for image in images),
        )  # fmt: skip
