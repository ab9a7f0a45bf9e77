"""Vectors of numbers in numba's compiled functions: one instruction computes :data:`LANES` of them.

numba's own loops become vector instructions only where LLVM can prove that it may, and a march of rays is not such a
loop: rays leave the loop at different times. Here a kernel says so itself: variables hold one number for each lane,
comparisons give masks, and :func:`select` takes the place of a branch. LLVM maps the vectors to those that the CPU has.

There are vectors of float32 (:data:`floats`), of int32 (:data:`ints`), and masks (:data:`masks`). The operators +, -,
*, comparisons, &, | and shifts take two vectors, or a vector and a scalar, which counts for all lanes.

>>> @njit
... def doubled(x, out):
...     for i in range(0, len(x), LANES):
...         store(out, i, 2.0 * load(x, i))
>>> numbers, out = np.arange(LANES, dtype=np.float32), np.zeros(LANES, np.float32)
>>> doubled(numbers, out)
>>> bool((out == 2.0 * numbers).all())
True
"""

from __future__ import annotations

import operator
from collections.abc import Callable

import numpy as np
from llvmlite import ir
from llvmlite.binding import llvm_version_info
from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH

LANES = 16
"""Numbers in a vector: one register of AVX-512, two of AVX2, four of SSE and NEON. Eight are slower, with SSE as well,
because fewer look-ups of memory are then on their way at the same time; NEON was not tried."""

COMPRESSES = (19, 0, 0)
"""Version of LLVM from which on it compresses vectors: with one instruction of AVX-512, otherwise lane by lane."""


class Vector(types.Type):
    """The type of a vector with elements of a type."""

    def __init__(self, of: types.Type) -> None:
        self.of = of
        super().__init__(name=f"vector({of} x {LANES})")


floats, ints, masks = Vector(types.float32), Vector(types.int32), Vector(types.boolean)
"""Types of vectors."""

_OF_LLVM = {
    kind: ir.VectorType(of, LANES)
    for kind, of in ((floats, ir.FloatType()), (ints, ir.IntType(32)), (masks, ir.IntType(1)))
}
_SCALARS = {floats: types.Float, ints: types.Integer}
_FLAGS = tuple(sorted(FAST_MATH))
_FIRST, _WORD = ir.IntType(32)(0), ir.IntType(64)


@register_model(Vector)
class _Model(models.PrimitiveModel):
    """Vectors are values of LLVM."""

    def __init__(self, manager: object, kind: Vector) -> None:
        super().__init__(manager, kind, _OF_LLVM[kind])


def _lanes(numbers: list[int]) -> ir.Constant:
    """Return the numbers of lanes that a shuffle takes."""
    return ir.Constant(ir.VectorType(ir.IntType(32), len(numbers)), numbers)


def _splat(builder: ir.IRBuilder, value: ir.Value, kind: Vector) -> ir.Value:
    """Return a vector of one value in all lanes."""
    nothing = ir.Constant(_OF_LLVM[kind], ir.Undefined)
    return builder.shuffle_vector(builder.insert_element(nothing, value, _FIRST), nothing, _lanes([0] * LANES))


def _arithmetic(name: str) -> Callable[..., ir.Value]:
    def build(builder: ir.IRBuilder, kind: Vector, a: ir.Value, b: ir.Value) -> ir.Value:
        return getattr(builder, "f" + name)(a, b, flags=_FLAGS) if kind is floats else getattr(builder, name)(a, b)

    return build


def _comparison(sign: str) -> Callable[..., ir.Value]:
    def build(builder: ir.IRBuilder, kind: Vector, a: ir.Value, b: ir.Value) -> ir.Value:
        return builder.fcmp_ordered(sign, a, b, _FLAGS) if kind is floats else builder.icmp_signed(sign, a, b)

    return build


def _define(function: Callable[..., object], kinds: dict[Vector, Vector], build: Callable[..., ir.Value]) -> None:
    """Define an operator for some kinds of vectors, each with the kind of its result."""

    class Template(AbstractTemplate):
        def generic(self, args: tuple[types.Type, ...], kws: object) -> object:
            kind = next((a for a in args if isinstance(a, Vector)), None)
            if kind not in kinds or not all(a is kind or isinstance(a, _SCALARS.get(kind, ())) for a in args):
                return None
            return signature(kinds[kind], *args)

    def define(kind: Vector, one: object, other: object) -> None:
        @lower_builtin(function, one, other)
        def lower(context, builder, sig, values):  # type: ignore[no-untyped-def]
            vectors = (
                value if of is kind else _splat(builder, context.cast(builder, value, of, kind.of), kind)
                for value, of in zip(values, sig.args, strict=True)
            )
            return build(builder, kind, *vectors)

    infer_global(function)(Template)
    for kind in kinds:
        define(kind, kind, kind)
        if kind in _SCALARS:
            define(kind, kind, _SCALARS[kind])
            define(kind, _SCALARS[kind], kind)


