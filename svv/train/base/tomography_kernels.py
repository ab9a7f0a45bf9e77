"""Projection and back-projection of an extinction, compiled with numba, for :mod:`svv.train.base.tomography`.

One thread computes each ray and vertex, without shared sums: results do not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import (
    LANES,
    as_floats,
    bits_of,
    exp,
    gather,
    gather_pairs,
    lane_numbers,
    load,
    mask_of,
    maximum,
    minimum,
    number_of,
    select,
    splat,
    store,
    truncated,
)
from svv.kernels.numba.bricks import NO_VALUES
from svv.kernels.numba.packets import (
    ENDED,
    ENOUGH,
    MOST_RAYS,
    NONE,
    ONE,
    STATE,
    TAU,
    ZERO,
    after_leap,
    begin,
    values_in_bricks,
    values_of_table,
    within,
)

TWO, BEFORE = np.float32(2.0), np.int32(-1)


@njit(parallel=True, cache=True)
def mean_of_squares(alpha, factor, out):  # type: ignore[no-untyped-def]
    """Write the mean of alpha, uint8 (N, H, W), over squares of ``factor`` pixels as float32 in [0, 1].

    ``out`` is of (N, H / factor, W / factor), rounded down.
    """
    _, height, width = out.shape
    parts, levels = np.float32(factor * factor), np.float32(255.0)
    for n in prange(out.shape[0]):
        total = np.empty(width, np.int64)
        for y in range(height):
            total[:] = 0
            for i in range(factor * y, factor * (y + 1)):
                for x in range(width):
                    for j in range(factor * x, factor * (x + 1)):
                        total[x] += alpha[n, i, j]
            for x in range(width):
                out[n, y, x] = np.float32(total[x]) / parts / levels


@njit(parallel=True, cache=True)
def beside_visible(alpha, odd, out):  # type: ignore[no-untyped-def]
    """Mark in ``out``, uint8, the pixels that are visible or one of whose 8 neighbours is. (N, H, W)

    Alpha is float32, > 0 where something is visible; ``odd``: only a chessboard's even (0) or odd squares (1); all
    (-1).
    """
    _, height, width = alpha.shape
    for n in prange(alpha.shape[0]):
        column = np.zeros(width + 2, np.uint8)  # three pixels above each other
        for y in range(height):
            column[:] = 0
            for i in range(max(y - 1, 0), min(y + 2, height)):
                for x in range(width):
                    column[x + 1] |= alpha[n, i, x] > 0.0
            for x in range(width):
                out[n, y, x] = column[x] | column[x + 1] | column[x + 2]
            if odd >= 0:
                out[n, y, (y + odd + 1) & 1 :: 2] = 0


def optical_depths(  # type: ignore[no-untyped-def]
    origins, directions, distance, cells, extent, step, shift, shapes, scales, bases, index, table, stop, out,
    bricks=NO_VALUES,
):  # fmt: skip
    """Write to ``out`` (R,) each ray's optical depth through an extinction of which a lattice holds the logarithm.

    Rays have ``origins`` and unit ``directions`` (R, 3), and end at the depth ``stop``. They may leap by ``distance``,
    uint8 (8, X, Y, Z) (:func:`svv.core.rays.cells.leaps`), of ``cells`` per box unit; ``extent`` (3,) are the box's
    sides. Samples lie at ``shift``, in [0, 1), of each ``step``. ``shapes`` to ``index`` are the layout of the lattice
    (:class:`svv.kernels.types.Lattice`), ``table`` (V,) its values, and ``bricks`` the same, from which they are read
    faster.
    """
    _optical_depths(
        origins, directions, distance, cells, extent, step, shift, shapes, scales, bases, index, table, *bricks, stop,
        out,
    )  # fmt: skip


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _optical_depths(  # type: ignore[no-untyped-def]  # long: one loop, whose state is registers
    origins, directions, distance, cells, extent, step, shift, shapes, scales, bases, index, table, slots, bricks, stop,
    out,
):  # fmt: skip
    """Do the work of :func:`optical_depths`, a packet of rays at a time as :mod:`svv.kernels.numba.packets` does."""
    nx, ny, nz = distance.shape[1:]
    side, rate, low, nothing = ONE / cells, ONE / step, splat(NONE), splat(ZERO)
    last_x, last_y, last_z = splat(np.int32(nx - 1)), splat(np.int32(ny - 1)), splat(np.int32(nz - 1))
    end_x, end_y, end_z = splat(extent[0]), splat(extent[1]), splat(extent[2])
    for block in prange((len(out) + MOST_RAYS - 1) // MOST_RAYS):
        state, steps = np.zeros((STATE, LANES), np.float32), np.zeros((3, LANES), np.int32)
        owner, going = np.full(LANES, -1, np.int64), 0
        coming, after = block * MOST_RAYS, min(len(out), (block + 1) * MOST_RAYS)
        ox = oy = oz = dx = dy = dz = rx = ry = rz = tau = nothing
        i, last, ahead = low, low, low
        while True:
            if going == 0 or (number_of(going) <= ENOUGH and coming < after):
                # Rays that have ended leave their depths, and others take their lanes.
                store(state, TAU * LANES, tau)
                store(steps, 0, i)
                for lane in range(LANES):
                    if going >> lane & 1:
                        continue
                    if owner[lane] >= 0:
                        out[owner[lane]], owner[lane] = state[TAU, lane], -1
                    while coming < after and owner[lane] < 0:
                        out[coming] = ZERO
                        if begin(origins, directions, extent, step, shift, coming, lane, state, steps):
                            owner[lane] = coming
                            going |= 1 << lane
                        coming += 1
                if going == 0:
                    break
                ox, oy, oz = load(state, 0), load(state, LANES), load(state, 2 * LANES)
                dx, dy, dz = load(state, 3 * LANES), load(state, 4 * LANES), load(state, 5 * LANES)
                rx, ry, rz = load(state, 6 * LANES), load(state, 7 * LANES), load(state, 8 * LANES)
                tau, i = load(state, TAU * LANES), load(steps, 0)
                last = select(mask_of(going), load(steps, LANES), splat(ENDED))
                ahead = load(steps, 2 * LANES) * (nx * ny * nz)
            t = (as_floats(i) + shift) * step
            x = within(ox + t * dx, nothing, end_x)
            y = within(oy + t * dy, nothing, end_y)
            z = within(oz + t * dz, nothing, end_z)
            cx, cy = minimum(truncated(x * cells), last_x), minimum(truncated(y * cells), last_y)
            cz = minimum(truncated(z * cells), last_z)
            empty = gather(distance, ahead + (cx * ny + cy) * nz + cz)
            occupied = (i <= last) & (empty == 0)
            i = i + 1
            if bits_of(occupied) != going:
                i = select(occupied, i, maximum(i, after_leap(
                    (as_floats(cx), as_floats(cy), as_floats(cz)), as_floats(empty), (ox, oy, oz), (dx, dy, dz),
                    (rx, ry, rz), side, rate, splat(shift),
                )))  # fmt: skip
            if bits_of(occupied) != 0:
                if slots.size > 0:
                    raw = values_in_bricks(x, y, z, scales[0], shapes[0], slots, bricks)
                else:
                    raw = values_of_table(x, y, z, shapes, scales, bases, index, table)
                tau = tau + select(occupied, exp(raw) * step, nothing)
                last = select(tau > stop, splat(ENDED), last)
            i = minimum(i, last + 1)
            going = bits_of(i <= last)


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def back_project(vertices, scale, rotations, positions, lenses, images, sums):  # type: ignore[no-untyped-def]
    """Write to ``sums``, for each vertex, the sum over views of what their images hold where the vertex is seen.

    ``vertices`` (V, 3), int32 and contiguous, are ``scale`` per box unit. Cameras have ``rotations`` to the box (N, 3,
    3), ``positions`` there (N, 3) and ``lenses`` (N, 4) (:func:`svv.kernels.numba.rays.pixel_rays`). ``images`` (N, H,
    W, 2) are interpolated bilinearly, and 0 beyond their frames. All but vertices are float32; ``sums`` (V, 2).
    """
    count, height, width = images.shape[:3]
    final, bottom, edge = np.int32(len(vertices) - 1), np.int32(height - 1), np.int32(width - 1)
    for block in prange((len(vertices) + MOST_RAYS - 1) // MOST_RAYS):
        found, end = np.empty((2, LANES), np.float32), min(len(vertices), (block + 1) * MOST_RAYS)
        for start in range(block * MOST_RAYS, end, LANES):
            at = minimum(lane_numbers() + np.int32(start), splat(final)) * 3
            x, y = as_floats(gather(vertices, at)) / scale, as_floats(gather(vertices, at + 1)) / scale
            z = as_floats(gather(vertices, at + 2)) / scale
            first = second = splat(ZERO)
            for n in range(count):
                m, zoom = rotations[n], splat(lenses[n, 0])
                dx, dy, dz = x - positions[n, 0], y - positions[n, 1], z - positions[n, 2]
                away = ZERO - (m[0, 2] * dx + m[1, 2] * dy + m[2, 2] * dz)
                ahead = away > ZERO
                if lenses[n, 3] <= ZERO:
                    zoom = zoom / select(ahead, away, splat(ONE))
                column = (m[0, 0] * dx + m[1, 0] * dy + m[2, 0] * dz) * zoom - lenses[n, 1]
                row = ZERO - (m[0, 1] * dx + m[1, 1] * dy + m[2, 1] * dz) * zoom - lenses[n, 2]
                top, upper, lower = _pixels(row, height)
                left, one, other = _pixels(column, width)
                if bits_of(ahead & (maximum(upper, lower) > ZERO) & (maximum(one, other) > ZERO)) == 0:
                    continue
                upper, lower = select(ahead, upper, splat(ZERO)), select(ahead, lower, splat(ZERO))
                below, right = minimum(top + 1, splat(bottom)), minimum(left + 1, splat(edge))
                top, below = maximum(top, splat(NONE)) * width, below * width
                left, view = maximum(left, splat(NONE)), 2 * n * height * width
                a, b = gather_pairs(images, (top + left) * 2, view), gather_pairs(images, (top + right) * 2, view)
                c, d = gather_pairs(images, (below + left) * 2, view), gather_pairs(images, (below + right) * 2, view)
                first = first + upper * (one * a[0] + other * b[0]) + lower * (one * c[0] + other * d[0])
                second = second + upper * (one * a[1] + other * b[1]) + lower * (one * c[1] + other * d[1])
            store(found, 0, first)
            store(found, LANES, second)
            for lane in range(min(LANES, end - start)):
                sums[start + lane, 0], sums[start + lane, 1] = found[0, lane], found[1, lane]


@njit(fastmath=FAST_MATH, inline="always")
def _pixels(place, count):  # type: ignore[no-untyped-def]
    """Return the pixels before places along an axis, from -1 on, and the weights of these and of the next ones.

    The weights of pixels beyond the ``count`` pixels of the frame are 0.
    """
    place = within(place, splat(-TWO), splat(np.float32(count + 1)))
    first = truncated(place)
    first = select(as_floats(first) > place, first - 1, first)
    part, last, nothing = place - as_floats(first), np.int32(count - 1), splat(ZERO)
    own = select((first >= 0) & (first <= last), ONE - part, nothing)
    following = select((first >= -1) & (first < last), part, nothing)
    return minimum(maximum(first, splat(BEFORE)), splat(last)), own, following
