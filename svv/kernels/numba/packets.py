"""Marching of rays through occupied cells, a packet of them at a time: each lane of a vector follows a ray of its own.

So a step's arithmetic is done for all rays of the packet at once, and the look-ups of all of them are on their way at
the same time, which counts most in training, where nearly every one leaves the caches. A thread follows several packets
in turn: the memory that all of them are about to read is asked for before the first of them waits for it. A ray leaps
through empty cells and ends by itself; a packet goes on until its last ray has ended. Whole rays of images have a march
of their own (:mod:`svv.kernels.numba.image_packets`).

Letters: R rays, (X, Y, Z) cells of the occupancy grid. All positions are box coordinates
(:mod:`svv.core.geometry.box`), all lengths are box units.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import (
    LANES,
    as_floats,
    ask_for_each,
    bits_of,
    exp,
    first_of,
    gather,
    gather_halves,
    gather_pairs,
    load,
    mask_of,
    maximum,
    minimum,
    number_of,
    ones_in_each,
    select,
    splat,
    store,
    truncated,
)
from svv.core.rays.marching import LEAST_DEPTH
from svv.kernels.numba.bricks import MASK, PLANE, SHIFT, SIDE, VERTICES
from svv.kernels.numba.leaping import octant
from svv.kernels.numba.marching import clip_to_box, inverse, uniform
from svv.kernels.types import UNSURE as UNSURE_CELLS

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
NONE, BIT, ENDED = np.int32(0), np.int32(1), np.int32(-1)
UNSURE = np.int32(UNSURE_CELLS)
FAR, NEVER = np.float32(1e9), np.float32(1e30)
LEAST = np.float32(LEAST_DEPTH)

KEPT = 5
"""Numbers of a sample that is kept: its position, the optical depth skipped before it, and its extinction."""

SHIFTS, LEFT_OUT, TAU, FRONT, STOPS, MOST, AT, STATE = 9, 10, 11, 12, 13, 14, 15, 16
"""Rows of a packet's state behind the rays' starts, directions and their inverses, and how many rows there are: shift
of the samples, optical depth since the last kept sample and since the start of the ray, an upper bound of the
transmittance in front of the next sample, where the piece of the ray ends, and the largest optical depth of a step, and
where that is."""

PACKETS = 2
"""Packets that a thread follows in turn: .8 of the time of one; what more of them ask for no longer fits into the first
level of the cache."""

ALL = (1 << LANES) - 1
"""Bits of all lanes."""

ENOUGH = LANES - 2
"""Lanes with rays up to which waiting rays take the others: an exchange costs as much as half a step."""

LEAST_RAYS, MOST_RAYS = 64, 256
"""Rays in a block, which one thread marches; the samples of a block are written contiguously. With fewer, more lanes
are idle at its end; with more, the last block keeps other threads waiting."""


@njit(fastmath=FAST_MATH, inline="always")
def within(a, low, high):  # type: ignore[no-untyped-def]
    """Return numbers, or the nearest ones between two limits."""
    return minimum(maximum(a, low), high)


@njit(fastmath=FAST_MATH, inline="always")
def _cell(x, y, z, scale, shape):  # type: ignore[no-untyped-def]
    """Return the cells of positions along each axis, ``shape`` being the numbers of vertices, and the offsets in it."""
    fx, fy, fz = x * scale, y * scale, z * scale
    ix = minimum(truncated(fx), splat(np.int32(shape[0] - 2)))
    iy = minimum(truncated(fy), splat(np.int32(shape[1] - 2)))
    iz = minimum(truncated(fz), splat(np.int32(shape[2] - 2)))
    return ix, iy, iz, fx - as_floats(ix), fy - as_floats(iy), fz - as_floats(iz)


@njit(fastmath=FAST_MATH, inline="always")
def _between(a, b, c, d, wx, wy, wz):  # type: ignore[no-untyped-def]
    """Interpolate trilinearly between the pairs of neighbours in z at (0, 0), (0, 1), (1, 0) and (1, 1)."""
    ux, uy, uz = ONE - wx, ONE - wy, ONE - wz
    near = uy * (uz * a[0] + wz * a[1]) + wy * (uz * b[0] + wz * b[1])
    return ux * near + wx * (uy * (uz * c[0] + wz * c[1]) + wy * (uz * d[0] + wz * d[1]))


@njit(fastmath=FAST_MATH, inline="always")
def _in_brick(ix, iy, iz, slots):  # type: ignore[no-untyped-def]
    """Return where the values of cells' first corners are in bricks."""
    slot = gather(slots, ((ix >> SHIFT) * slots.shape[1] + (iy >> SHIFT)) * slots.shape[2] + (iz >> SHIFT))
    return slot * VERTICES + (ix & MASK) * PLANE + (iy & MASK) * SIDE + (iz & MASK)