for _function, _name in ((operator.add, "add"), (operator.sub, "sub"), (operator.mul, "mul")):
    _define(_function, {floats: floats, ints: ints}, _arithmetic(_name))
_define(operator.truediv, {floats: floats}, _arithmetic("div"))
for _function, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _define(_function, {floats: masks, ints: masks}, _comparison(_sign))
_define(operator.eq, {floats: masks, ints: masks}, _comparison("=="))
_define(operator.and_, {masks: masks, ints: ints}, lambda builder, _, a, b: builder.and_(a, b))
_define(operator.or_, {masks: masks, ints: ints}, lambda builder, _, a, b: builder.or_(a, b))
_define(operator.rshift, {ints: ints}, lambda builder, _, a, b: builder.ashr(a, b))
_define(operator.lshift, {ints: ints}, lambda builder, _, a, b: builder.shl(a, b))


@intrinsic
def splat(typing, value):  # type: ignore[no-untyped-def]
    """Return a vector of a float32 or an int32 in all lanes."""
    kind = {types.float32: floats, types.int32: ints}[value]
    return kind(value), lambda _, builder, __, values: _splat(builder, values[0], kind)


@intrinsic
def select(typing, mask, a, b):  # type: ignore[no-untyped-def]
    """Return a vector with the lanes of ``a`` where the mask is set, otherwise those of ``b``."""
    return a(masks, a, a), lambda _, builder, __, values: builder.select(*values)


@njit(fastmath=FAST_MATH, inline="always")
def minimum(a, b):  # type: ignore[no-untyped-def]
    """Return the smaller number of each lane."""
    return select(a < b, a, b)


@njit(fastmath=FAST_MATH, inline="always")
def maximum(a, b):  # type: ignore[no-untyped-def]
    """Return the larger number of each lane."""
    return select(a > b, a, b)


@intrinsic
def truncated(typing, a):  # type: ignore[no-untyped-def]
    """Return floats without their fractions, as ints."""
    return ints(floats), lambda _, builder, __, values: builder.fptosi(values[0], _OF_LLVM[ints])


@intrinsic
def as_floats(typing, a):  # type: ignore[no-untyped-def]
    """Return ints as floats, or floats as they are."""
    if a is floats:
        return floats(floats), lambda _, __, ___, values: values[0]
    return floats(ints), lambda _, builder, __, values: builder.sitofp(values[0], _OF_LLVM[floats])


@intrinsic
def with_bits(typing, a):  # type: ignore[no-untyped-def]
    """Return the floats that have the bits of ints."""
    return floats(ints), lambda _, builder, __, values: builder.bitcast(values[0], _OF_LLVM[floats])


@intrinsic
def ones_in_each(typing, a):  # type: ignore[no-untyped-def]
    """Return the number of ones among the bits of each of the ints."""

    def generate(context, builder, _, values):  # type: ignore[no-untyped-def]
        kind = _OF_LLVM[ints]
        name = f"llvm.ctpop.v{LANES}i32"
        function = builder.module.globals.get(name) or ir.Function(builder.module, ir.FunctionType(kind, [kind]), name)
        return builder.call(function, values)

    return ints(ints), generate


@intrinsic
def bits_of(typing, mask):  # type: ignore[no-untyped-def]
    """Return a mask as an int64, whose lowest bit is the first lane."""

    def generate(context, builder, _, values):  # type: ignore[no-untyped-def]
        return builder.zext(builder.bitcast(values[0], ir.IntType(LANES)), _WORD)

    return types.int64(masks), generate


@intrinsic
def mask_of(typing, bits):  # type: ignore[no-untyped-def]
    """Return the mask of which :func:`bits_of` gives an int64."""

    def generate(context, builder, _, values):  # type: ignore[no-untyped-def]
        return builder.bitcast(builder.trunc(values[0], ir.IntType(LANES)), _OF_LLVM[masks])

    return masks(types.int64), generate


@intrinsic
def number_of(typing, bits):  # type: ignore[no-untyped-def]
    """Return how many bits of an int64 are set."""
    return types.int64(types.int64), lambda _, builder, __, values: builder.ctpop(values[0])


