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


@njit(parallel=True, cache=True)
def leaps(occupied, out):  # type: ignore[no-untyped-def]
    """Compute :func:`svv.core.rays.cells.leaps`: (X, Y, Z) -> out (8, X, Y, Z), uint8.

    An empty cell is one cell farther from something than the nearest to it of the seven cells that follow it in its
    octant, so each octant is swept once, from its far corner.
    """
    nx, ny, nz = occupied.shape
    for one in prange(8):
        distance = out[one]
        sx, sy, sz = (-1 if one & 4 else 1), (-1 if one & 2 else 1), (-1 if one & 1 else 1)
        for i in range(nx):
            x = nx - 1 - i if sx > 0 else i
            for j in range(ny):
                y = ny - 1 - j if sy > 0 else j
                ahead = np.int64(FARTHEST_LEAP)  # of the cell that follows in z, and of its neighbours in x and y
                beside = np.int64(FARTHEST_LEAP)
                for k in range(nz):
                    z = nz - 1 - k if sz > 0 else k
                    now = np.int64(FARTHEST_LEAP)
                    if i > 0:
                        now = min(now, np.int64(distance[x + sx, y, z]))
                        if j > 0:
                            now = min(now, np.int64(distance[x + sx, y + sy, z]))
                    if j > 0:
                        now = min(now, np.int64(distance[x, y + sy, z]))
                    if occupied[x, y, z]:
                        ahead = np.int64(0)
                    else:
                        ahead = min(np.int64(FARTHEST_LEAP), np.int64(1) + min(ahead, min(now, beside)))
                    beside = now
                    distance[x, y, z] = ahead
