"""Values of a grid between its nodes. Numba, CPU."""

from __future__ import annotations

from numba import prange

from svv.core.compiled import njit


@njit(parallel=True, cache=True)
def interpolate(grids, at, out):  # type: ignore[no-untyped-def]
    """Interpolate grids (C, X, Y, Z) trilinearly at nodes' coordinates (S, 3), nearest beyond them. ``out`` (S, C)

    Sums in the order of scipy's ``map_coordinates``, with the same results, but finds the cell once for all grids.
    """
    count, height, depth = grids.shape[1], grids.shape[2], grids.shape[3]
    for s in prange(len(at)):
        x = min(max(at[s, 0], 0.0), count - 1.0)
        y = min(max(at[s, 1], 0.0), height - 1.0)
        z = min(max(at[s, 2], 0.0), depth - 1.0)
        i, j, k = int(x), int(y), int(z)
        u, v, w = x - i, y - j, z - k
        far, up, on = min(i + 1, count - 1), min(j + 1, height - 1), min(k + 1, depth - 1)
        for c in range(len(grids)):
            total = grids[c, i, j, k] * (1.0 - u) * (1.0 - v) * (1.0 - w)
            total += grids[c, i, j, on] * (1.0 - u) * (1.0 - v) * w
            total += grids[c, i, up, k] * (1.0 - u) * v * (1.0 - w)
            total += grids[c, i, up, on] * (1.0 - u) * v * w
            total += grids[c, far, j, k] * u * (1.0 - v) * (1.0 - w)
            total += grids[c, far, j, on] * u * (1.0 - v) * w
            total += grids[c, far, up, k] * u * v * (1.0 - w)
            total += grids[c, far, up, on] * u * v * w
            out[s, c] = total