@intrinsic
def first_of(typing, bits):  # type: ignore[no-untyped-def]
    """Return the number of the lowest bit that is set, of at least one."""
    return types.int64(types.int64), lambda _, builder, __, values: builder.cttz(values[0], ir.IntType(1)(1))


def _pointer(context, builder, sig, values, place):  # type: ignore[no-untyped-def]
    """Return the address of an element of an array, counted in raster order."""
    return builder.gep(context.make_array(sig.args[0])(context, builder, values[0]).data, [place])


@intrinsic
def load(typing, array, first):  # type: ignore[no-untyped-def]
    """Return consecutive elements of an array of float32 or int32, from one on, counted in raster order."""
    kind = {types.float32: floats, types.int32: ints}[array.dtype]

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        place = _pointer(context, builder, sig, values, values[1])
        return builder.load(builder.bitcast(place, _OF_LLVM[kind].as_pointer()), align=4)

    return kind(array, types.int64), generate


@intrinsic
def store(typing, array, first, vector):  # type: ignore[no-untyped-def]
    """Write consecutive elements of an array, from one on, counted in raster order."""

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        place = _pointer(context, builder, sig, values, values[1])
        builder.store(values[2], builder.bitcast(place, values[2].type.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.int64, vector), generate


def _each(builder: ir.IRBuilder, at: ir.Value, of: ir.Type, read: Callable[[ir.Value], ir.Value]) -> ir.Value:
    """Return the vector of what ``read`` gives for the place, >= 0, in each lane."""
    out = ir.Constant(ir.VectorType(of, LANES), ir.Undefined)
    for lane in map(ir.IntType(32), range(LANES)):
        # Taking an element out of a vector of x86 fills the upper half of its place with zeros, not with its sign.
        out = builder.insert_element(out, read(builder.zext(builder.extract_element(at, lane), _WORD)), lane)
    return out


@intrinsic
def to_front(typing, a, mask):  # type: ignore[no-untyped-def]
    """Return the lanes of ``a`` that the mask sets, next to each other from the first on; others may be any numbers."""

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        of, place = _OF_LLVM[sig.args[0]], ir.IntType(32)(0)
        out = ir.Constant(of, ir.Undefined)
        if llvm_version_info >= COMPRESSES:
            name = f"llvm.experimental.vector.compress.v{LANES}{'f' if sig.args[0] is floats else 'i'}32"
            kind = ir.FunctionType(of, [of, _OF_LLVM[masks], of])
            function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
            return builder.call(function, [*values, out])
        for lane in map(ir.IntType(32), range(LANES)):
            out = builder.insert_element(out, builder.extract_element(values[0], lane), place)
            place = builder.add(place, builder.zext(builder.extract_element(values[1], lane), place.type))
        return out

    return a(a, masks), generate


@intrinsic
def gather(typing, array, at):  # type: ignore[no-untyped-def]
    """Return elements of an array of float32 or of integers, which must fit an int32, counted in raster order."""
    kind = floats if array.dtype == types.float32 else ints

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        def read(place):  # type: ignore[no-untyped-def]
            return builder.load(_pointer(context, builder, sig, values, place))

        own, of = context.get_data_type(array.dtype), _OF_LLVM[kind]
        found = _each(builder, values[1], own, read)  # widened together, by one instruction
        if own == of.element:
            return found
        return builder.zext(found, of) if own.width < of.element.width else builder.trunc(found, of)

    return kind(array, ints), generate


@intrinsic
def ask_for_each(typing, array, at, offset):  # type: ignore[no-untyped-def]
    """Ask for the memory of elements ``offset`` behind places in raster order, without waiting for it."""

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, *[ir.IntType(32)] * 3])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        to_read, keep, data = (ir.IntType(32)(n) for n in (0, 3, 1))
        for lane in map(ir.IntType(32), range(LANES)):
            place = builder.sext(builder.extract_element(values[1], lane), _WORD)
            element = builder.gep(_pointer(context, builder, sig, values, place), [values[2]])
            builder.call(function, [builder.bitcast(element, byte), to_read, keep, data])
        return context.get_dummy_value()

    return types.void(array, ints, types.int64), generate


def _halves(builder: ir.IRBuilder, pairs: ir.Value, of: ir.Type) -> list[ir.Value]:
    """Return the vectors of the lower and of the upper halves of a vector of integers."""
    flat = builder.bitcast(pairs, ir.VectorType(of, 2 * LANES))
    return [builder.shuffle_vector(flat, flat, _lanes(list(range(k, 2 * LANES, 2)))) for k in (0, 1)]