@njit(fastmath=FAST_MATH, inline="always")
def _pair_as_floats(values, at, offset):  # type: ignore[no-untyped-def]
    """Return elements ``offset`` behind places, and those that follow them, as floats."""
    pair = gather_pairs(values, at, offset)
    return as_floats(pair[0]), as_floats(pair[1])


@njit(fastmath=FAST_MATH, inline="always")
def between_corners(ix, iy, iz, wx, wy, wz, slots, values):  # type: ignore[no-untyped-def]
    """Return the trilinear interpolations at offsets ``wx``, ``wy``, ``wz`` in cells, of values or codes in bricks."""
    at = _in_brick(ix, iy, iz, slots)
    a, b = _pair_as_floats(values, at, 0), _pair_as_floats(values, at, SIDE)
    c, d = _pair_as_floats(values, at, PLANE), _pair_as_floats(values, at, PLANE + SIDE)
    return _between(a, b, c, d, wx, wy, wz)


@njit(fastmath=FAST_MATH)
def values_in_bricks(x, y, z, scale, shape, slots, values):  # type: ignore[no-untyped-def]
    """Return the trilinear interpolations at positions in occupied cells; see :mod:`svv.kernels.numba.bricks`."""
    ix, iy, iz, wx, wy, wz = _cell(x, y, z, scale, shape)
    return between_corners(ix, iy, iz, wx, wy, wz, slots, values)


@njit(fastmath=FAST_MATH, inline="always")
def _rows_at(index, at, before, last):  # type: ignore[no-untyped-def]
    """Return the rows of vertices; see :func:`svv.kernels.numba.trilinear.row_at`."""
    stored, row = gather_halves(index, at)
    return minimum(row + ones_in_each(stored & before), last)


@njit(fastmath=FAST_MATH, inline="always")
def _pairs_at(table, index, at, before, last):  # type: ignore[no-untyped-def]
    """Return the values of vertices, and of their neighbours in z."""
    return gather_pairs(table, _rows_at(index, at, before, last), 0)


@njit(fastmath=FAST_MATH, inline="always")
def _words_at(ix, iy, iz, level, shapes, bases):  # type: ignore[no-untyped-def]
    """Return where the index has the words of cells' first corners, and how far those of the others in y and x are."""
    ny, words = shapes[level, 1], (shapes[level, 2] + 31) >> 5
    return (ix * ny + iy) * words + (iz >> 5) + bases[level], words, ny * words


@njit(fastmath=FAST_MATH)
def values_of_table(x, y, z, shapes, scales, bases, index, table):  # type: ignore[no-untyped-def]
    """Return the sums over levels of the trilinear interpolations of a one-channel table."""
    total, last = splat(ZERO), splat(np.int32(bases[shapes.shape[0]]))
    for level in range(shapes.shape[0]):
        ix, iy, iz, wx, wy, wz = _cell(x, y, z, scales[level], shapes[level])
        at, right, behind = _words_at(ix, iy, iz, level, shapes, bases)
        before = (splat(BIT) << (iz & 31)) - 1
        a, b = _pairs_at(table, index, at, before, last), _pairs_at(table, index, at + right, before, last)
        at = at + behind
        c, d = _pairs_at(table, index, at, before, last), _pairs_at(table, index, at + right, before, last)
        total = total + _between(a, b, c, d, wx, wy, wz)
    return total


