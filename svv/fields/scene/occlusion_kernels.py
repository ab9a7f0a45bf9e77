"""Mean transmittance around points, compiled with numba."""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit


@njit(inline="always")
def _extinction(field, x, y, z):  # type: ignore[no-untyped-def]
    """Return the trilinear mean of a field (X, Y, Z) at a place in its cells, 0 outside."""
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    if i < 0 or j < 0 or k < 0 or i >= field.shape[0] - 1 or j >= field.shape[1] - 1 or k >= field.shape[2] - 1:
        return 0.0
    u, v, w = x - i, y - j, z - k
    low = (1.0 - v) * ((1.0 - w) * field[i, j, k] + w * field[i, j, k + 1])
    low += v * ((1.0 - w) * field[i, j + 1, k] + w * field[i, j + 1, k + 1])
    high = (1.0 - v) * ((1.0 - w) * field[i + 1, j, k] + w * field[i + 1, j, k + 1])
    high += v * ((1.0 - w) * field[i + 1, j + 1, k] + w * field[i + 1, j + 1, k + 1])
    return (1.0 - u) * low + u * high


@njit(parallel=True, cache=True)
def mean_transmittance(field, vertices, directions, start, reach, step, stop, found):  # type: ignore[no-untyped-def]
    """Write how much of the light of all directions (D, 3) arrives at vertices, ``found`` (V,) in [0, 1].

    ``field`` (X, Y, Z): optical depth of one cell; ``vertices`` (V, 3): their indices in it; ``start``: distance at
    which rays begin; ``reach``: up to which matter counts, the less, the farther away it is; ``step``: between samples,
    all in cells; ``stop``: optical depth at which a ray ends.
    """
    for n in prange(vertices.shape[0]):
        total = 0.0
        for d in range(directions.shape[0]):
            depth, away = 0.0, start + 0.5 * step
            while away < reach and depth < stop:
                x = vertices[n, 0] + away * directions[d, 0]
                y = vertices[n, 1] + away * directions[d, 1]
                z = vertices[n, 2] + away * directions[d, 2]
                near = 1.0 - away / reach
                depth += step * near * _extinction(field, x, y, z)
                away += step
            total += np.exp(-depth)
        found[n] = total / directions.shape[0]
