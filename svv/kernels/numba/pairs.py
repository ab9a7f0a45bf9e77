"""Products of pairs of bfloat16 numbers, on CPUs that multiply and add two of them at a time (AVX-512 BF16).

Numbers are float32 outside; sums are float32 as well, and only factors are rounded to bfloat16 (8 bits of mantissa).
Two neighbouring rows of a matrix lie in one of int32: the first in the lower half of each word.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from llvmlite import binding, ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

ROWS, COLUMNS = 4, 32
"""Rows and columns of a tile of a product: its eight vectors of sums hide the time that a product takes."""

_LANES = 16
_FLOATS, _WORDS = (ir.VectorType(kind, _LANES) for kind in (ir.FloatType(), ir.IntType(32)))
_HALVES = ir.VectorType(ir.IntType(16), 2 * _LANES)


@cache
def cpu_multiplies_pairs() -> bool:
    """Return whether this CPU has the instructions and numba compiles for it, not for a named or a restricted one."""
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return False
    return bool(binding.get_host_cpu_features().get("avx512bf16", False))


def _numbers(values: list[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(values)), values)


def _call(builder: ir.IRBuilder, name: str, result: ir.Type, arguments: list[ir.Value]) -> ir.Value:
    """Call an instruction of the CPU."""
    name = f"llvm.x86.avx512bf16.{name}.512"
    kind = ir.FunctionType(result, [a.type for a in arguments])
    return builder.call(builder.module.globals.get(name) or ir.Function(builder.module, kind, name), arguments)


def _paired(builder: ir.IRBuilder, low: ir.Value, high: ir.Value) -> ir.Value:
    """Return words with the numbers of two vectors, rounded to the nearest."""
    both = _call(builder, "cvtne2ps2bf16", _HALVES, [high, low])
    order = _numbers([lane + half for lane in range(_LANES) for half in (0, _LANES)])
    return builder.bitcast(builder.shuffle_vector(both, both, order), _WORDS)


def _address(context, builder, sig, arguments, number, place):  # type: ignore[no-untyped-def]
    """Return the address of an element of an array among the arguments, counted in raster order."""
    array = context.make_array(sig.args[number])(context, builder, arguments[number])
    return builder.gep(array.data, [place])


def _vector(builder: ir.IRBuilder, address: ir.Value, kind: ir.Type) -> ir.Value:
    return builder.bitcast(address, kind.as_pointer())


@intrinsic
def pack(typing, a, a0, b0, c, c0):  # type: ignore[no-untyped-def]
    """Write 16 words from places of two rows of floats, all counted in raster order."""

    def generate(context, builder, sig, arguments):  # type: ignore[no-untyped-def]
        rows = [_address(context, builder, sig, arguments, 0, arguments[k]) for k in (1, 2)]
        low, high = (builder.load(_vector(builder, row, _FLOATS), align=4) for row in rows)
        out = _vector(builder, _address(context, builder, sig, arguments, 3, arguments[4]), _WORDS)
        builder.store(_paired(builder, low, high), out, align=4)
        return context.get_dummy_value()

    i = types.int64
    return types.void(a, i, i, c, i), generate


def _tile(relu: bool) -> Callable[..., None]:
    """Return a compiled function that computes c[m, n] = sum over k of a[m, k] b[k, n], ``depth`` pairs of k.

    There are ``ROWS`` rows m and ``COLUMNS`` columns n. Arrays count as flat: pair p of a[m] is a[a0 + m am + p], that
    of b is b[b0 + p bk + n], and c[m, n] is c[c0 + m cm + n]. With ``relu``, nothing is negative (NaN stays NaN), and c
    has pairs of rows as well.
    """
    nothing, halves = ir.Constant(_FLOATS, None), range(0, COLUMNS, _LANES)

    def generate(context, builder, sig, arguments):  # type: ignore[no-untyped-def]
        a0, am, b0, bk, depth, c0, cm = (arguments[k] for k in (1, 2, 4, 5, 6, 8, 9))

        def at(number, *offsets):  # type: ignore[no-untyped-def]
            place = offsets[0]
            for offset in offsets[1:]:
                place = builder.add(place, offset)
            return _address(context, builder, sig, arguments, number, place)

        def times(stride: ir.Value, number: int) -> ir.Value:
            return builder.mul(stride, stride.type(number))

        sums = [[cgutils.alloca_once_value(builder, nothing) for _ in halves] for _ in range(ROWS)]
        with cgutils.for_range(builder, depth) as loop:
            row = builder.mul(loop.index, bk)
            right = [_vector(builder, at(3, b0, row, bk.type(n)), _WORDS) for n in halves]
            right = [builder.load(address, align=4) for address in right]
            for m in range(ROWS):
                word = builder.load(at(0, a0, times(am, m), loop.index))
                one = builder.insert_element(ir.Constant(_WORDS, ir.Undefined), word, ir.IntType(32)(0))
                left = builder.shuffle_vector(one, one, _numbers([0] * _LANES))
                for total, numbers in zip(sums[m], right, strict=True):
                    builder.store(_call(builder, "dpbf16ps", _FLOATS, [builder.load(total), left, numbers]), total)
        for k, n in enumerate(halves):
            found = [builder.load(total[k]) for total in sums]
            if relu:
                found = [builder.select(builder.fcmp_ordered("<", f, nothing), nothing, f) for f in found]
                found = [_paired(builder, *found[m : m + 2]) for m in range(0, ROWS, 2)]
            for m, vector in enumerate(found):
                place = _vector(builder, at(7, c0, times(cm, m), cm.type(n)), vector.type)
                builder.store(vector, place, align=4)
        return context.get_dummy_value()

    @intrinsic
    def tile(typing, a, a0, am, b, b0, bk, depth, c, c0, cm):  # type: ignore[no-untyped-def]
        i = types.int64
        return types.void(a, i, i, b, i, i, i, c, i, i), generate

    return tile


multiply, multiply_relu = _tile(False), _tile(True)


def rounded(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return numbers rounded to the nearest bfloat16, those halfway to even."""
    bits = np.ascontiguousarray(values).view(np.uint32)
    bits = (bits + 0x7FFF + (bits >> 16 & 1)) & np.uint32(0xFFFF0000)
    return bits.view(np.float32)


def paired(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return rows (N, 2 M) as pairs of neighbours in a row (N, M)."""
    bits = rounded(values).view(np.uint32)
    return (bits[..., ::2] >> 16 | bits[..., 1::2]).view(np.int32)
