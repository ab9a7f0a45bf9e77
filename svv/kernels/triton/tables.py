"""Look-ups in feature tables, and the optimiser of the tables, in Triton.

Letters: S samples, L levels, F features per level, V rows of a table. ``WIDE`` is F rounded up to a power of two, and
``BLOCK`` is the number of samples or rows of one program. :mod:`svv.kernels.numba.lattice` and
:mod:`svv.kernels.numba.hashing` describe what each function computes.

Triton compiles a kernel again for sizes that are divisible by 16 and for addresses that are, which takes seconds. Sizes
change from step to step and gain nothing by it, so they are not specialized; neither are addresses that are read or
written number by number. Tables and features are always aligned.
"""

from __future__ import annotations

import triton
import triton.language as tl


@triton.jit
def known(samples):  # type: ignore[no-untyped-def]
    """Return a number that kernels are given, or that lies on the GPU, because the CPU does not wait for it."""
    if samples.dtype.is_ptr():
        samples = tl.load(samples).to(tl.int32)
    return samples


@triton.jit
def position_in_cell(x, i, there, sx, sy, sz, highest_x, highest_y, highest_z):  # type: ignore[no-untyped-def]
    """Return the lowest vertex of the cell around each sample, and the sample's position in the cell."""
    fx = tl.load(x + 3 * i, mask=there, other=0.0) * sx
    fy = tl.load(x + 3 * i + 1, mask=there, other=0.0) * sy
    fz = tl.load(x + 3 * i + 2, mask=there, other=0.0) * sz
    ix = tl.minimum(fx.to(tl.int32), highest_x)
    iy = tl.minimum(fy.to(tl.int32), highest_y)
    iz = tl.minimum(fz.to(tl.int32), highest_z)
    return ix, iy, iz, fx - ix.to(tl.float32), fy - iy.to(tl.float32), fz - iz.to(tl.float32)


@triton.jit
def corner_weight(wx, wy, wz, corner: tl.constexpr):  # type: ignore[no-untyped-def]
    """Return the trilinear weight of a corner, whose three bits are steps along x, y and z."""
    x = wx if corner & 4 else 1.0 - wx
    y = wy if corner & 2 else 1.0 - wy
    z = wz if corner & 1 else 1.0 - wz
    return x * y * z


@triton.jit
def row_of(word, z, last):  # type: ignore[no-untyped-def]
    """Return the row of a vertex from its word of the index; see :func:`svv.core.rays.encodings.stored_rows`.

    ``last``: see :func:`svv.kernels.numba.trilinear.row_at`.
    """
    before = word & ((tl.full(z.shape, 1, tl.int64) << (z & 31).to(tl.int64)) - 1)
    before = (before & 0x55555555) + (before >> 1 & 0x55555555)
    before = (before & 0x33333333) + (before >> 2 & 0x33333333)
    before = (before & 0x0F0F0F0F) + (before >> 4 & 0x0F0F0F0F)
    return tl.minimum((word >> 32) + (before * 0x01010101 >> 24 & 0xFF), last)


@triton.jit
def lattice_cells(x, i, there, shapes, scales, bases, level):  # type: ignore[no-untyped-def]
    """Return the word of each sample's lowest vertex in ``index``, x and y strides, z, and the position in the cell."""
    scale = tl.load(scales + level)
    nx = tl.load(shapes + 3 * level).to(tl.int32)
    ny = tl.load(shapes + 3 * level + 1).to(tl.int32)
    nz = tl.load(shapes + 3 * level + 2).to(tl.int32)
    ix, iy, iz, wx, wy, wz = position_in_cell(x, i, there, scale, scale, scale, nx - 2, ny - 2, nz - 2)
    words = (nz + 31) // 32
    at = tl.load(bases + level) + (ix.to(tl.int64) * ny + iy) * words + iz // 32
    return at, ny * words, words, iz, wx, wy, wz


