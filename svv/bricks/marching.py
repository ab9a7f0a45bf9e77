"""The brick marcher's compiled loops: filling of bricks, and marching of rays through them.

Positions are in voxels of the level, (x, y, z); arrays of voxels are indexed [z, y, x]. A brick has :data:`BRICK`
cells and one more voxel along each side, so that each cell lies in exactly one brick. Blocks of :data:`BLOCK` cells
record whether anything is visible in them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from svv.core.fast_math import FAST_MATH

BRICK = 32
"""Cells along each side of a brick."""

BLOCK = 8
"""Cells along each side of a block of a brick."""

PART = BLOCK // 2
"""Cells along each side of an eighth of a block. Which of them show something is one bit each of a block's byte."""

SIDE = BRICK + 1
"""Voxels along each side of a brick."""

VOXELS = SIDE**3
"""Voxels of a brick."""

BLOCKS = BRICK // BLOCK
"""Blocks along each side of a brick."""

UNKNOWN, EMPTY = -1, -2
"""Entries of the table of bricks that have no slot: not in memory, or without anything visible."""

CODES = 128
"""Steps along each side of the square on which normals are encoded: with 128, they are at most 1.1 degrees off."""

BLANK = 1 << 15
"""Flag in the code of a normal: the voxel is blanked."""

SPENT = np.float32(1.0 / 128.0)
"""Transmittance at which a ray ends, as in VTK's ray caster (255 / 32767)."""


@njit(nogil=True, fastmath=FAST_MATH, cache=True, inline="always")
def encoded(gx, gy, gz):  # type: ignore[no-untyped-def]
    """Return the code of a gradient's axis, regardless of its sign; 0 for no gradient.

    The hemisphere is folded onto a square (Cigolle et al. 2014, hemi-oct).
    """
    if gz < 0.0:
        gx, gy, gz = -gx, -gy, -gz
    total = abs(gx) + abs(gy) + gz
    if total == 0.0:
        return 0
    across, up = (gx + gy) / total, (gx - gy) / total
    column = int((0.5 * across + 0.5) * (CODES - 1) + 0.5)
    row = int((0.5 * up + 0.5) * (CODES - 1) + 0.5)
    return 1 + row * CODES + column


def decoded() -> np.ndarray:
    """Return the unit vectors of all codes of :func:`encoded`; that of code 0 is zero. (CODES ** 2 + 1, 3)"""
    steps = np.linspace(-1.0, 1.0, CODES)
    across, up = np.meshgrid(steps, steps)  # (row, column)
    x, y = 0.5 * (across + up), 0.5 * (across - up)
    axis = np.stack([x, y, 1.0 - np.abs(x) - np.abs(y)], axis=-1).reshape(-1, 3)
    return np.concatenate([np.zeros((1, 3)), axis / np.linalg.norm(axis, axis=1, keepdims=True)])


@njit(nogil=True, cache=True)
def find_visible(box, first, ranges, seen):  # type: ignore[no-untyped-def]
    """Record which eighths of the blocks of a brick contain a value to be seen; returns whether any does.

    Args:
        box: Voxels of the brick and around it. (z, y, x)
        first: Index in ``box`` of the brick's first voxel. (3,)
        ranges: Intervals of values that are visible. (R, 2)
        seen: Receives a bit for each visible eighth of a block, the lowest for the first along all axes, then along x,
            y, z. (BLOCKS, BLOCKS, BLOCKS)
    """
    found = False
    seen[:] = 0
    for bz in range(2 * BLOCKS):
        z0 = first[0] + bz * PART
        z1 = min(z0 + PART + 1, box.shape[0])
        for by in range(2 * BLOCKS):
            y0 = first[1] + by * PART
            y1 = min(y0 + PART + 1, box.shape[1])
            for bx in range(2 * BLOCKS):
                x0 = first[2] + bx * PART
                x1 = min(x0 + PART + 1, box.shape[2])
                if z1 - z0 < 2 or y1 - y0 < 2 or x1 - x0 < 2:
                    continue  # beyond the volume's last voxel
                low = high = box[z0, y0, x0]
                for z in range(z0, z1):
                    for y in range(y0, y1):
                        for x in range(x0, x1):
                            value = box[z, y, x]
                            low, high = min(low, value), max(high, value)
                for r in range(len(ranges)):
                    if high >= ranges[r, 0] and low <= ranges[r, 1]:
                        seen[bz >> 1, by >> 1, bx >> 1] |= np.uint8(1 << ((bz & 1) << 2 | (by & 1) << 1 | (bx & 1)))
                        found = True
    return found