@njit(fastmath=FAST_MATH)
def _ask_for_words(x, y, z, shapes, scales, bases, index):  # type: ignore[no-untyped-def]
    """Ask for the words of the index that :func:`values_of_table` reads."""
    for level in range(shapes.shape[0]):
        ix, iy, iz, _, _, _ = _cell(x, y, z, scales[level], shapes[level])
        at, right, behind = _words_at(ix, iy, iz, level, shapes, bases)
        for corner in (0, right, behind, behind + right):
            ask_for_each(index, at, corner)


@njit(fastmath=FAST_MATH)
def _ask_for_rows(x, y, z, shapes, scales, bases, index, table):  # type: ignore[no-untyped-def]
    """Ask for the rows of the table that :func:`values_of_table` reads."""
    last = splat(np.int32(bases[shapes.shape[0]]))
    for level in range(shapes.shape[0]):
        ix, iy, iz, _, _, _ = _cell(x, y, z, scales[level], shapes[level])
        at, right, behind = _words_at(ix, iy, iz, level, shapes, bases)
        before = (splat(BIT) << (iz & 31)) - 1
        for corner in (0, right, behind, behind + right):
            ask_for_each(table, _rows_at(index, at + corner, before, last), 0)


@njit(fastmath=FAST_MATH)
def _ask_for_brick(x, y, z, scale, shape, slots, values):  # type: ignore[no-untyped-def]
    """Ask for the values that :func:`values_in_bricks` reads."""
    ix, iy, iz, _, _, _ = _cell(x, y, z, scale, shape)
    at = _in_brick(ix, iy, iz, slots)
    for corner in (0, SIDE, PLANE, PLANE + SIDE):
        ask_for_each(values, at, corner)


@njit(fastmath=FAST_MATH, inline="always")
def _grid_cell(x, y, z, cells, shape):  # type: ignore[no-untyped-def]
    """Return the cells of the occupancy grid in which positions lie, along each axis, or the nearest ones."""
    low = splat(NONE)
    cx = within(truncated(x * cells), low, splat(np.int32(shape[1] - 1)))
    cy = within(truncated(y * cells), low, splat(np.int32(shape[2] - 1)))
    cz = within(truncated(z * cells), low, splat(np.int32(shape[3] - 1)))
    return cx, cy, cz


@njit(fastmath=FAST_MATH, inline="always")
def _inside(x, y, z, extent):  # type: ignore[no-untyped-def]
    """Return positions in the box, or the nearest ones."""
    low = splat(ZERO)
    return within(x, low, splat(extent[0])), within(y, low, splat(extent[1])), within(z, low, splat(extent[2]))


@njit(fastmath=FAST_MATH, inline="always")
def _coming(state, steps, step):  # type: ignore[no-untyped-def]
    """Return the positions of a packet's next step."""
    t = (as_floats(load(steps, 0)) + load(state, SHIFTS * LANES)) * step
    x = load(state, 0) + t * load(state, 3 * LANES)
    y = load(state, LANES) + t * load(state, 4 * LANES)
    return x, y, load(state, 2 * LANES) + t * load(state, 5 * LANES)


@njit(fastmath=FAST_MATH, inline="always")
def _leap(cell, empty, o, d, inverse_d, side):  # type: ignore[no-untyped-def]
    """Return where rays leave the slabs of ``empty`` cells that begin with their cells, along one axis."""
    wall = select(d > ZERO, cell + empty, cell + ONE - empty) * side
    return select(inverse_d == ZERO, splat(NEVER), (wall - o) * inverse_d)