@triton.jit(do_not_specialize=["x", "samples", "levels"])
def lattice_encode(  # type: ignore[no-untyped-def]
    x, shapes, scales, bases, index, table, out, samples, levels,
    FEATURES: tl.constexpr, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Compute one level for a block of samples: x (S, 3) -> out (S, L * F)."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    level = tl.program_id(1)
    f = tl.arange(0, WIDE)
    there = i < known(samples)
    both = there[:, None] & (f < FEATURES)[None, :]
    at, along_x, along_y, z, wx, wy, wz = lattice_cells(x, i, there, shapes, scales, bases, level)
    total = tl.zeros((BLOCK, WIDE), tl.float32)
    for corner in tl.static_range(8):
        # Vertices are numbered in raster order, so the neighbour in z always has the next number.
        word = tl.load(index + at + (corner >> 2) * along_x + (corner >> 1 & 1) * along_y, mask=there, other=0)
        row = row_of(word, z, tl.load(bases + levels)) + (corner & 1)
        value = tl.load(table + row[:, None] * FEATURES + f[None, :], mask=both, other=0.0)
        total += corner_weight(wx, wy, wz, corner)[:, None] * value
    tl.store(out + (i * levels + level)[:, None] * FEATURES + f[None, :], total, mask=both)


@triton.jit(do_not_specialize=["x", "chosen", "g_out", "used", "samples", "levels", "columns"])
def lattice_backward(  # type: ignore[no-untyped-def]
    x, chosen, g_out, shapes, scales, bases, index, gradient, used, samples, levels, columns,
    FEATURES: tl.constexpr, WIDE: tl.constexpr, CHOSEN: tl.constexpr, ALIKE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Add the gradient of one level for a block of samples to ``gradient`` (V, F); mark rows in ``used`` (V,).

    ``g_out`` (S, ``columns``) begins with the gradients of all levels, or, if they are ``ALIKE``, has that of each.
    Sample k lies at row k of ``x``, or, if only some are ``CHOSEN``, at row ``chosen[k]``.
    """
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    level = tl.program_id(1)
    f = tl.arange(0, WIDE)
    there = i < known(samples)
    both = there[:, None] & (f < FEATURES)[None, :]
    place = tl.load(chosen + i, mask=there, other=0) if CHOSEN else i
    at, along_x, along_y, z, wx, wy, wz = lattice_cells(x, place, there, shapes, scales, bases, level)
    first = 0 if ALIKE else level * FEATURES
    g = tl.load(g_out + (i * columns + first)[:, None] + f[None, :], mask=both, other=0.0)
    one = tl.full((BLOCK,), 1, tl.uint8)
    for corner in tl.static_range(8):
        word = tl.load(index + at + (corner >> 2) * along_x + (corner >> 1 & 1) * along_y, mask=there, other=0)
        row = row_of(word, z, tl.load(bases + levels)) + (corner & 1)
        share = corner_weight(wx, wy, wz, corner)[:, None] * g
        tl.atomic_add(gradient + row[:, None] * FEATURES + f[None, :], share, mask=both, sem="relaxed")
        tl.store(used + row, one, mask=there)


@triton.jit
def hash_row(x, y, z, resolution, entries):  # type: ignore[no-untyped-def]
    """Return the row of a vertex in its level: direct if all fit, hashed otherwise (Müller et al. 2022, eq. 4).

    The number of rows of a hashed level is a power of two.
    """
    side = (resolution + 1).to(tl.int64)
    direct = (x.to(tl.int64) * side + y) * side + z
    h = x.to(tl.uint32) ^ (y.to(tl.uint32) * 2654435761) ^ (z.to(tl.uint32) * 805459861)
    return tl.where(side * side * side <= entries, direct, h.to(tl.int64) & (entries - 1))


@triton.jit(do_not_specialize=["x", "samples", "levels"])
def hash_encode(  # type: ignore[no-untyped-def]
    x, resolutions, offsets, table, out, samples, levels,
    FEATURES: tl.constexpr, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Compute one level for a block of samples: x (S, 3) in [0, 1] -> out (S, L * F)."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    level = tl.program_id(1)
    f = tl.arange(0, WIDE)
    there = i < samples
    both = there[:, None] & (f < FEATURES)[None, :]
    r = tl.load(resolutions + level).to(tl.int32)
    first = tl.load(offsets + level)
    entries = tl.load(offsets + level + 1) - first
    ix, iy, iz, wx, wy, wz = position_in_cell(x, i, there, r, r, r, r - 1, r - 1, r - 1)
    total = tl.zeros((BLOCK, WIDE), tl.float32)
    for corner in tl.static_range(8):
        row = first + hash_row(ix + (corner >> 2), iy + (corner >> 1 & 1), iz + (corner & 1), r, entries)
        value = tl.load(table + row[:, None] * FEATURES + f[None, :], mask=both, other=0.0)
        total += corner_weight(wx, wy, wz, corner)[:, None] * value
    tl.store(out + (i * levels + level)[:, None] * FEATURES + f[None, :], total, mask=both)


@triton.jit(do_not_specialize=["x", "used", "samples", "levels"])
def hash_backward(  # type: ignore[no-untyped-def]
    x, g_out, resolutions, offsets, gradient, used, samples, levels,
    FEATURES: tl.constexpr, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Add the gradient of one level for a block of samples to ``gradient`` (V, F); mark rows in ``used`` (V,)."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    level = tl.program_id(1)
    f = tl.arange(0, WIDE)
    there = i < samples
    both = there[:, None] & (f < FEATURES)[None, :]
    r = tl.load(resolutions + level).to(tl.int32)
    first = tl.load(offsets + level)
    entries = tl.load(offsets + level + 1) - first
    ix, iy, iz, wx, wy, wz = position_in_cell(x, i, there, r, r, r, r - 1, r - 1, r - 1)
    g = tl.load(g_out + (i * levels + level)[:, None] * FEATURES + f[None, :], mask=both, other=0.0)
    one = tl.full((BLOCK,), 1, tl.uint8)
    for corner in tl.static_range(8):
        row = first + hash_row(ix + (corner >> 2), iy + (corner >> 1 & 1), iz + (corner & 1), r, entries)
        share = corner_weight(wx, wy, wz, corner)[:, None] * g
        tl.atomic_add(gradient + row[:, None] * FEATURES + f[None, :], share, mask=both, sem="relaxed")
        tl.store(used + row, one, mask=there)


@triton.jit(do_not_specialize=["used", "first", "second", "age", "rate", "pull", "finer", "rows"])
def adam(  # type: ignore[no-untyped-def]
    table, gradient, used, first, second, age, rate, beta1, beta2, epsilon, pull, finer, rows,
    FEATURES: tl.constexpr, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Take one Adam step on the marked rows of a block; clear their gradient and mark. ``rate`` (1,), ``pull`` (1,)."""
    v = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    f = tl.arange(0, WIDE)
    marked = tl.load(used + v, mask=v < rows, other=0) > 0
    steps = tl.load(age + v, mask=marked, other=0) + 1
    tl.store(age + v, steps, mask=marked)
    tl.store(used + v, tl.zeros((BLOCK,), tl.uint8), mask=marked)
    n = tl.minimum(steps, 10000).to(tl.float32)
    a = tl.load(rate) / (1.0 - tl.exp(n * tl.log(beta1)))
    b = 1.0 / (1.0 - tl.exp(n * tl.log(beta2)))
    back = tl.where(v >= finer, tl.load(pull), 0.0)
    at = v.to(tl.int64)[:, None] * FEATURES + f[None, :]
    both = marked[:, None] & (f < FEATURES)[None, :]
    value = tl.load(table + at, mask=both, other=0.0)
    g = tl.load(gradient + at, mask=both, other=0.0) + back[:, None] * value
    m = tl.load(first + at, mask=both, other=0.0)
    s = tl.load(second + at, mask=both, other=0.0)
    m += (1.0 - beta1) * (g - m)
    s += (1.0 - beta2) * (g * g - s)
    tl.store(first + at, m, mask=both)
    tl.store(second + at, s, mask=both)
    tl.store(gradient + at, tl.zeros((BLOCK, WIDE), tl.float32), mask=both)
    tl.store(table + at, value - a[:, None] * m / (tl.sqrt(s * b[:, None]) + epsilon), mask=both)