@njit(nogil=True, fastmath=FAST_MATH, cache=True)
def fill(box, first, to_world, values, codes):  # type: ignore[no-untyped-def]
    """Copy a brick's voxels, and encode the normals there.

    Gradients are central differences, at the ends of the volume one-sided ones, as in VTK's ray casters.

    Args:
        box: Voxels of the brick, and one around it on each side where the volume has one. (z, y, x)
        first: Index in ``box`` of the brick's first voxel. (3,)
        to_world: Matrix that turns a gradient per voxel into one along world axes, up to a factor. (3, 3)
        values: Receives the voxels. (VOXELS,)
        codes: Receives the codes of normals. (VOXELS,) uint16
    """
    place = 0
    for k in range(SIDE):
        z = min(first[0] + k, box.shape[0] - 1)
        zb, za = max(z - 1, 0), min(z + 1, box.shape[0] - 1)
        for j in range(SIDE):
            y = min(first[1] + j, box.shape[1] - 1)
            yb, ya = max(y - 1, 0), min(y + 1, box.shape[1] - 1)
            for i in range(SIDE):
                x = min(first[2] + i, box.shape[2] - 1)
                xb, xa = max(x - 1, 0), min(x + 1, box.shape[2] - 1)
                values[place] = box[z, y, x]
                dx = (np.float32(box[z, y, xa]) - np.float32(box[z, y, xb])) / np.float32(xa - xb)
                dy = (np.float32(box[z, ya, x]) - np.float32(box[z, yb, x])) / np.float32(ya - yb)
                dz = (np.float32(box[za, y, x]) - np.float32(box[zb, y, x])) / np.float32(za - zb)
                gx = to_world[0, 0] * dx + to_world[0, 1] * dy + to_world[0, 2] * dz
                gy = to_world[1, 0] * dx + to_world[1, 1] * dy + to_world[1, 2] * dz
                gz = to_world[2, 0] * dx + to_world[2, 1] * dy + to_world[2, 2] * dz
                codes[place] = encoded(gx, gy, gz)
                place += 1


@njit(nogil=True, fastmath=FAST_MATH, cache=True, inline="always")
def _leaves(o, d, low, high):  # type: ignore[no-untyped-def]
    """Return the distance at which a ray that is inside a slab leaves it."""
    if d > 1e-12:
        return (high - o) / d
    if d < -1e-12:
        return (low - o) / d
    return 1e30


@njit(nogil=True, fastmath=FAST_MATH, cache=True)
def through_block(  # type: ignore[no-untyped-def]
    ox, oy, oz, dx, dy, dz, step, k, until, first, seen, values, codes, table, alphas, low, gain, shades, glossy,
    blanks, nearest, red, green, blue, through,
):  # fmt: skip
    """Add the light of the samples ``k`` to ``until`` of a ray, which lie in one block, and return it.

    (ox, oy, oz) and (dx, dy, dz) are the ray's start and direction in voxels, counted from the brick's first one;
    ``first`` is the block's first cell (x, y, z), and ``seen`` its byte; ``values`` and ``codes`` (VOXELS,) are the
    brick's; (red, green, blue) is the light so far, and ``through`` the
    transmittance. Other arguments are those of :func:`march`.
    """
    last, shine = len(table) - 1, np.float32(0.0)
    while k < until:
        t = (k + 0.5) * step
        k += 1
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        i = min(max(int(x), 0), BRICK - 1)
        j = min(max(int(y), 0), BRICK - 1)
        h = min(max(int(z), 0), BRICK - 1)
        eighth = (h - first[2] >= PART) << 2 | (j - first[1] >= PART) << 1 | (i - first[0] >= PART)
        if not (seen >> eighth) & 1:
            continue
        wx, wy, wz = np.float32(x - i), np.float32(y - j), np.float32(z - h)
        # The first voxels of the four rows of a cell.
        a = (h * SIDE + j) * SIDE + i
        b, c = a + SIDE, a + SIDE * SIDE
        d = c + SIDE
        if (blanks or nearest) and _to_nearest(codes, a, wx, wy, wz, blanks) < 0:
            continue
        if nearest:
            a += _to_nearest(codes, a, wx, wy, wz, False)
            b = c = d = a
            wx = wy = wz = np.float32(0.0)
        near = _between(values[a], values[a + 1], values[b], values[b + 1], wx, wy)
        far = _between(values[c], values[c + 1], values[d], values[d + 1], wx, wy)
        entry = min(max(int((near + wz * (far - near) - low) * gain + np.float32(0.5)), 0), last)
        alpha = alphas[entry]
        if alpha <= np.float32(0.0):
            continue
        lit = _shade(codes, shades, 0, a, b, c, d, wx, wy, wz)
        if glossy:
            shine = _shade(codes, shades, 1, a, b, c, d, wx, wy, wz)
        weight = through * alpha
        red += weight * (table[entry, 0] * lit + shine)
        green += weight * (table[entry, 1] * lit + shine)
        blue += weight * (table[entry, 2] * lit + shine)
        through -= weight
        if through < SPENT:
            break
    return red, green, blue, through


