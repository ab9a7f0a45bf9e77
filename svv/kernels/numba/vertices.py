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
    lane_numbers,
    load,
    minimum,
    select,
    splat,
    store,
    truncated,
)
from svv.core.rays.compositing import LEAST_ALPHA
from svv.kernels.numba.image import show
from svv.kernels.numba.marching import RAYS_A_BLOCK
from svv.kernels.numba.trilinear import ONE32, ones_in
from svv.kernels.types import Samples

ZERO32, HALF32, LEAST_SHARE = np.float32(0.0), np.float32(0.5), np.float32(1e-6)

EACH = 4
"""Numbers of a vertex: its colour times its opacity, and that opacity."""


WORD, EACH_BYTE = 8, np.uint64(0x0101010101010101)
"""Marks in a word, and a word with the lowest bit of each of its bytes."""

ALONE = 1.5
"""Times as many vertices per position as are too many of all sets that are too many of the first: others share some."""


@njit(fastmath=FAST_MATH, inline="always")
def _cell(x, scale, last):  # type: ignore[no-untyped-def]
    """Return the cell of a coordinate along an axis, and the offset in it."""
    f = x * scale
    i = min(int(f), last)
    return i, f - np.float32(i)


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _touch(position, scale, nz, touched):  # type: ignore[no-untyped-def]
    """Mark the vertices of the cells of samples (S, 3), ``nz`` the last cell in z; threads may write the same marks."""
    nx, ny = touched.shape[0] - 2, touched.shape[1] - 2
    for s in prange(len(position)):
        i, _ = _cell(position[s, 0], scale, nx)
        j, _ = _cell(position[s, 1], scale, ny)
        k, _ = _cell(position[s, 2], scale, nz)
        if touched[i, j, k] < 2:  # 2: all eight are marked
            for a in range(2):
                for b in range(2):
                    for c in range(2):
                        touched[i + a, j + b, k + c] = max(touched[i + a, j + b, k + c], 1)
            touched[i, j, k] = 2


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
def _number(words, touched, first, side, rows, position):  # type: ignore[no-untyped-def]
    """Number the marked vertices in raster order, in ``rows`` (X, Y, Z), and write their positions (V, 3)."""
    for x in prange(words.shape[0]):
        row = first[x]
        for y in range(words.shape[1]):
            for word in range(words.shape[2]):
                if words[x, y, word] == 0:
                    continue
                for z in range(WORD * word, min(WORD * (word + 1), rows.shape[2])):
                    if touched[x, y, z] > 0:
                        rows[x, y, z] = row
                        position[row, 0] = np.float32(x) * side
                        position[row, 1] = np.float32(y) * side
                        position[row, 2] = np.float32(z) * side
                        row += 1


@njit(fastmath=FAST_MATH, inline="always")
def _cells(position, at, scale, last):  # type: ignore[no-untyped-def]
    """Return the cells of coordinates along an axis, and the offsets in them, of as many samples as there are lanes."""
    f = gather(position, at) * scale
    i = minimum(truncated(f), splat(last))
    return i, f - as_floats(i)


