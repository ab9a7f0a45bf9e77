"""Means of 2 x 2 x 2 voxels, compiled: :mod:`svv.bricks.pyramid` imports this when it builds a level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from svv.core.compiled import njit


def halved(values: NDArray[np.number]) -> NDArray[np.number]:
    """Return the means of 2 x 2 x 2 voxels, of integers rounded; at the end of an odd side, of fewer. (z, y, x)"""
    out = np.empty([-(-size // 2) for size in values.shape], values.dtype)
    if values.dtype.kind == "f":
        _mean_reals(values, out)
    elif values.dtype.itemsize <= 4:
        _mean_integers(values, out)
    else:
        wide = np.empty(out.shape)
        _mean_reals(values, wide)
        np.rint(wide, out=wide)
        out[...] = wide
    return out


@njit(nogil=True, cache=True)
def _mean_reals(values, out):  # type: ignore[no-untyped-def]
    for z in range(out.shape[0]):
        za, zb = values[2 * z], values[min(2 * z + 1, values.shape[0] - 1)]
        for y in range(out.shape[1]):
            ya, yb = 2 * y, min(2 * y + 1, values.shape[1] - 1)
            for x in range(out.shape[2]):
                a, b = 2 * x, min(2 * x + 1, values.shape[2] - 1)
                near = float(za[ya, a]) + float(za[ya, b]) + float(za[yb, a]) + float(za[yb, b])
                far = float(zb[ya, a]) + float(zb[ya, b]) + float(zb[yb, a]) + float(zb[yb, b])
                out[z, y, x] = 0.125 * (near + far)


@njit(nogil=True, cache=True)
def _mean_integers(values, out):  # type: ignore[no-untyped-def]
    half = values.shape[2] // 2
    for z in range(out.shape[0]):
        za, zb = values[2 * z], values[min(2 * z + 1, values.shape[0] - 1)]
        for y in range(out.shape[1]):
            ya, yb = 2 * y, min(2 * y + 1, values.shape[1] - 1)
            a, b, c, d, row = za[ya], za[yb], zb[ya], zb[yb], out[z, y]
            for x in range(half):
                k = 2 * x
                row[x] = (np.int64(a[k]) + a[k + 1] + b[k] + b[k + 1] + c[k] + c[k + 1] + d[k] + d[k + 1] + 4) >> 3
            if half < len(row):
                row[half] = (np.int64(a[-1]) + b[-1] + c[-1] + d[-1] + 2) >> 2
