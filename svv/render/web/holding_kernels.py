"""Quantization with a tolerance, for files: a value that may differ a little repeats the one before it."""

from __future__ import annotations

import numpy as np

from svv.core.compiled import njit


@njit(cache=True)
def held(levels, tolerance):  # type: ignore[no-untyped-def]
    """Round ``levels`` (V,) in [0, 255] to bytes, where the byte before is not within the ``tolerance`` (V,) anyway.

    A tolerance of 0.5 or less rounds every value.
    """
    out = np.empty(len(levels), np.uint8)
    last = np.int64(np.round(levels[0])) if len(levels) else np.int64(0)
    for k in range(len(levels)):
        if abs(levels[k] - last) > tolerance[k]:
            last = np.int64(np.round(levels[k]))
        out[k] = last
    return out
