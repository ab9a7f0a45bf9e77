"""What the networks say of an image's samples, compiled with numba: look-ups and both networks in one pass.

A block of samples stays in the cache from its look-ups to its outputs, each number of the samples in a row: so a
narrow layer takes as little time as its products, and what a network is told of a view that is seen along one direction
is a part of its first layer, computed once.

Letters: S samples, R rays, L levels, F features per level, D numbers of a direction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numba import prange, types
from numba.extending import overload
from numpy.typing import NDArray
from torch import Tensor

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import LANES, gather, lane_numbers, load, minimum, select, splat, store
from svv.kernels.numba import pairs
from svv.kernels.numba import rays as numba_rays
from svv.kernels.numba.bfloat16 import LEAST_SAMPLES
from svv.kernels.numba.networks import BLOCK, ROWS, tile_of
from svv.kernels.numba.trilinear import ONE32, cell_at, mean_of, weights_of
from svv.kernels.types import HARMONICS, Lattice, Samples

PARTS = 64
"""Parts of the samples, each for one thread."""

_multiply, _multiply_relu = (tile_of(LANES, kind) for kind in ("plain", "relu"))


@njit(fastmath=FAST_MATH, inline="always")
def _two_rows(tables, row):  # type: ignore[no-untyped-def]
    """Return a row of half as many numbers as there are lanes, and the next one: neighbours in z."""
    return load(tables, np.int64(row) * (LANES // 2))


@njit(fastmath=FAST_MATH, cache=True)
def _look_up(  # type: ignore[no-untyped-def]
    first, count, x, ray, told, shapes, scales, bases, index, tables, width, sums, lit, plain
):
    """Write the inputs of samples into the columns of the first parts of ``lit`` and ``plain`` (3, rows, BLOCK)."""
    levels, own = shapes.shape[0], len(width)
    second, rows = lane_numbers() >= LANES // 2, tables.size // max(2 * own, 1)
    for s in range(count):
        px, py, pz = x[first + s, 0], x[first + s, 1], x[first + s, 2]
        for level in range(levels):
            a, b, c, d, wx, wy, wz = cell_at(px, py, pz, level, shapes, scales, bases, index)
            if 4 * own == LANES and rows > 1:
                ux, uy = ONE32 - wx, ONE32 - wy
                near = ux * uy * _two_rows(tables, a) + ux * wy * _two_rows(tables, b)
                far = wx * uy * _two_rows(tables, c) + wx * wy * _two_rows(tables, d)
                store(sums, 0, select(second, splat(wz), splat(ONE32 - wz)) * (near + far))
                for f in range(own):
                    lit[0, level * own + f, s] = sums[f] + sums[2 * own + f]
                    plain[0, level * own + f, s] = sums[own + f] + sums[3 * own + f]
                continue
            w = weights_of(wx, wy, wz)
            for f in range(own):
                lit[0, level * own + f, s] = mean_of(tables, a, b, c, d, w, np.uint64(f))
                plain[0, level * own + f, s] = mean_of(tables, a, b, c, d, w, np.uint64(own + f))
        r = min(np.int64(ray[first + s]), len(told) - 1)
        for k in range(told.shape[1]):
            lit[0, levels * own + k, s] = told[r, k]


@njit(fastmath=FAST_MATH, cache=True)
def _single(h, room, weights, widths, wide, first, count, out):  # type: ignore[no-untyped-def]
    """Run a network in single precision on the first part of ``h`` (3, rows, BLOCK), and write its outputs.

    These are columns of ``h``, and become the rows of ``out`` (S, O) from ``first`` on. ``room`` is not used.
    """
    row, size, layers, last = weights.shape[2], h.shape[1] * BLOCK, len(widths) - 1, 0
    for k in range(layers):
        to, square = 1 + k % 2, k * weights.shape[1] * row
        for n in range(0, BLOCK, LANES):
            for m in range(0, wide[k + 1], ROWS):
                a, b, c = square + m * row, last * size + n, to * size + m * BLOCK + n
                if k + 1 < layers:
                    _multiply_relu(weights, a, row, 1, h, b, BLOCK, widths[k], h, c, BLOCK)
                else:
                    _multiply(weights, a, row, 1, h, b, BLOCK, widths[k], h, c, BLOCK)
        last = to
    for s in range(count):
        for k in range(out.shape[1]):
            out[first + s, k] = h[last, k, s]


@njit(fastmath=FAST_MATH, cache=True)
def _half(h, room, weights, widths, wide, first, count, out):  # type: ignore[no-untyped-def]
    """Do what :func:`_single` does in half precision, with weights in pairs and ``room`` (3, rows, BLOCK) for pairs."""
    row, size, layers, last = weights.shape[2], h.shape[1] * BLOCK, len(widths) - 1, 0
    for p in range((widths[0] + 1) // 2):
        for s in range(0, BLOCK, LANES):
            pairs.pack(h, 2 * p * BLOCK + s, (2 * p + 1) * BLOCK + s, room, p * BLOCK + s)
    for k in range(layers):
        to, square, depth = 1 + k % 2, k * weights.shape[1] * row, (widths[k] + 1) // 2
        for n in range(0, BLOCK, pairs.COLUMNS):
            for m in range(0, wide[k + 1], ROWS):
                a, b = square + m * row, last * size + n
                if k + 1 < layers:
                    c = to * size + m // 2 * BLOCK + n
                    pairs.multiply_relu(weights, a, row, room, b, BLOCK, depth, room, c, BLOCK)
                else:
                    pairs.multiply(weights, a, row, room, b, BLOCK, depth, h, size + m * BLOCK + n, BLOCK)
        last = to
    for s in range(count):
        for k in range(out.shape[1]):
            out[first + s, k] = h[1, k, s]


def _run(h, room, network, first, count, out):  # type: ignore[no-untyped-def]
    """Run a network, from :func:`_prepared`, by :func:`_half` or :func:`_single`, as its weights are."""


@overload(_run)
def _chosen(h, room, network, first, count, out):  # type: ignore[no-untyped-def]
    run = _half if network[0].dtype == types.int32 else _single

    def go(h, room, network, first, count, out):  # type: ignore[no-untyped-def]
        run(h, room, network[0], network[1], network[2], first, count, out)

    return go


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _looks(  # type: ignore[no-untyped-def]
    x, ray, told, shapes, scales, bases, index, tables, width, rows, lighting, palette, light, raw
):
    """Write the outputs of the lighting MLP, ``light`` (S, O), and of the palette MLP, ``raw`` (S, O).

    ``told`` (R, D), or (1, D) for all rays: what the lighting MLP is told of directions, behind the features of the
    first F columns of ``tables`` (V, 2 F); the others are the palette MLP's. ``width``: see
    :func:`svv.kernels.numba.lattice.encode`; ``rows``: most inputs or padded outputs of a layer, and those of a layer
    in pairs; ``lighting`` and ``palette``: see :func:`_prepared`.
    """
    blocks = (len(x) + BLOCK - 1) // BLOCK
    for part in prange(PARTS):
        sums, room = np.empty(LANES, np.float32), np.zeros((3, rows[1], BLOCK), np.int32)
        lit, plain = np.zeros((3, rows[0], BLOCK), np.float32), np.zeros((3, rows[0], BLOCK), np.float32)
        for block in range(part * blocks // PARTS, (part + 1) * blocks // PARTS):
            first, count = block * BLOCK, min(BLOCK, len(x) - block * BLOCK)
            _look_up(first, count, x, ray, told, shapes, scales, bases, index, tables, width, sums, lit, plain)
            _run(lit, room, lighting, first, count, light)
            _run(plain, room, palette, first, count, raw)


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _unlit(  # type: ignore[no-untyped-def]
    x, ray, told, shapes, scales, bases, index, tables, width, rows, palette, features, raw
):
    """Write what :func:`_looks` writes but light; the lighting MLP's ``features`` (S, L F) take its place."""
    blocks = (len(x) + BLOCK - 1) // BLOCK
    for part in prange(PARTS):
        sums, room = np.empty(LANES, np.float32), np.zeros((3, rows[1], BLOCK), np.int32)
        lit, plain = np.zeros((3, rows[0], BLOCK), np.float32), np.zeros((3, rows[0], BLOCK), np.float32)
        for block in range(part * blocks // PARTS, (part + 1) * blocks // PARTS):
            first, count = block * BLOCK, min(BLOCK, len(x) - block * BLOCK)
            _look_up(first, count, x, ray, told, shapes, scales, bases, index, tables, width, sums, lit, plain)
            for s in range(count):
                for k in range(features.shape[1]):
                    features[first + s, k] = lit[0, k, s]
            _run(plain, room, palette, first, count, raw)


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _light(features, of, told, rows, lighting, light):  # type: ignore[no-untyped-def]
    """Write the lighting MLP's outputs of the rows ``of`` (S,) of ``features``, ``light`` (S, O)."""
    blocks, own = (len(of) + BLOCK - 1) // BLOCK, features.shape[1]
    for part in prange(PARTS):
        lit, room = np.zeros((3, rows[0], BLOCK), np.float32), np.zeros((3, rows[1], BLOCK), np.int32)
        for block in range(part * blocks // PARTS, (part + 1) * blocks // PARTS):
            first, count = block * BLOCK, min(BLOCK, len(of) - block * BLOCK)
            for s in range(0, count, LANES):
                at = minimum(lane_numbers() + np.int32(first + s), splat(np.int32(len(of) - 1)))
                row, r = gather(of, at) * own, minimum(at, splat(np.int32(len(told) - 1))) * told.shape[1]
                for k in range(own):
                    store(lit, k * BLOCK + s, gather(features, row + k))
                for k in range(told.shape[1]):
                    store(lit, (own + k) * BLOCK + s, gather(told, r + k))
            _run(lit, room, lighting, first, count, light)


def looks(
    samples: Samples, along: Tensor, lattice: Lattice, tables: Tensor, lighting: Sequence[Tensor],
    palette: Sequence[Tensor],
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Run both networks; see :meth:`svv.kernels.types.ImageKernels.looks`."""
    first, *others = (w.detach().numpy() for w in lighting)
    told, first = _told(along, first)
    half = len(samples) >= LEAST_SAMPLES and pairs.cpu_multiplies_pairs()
    prepared = [_prepared(w, half) for w in ([first, *others], [w.detach().numpy() for w in palette])]
    light, raw = (torch.empty(len(samples), len(weights[-1])) for weights in (lighting, palette))
    looked_up = _looked_up(samples.position, samples.ray, told, lattice, tables)
    _looks(*looked_up, _rows(prepared), *prepared, light.numpy(), raw.numpy())
    return light, raw


def unlit(position: Tensor, lattice: Lattice, tables: Tensor, palette: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Run the palette MLP; see :meth:`svv.kernels.types.VertexKernels.unlit`."""
    prepared = _prepared([w.detach().numpy() for w in palette], pairs.cpu_multiplies_pairs())
    features = torch.empty(len(position), len(lattice.scales) * tables.shape[1] // 2)
    raw, nothing = torch.empty(len(position), len(palette[-1])), np.zeros((1, 0), np.float32)
    looked_up = _looked_up(position, torch.zeros(len(position), dtype=torch.int32), nothing, lattice, tables)
    _unlit(*looked_up, _rows([prepared], features.shape[1]), prepared, features.numpy(), raw.numpy())
    return features, raw


def light(features: Tensor, rows: Tensor, along: Tensor, lighting: Sequence[Tensor]) -> Tensor:
    """Run the lighting MLP; see :meth:`svv.kernels.types.VertexKernels.light`."""
    first, *others = (w.detach().numpy() for w in lighting)
    told, first = _told(along, first)
    prepared = _prepared([first, *others], pairs.cpu_multiplies_pairs())
    out = torch.empty(len(rows), len(lighting[-1]))
    _light(features.numpy(), rows.numpy(), told, _rows([prepared]), prepared, out.numpy())
    return out


def _looked_up(
    position: Tensor, ray: Tensor, told: NDArray[np.float32], lattice: Lattice, tables: Tensor
) -> tuple[object, ...]:
    """Return the arguments of :func:`_look_up` that all samples share."""
    return (
        position.numpy(), ray.numpy(), told, lattice.shapes.numpy(), lattice.scales.numpy(), lattice.bases.numpy(),
        lattice.index.numpy(), tables.detach().numpy(), (0.0,) * (tables.shape[1] // 2),
    )  # fmt: skip


def _told(along: Tensor, weights: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return what the lighting MLP is told of directions (R, 3), and the weights of its first layer, for that.

    If all directions are equal, their part of the layer's sums is a weight of the constant 1, and another one that is
    what half precision rounds off.
    """
    one = along.stride(0) == 0 or bool((along[-1] == along[0]).all() and (along == along[0]).all())
    directions = along[:1] if one else along
    harmonics = np.empty((len(directions), HARMONICS), np.float32)
    numba_rays.harmonics(directions.contiguous().numpy(), np.arange(len(directions), dtype=np.int32), harmonics)
    if not one:
        return harmonics, weights
    part = (weights[:, -HARMONICS:].astype(np.float64) @ harmonics[0]).astype(np.float32)
    high = pairs.rounded(part)
    return np.ones((1, 2), np.float32), np.concatenate(
        [weights[:, :-HARMONICS], high[:, None], (part - high)[:, None]], axis=1
    )


Prepared = tuple[NDArray[np.generic], NDArray[np.int64], NDArray[np.int64]]


def _rows(networks: Sequence[Prepared], least: int = 0) -> tuple[int, int]:
    """Return the rows that networks of one precision need for their numbers, and for pairs of them."""
    rows = max(least, *(int(wide.max()) for _, _, wide in networks))
    return rows, rows if networks[0][0].dtype == np.int32 else 0


def _prepared(matrices: Sequence[NDArray[np.float32]], half: bool) -> Prepared:
    """Return the weights of all layers, (to, from) in squares padded with zeros, the layers' widths, and padded ones.

    If ``half``, rows are of pairs. Padded widths are even, so a layer's last pair is complete.
    """
    widths = np.array([matrices[0].shape[1], *(len(m) for m in matrices)])
    wide = -(-widths // ROWS) * ROWS
    squares = np.zeros((len(matrices), wide.max(), wide.max()), np.float32)
    for square, matrix in zip(squares, matrices, strict=True):
        square[: matrix.shape[0], : matrix.shape[1]] = matrix
    return pairs.paired(squares) if half else squares, widths, wide