@intrinsic
def gather_pairs(typing, array, at, offset):  # type: ignore[no-untyped-def]
    """Return two vectors: elements ``offset`` behind places in raster order, and those that follow them.

    The array is of float32, or of integers of at most 32 bits, which become ints: negative ones only of 32. Two
    elements take a single read of memory.
    """
    kind = floats if array.dtype == types.float32 else ints

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        bits = 8 * context.get_abi_sizeof(context.get_data_type(array.dtype))
        both = ir.IntType(2 * bits)

        def read(place):  # type: ignore[no-untyped-def]
            at = builder.gep(_pointer(context, builder, sig, values, place), [values[2]])
            return builder.load(builder.bitcast(at, both.as_pointer()), align=1)

        pairs = _each(builder, values[1], both, read)
        if array.dtype == types.float32:
            halves = _halves(builder, pairs, ir.FloatType())
        else:
            halves = [builder.zext(half, _OF_LLVM[ints]) for half in _halves(builder, pairs, ir.IntType(bits))]
        return context.make_tuple(builder, sig.return_type, halves)

    return types.UniTuple(kind, 2)(array, ints, types.int64), generate


@intrinsic
def gather_halves(typing, array, at):  # type: ignore[no-untyped-def]
    """Return two vectors of ints: the lower and the upper halves of elements of an array of int64."""

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        def read(place):  # type: ignore[no-untyped-def]
            return builder.load(_pointer(context, builder, sig, values, place))

        halves = _halves(builder, _each(builder, values[1], _WORD, read), ir.IntType(32))
        return context.make_tuple(builder, sig.return_type, halves)

    return types.UniTuple(ints, 2)(array, ints), generate


@intrinsic
def total(typing, a):  # type: ignore[no-untyped-def]
    """Return the sum of the lanes of floats: of pairs, of pairs of these, and so on."""

    def generate(context, builder, sig, values):  # type: ignore[no-untyped-def]
        left, count = values[0], LANES
        while count > 1:
            count //= 2
            halves = [builder.shuffle_vector(left, left, _lanes([k + far for k in range(count)])) for far in (0, count)]
            left = builder.fadd(*halves)
        return builder.extract_element(left, _FIRST)

    return types.float32(floats), generate


@intrinsic
def lane_numbers(typing):  # type: ignore[no-untyped-def]
    """Return 0, 1, 2, ... as ints."""
    return ints(), lambda _, __, ___, ____: _lanes(list(range(LANES)))


LOWEST, HIGHEST, HALF = np.float32(-87.0), np.float32(88.0), np.float32(0.5)
LOG2_E, LN_2_HIGH, LN_2_LOW = np.float32(1.44269504), np.float32(0.693359375), np.float32(-2.12194440e-4)
TERMS = tuple(
    np.float32(t) for t in (1.9875691500e-4, 1.3981999507e-3, 8.3334519073e-3, 4.1665795894e-2, 0.16666665459)
)
"""Coefficients of the polynomial with which the Cephes library approximates the exponential between powers of two."""

ZERO, TWO = np.float32(0.0), np.float32(2.0)
ARTANH = tuple(np.float32(2.0 / n) for n in range(15, 0, -2))
"""Coefficients of 2 artanh(z) / z in z^2, from the last that counts on."""


@njit(fastmath=FAST_MATH, inline="always")
def exp(x):  # type: ignore[no-untyped-def]
    """Return e^x for floats, to 1e-7 of its value, where that is a normal number; those beyond get the last such."""
    x = minimum(maximum(x, splat(LOWEST)), splat(HIGHEST))
    x_2 = x * LOG2_E
    power = truncated(x_2 + select(x_2 < np.float32(0.0), splat(-HALF), splat(HALF)))
    whole = as_floats(power)
    r = x - whole * LN_2_HIGH - whole * LN_2_LOW
    t = TERMS
    p = (((t[0] * r + t[1]) * r + t[2]) * r + t[3]) * r + t[4]
    p = (p * r + HALF) * (r * r) + r + np.float32(1.0)
    return p * with_bits((power + 127) << 23)


@njit(fastmath=FAST_MATH, inline="always")
def softplus(x):  # type: ignore[no-untyped-def]
    """Return log(1 + e^x) for floats, to 3e-7 of its value."""
    y = exp(minimum(x, ZERO - x))  # at most 1: log(1 + y) is 2 artanh(y / (2 + y)), whose series ends soon
    z = y / (TWO + y)
    zz, series = z * z, splat(ARTANH[0])
    for k in range(1, len(ARTANH)):
        series = series * zz + ARTANH[k]
    return maximum(x, splat(ZERO)) + z * series