@njit(nogil=True, fastmath=FAST_MATH, cache=True, inline="always")
def _to_nearest(codes, first, wx, wy, wz, blanks):  # type: ignore[no-untyped-def]
    """Return the way from a cell's first voxel to the one nearest to a sample; -1 if the sample is blanked.

    It is with the nearest voxel, and with those that are nearest after that along each axis.
    """
    x, y, z = int(wx >= 0.5), int(wy >= 0.5), int(wz >= 0.5)
    way = (z * SIDE + y) * SIDE + x
    if blanks:
        voxel = first + way
        flags = codes[voxel] | codes[voxel + 1 - 2 * x]
        flags |= codes[voxel + (1 - 2 * y) * SIDE] | codes[voxel + (1 - 2 * z) * SIDE * SIDE]
        if flags & BLANK:
            return -1
    return way


@njit(nogil=True, fastmath=FAST_MATH, cache=True, inline="always")
def _between(v00, v01, v10, v11, wx, wy):  # type: ignore[no-untyped-def]
    """Interpolate bilinearly."""
    v0 = np.float32(v00) + wx * (np.float32(v01) - np.float32(v00))
    v1 = np.float32(v10) + wx * (np.float32(v11) - np.float32(v10))
    return v0 + wy * (v1 - v0)


@njit(nogil=True, fastmath=FAST_MATH, cache=True, inline="always")
def _shade(codes, shades, which, a, b, c, d, wx, wy, wz):  # type: ignore[no-untyped-def]
    """Interpolate a column of the shades of a cell's eight voxels."""
    near = _between(
        shades[codes[a], which], shades[codes[a + 1], which], shades[codes[b], which], shades[codes[b + 1], which],
        wx, wy,
    )  # fmt: skip
    far = _between(
        shades[codes[c], which], shades[codes[c + 1], which], shades[codes[d], which], shades[codes[d + 1], which],
        wx, wy,
    )  # fmt: skip
    return near + wz * (far - near)


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