@njit(fastmath=FAST_MATH, inline="always")
def after_leap(cell, empty, o, d, inverse_d, side, rate, shifts):  # type: ignore[no-untyped-def]
    """Return the first samples of rays behind the cubes of ``empty`` cells that begin with their cells."""
    tx = _leap(cell[0], empty, o[0], d[0], inverse_d[0], side)
    ty = _leap(cell[1], empty, o[1], d[1], inverse_d[1], side)
    leaves = minimum(tx, minimum(ty, _leap(cell[2], empty, o[2], d[2], inverse_d[2], side)))
    leaves = minimum(leaves * rate - shifts, splat(FAR))
    whole = truncated(leaves)
    return select(as_floats(whole) < leaves, whole + 1, whole)


@njit(fastmath=FAST_MATH)
def begin(origins, directions, extent, step, shift, r, lane, state, steps):  # type: ignore[no-untyped-def]
    """Write the state at the start of a ray into a lane; returns whether there are steps to take."""
    near, far = clip_to_box(origins, directions, r, extent)
    if near >= far:
        return False
    for k in range(3):
        state[k, lane], state[3 + k, lane] = origins[r, k], directions[r, k]
        state[6 + k, lane] = inverse(directions[r, k])
    state[SHIFTS, lane], state[LEFT_OUT, lane], state[TAU, lane], state[FRONT, lane] = shift, ZERO, ZERO, ONE
    state[MOST, lane] = ZERO
    steps[0, lane], steps[1, lane] = math.ceil(near / step - shift), math.floor(far / step - shift)
    steps[2, lane] = octant(directions[r, 0], directions[r, 1], directions[r, 2])
    return steps[0, lane] <= steps[1, lane]


@njit(fastmath=FAST_MATH)
def begin_piece(origins, directions, extent, step, begins, ends, r, piece, lane, state, steps):  # type: ignore[no-untyped-def]
    """Write the start of a ray's next piece into a lane, from number ``piece`` on; returns the number behind it, or 0.

    Samples are whole steps apart, the first one half a step behind the start of the piece.
    """
    near, far = clip_to_box(origins, directions, r, extent)
    for k in range(piece, begins.shape[1] if near < far else 0):
        low, high = begins[r, k], ends[r, k]
        if not (high > low and low < far and high > near):
            continue
        whole = math.floor(low / step)
        shift = low / step - np.float32(whole) + HALF
        first, last = max(whole, math.ceil(near / step - shift)), math.floor(far / step - shift)
        if high < far:
            last = min(last, math.ceil(high / step - shift + HALF) - 1)
        if first > last:
            continue
        for axis in range(3):
            state[axis, lane], state[3 + axis, lane] = origins[r, axis], directions[r, axis]
            state[6 + axis, lane] = inverse(directions[r, axis])
        state[SHIFTS, lane], state[STOPS, lane] = shift, min(high, FAR)
        steps[0, lane], steps[1, lane] = first, last
        steps[2, lane] = octant(directions[r, 0], directions[r, 1], directions[r, 2])
        return k + 1
    return 0


@njit(fastmath=FAST_MATH)
def _go_on(  # type: ignore[no-untyped-def]
    ended, origins, directions, extent, step, begins, ends, most, owner, piece, state, steps
):
    """Begin the next pieces of rays whose optical depth is at most ``most``; returns the lanes of these, as bits."""
    onward = 0
    while ended != 0:
        lane = first_of(ended)
        ended &= ended - 1
        if owner[lane] >= 0 and not state[TAU, lane] > most:
            piece[lane] = begin_piece(
                origins, directions, extent, step, begins, ends, owner[lane], piece[lane], lane, state, steps
            )
            if piece[lane] > 0:
                onward |= 1 << lane
    return onward


