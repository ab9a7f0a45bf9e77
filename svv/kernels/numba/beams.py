"""Search for the parts of an image that can show occupied cells, one beam per tile of pixels; compiled with numba."""

from __future__ import annotations

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary

from svv.core.compiled import njit

TILE_SIDE = 8
"""Pixels along the side of a tile."""

BLOCK = 4
"""Tiles along the side of a block of them."""

LEAST_ADVANCE = 0.1
"""Fraction of a cell; a beam that cannot advance by this much counts as meeting an occupied cell."""

POSITION_ERROR = 1e-5
"""Bound of a sample's position error in single precision, in box units."""


_NEAREST = WeakTensorKeyDictionary()


@njit(cache=True)
def _ray(column, row, lens):  # type: ignore[no-untyped-def]
    """Return the ray through a point in camera axes: its origin's x and y (z is 0) and its unit direction.

    The point is in pixels from the centre of the first one.
    """
    u = (column + lens[1]) / lens[0]
    v = -(row + lens[2]) / lens[0]
    if lens[3] > 0.0:
        return u, v, 0.0, 0.0, -1.0
    norm = math.sqrt(u * u + v * v + 1.0)
    return 0.0, 0.0, u / norm, v / norm, -1.0 / norm


@njit(cache=True)
def _advance(  # type: ignore[no-untyped-def]
    rotation, position, lens, top, left, bottom, right, nearest, cells, extent, t, reach
):
    """Return how far the beam of some pixels advances from a distance ``t`` on; -1 if it meets no occupied cell.

    A beam is an axis together with all rays of the pixels: at distance t they are within s + t k of the axis, where s
    is the largest distance between their origins and the axis's (0 unless the camera is orthographic), and k is the
    largest difference between their unit directions and the axis (0 if it is). Each point of the axis is the centre of
    a cube without occupied cells, and the beam can advance until its rays might leave that cube (sphere tracing,
    Hart 1996, in the maximum norm). ``reach``: distance behind which nothing is. Other arguments:
    :func:`tiles_in_sight`.
    """
    side = 1.0 / cells
    u, v, a, b, c = _ray(0.5 * (left + right), 0.5 * (top + bottom), lens)
    radius, spread = 0.0, 0.0
    for corner in range(4):
        g, h, p, q, r = _ray(right if corner & 1 else left, bottom if corner & 2 else top, lens)
        radius = max(radius, math.sqrt((g - u) ** 2 + (h - v) ** 2))
        spread = max(spread, math.sqrt((p - a) ** 2 + (q - b) ** 2 + (r - c) ** 2))
    end = reach + math.sqrt(u * u + v * v)
    cell = np.zeros(3, np.int64)
    while t <= end:
        away = 0.0
        for axis in range(3):
            x = position[axis] + rotation[axis, 0] * u + rotation[axis, 1] * v
            x += t * (rotation[axis, 0] * a + rotation[axis, 1] * b + rotation[axis, 2] * c)
            inside = min(max(x, 0.0), extent[axis])
            away = max(away, abs(x - inside))
            cell[axis] = min(int(inside * cells), nearest.shape[axis] - 1)
        # Outside the box, nothing in it is nearer than the box itself.
        free = max(away, (float(nearest[cell[0], cell[1], cell[2]]) - 1.0) * side)
        step = free - (radius + t * spread) - POSITION_ERROR
        if step < LEAST_ADVANCE * side:
            return t
        t += step
    return -1.0


@njit(parallel=True, cache=True)
def tiles_in_sight(rotation, position, lens, width, height, nearest, cells, extent, seen):  # type: ignore[no-untyped-def]
    """Mark the tiles of an image through which an occupied cell may be visible.

    Every tile with a pixel centre whose ray meets an occupied cell is marked. The beam of a block of tiles goes first:
    those of its tiles begin where it could not advance any more.

    Args:
        rotation: Camera-to-box rotation, as in :mod:`svv.kernels.numba.rays`. (3, 3)
        position: Camera position in box coordinates. (3,)
        lens: As in :mod:`svv.kernels.numba.rays`. (4,)
        width: Image width in pixels.
        height: Image height in pixels.
        nearest: Chessboard distance of each cell to the nearest occupied one. (X, Y, Z)
        cells: Cells per box unit.
        extent: Sides of the box. (3,)
        seen: Result, 1 for marked tiles. (rows of tiles, columns of tiles)
    """
    reach = 0.0
    for axis in range(3):
        reach += max(abs(position[axis]), abs(extent[axis] - position[axis])) ** 2
    reach = math.sqrt(reach)  # to the farthest corner of the box
    across = -(-seen.shape[1] // BLOCK)
    for block in prange(-(-seen.shape[0] // BLOCK) * across):
        row, column = block // across * BLOCK, block % across * BLOCK
        after_row, after_column = min(row + BLOCK, seen.shape[0]), min(column + BLOCK, seen.shape[1])
        bottom, right = min(after_row * TILE_SIDE, height) - 1, min(after_column * TILE_SIDE, width) - 1
        begin = _advance(
            rotation, position, lens, row * TILE_SIDE, column * TILE_SIDE, bottom, right, nearest, cells, extent, 0.0,
            reach,
        )  # fmt: skip
        if begin < 0.0:
            continue
        for j in range(row, after_row):
            for k in range(column, after_column):
                bottom, right = min((j + 1) * TILE_SIDE, height) - 1, min((k + 1) * TILE_SIDE, width) - 1
                advanced = _advance(
                    rotation, position, lens, j * TILE_SIDE, k * TILE_SIDE, bottom, right, nearest, cells, extent,
                    begin, reach,
                )  # fmt: skip
                seen[j, k] = advanced >= 0.0


def nearest_of(distance: Tensor) -> NDArray[np.uint8]:
    """Return the chessboard distance of each cell to the nearest occupied one, remembered. (X, Y, Z)

    ``distance``: how far a ray may leap in each octant, 0 for occupied cells (:func:`svv.core.rays.cells.leaps`).
    """
    found: NDArray[np.uint8] | None = _NEAREST.get(distance)
    if found is None:
        found = _NEAREST[distance] = distance.amin(dim=0).numpy()
    return found


@njit(cache=True)
def _pixels_of(seen, width, height, pixels):  # type: ignore[no-untyped-def]
    """Write the flat indices of the pixels in marked tiles, and return their number."""
    n = 0
    for tile in range(seen.size):
        top, left = tile // seen.shape[1] * TILE_SIDE, tile % seen.shape[1] * TILE_SIDE
        if seen[tile // seen.shape[1], tile % seen.shape[1]]:
            for row in range(top, min(top + TILE_SIDE, height)):
                for column in range(left, min(left + TILE_SIDE, width)):
                    pixels[n] = row * width + column
                    n += 1
    return n


def pixels_of(seen: NDArray[np.uint8], width: int, height: int) -> NDArray[np.int64]:
    """Return the flat indices of the pixels in marked tiles, tile by tile, so that neighbours stay together."""
    pixels = np.empty(TILE_SIDE * TILE_SIDE * int(np.count_nonzero(seen)), np.int64)
    return pixels[: _pixels_of(seen, width, height, pixels)]