@njit(fastmath=FAST_MATH)
def _around(first, position, rows, scale, corner, weight, near):  # type: ignore[no-untyped-def]
    """Write the vertices around as many samples, from ``first`` on, as there are lanes; the last one stands for others.

    ``corner`` (4, LANES): those at (0, 0), (0, 1), (1, 0) and (1, 1) of the cell, whose neighbours in z have the next
    numbers; ``weight`` (6, LANES): theirs, and those of the neighbours in z; ``near`` (LANES,): the nearest vertex.
    ``position``: as one row of numbers.
    """
    ny, nz, last = rows.shape[1], rows.shape[2], np.int32(len(position) // 3 - 1)
    at = minimum(lane_numbers() + first, splat(last)) * 3
    i, wx = _cells(position, at, scale, np.int32(rows.shape[0] - 2))
    j, wy = _cells(position, at + 1, scale, np.int32(ny - 2))
    k, wz = _cells(position, at + 2, scale, np.int32(nz - 2))
    place, ux, uy = (i * ny + j) * nz + k, ONE32 - wx, ONE32 - wy
    a, b = gather(rows, place), gather(rows, place + nz)
    c, d = gather(rows, place + ny * nz), gather(rows, place + (ny * nz + nz))
    for n, each in enumerate((a, b, c, d)):
        store(corner, n * LANES, each)
    for n, each in enumerate((ux * uy, ux * wy, wx * uy, wx * wy, ONE32 - wz, wz)):
        store(weight, n * LANES, each)
    right = wy > HALF32
    nearest = select(wx > HALF32, select(right, d, c), select(right, b, a))
    store(near, 0, nearest + select(wz > HALF32, splat(np.int32(1)), splat(np.int32(0))))


@njit(fastmath=FAST_MATH, inline="always")
def _mean(table, width, from_, lane, corner, weight):  # type: ignore[no-untyped-def]
    """Return the mean of the numbers from a place ``from_`` of rows of a ``width`` on, over four corners of a cell."""
    out = splat(weight[0, lane]) * load(table, np.int64(corner[0, lane]) * width + from_)
    out = out + splat(weight[1, lane]) * load(table, np.int64(corner[1, lane]) * width + from_)
    out = out + splat(weight[2, lane]) * load(table, np.int64(corner[2, lane]) * width + from_)
    return out + splat(weight[3, lane]) * load(table, np.int64(corner[3, lane]) * width + from_)


@njit(fastmath=FAST_MATH, cache=True)
def _look_up(first, position, rows, scale, table, region, found, of):  # type: ignore[no-untyped-def]
    """Write the means of ``table`` around the samples from ``first`` on, ``found`` (N, EACH), and their regions (N,).

    ``table`` has a row of :data:`LANES` numbers more.
    """
    corner, near, weight = np.empty((4, LANES), np.int32), np.empty(LANES, np.int32), np.empty((6, LANES), np.float32)
    mean = np.empty(LANES, np.float32)
    for block in range(0, len(of), LANES):
        _around(np.int32(first + block), position, rows, scale, corner, weight, near)
        for lane in range(min(LANES, len(of) - block)):
            store(mean, 0, _mean(table, EACH, 0, lane, corner, weight))  # of a row and the next one
            for f in range(EACH):
                found[block + lane, f] = weight[4, lane] * mean[f] + weight[5, lane] * mean[EACH + f]
            of[block + lane] = region[np.uint64(near[lane])]


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _interpolate(position, rows, scale, table, width, light, raw):  # type: ignore[no-untyped-def]
    """Write the means of rows of a ``width``, a multiple of the lanes: ``light`` (S, L), followed by ``raw`` (S, C)."""
    samples, lights = len(raw), light.shape[1]
    for part in prange((samples + RAYS_A_BLOCK - 1) // RAYS_A_BLOCK):
        begin, end = part * RAYS_A_BLOCK, min(samples, (part + 1) * RAYS_A_BLOCK)
        corner, near = np.empty((4, LANES), np.int32), np.empty(LANES, np.int32)
        weight, mean = np.empty((6, LANES), np.float32), np.empty(width, np.float32)
        for first in range(begin, end, LANES):
            _around(np.int32(first), position, rows, scale, corner, weight, near)
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
    position, sigma, skipped, rows, scale, table, region, regions, origins, start, count, tail, step, size, faint,
    rgba, depth, seen,
):  # fmt: skip
    """Write the pixels of rays as :func:`svv.kernels.numba.image._composite` does, from ``table`` (V * EACH,).

    A sample's opacity is interpolated between vertices, and its colour in proportion to theirs. Its region is that of
    the nearest vertex, ``region`` (V,), of ``regions``.
    """
    rays = start.shape[0]
    for block in prange((rays + RAYS_A_BLOCK - 1) // RAYS_A_BLOCK):
        begin, end = block * RAYS_A_BLOCK, min(rays, (block + 1) * RAYS_A_BLOCK)
        first = start[begin]
        total = start[end - 1] + count[end - 1] - first
        wide = -(-total // LANES) * LANES
        shares, found = np.zeros(regions, np.float32), np.empty((total, EACH), np.float32)
        through, of = np.zeros(wide, np.float32), np.empty(total, np.uint8)
        _look_up(first, position, rows, scale, table, region, found, of)
        for n in range(total):
            through[n] = -sigma[first + n] * found[n, 3] * step
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
                own = w / max(found[n, 3], LEAST_SHARE)
                red += own * found[n, 0]
                green += own * found[n, 1]
                blue += own * found[n, 2]
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
        _touch(each.numpy(), np.float32(scale), shape[2] - 2, marks)
        count += len(each)
        last = n + 1 == len(positions)
        if n == 0 or last:
            _count(words, number)
            if number.sum() > (1.0 if last else ALONE) * most * count:
                return None
    rows, position = torch.empty(shape, dtype=torch.int32), torch.empty(int(number.sum()), 3)
    _number(words, marks, np.cumsum(number) - number, np.float32(1.0 / scale), rows.numpy(), position.numpy())
    return rows, position


def interpolate(position: Tensor, rows: Tensor, scale: float, light: Tensor, raw: Tensor) -> tuple[Tensor, Tensor]:
    lights, total = light.shape[1], light.shape[1] + raw.shape[1]
    table = torch.zeros(len(raw), -(-total // LANES) * LANES)
    table[:, :lights], table[:, lights:total] = light, raw
    out = torch.empty(len(position), lights), torch.empty(len(position), raw.shape[1])
    _interpolate(
        position.numpy().ravel(), rows.numpy(), np.float32(scale), table.numpy().ravel(), table.shape[1],
        out[0].numpy(), out[1].numpy(),
    )  # fmt: skip
    return out


def composite(
    pieces: Sequence[tuple[Samples, Tensor, tuple[Tensor, Tensor, Tensor]]], rows: Tensor, scale: float,
    colours: tuple[Tensor, Tensor, Tensor], regions: int, size: float,
) -> None:  # fmt: skip
    colour, opacity, region = colours
    table = torch.zeros(len(colour) + LANES // EACH, EACH)
    torch.mul(colour, opacity[:, None], out=table[: len(colour), :3])
    table[: len(colour), 3] = opacity
    of = region.to(torch.uint8).numpy()
    for samples, origins, images in pieces:
        _composite(
            samples.position.numpy().ravel(), samples.sigma.numpy(), samples.skipped.numpy(), rows.numpy(),
            np.float32(scale), table.numpy().ravel(), of, regions, origins.numpy(), samples.start.numpy(),
            samples.count.numpy(), samples.tail.numpy(), np.float32(samples.step), np.float32(size),
            np.float32(LEAST_ALPHA), *(image.numpy() for image in images),
        )  # fmt: skip