@njit(fastmath=FAST_MATH)
def _hand_over(  # type: ignore[no-untyped-def]
    ended, n, end, step, extent, merge, owner, number, kept, state, position, skipped, sigma, ray, start, count, tail
):
    """Write the samples of rays that have ended from row ``n`` on; returns the next row, beyond ``end`` if one is.

    With ``merge``, a ray that has kept none has a single one, where it has most optical depth.
    """
    while ended != 0:
        lane = first_of(ended)
        ended &= ended - 1
        r = owner[lane]
        if r < 0:
            continue
        if merge and number[lane] == 0 and state[LEFT_OUT, lane] > LEAST:
            for axis in range(3):
                at = state[axis, lane] + state[AT, lane] * state[3 + axis, lane]
                kept[lane, 0, axis] = min(max(at, ZERO), extent[axis])
            kept[lane, 0, 3], kept[lane, 0, 4], number[lane] = ZERO, state[LEFT_OUT, lane] / step, 1
            state[LEFT_OUT, lane] = ZERO
        start[r], count[r], tail[r] = n, number[lane], state[LEFT_OUT, lane]
        if n + number[lane] > end:
            return end + 1
        for k in range(number[lane]):
            for axis in range(3):
                position[n, axis] = kept[lane, k, axis]
            skipped[n], sigma[n], ray[n] = kept[lane, k, 3], kept[lane, k, 4], r
            n += 1
        owner[lane], number[lane] = -1, 0
    return n


