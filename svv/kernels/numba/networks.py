"""The small networks in single precision, compiled with numba: a block of samples passes through all layers at once.

torch multiplies layer by layer and writes the activations of all samples to memory in between, most of it for the first
time, so much of the time goes into page faults. Here, only inputs and outputs are in memory, and activations in the
cache; the backward pass computes them again.

numba keeps the elements of an array in memory, not in registers, so the innermost product is given to LLVM directly
(:func:`tile_of`), which maps it to whatever vectors the CPU has.

Letters: S samples, I inputs, O outputs. Widths are padded with zeros to multiples of ``LANES``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import torch
from llvmlite import ir
from numba import prange, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray
from torch import Tensor

from svv.core.compiled import njit
from svv.kernels.types import Context

ROWS = 4
"""Rows of a tile of a product: its sums stay in registers, 8 of AVX2 for 4 x 16."""

LANES = 8
"""Columns of the narrow tile; the wide one has twice as many."""

BLOCK = 64
"""Samples of a block, a multiple of ``LANES``; the activations of one layer fit into the first level of the cache."""

PARTS, SUMS = 64, 16
"""Parts of the work, forward and backward. Each has a gradient of its own, so sums do not depend on the threads."""


def tile_of(columns: int, kind: str) -> Callable[..., None]:
    """Return a compiled function that computes c[m, n] = sum over k < depth of a[m, k] b[k, n].

    There are ``ROWS`` rows m and ``columns`` columns n. Arrays count as flat: a[m, k] is a[a0 + m am + k ak], b[k, n]
    is b[b0 + k bk + n], and c[m, n] is c[c0 + m cm + n].

    Args:
        columns: Number of columns.
        kind: ``plain``; ``relu``, whose result is never negative (NaN stays NaN); or ``sum``, which adds to c.
    """
    vector, fuse = ir.VectorType(ir.FloatType(), columns), ("contract",)
    lanes, nothing = ir.Constant(ir.VectorType(ir.IntType(32), columns), [0] * columns), ir.Constant(vector, None)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        a0, am, ak, b0, bk, depth, c0, cm = (arguments[k] for k in (1, 2, 3, 5, 6, 7, 9, 10))

        def at(number: int, offset: ir.Value) -> ir.Value:
            array = context.make_array(signature.args[number])(context, builder, arguments[number])
            return builder.gep(array.data, [offset])

        def row(pointer: ir.Value, stride: ir.Value, m: int) -> ir.Value:
            return builder.gep(pointer, [builder.mul(stride, stride.type(m))])

        out = [builder.bitcast(row(at(8, c0), cm, m), vector.as_pointer()) for m in range(ROWS)]
        begin = [builder.load(pointer, align=4) if kind == "sum" else nothing for pointer in out]
        sums = [cgutils.alloca_once_value(builder, value) for value in begin]
        with cgutils.for_range(builder, depth) as loop:
            right = builder.bitcast(at(4, builder.add(b0, builder.mul(loop.index, bk))), vector.as_pointer())
            right, left = builder.load(right, align=4), at(0, builder.add(a0, builder.mul(loop.index, ak)))
            for m in range(ROWS):
                one = builder.insert_element(nothing, builder.load(row(left, am, m)), ir.IntType(32)(0))
                product = builder.fmul(builder.shuffle_vector(one, nothing, lanes), right, flags=fuse)
                builder.store(builder.fadd(builder.load(sums[m]), product, flags=fuse), sums[m])
        for pointer, total in zip(out, map(builder.load, sums), strict=True):
            negative = builder.fcmp_ordered("<", total, nothing)
            builder.store(builder.select(negative, nothing, total) if kind == "relu" else total, pointer, align=4)
        return context.get_dummy_value()

    @intrinsic
    def tile(typing, a, a0, am, ak, b, b0, bk, depth, c, c0, cm):  # type: ignore[no-untyped-def]
        i = types.int64
        return types.void(a, i, i, i, b, i, i, i, c, i, i), generate

    return tile


def _product(kind: str) -> Callable[..., None]:
    """Return a compiled function that multiplies matrices whose rows and columns are padded; see :func:`tile_of`."""
    narrow, wide = tile_of(LANES, kind), tile_of(2 * LANES, kind)

    @njit
    def product(a, a0, am, ak, b, b0, bk, depth, c, c0, cm, rows, columns):  # type: ignore[no-untyped-def]
        for n in range(0, columns - LANES, 2 * LANES):
            for m in range(0, rows, ROWS):
                wide(a, a0 + m * am, am, ak, b, b0 + n, bk, depth, c, c0 + m * cm + n, cm)
        if columns % (2 * LANES):
            n = columns - LANES
            for m in range(0, rows, ROWS):
                narrow(a, a0 + m * am, am, ak, b, b0 + n, bk, depth, c, c0 + m * cm + n, cm)

    return product


_multiply, _multiply_relu, _multiply_add = (_product(kind) for kind in ("plain", "relu", "sum"))


@njit(cache=True)
def _fill(values, first, count, wide, out):  # type: ignore[no-untyped-def]
    """Copy rows of (S, width) into a block (BLOCK, >= wide); the other rows and columns, up to ``wide``, become 0."""
    for i in range(BLOCK):
        for j in range(wide):
            out[i, j] = np.float32(0.0)
    for i in range(count):
        for j in range(values.shape[1]):
            out[i, j] = values[first + i, j]


@njit(cache=True)
def _activate(x, first, count, weights, widths, wide, h, until):  # type: ignore[no-untyped-def]
    """Write the inputs of a block and what the layers before ``until`` give into ``h`` (layers + 1, BLOCK, widest)."""
    _fill(x, first, count, wide[0], h[0])
    row, layers = h.shape[2], len(widths) - 1
    for k in range(until):
        a, b, c, columns = k * BLOCK * row, k * row * row, (k + 1) * BLOCK * row, wide[k + 1]
        if k + 1 < layers:
            _multiply_relu(h, a, row, 1, weights, b, row, widths[k], h, c, row, BLOCK, columns)
        else:
            _multiply(h, a, row, 1, weights, b, row, widths[k], h, c, row, BLOCK, columns)


@njit(cache=True)
def _forward_part(part, x, weights, widths, wide, out):  # type: ignore[no-untyped-def]
    """Compute the outputs of a part of the samples."""
    blocks, layers = (len(x) + BLOCK - 1) // BLOCK, len(widths) - 1
    h = np.empty((layers + 1, BLOCK, weights.shape[2]), np.float32)
    for block in range(part * blocks // PARTS, (part + 1) * blocks // PARTS):
        first, count = block * BLOCK, min(BLOCK, len(x) - block * BLOCK)
        _activate(x, first, count, weights, widths, wide, h, layers)
        for i in range(count):
            for j in range(out.shape[1]):
                out[first + i, j] = h[layers, i, j]


@njit(parallel=True, cache=True)
def forward(x, weights, widths, wide, out):  # type: ignore[no-untyped-def]
    """Compute the outputs of a network, ``out`` (S, O).

    ``weights``: those of each layer, (from, to) in a square of the widest layer, padded with zeros; ``widths``: I, the
    widths of the hidden layers, and O, int64; ``wide``: the same, padded.
    """
    for part in prange(PARTS):
        _forward_part(part, x, weights, widths, wide, out)


@njit(cache=True)
def _backward_part(part, x, weights, back, widths, wide, upstream, of_x, of_weights):  # type: ignore[no-untyped-def]
    """Compute the gradients of a part of the samples: rows of ``of_x``, and a sum over them, ``of_weights``."""
    blocks, layers, row = (len(x) + BLOCK - 1) // BLOCK, len(widths) - 1, weights.shape[2]
    h, g = np.empty((layers + 1, BLOCK, row), np.float32), np.empty((layers + 1, BLOCK, row), np.float32)
    for k in range(layers):
        for i in range(wide[k + 1]):
            for j in range(wide[k]):
                of_weights[k, i, j] = np.float32(0.0)
    for block in range(part * blocks // SUMS, (part + 1) * blocks // SUMS):
        first, count = block * BLOCK, min(BLOCK, len(x) - block * BLOCK)
        _activate(x, first, count, weights, widths, wide, h, layers - 1)
        _fill(upstream, first, count, wide[layers], g[layers])
        for k in range(layers - 1, -1, -1):
            at, behind, square = k * BLOCK * row, (k + 1) * BLOCK * row, k * row * row
            _multiply_add(g, behind, 1, row, h, at, row, count, of_weights, square, row, wide[k + 1], wide[k])
            if k > 0 or len(of_x):
                _multiply(g, behind, row, 1, back, square, row, widths[k + 1], g, at, row, BLOCK, wide[k])
            if k > 0:
                for i in range(BLOCK):
                    for j in range(wide[k]):
                        g[k, i, j] = np.float32(0.0) if h[k, i, j] <= np.float32(0.0) else g[k, i, j]
        if len(of_x):
            for i in range(count):
                for j in range(of_x.shape[1]):
                    of_x[first + i, j] = g[0, i, j]


@njit(cache=True)
def _sum_up(sums, widths, out):  # type: ignore[no-untyped-def]
    """Sum the gradients of all parts, in their order, and leave out what is padded."""
    for k in range(len(widths) - 1):
        for i in range(widths[k + 1]):
            for part in range(SUMS):
                for j in range(widths[k]):
                    out[k, i, j] = sums[part, k, i, j] + (out[k, i, j] if part else np.float32(0.0))


@njit(parallel=True, cache=True)
def backward(x, weights, back, widths, wide, upstream, of_x, sums, of_weights):  # type: ignore[no-untyped-def]
    """Compute the gradients of :func:`forward` for ``upstream`` (S, O), with respect to inputs and weights.

    ``of_x`` (S, I) may have no rows, and is then not computed. ``back`` and ``of_weights`` are as ``weights``, but
    (to, from); ``sums`` is room for ``SUMS`` times as much.
    """
    for part in prange(SUMS):
        _backward_part(part, x, weights, back, widths, wide, upstream, of_x, sums[part])
    _sum_up(sums, widths, of_weights)


class Network(torch.autograd.Function):
    """Linear layers without biases, with ReLU between them: x (S, I) and weights (to, from) each -> (S, O)."""

    @staticmethod
    def forward(ctx: Context, x: Tensor, *weights: Tensor) -> Tensor:
        x, out = x.detach().contiguous(), torch.empty(len(x), len(weights[-1]))
        matrices = [w.detach().numpy() for w in weights]
        widths, wide = _widths(matrices)
        forward(x.numpy(), _squares((m.T for m in matrices), wide), widths, wide, out.numpy())
        ctx.save_for_backward(x, *weights)
        return out

    @staticmethod
    def backward(ctx: Context, upstream: Tensor) -> tuple[Tensor | None, ...]:
        x, *weights = ctx.saved_tensors
        of_x, *each = gradients_of(x, weights, upstream, ctx.needs_input_grad[0])
        return (of_x if ctx.needs_input_grad[0] else None, *each)


def gradients_of(x: Tensor, weights: Sequence[Tensor], upstream: Tensor, of_inputs: bool) -> list[Tensor]:
    """Return the gradients of a network's inputs (S, I), without rows unless ``of_inputs``, and of its weights."""
    matrices = [w.detach().numpy() for w in weights]
    widths, wide = _widths(matrices)
    ahead, back = _squares((m.T for m in matrices), wide), _squares(matrices, wide)
    of_x = torch.empty(len(x) if of_inputs else 0, x.shape[1])
    sums, of_weights = np.empty((SUMS, *ahead.shape), np.float32), torch.empty(ahead.shape)
    backward(
        x.numpy(), ahead, back, widths, wide, upstream.contiguous().numpy(), of_x.numpy(), sums, of_weights.numpy()
    )
    each = (g[: w.shape[0], : w.shape[1]].contiguous() for g, w in zip(of_weights, weights, strict=True))
    return [of_x, *each]


def _widths(weights: Sequence[NDArray[np.float32]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the widths of all layers from the inputs to the outputs, and the same, padded."""
    widths = np.array([weights[0].shape[1], *(len(w) for w in weights)])
    return widths, -(-widths // LANES) * LANES


def _squares(matrices: Iterable[NDArray[np.float32]], wide: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return matrices, each in a square of the widest layer, padded with zeros."""
    out = np.zeros((len(wide) - 1, wide.max(), wide.max()), np.float32)
    for square, matrix in zip(out, matrices, strict=True):
        square[: matrix.shape[0], : matrix.shape[1]] = matrix
    return out
