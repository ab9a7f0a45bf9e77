"""Filling of bricks: their voxels, the codes of their normals, and which of their parts show anything.

Arrays of voxels are indexed [z, y, x]. A brick has :data:`BRICK` cells and one more voxel along each side, so that each
cell lies in exactly one brick. Blocks of :data:`BLOCK` cells record whether anything is visible in them.
"""

from __future__ import annotations

import numpy as np

from svv.core.compiled import njit
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

CODES = 128
"""Steps along each side of the square on which normals are encoded: with 128, they are at most 1.1 degrees off."""

BLANK = 1 << 15
"""Flag in the code of a normal: the voxel is blanked."""


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

    ``box`` (z, y, x): voxels of the brick and around it; ``first`` (3,): index of the brick's first voxel there;
    ``ranges`` (R, 2): intervals of values that are visible; ``seen`` (BLOCKS, BLOCKS, BLOCKS): receives a bit for each
    visible eighth of a block, the lowest for the first along all axes, then along x, y, z.
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
    """Copy a brick's voxels to ``values`` (VOXELS,), and write the ``codes`` of the normals there, uint16 (VOXELS,).

    Gradients are central differences, at the ends of the volume one-sided ones, as in VTK's ray casters. ``box`` and
    ``first``: as for :func:`find_visible`; ``to_world`` (3, 3): turns a gradient per voxel into one along world axes,
    up to a factor.
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