@njit(fastmath=FAST_MATH)
def _drawn(among, steps, seed, first_ray, owner, keep):  # type: ignore[no-untyped-def]
    """Return the lanes, as bits, whose samples are kept by chance, of those that are set in ``among``."""
    drawn = 0
    while among != 0:
        lane = first_of(among)
        among &= among - 1
        if uniform(seed, first_ray + owner[lane], steps[0, lane] + 1) < keep:
            drawn |= 1 << lane
    return drawn


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def march(  # type: ignore[no-untyped-def]  # long: one loop, whose state is registers
    origins, directions, distance, cells, extent, step, seed, first_ray, shapes, scales, bases, index, table, slots,
    bricks, low, level, ceiling, least_weight, keep, stop, fade, merge, begins, ends, marked, position, skipped, sigma,
    ray, start, count, tail, full, rays_a_block,
):  # fmt: skip
    """March rays through the occupied cells and keep the samples that matter.

    ``distance`` (8, X, Y, Z) tells how far a ray may leap, 0 for occupied cells (:func:`svv.core.rays.cells.leaps`).
    Every ray is sampled with a fixed step (shifted by a random fraction of it if ``seed`` > 0, by half a step
    otherwise; ``first_ray`` is the number of the first ray in its batch, for its random numbers). A sample whose weight
    is below ``least_weight`` is kept only with probability ``keep``; the optical
    depth of samples left out is accumulated in ``skipped`` of the next kept one (or ``tail`` of the ray), so that
    transmittance stays exact. With ``merge``, it becomes part of the next sample instead, as soon as both together
    weigh enough: there are few samples, and no part of the pixel is lost. A ray that would keep none has one sample of
    all its optical depth where most of that is, if it exceeds :data:`svv.core.rays.marching.LEAST_DEPTH`. Optical depth
    is multiplied by ``fade`` when it dims a sample and when it ends a ray (above ``stop``), because extinctions may be
    scaled later by factors of ``fade`` or more. With 0, no ray ends.

    With ``begins`` and ``ends`` (R, M), only these pieces of rays are marched; a sample across the end of one stands
    for what it covers of the piece, in the middle of that. If ``marked``, optical depth in occupied cells whose
    ``distance`` is :data:`svv.kernels.types.UNSURE` neither dims nor ends a ray.

    Where there are bricks (:mod:`svv.kernels.numba.bricks`), they have the values of ``table``: ``low`` plus
    ``level`` times what is in them.

    A thread marches ``rays_a_block`` rays. The samples of block k are written from ``k * capacity`` on, where capacity
    is ``len(sigma) // blocks``. A block that needs more room marks itself in ``full`` (blocks,) and stops.
    """
    blocks = len(full)
    capacity, longest = sigma.shape[0] // blocks, int(math.ceil(math.sqrt(3.0) / step)) + 2
    side, rate = ONE / cells, ONE / step
    ny, nz = distance.shape[2:]
    octants = distance.shape[1] * ny * nz
    divided, most = begins.shape[1] > 0, stop / fade if fade > 0 else NEVER
    nothing = splat(ZERO)
    for block in prange(blocks):
        states, every_steps = np.zeros((PACKETS, STATE, LANES), np.float32), np.zeros((PACKETS, 3, LANES), np.int32)
        found, kept_of = np.empty((KEPT, LANES), np.float32), np.empty((PACKETS, LANES, longest, KEPT), np.float32)
        owners, numbers = np.full((PACKETS, LANES), -1, np.int64), np.zeros((PACKETS, LANES), np.int64)
        pieces, lanes_going = np.zeros((PACKETS, LANES), np.int64), np.zeros(PACKETS, np.int64)
        n, end = block * capacity, (block + 1) * capacity
        coming, after = block * rays_a_block, min(len(origins), (block + 1) * rays_a_block)
        while True:
            any_going = 0
            for packet in range(PACKETS):
                state, steps, going = states[packet], every_steps[packet], lanes_going[packet]
                if going == 0 or (number_of(going) <= ENOUGH and coming < after):
                    # Rays that have ended hand over their samples, and others take their lanes.
                    owner, number, piece = owners[packet], numbers[packet], pieces[packet]
                    ended = ALL & ~going
                    if divided:
                        onward = _go_on(
                            ended, origins, directions, extent, step, begins, ends, most, owner, piece, state, steps
                        )
                        going |= onward
                        ended &= ~onward
                    n = _hand_over(
                        ended, n, end, step, extent, merge, owner, number, kept_of[packet], state, position, skipped,
                        sigma, ray, start, count, tail,
                    )  # fmt: skip
                    if n > end:
                        break
                    while coming < after and ended != 0:
                        shift = uniform(seed, first_ray + coming, 0) if seed > 0 else HALF
                        lane = first_of(ended)
                        start[coming], count[coming], tail[coming] = n, 0, ZERO
                        if divided:
                            state[LEFT_OUT, lane], state[TAU, lane], state[FRONT, lane] = ZERO, ZERO, ONE
                            state[MOST, lane] = ZERO
                            piece[lane] = begin_piece(
                                origins, directions, extent, step, begins, ends, coming, 0, lane, state, steps
                            )
                            begun = piece[lane] > 0
                        else:
                            begun = begin(origins, directions, extent, step, shift, coming, lane, state, steps)
                        if begun:
                            owner[lane] = coming
                            going |= 1 << lane
                            ended &= ended - 1
                        coming += 1
                    store(steps, LANES, select(mask_of(going), load(steps, LANES), splat(ENDED)))
                    lanes_going[packet] = going
                any_going |= going
                if going != 0:
                    x, y, z = _coming(state, steps, step)
                    cx, cy, cz = _grid_cell(x, y, z, cells, distance.shape)
                    ask_for_each(distance, load(steps, 2 * LANES) * octants + (cx * ny + cy) * nz + cz, 0)
                    x, y, z = _inside(x, y, z, extent)
                    if slots.size > 0:
                        _ask_for_brick(x, y, z, scales[0], shapes[0], slots, bricks)
                    else:
                        _ask_for_words(x, y, z, shapes, scales, bases, index)
            full[block] = n > end
            if any_going == 0 or n > end:
                break
            for packet in range(0 if slots.size > 0 else PACKETS):
                x, y, z = _coming(states[packet], every_steps[packet], step)
                x, y, z = _inside(x, y, z, extent)
                _ask_for_rows(x, y, z, shapes, scales, bases, index, table)
            for packet in range(PACKETS):
                going = lanes_going[packet]
                if going == 0:
                    continue
                state, steps = states[packet], every_steps[packet]
                ox, oy, oz = load(state, 0), load(state, LANES), load(state, 2 * LANES)
                dx, dy, dz = load(state, 3 * LANES), load(state, 4 * LANES), load(state, 5 * LANES)
                rx, ry, rz = load(state, 6 * LANES), load(state, 7 * LANES), load(state, 8 * LANES)
                shifts, left_out = load(state, SHIFTS * LANES), load(state, LEFT_OUT * LANES)
                tau, front = load(state, TAU * LANES), load(state, FRONT * LANES)
                stops, ahead = load(state, STOPS * LANES), load(steps, 2 * LANES) * octants
                i, last = load(steps, 0), load(steps, LANES)
                now, t = i, (as_floats(i) + shifts) * step
                left = (stops - t) * rate + HALF
                if divided:
                    t = minimum(t, HALF * (t - HALF * step + stops))
                x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
                cx, cy, cz = _grid_cell(x, y, z, cells, distance.shape)
                empty = gather(distance, ahead + (cx * ny + cy) * nz + cz)
                sure = empty == 0
                occupied = (i <= last) & (sure | (empty == UNSURE) if marked else sure)
                i = i + 1
                if bits_of(occupied) != going:
                    cell, origin = (as_floats(cx), as_floats(cy), as_floats(cz)), (ox, oy, oz)
                    following = after_leap(
                        cell, as_floats(empty), origin, (dx, dy, dz), (rx, ry, rz), side, rate, shifts
                    )
                    i = select(occupied, i, maximum(i, following))
                if bits_of(occupied) != 0:
                    x, y, z = _inside(x, y, z, extent)
                    if slots.size > 0:
                        raw = low + level * values_in_bricks(x, y, z, scales[0], shapes[0], slots, bricks)
                    else:
                        raw = values_of_table(x, y, z, shapes, scales, bases, index, table)
                    s = exp(minimum(raw, splat(ceiling)))
                    if divided:
                        s = s * minimum(left, splat(ONE))
                    thickness = select(occupied, s * step, nothing)
                    if merge:
                        most_of = load(state, MOST * LANES)
                        heavier = thickness > most_of
                        store(state, MOST * LANES, select(heavier, thickness, most_of))
                        store(state, AT * LANES, select(heavier, t, load(state, AT * LANES)))
                    before = left_out if merge else nothing
                    weight = (thickness + before) * front  # an upper bound, which saves most exponentials
                    heavy = occupied & (weight >= least_weight)
                    if bits_of(heavy) != 0:
                        seen = minimum(before - tau, nothing) if marked else before - tau
                        front = select(heavy, exp(seen * fade), front)
                        weight = front * (ONE - exp(ZERO - thickness - before))
                        heavy = heavy & (weight >= least_weight)
                    taken = bits_of(heavy)
                    if keep > 0:
                        store(steps, 0, now)
                        taken |= _drawn(bits_of(occupied) & ~taken, steps, seed, first_ray, owners[packet], keep)
                    behind = left_out + thickness
                    if taken != 0:
                        store(found, 0, x)
                        store(found, LANES, y)
                        store(found, 2 * LANES, z)
                        store(found, 3 * LANES, left_out - before)
                        store(found, 4 * LANES, s + before * rate)
                        behind = select(mask_of(taken), nothing, behind)
                    number, kept = numbers[packet], kept_of[packet]
                    while taken != 0:
                        lane = first_of(taken)
                        taken &= taken - 1
                        for k in range(KEPT):
                            kept[lane, number[lane], k] = found[k, lane]
                        number[lane] += 1
                    left_out = behind
                    if marked:
                        thickness = select(sure, thickness, nothing)
                    tau = tau + thickness
                    last = select(tau * fade > stop, splat(ENDED), last)
                i = minimum(i, last + 1)
                going = bits_of(i <= last)
                store(state, LEFT_OUT * LANES, left_out)
                store(state, TAU * LANES, tau)
                store(state, FRONT * LANES, front)
                store(steps, 0, i)
                store(steps, LANES, last)
                lanes_going[packet] = going
