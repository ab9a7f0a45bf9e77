"""Differences of kept values from what their neighbours predict, and back, compiled with numba.

A value is nearly the one that the plane through three neighbours has (Lorenzo predictor, Ibarria et al. 2003): the mean
of those in the three planes of the axes is told, as it has less noise than the one of all seven neighbours.
"""

from __future__ import annotations

import numpy as np

from svv.core.compiled import njit


@njit(cache=True)
def _predicted(codes, seen, x, y, z, last):  # type: ignore[no-untyped-def]
    """Return what the neighbours before a vertex predict, or the ``last`` value where it has none."""
    a = z > 0 and seen[x, y, z - 1]
    b = y > 0 and seen[x, y - 1, z]
    c = x > 0 and seen[x - 1, y, z]
    total, count = np.int64(0), np.int64(0)
    if a and b and seen[x, y - 1, z - 1]:
        total += codes[x, y, z - 1] + codes[x, y - 1, z] - codes[x, y - 1, z - 1]
        count += 1
    if a and c and seen[x - 1, y, z - 1]:
        total += codes[x, y, z - 1] + codes[x - 1, y, z] - codes[x - 1, y, z - 1]
        count += 1
    if b and c and seen[x - 1, y - 1, z]:
        total += codes[x, y - 1, z] + codes[x - 1, y, z] - codes[x - 1, y - 1, z]
        count += 1
    if count == 0:
        if a:
            total += codes[x, y, z - 1]
            count += 1
        if b:
            total += codes[x, y - 1, z]
            count += 1
        if c:
            total += codes[x - 1, y, z]
            count += 1
    return last if count == 0 else (2 * total + count) // (2 * count)


@njit(cache=True)
def differences(codes, seen, out):  # type: ignore[no-untyped-def]
    """Write the differences of N seen codes from what is predicted, modulo 65536.

    ``codes`` (X, Y, Z) int32, in [0, 65535]; ``seen`` (X, Y, Z) bool; ``out``: result, uint16. (N,)
    """
    nx, ny, nz = codes.shape
    number, last = 0, np.int64(0)
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                if seen[x, y, z]:
                    out[number] = np.uint16((codes[x, y, z] - _predicted(codes, seen, x, y, z, last)) & 65535)
                    last = np.int64(codes[x, y, z])
                    number += 1


@njit(cache=True)
def restore(rest, seen, codes):  # type: ignore[no-untyped-def]
    """Invert :func:`differences`: write the codes (X, Y, Z), int32, where they are seen, from the differences (N,)."""
    nx, ny, nz = codes.shape
    number, last = 0, np.int64(0)
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                if seen[x, y, z]:
                    last = (np.int64(rest[number]) + _predicted(codes, seen, x, y, z, last)) & 65535
                    codes[x, y, z] = last
                    number += 1
