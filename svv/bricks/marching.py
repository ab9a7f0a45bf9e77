"""Marching of rays through bricks (:mod:`svv.bricks.filling`): a packet of them at a time, a ray in each lane.

Positions are in voxels of the level, (x, y, z).
"""

from __future__ import annotations

import math

import numpy as np

from svv.bricks.filling import BLANK, BLOCK, BLOCKS, BRICK, PART, SIDE
from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import (
    LANES,
    as_floats,
    bits_of,
    first_of,
    gather,
    gather_pairs,
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

UNKNOWN, EMPTY = -1, -2
"""Entries of the table of bricks that have no slot: not in memory, or without anything visible."""

SPENT = np.float32(1.0 / 128.0)
"""Transmittance at which a ray ends, as in VTK's ray caster (255 / 32767)."""

TO_BRICK, TO_BLOCK, TO_PART, CELLS = 5, 3, 2, BRICK - 1
"""Shifts from a cell's number to those of its brick, block and eighth, and a mask of its number within the brick."""

ZERO, HALF = np.float32(0.0), np.float32(0.5)
FAR, NEVER = np.float32(1e9), np.float32(1e30)
ENDED, ALL, ENOUGH = np.int32(-1), (1 << LANES) - 1, LANES - 2
"""Last sample of a ray that has ended; bits of all lanes; lanes with rays up to which waiting rays take the others."""


@njit(nogil=True, fastmath=FAST_MATH, inline="always")
def _within(a, low, high):  # type: ignore[no-untyped-def]
    """Return whole numbers, or the nearest ones between two limits."""
    return minimum(maximum(a, splat(np.int32(low))), splat(np.int32(high)))


@njit(nogil=True, fastmath=FAST_MATH, inline="always")
def _between(near, far, wx, wy):  # type: ignore[no-untyped-def]
    """Interpolate bilinearly between pairs of neighbours in x."""
    a, b = as_floats(near[0]), as_floats(far[0])
    low, high = a + wx * (as_floats(near[1]) - a), b + wx * (as_floats(far[1]) - b)
    return low + wy * (high - low)


@njit(nogil=True, fastmath=FAST_MATH, inline="always")
def _inside(pairs, wx, wy, wz):  # type: ignore[no-untyped-def]
    """Interpolate trilinearly between the pairs of neighbours in x of a cell's four rows."""
    near = _between(pairs[0], pairs[1], wx, wy)
    return near + wz * (_between(pairs[2], pairs[3], wx, wy) - near)


@njit(nogil=True, fastmath=FAST_MATH, inline="always")
def _rows(array, at):  # type: ignore[no-untyped-def]
    """Return what the voxels of a cell hold, as four pairs; ``at`` is the place of the first."""
    above = SIDE * SIDE
    return (
        gather_pairs(array, at, 0), gather_pairs(array, at, SIDE),
        gather_pairs(array, at, above), gather_pairs(array, at, above + SIDE),
    )  # fmt: skip


@njit(nogil=True, fastmath=FAST_MATH, inline="always")
def _shade(rows, shades, wx, wy, wz):  # type: ignore[no-untyped-def]
    """Interpolate the shades of the codes of a cell's voxels."""
    a, b, c, d = rows
    return _inside(
        (
            (gather(shades, a[0] * 2), gather(shades, a[1] * 2)), (gather(shades, b[0] * 2), gather(shades, b[1] * 2)),
            (gather(shades, c[0] * 2), gather(shades, c[1] * 2)), (gather(shades, d[0] * 2), gather(shades, d[1] * 2)),
        ), wx, wy, wz,
    )  # fmt: skip


@njit(nogil=True, fastmath=FAST_MATH, inline="always")
def _both(shades, codes):  # type: ignore[no-untyped-def]
    """Return the shades of a pair of codes, and their highlights."""
    one, other = gather_pairs(shades, codes[0] * 2, 0), gather_pairs(shades, codes[1] * 2, 0)
    return (one[0], other[0]), (one[1], other[1])


@njit(nogil=True, fastmath=FAST_MATH)
def _shade_glossy(rows, shades, wx, wy, wz):  # type: ignore[no-untyped-def]
    """Interpolate the shades of the codes of a cell's voxels, and their highlights."""
    a, b, c, d = _both(shades, rows[0]), _both(shades, rows[1]), _both(shades, rows[2]), _both(shades, rows[3])
    return _inside((a[0], b[0], c[0], d[0]), wx, wy, wz), _inside((a[1], b[1], c[1], d[1]), wx, wy, wz)


@njit(nogil=True, fastmath=FAST_MATH)
def _not_blanked(codes, at, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether the voxels nearest to samples, and those next to them along each axis, are not blanked.

    ``at`` is the first voxel of their cells; ``x``, ``y``, ``z`` are 1 where the second along an axis is the nearest.
    """
    voxel = at + (z * SIDE + y) * SIDE + x
    flags = gather(codes, voxel) | gather(codes, voxel + 1 - 2 * x)
    flags = flags | gather(codes, voxel + (1 - 2 * y) * SIDE) | gather(codes, voxel + (1 - 2 * z) * (SIDE * SIDE))
    return (flags & BLANK) == 0


@njit(nogil=True, fastmath=FAST_MATH, inline="always")
def _steps_to(low, size, start, inverse):  # type: ignore[no-untyped-def]
    """Return after how many steps rays leave boxes, with where they start and steps a voxel, along one axis."""
    wall = as_floats(select(inverse > ZERO, low + size, low))
    return select(inverse == ZERO, splat(NEVER), (wall - start) * inverse)


@njit(nogil=True, fastmath=FAST_MATH, cache=True, inline="always")
def _ray(u, v, frame, pixel):  # type: ignore[no-untyped-def]
    """Return the start and direction of the ray through a place in the image; see :func:`march`."""
    ox, oy, oz = frame[0, 0], frame[0, 1], frame[0, 2]
    dx, dy, dz = frame[1, 0], frame[1, 1], frame[1, 2]
    ax, ay = u * frame[2, 0] + v * frame[3, 0], u * frame[2, 1] + v * frame[3, 1]
    az = u * frame[2, 2] + v * frame[3, 2]
    if pixel == 0.0:
        return ox + ax, oy + ay, oz + az, dx, dy, dz
    length = math.sqrt(1.0 + (u * u + v * v) * pixel * pixel)
    return ox, oy, oz, (dx + ax) / length, (dy + ay) / length, (dz + az) / length


@njit(nogil=True, fastmath=FAST_MATH, cache=True, inline="always")
def _clipped(o, d, low, high, near, far):  # type: ignore[no-untyped-def]
    """Return the part of a ray from ``near`` to ``far`` that lies in a slab; the first is larger if none does."""
    if abs(d) < 1e-12:
        return (near, far) if low <= o <= high else (1.0, -1.0)
    a, b = (low - o) / d, (high - o) / d
    return max(near, min(a, b)), min(far, max(a, b))


@njit(nogil=True, fastmath=FAST_MATH)
def _shine(count, places, weights, pixels, light, codes, table, shades, glossy, state):  # type: ignore[no-untyped-def]
    """Add the light of samples to the first columns of their pixels' ``state``.

    ``places`` (2, LANES) holds the samples' first voxels and entries of the table, ``weights`` (4, LANES) their weights
    and their offsets from the voxels. Samples of several rays wait for each other, because few of those that are taken
    at the same time show anything, and light is what takes longest.
    """
    rows, entry = _rows(codes, load(places, 0)), load(places, LANES)
    weight, wx, wy, wz = (load(weights, 0), load(weights, LANES), load(weights, 2 * LANES), load(weights, 3 * LANES))
    if glossy:
        lit, shine = _shade_glossy(rows, shades, wx, wy, wz)
    else:
        lit, shine = _shade(rows, shades, wx, wy, wz), splat(ZERO)
    warm, cold = gather_pairs(table, entry * 4, 0), gather_pairs(table, entry * 4, 2)
    store(light, 0, weight * (warm[0] * lit + shine))
    store(light, LANES, weight * (warm[1] * lit + shine))
    store(light, 2 * LANES, weight * (cold[0] * lit + shine))
    for k in range(count):
        for c in range(3):
            state[pixels[k], c] += light[c, k]


@njit(nogil=True, fastmath=FAST_MATH)
def _begin(number, width, frame, corner, pixel, lengths, bounds, step, done, lane, ray, steps):  # type: ignore[no-untyped-def]
    """Write a ray into a lane: its first sample and what a step is, and the numbers of its samples.

    The first sample is that at the bounds, even if ``done`` samples have been taken: an image must not depend on where
    a ray had to wait. Returns whether there are samples to take.
    """
    u, v = corner[0] + number % width, corner[1] + number // width
    ox, oy, oz, dx, dy, dz = _ray(u, v, frame, pixel)
    if lengths[0] > 0.0:
        length = math.sqrt((dx * lengths[0]) ** 2 + (dy * lengths[1]) ** 2 + (dz * lengths[2]) ** 2)
        dx, dy, dz = dx / length, dy / length, dz / length
    near, far = 0.0, 1e30
    for axis, o, d in ((0, ox, dx), (1, oy, dy), (2, oz, dz)):
        near, far = _clipped(o, d, bounds[0, axis], bounds[1, axis], near, far)
    first, last = int(math.ceil(near / step - 0.5)), int(math.floor(far / step - 0.5))
    if max(done, first) > last:
        return False
    for axis, o, d in ((0, ox, dx), (1, oy, dy), (2, oz, dz)):
        ray[axis, lane], ray[3 + axis, lane] = o + (first + 0.5) * step * d, step * d
        ray[6 + axis, lane] = 1.0 / (step * d) if abs(d) > 1e-12 else 0.0
    steps[0, lane], steps[1, lane], steps[2, lane] = first, max(done - first, 0), last - first
    return True


@njit(nogil=True, fastmath=FAST_MATH, cache=True)
def march(  # type: ignore[no-untyped-def]  # long: one loop, whose state is registers
    rays, width, frame, corner, pixel, lengths, bounds, step, slots, stamps, now, seen, values, codes, table, alphas,
    low, gain, first, shades, glossy, blanks, nearest, state, samples, wanted,
):  # fmt: skip
    """March rays until they end or reach a brick that is not in memory, each in a lane of its own.

    A ray takes samples at (k + 0.5) ``step`` from the camera, k = 0, 1, ... Values, and the light at the 8 voxels
    around, are interpolated trilinearly, and colours and opacities looked up for the interpolated value, as in VTK's
    ray casters.

    Args:
        rays: Numbers of the pixels. (R,)
        width: Width of the image in pixels.
        frame: The camera's position; and its view direction, step to the next column and step to the next row, each in
            voxels for a distance of 1 along the axis, in a unit of about a voxel. (4, 3)
        corner: Centre of the first pixel relative to the camera's axis, in pixels: column and row. (2,)
        pixel: Side of a pixel at a distance of 1; 0 for parallel rays, for which the steps in ``frame`` are a pixel's.
        lengths: Size of a voxel by which a ray's length is measured; 0: as in the world. (3,)
        bounds: Positions between which anything is visible. (2, 3)
        step: Sample distance, in that unit, or that of ``lengths``.
        slots: Slot of each brick, or UNKNOWN or EMPTY. (bz, by, bx)
        stamps: Time at which a slot was last used. (slots,)
        now: The present time.
        seen: Which eighths of the blocks are visible. (slots, BLOCKS, BLOCKS, BLOCKS)
        values: Voxels. (slots, VOXELS)
        codes: Codes of normals. (slots, VOXELS)
        table: RGB of evenly spaced values; the fourth column is not used. (N, 4)
        alphas: Opacity of one sample of these values. (N,)
        low: A value near the first one of the table.
        gain: Entries of the table per unit of the value.
        first: Place of ``low`` in the table, in entries, and a half, for rounding.
        shades: Factor of the colour, and highlight, of each code. (CODES ** 2 + 1, 2)
        glossy: Whether there are highlights.
        blanks: Whether codes may have the flag BLANK; there are shades for those, too.
        nearest: Whether samples have the value and the normal of the nearest voxel.
        state: Light so far (RGB times opacity) and transmittance of each pixel. (pixels, 4)
        samples: Number of each pixel's next sample. (pixels,)
        wanted: Receives the flat index of the brick that a ray needs, or -1 if it has ended. (R,)
    """
    bricks_z, bricks_y, bricks_x = slots.shape
    entries = len(table) - 1
    ray, light = np.zeros((9, LANES), np.float32), np.ones(LANES, np.float32)
    steps, number_in = np.zeros((3, LANES), np.int32), np.zeros(LANES, np.int32)
    now_at, places = np.zeros((2, LANES), np.int32), np.zeros((2, LANES), np.int32)
    now_weights, weights = np.zeros((4, LANES), np.float32), np.zeros((4, LANES), np.float32)
    pixel_of, owner = np.zeros(LANES, np.int64), np.full(LANES, -1, np.int64)
    lights = np.zeros((3, LANES), np.float32)
    coming, going, queued = 0, 0, 0
    nothing, none = splat(ZERO), splat(np.int32(0))
    x0 = y0 = z0 = sx = sy = sz = rx = ry = rz = through = nothing
    k, last, held = none, none, splat(ENDED)
    while True:
        if going == 0 or (number_of(going) <= ENOUGH and coming < len(rays)):
            # Rays that have ended hand over their light, and others take their lanes.
            store(light, 0, through)
            store(steps, LANES, k)
            ended = ALL & ~going
            while ended != 0:
                lane = first_of(ended)
                ended &= ended - 1
                if owner[lane] >= 0:
                    number = rays[owner[lane]]
                    state[number, 3] = light[lane]
                    samples[number] = steps[0, lane] + steps[1, lane]
                    owner[lane] = -1
                while coming < len(rays) and owner[lane] < 0:
                    number = rays[coming]
                    wanted[coming] = -1
                    if _begin(
                        number, width, frame, corner, pixel, lengths, bounds, step, samples[number], lane, ray, steps
                    ):
                        owner[lane] = coming
                        going |= 1 << lane
                        light[lane] = state[number, 3]
                    coming += 1
            if going == 0:
                break
            x0, y0, z0 = load(ray, 0), load(ray, LANES), load(ray, 2 * LANES)
            sx, sy, sz = load(ray, 3 * LANES), load(ray, 4 * LANES), load(ray, 5 * LANES)
            rx, ry, rz = load(ray, 6 * LANES), load(ray, 7 * LANES), load(ray, 8 * LANES)
            through = load(light, 0)
            k, last = load(steps, LANES), select(mask_of(going), load(steps, 2 * LANES), splat(ENDED))
        t = as_floats(k)
        x, y, z = x0 + t * sx, y0 + t * sy, z0 + t * sz
        # The cell, its brick, the block and the eighth of the block.
        i = _within(truncated(x), 0, bricks_x * BRICK - 1)
        j = _within(truncated(y), 0, bricks_y * BRICK - 1)
        h = _within(truncated(z), 0, bricks_z * BRICK - 1)
        place = ((h >> TO_BRICK) * bricks_y + (j >> TO_BRICK)) * bricks_x + (i >> TO_BRICK)
        slot = gather(slots, place)
        there = k <= last
        unknown = bits_of(there & (slot == UNKNOWN))
        if unknown != 0:
            store(number_in, 0, place)
            last = select(slot == UNKNOWN, splat(ENDED), last)
            there = k <= last
            going = bits_of(there)
            while unknown != 0:
                lane = first_of(unknown)
                unknown &= unknown - 1
                wanted[owner[lane]] = number_in[lane]
            continue
        moved = bits_of(there & (slot >= 0) & ((slot < held) | (slot > held)))
        if moved != 0:
            store(number_in, 0, slot)
            held = slot
            while moved != 0:
                lane = first_of(moved)
                moved &= moved - 1
                stamps[number_in[lane]] = now
        own = maximum(slot, none)
        at = ((own * BLOCKS + ((h & CELLS) >> TO_BLOCK)) * BLOCKS + ((j & CELLS) >> TO_BLOCK)) * BLOCKS
        block = select(slot >= 0, gather(seen, at + ((i & CELLS) >> TO_BLOCK)), none)
        eighth = (((h >> TO_PART) & 1) << 2) | (((j >> TO_PART) & 1) << 1) | ((i >> TO_PART) & 1)
        visible = there & (((block >> eighth) & 1) == 1)
        here, coming_next = bits_of(visible), k + 1
        if here != going:
            # Go to the first sample behind the largest of brick, block and eighth in which nothing is visible.
            wide = select(block == 0, splat(np.int32(BLOCK)), splat(np.int32(PART)))
            wide = select(slot < 0, splat(np.int32(BRICK)), wide)
            inner = none - wide
            leaves = _steps_to(i & inner, wide, x0, rx)
            leaves = minimum(leaves, _steps_to(j & inner, wide, y0, ry))
            leaves = minimum(minimum(leaves, _steps_to(h & inner, wide, z0, rz)), splat(FAR))
            coming_next = select(visible, coming_next, maximum(coming_next, truncated(leaves) + 1))
        if here != 0:
            wx, wy, wz = x - as_floats(i), y - as_floats(j), z - as_floats(h)
            at = ((own * SIDE + (h & CELLS)) * SIDE + (j & CELLS)) * SIDE + (i & CELLS)
            if blanks or nearest:
                half, one = splat(HALF), splat(np.int32(1))
                nx, ny, nz = select(wx < half, none, one), select(wy < half, none, one), select(wz < half, none, one)
                if blanks:
                    visible = visible & _not_blanked(codes, at, nx, ny, nz)
                if nearest:
                    wx, wy, wz = as_floats(nx), as_floats(ny), as_floats(nz)
            value = (_inside(_rows(values, at), wx, wy, wz) - low) * gain + first
            entry = truncated(minimum(maximum(value, nothing), splat(np.float32(entries))))
            alpha = gather(alphas, entry)
            visible = visible & (alpha > ZERO)
            weight = through * alpha
            shown = bits_of(visible)
            if shown != 0:
                through = select(visible, through - weight, through)
                coming_next = select(through < SPENT, last + 1, coming_next)
                store(now_at, 0, at)
                store(now_at, LANES, entry)
                store(now_weights, 0, weight)
                store(now_weights, LANES, wx)
                store(now_weights, 2 * LANES, wy)
                store(now_weights, 3 * LANES, wz)
            while shown != 0:
                lane = first_of(shown)
                shown &= shown - 1
                for c in range(2):
                    places[c, queued] = now_at[c, lane]
                for c in range(4):
                    weights[c, queued] = now_weights[c, lane]
                pixel_of[queued] = rays[owner[lane]]
                queued += 1
                if queued == LANES:
                    _shine(queued, places, weights, pixel_of, lights, codes, table, shades, glossy, state)
                    queued = 0
        k = minimum(coming_next, maximum(last + 1, k))
        going = bits_of(k <= last)
    _shine(queued, places, weights, pixel_of, lights, codes, table, shades, glossy, state)