@njit(nogil=True, fastmath=FAST_MATH, cache=True)
def march(  # type: ignore[no-untyped-def]
    rays, width, frame, corner, pixel, lengths, bounds, step, slots, stamps, now, seen, values, codes, table, alphas,
    low, gain, shades, glossy, blanks, nearest, state, samples, wanted,
):  # fmt: skip
    """March rays until they end or reach a brick that is not in memory.

    A ray takes samples at (k + 0.5) ``step`` from the camera, k = 0, 1, ... Values, and the light at the 8 voxels
    around, are interpolated trilinearly, and colours and opacities looked up for the interpolated value, as in VTK's
    ray casters.

    Args:
        rays: Numbers of the pixels. (R,)
        width: Width of the image in pixels.
        frame: The camera's position; and its view direction, step to the next column and step to the next row, each in
            voxels for a distance of 1 in the world along the axis. (4, 3)
        corner: Centre of the first pixel relative to the camera's axis, in pixels: column and row. (2,)
        pixel: Side of a pixel at a distance of 1; 0 for parallel rays, for which the steps in ``frame`` are a pixel's.
        lengths: Size of a voxel by which a ray's length is measured; 0: as in the world. (3,)
        bounds: Positions between which anything is visible. (2, 3)
        step: Sample distance, world units, or those of ``lengths``.
        slots: Slot of each brick, or UNKNOWN or EMPTY. (bz, by, bx)
        stamps: Time at which a slot was last used. (slots,)
        now: The present time.
        seen: Which eighths of the blocks are visible. (slots, BLOCKS, BLOCKS, BLOCKS)
        values: Voxels. (slots, VOXELS)
        codes: Codes of normals. (slots, VOXELS)
        table: RGB of evenly spaced values; the fourth column is not used. (N, 4)
        alphas: Opacity of one sample of these values. (N,)
        low: First value of the table.
        gain: Entries of the table per unit of the value.
        shades: Factor of the colour, and highlight, of each code. (CODES ** 2 + 1, 2)
        glossy: Whether there are highlights.
        blanks: Whether codes may have the flag BLANK; there are shades for those, too.
        nearest: Whether samples have the value and the normal of the nearest voxel.
        state: Light so far (RGB times opacity) and transmittance of each pixel. (pixels, 4)
        samples: Number of each pixel's next sample. (pixels,)
        wanted: Receives the flat index of the brick that a ray needs, or -1 if it has ended. (R,)
    """
    bricks_z, bricks_y, bricks_x = slots.shape
    for r in range(len(rays)):
        number = rays[r]
        wanted[r] = -1
        u, v = corner[0] + number % width, corner[1] + number // width
        ox, oy, oz, dx, dy, dz = _ray(u, v, frame, pixel)
        if lengths[0] > 0.0:
            length = math.sqrt((dx * lengths[0]) ** 2 + (dy * lengths[1]) ** 2 + (dz * lengths[2]) ** 2)
            dx, dy, dz = dx / length, dy / length, dz / length
        near, far = 0.0, 1e30
        for axis, o, d in ((0, ox, dx), (1, oy, dy), (2, oz, dz)):
            near, far = _clipped(o, d, bounds[0, axis], bounds[1, axis], near, far)
        k = max(samples[number], int(math.ceil(near / step - 0.5)))
        end = int(math.floor(far / step - 0.5))
        red, green, blue, through = state[number, 0], state[number, 1], state[number, 2], state[number, 3]
        while k <= end:
            t = (k + 0.5) * step
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            bx = min(max(int(x) // BRICK, 0), bricks_x - 1)
            by = min(max(int(y) // BRICK, 0), bricks_y - 1)
            bz = min(max(int(z) // BRICK, 0), bricks_z - 1)
            slot = slots[bz, by, bx]
            if slot == UNKNOWN:
                wanted[r] = (bz * bricks_y + by) * bricks_x + bx
                break
            # Within the brick, positions count from its first voxel.
            sx, sy, sz = ox - bx * BRICK, oy - by * BRICK, oz - bz * BRICK
            if slot == EMPTY:
                leave = min(_leaves(sx, dx, 0.0, BRICK), _leaves(sy, dy, 0.0, BRICK), _leaves(sz, dz, 0.0, BRICK))
                k = max(k + 1, int(math.floor(leave / step - 0.5)) + 1)
                continue
            stamps[slot] = now
            x, y, z = sx + t * dx, sy + t * dy, sz + t * dz
            mx = min(max(int(x) // BLOCK, 0), BLOCKS - 1)
            my = min(max(int(y) // BLOCK, 0), BLOCKS - 1)
            mz = min(max(int(z) // BLOCK, 0), BLOCKS - 1)
            leave = min(
                _leaves(sx, dx, mx * BLOCK, (mx + 1) * BLOCK),
                _leaves(sy, dy, my * BLOCK, (my + 1) * BLOCK),
                _leaves(sz, dz, mz * BLOCK, (mz + 1) * BLOCK),
            )
            until = max(k + 1, int(math.floor(leave / step - 0.5)) + 1)
            if not seen[slot, mz, my, mx]:
                k = until
                continue
            red, green, blue, through = through_block(
                sx, sy, sz, dx, dy, dz, step, k, min(until, end + 1), (mx * BLOCK, my * BLOCK, mz * BLOCK),
                int(seen[slot, mz, my, mx]), values[slot], codes[slot], table, alphas, low, gain, shades, glossy,
                blanks, nearest, red, green, blue, through,
            )  # fmt: skip
            k = end + 1 if through < SPENT else until
        state[number, 0], state[number, 1], state[number, 2], state[number, 3] = red, green, blue, through
        samples[number] = k
