"""How far rays may leap through empty cells, compiled with numba. Letters: (X, Y, Z) cells."""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.rays.cells import FARTHEST_LEAP


@njit(cache=True)
def octant(dx, dy, dz):  # type: ignore[no-untyped-def]
    """Return the octant into which a direction points; see :func:`svv.core.rays.cells.leaps`."""
    return (4 if dx < 0 else 0) + (2 if dy < 0 else 0) + (1 if dz < 0 else 0)


HALF = (FARTHEST_LEAP + 1) // 2
"""The longest of the steps 1, 2, 4, ... that together reach the farthest leap."""


@njit(inline="always")
def _nearer(a, b):  # type: ignore[no-untyped-def]
    """Return the smaller of two bytes as a byte, so that LLVM compares many at once."""
    return a if a < b else b


@njit(inline="always")
def _beyond(a, step):  # type: ignore[no-untyped-def]
    """Return a distance that is some cells longer, as a byte."""
    return np.uint8(_nearer(a, np.uint8(FARTHEST_LEAP - step)) + step)


@njit(parallel=True, cache=True)
def leaps(occupied, out):  # type: ignore[no-untyped-def]
    """Compute :func:`svv.core.rays.cells.leaps`: (X, Y, Z) -> out (8, X, Y, Z), uint8.

    An empty cell is one cell farther from something than the nearest to it of the seven cells that follow it in its
    octant, so each octant is swept once, from its far corner. Within a row along z, where each cell waits for the next,
    all look 1, 2, 4, ... cells ahead at once instead (the minimum over all cells ahead of distance plus way).
    """
    nx, ny, nz = occupied.shape
    for one in prange(8):
        sx, sy, sz = (-1 if one & 4 else 1), (-1 if one & 2 else 1), (-1 if one & 1 else 1)
        beside = np.full(nz + 2 * HALF, FARTHEST_LEAP, np.uint8)  # beyond the box is nothing
        before, after = beside.copy(), beside.copy()
        near, follows = beside[HALF : HALF + nz], beside[HALF + sz : HALF + sz + nz]
        for i in range(nx):
            x = nx - 1 - i if sx > 0 else i
            for j in range(ny):
                y = ny - 1 - j if sy > 0 else j
                there, found = occupied[x, y], before[HALF : HALF + nz]
                if i > 0 and j > 0:
                    a, b, c = out[one, x + sx, y], out[one, x, y + sy], out[one, x + sx, y + sy]
                    for z in range(nz):
                        near[z] = _nearer(a[z], _nearer(b[z], c[z]))
                elif i > 0 or j > 0:
                    near[:] = out[one, x + sx, y] if i > 0 else out[one, x, y + sy]
                for z in range(nz):
                    found[z] = 0 if there[z] else _beyond(_nearer(near[z], follows[z]), 1)
                step = 1
                while step < min(nz, FARTHEST_LEAP + 1):
                    ahead = before[HALF + sz * step : HALF + sz * step + nz]
                    closer = after[HALF : HALF + nz]
                    for z in range(nz):
                        closer[z] = _nearer(found[z], _beyond(ahead[z], step))
                    before, after, found = after, before, closer
                    step *= 2
                out[one, x, y] = found
