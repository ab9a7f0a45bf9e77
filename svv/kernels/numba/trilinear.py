"""Position of a point among the vertices of a lattice, and interpolation of their values, compiled with numba.

Everything is in single precision with unsigned rows: if integers and floats were mixed, numba would compute in double
precision, and for a signed row it would check for indices that count from the end.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH

ONE32 = np.float32(1.0)
NEXT_ROW = np.uint64(1)
WORD_BITS = np.uint64(32)


@intrinsic
def ones_in(context, word):  # type: ignore[no-untyped-def]
    """Return the number of ones among the bits of an unsigned integer: one instruction."""
    return types.uint64(types.uint64), lambda _, builder, __, arguments: builder.ctpop(arguments[0])


@intrinsic
def ask_for(typing, array, place):  # type: ignore[no-untyped-def]
    """Ask for the memory of an element of an array, counted in raster order, without waiting for it."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        byte = builder.bitcast(builder.gep(array.data, [arguments[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [byte.type, *[ir.IntType(32)] * 3])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte.type], kind)
        to_read, keep, data = (ir.IntType(32)(n) for n in (0, 3, 1))
        builder.call(function, [byte, to_read, keep, data])
        return context.get_dummy_value()

    return types.void(array, types.uint64), generate


@njit(fastmath=FAST_MATH)
def row_at(word, before, last):  # type: ignore[no-untyped-def]
    """Return the row of a vertex from its word of the index and a mask of the word's vertices before it.

    See :func:`svv.core.rays.encodings.stored_rows`. The rows of vertices that are not stored mean nothing, but no
    look-up may leave the table: none exceeds ``last``.
    """
    bits = np.uint64(word)
    return min((bits >> WORD_BITS) + ones_in(bits & before), last)


@njit(fastmath=FAST_MATH)
def cell_at(x, y, z, level, shapes, scales, bases, index):  # type: ignore[no-untyped-def]
    """Return the rows of four corners of a position's cell, and its offset from the first along each axis, in cells.

    The corners are (0, 0, 0), (0, 1, 0), (1, 0, 0) and (1, 1, 0). Vertices are numbered in raster order, so the
    neighbour in z always has the next row.
    """
    s = scales[level]
    fx, fy, fz = x * s, y * s, z * s
    ny, nz = shapes[level, 1], shapes[level, 2]
    ix = min(int(fx), shapes[level, 0] - 2)
    iy = min(int(fy), ny - 2)
    iz = min(int(fz), nz - 2)
    words = (nz + 31) >> 5
    at = np.uint64(bases[level] + (ix * ny + iy) * words + (iz >> 5))
    right, behind = np.uint64(words), np.uint64(ny * words)
    before = (np.uint64(1) << np.uint64(iz & 31)) - np.uint64(1)
    last = np.uint64(bases[shapes.shape[0]])
    a, b = row_at(index[at], before, last), row_at(index[at + right], before, last)
    c, d = row_at(index[at + behind], before, last), row_at(index[at + behind + right], before, last)
    return a, b, c, d, fx - np.float32(ix), fy - np.float32(iy), fz - np.float32(iz)


@njit(fastmath=FAST_MATH)
def weights_of(wx, wy, wz):  # type: ignore[no-untyped-def]
    """Return the weights of the eight corners, neighbours in z next to each other."""
    ux, uy, uz = ONE32 - wx, ONE32 - wy, ONE32 - wz
    uu, uw, wu, ww = ux * uy, ux * wy, wx * uy, wx * wy
    return uu * uz, uu * wz, uw * uz, uw * wz, wu * uz, wu * wz, ww * uz, ww * wz


@njit(fastmath=FAST_MATH)
def mean_of(table, a, b, c, d, w, f):  # type: ignore[no-untyped-def]
    """Return the mean of column ``f`` over a cell's rows (:func:`cell_at`) with weights ``w`` (:func:`weights_of`)."""
    return (
        w[0] * table[a, f]
        + w[1] * table[a + NEXT_ROW, f]
        + w[2] * table[b, f]
        + w[3] * table[b + NEXT_ROW, f]
        + w[4] * table[c, f]
        + w[5] * table[c + NEXT_ROW, f]
        + w[6] * table[d, f]
        + w[7] * table[d + NEXT_ROW, f]
    )
