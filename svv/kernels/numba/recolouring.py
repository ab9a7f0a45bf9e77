"""Edits of palette colours, compiled with numba: :func:`svv.core.colour.colour.with_change` for vectors of samples."""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import LANES, as_floats, gather, lane_numbers, maximum, minimum, select, splat, store, truncated
from svv.kernels.numba.trilinear import ONE32

ZERO32, TWO32, SIX32 = np.float32(0.0), np.float32(2.0), np.float32(6.0)
TINY32 = np.finfo(np.float32).tiny
"""Below, a colour counts as black, and a difference between channels as none."""


@njit(fastmath=FAST_MATH, inline="always")
def _wrapped(x):  # type: ignore[no-untyped-def]
    """Return hues in sixths of the circle, from 0 to 6."""
    turns = x * np.float32(1.0 / 6.0)
    whole = as_floats(truncated(turns))
    return x - SIX32 * select(turns < whole, whole - ONE32, whole)


@njit(fastmath=FAST_MATH, inline="always")
def _channel(offset, hue, saturation, value):  # type: ignore[no-untyped-def]
    """Return a channel of colours; see :func:`svv.core.colour.colour.hsb_to_rgb`."""
    k = _wrapped(hue + offset)
    drop = minimum(maximum(minimum(k, np.float32(4.0) - k), splat(ZERO32)), splat(ONE32))
    return value * (ONE32 - saturation * drop)


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def shift(raw, column, colour, change, among):  # type: ignore[no-untyped-def]
    """Change the offsets of a palette colour in ``raw`` (S, 1 + 4 P), from ``column`` on, as an edit of it asks.

    ``change`` (4,): see :func:`svv.core.colour.colour.hsb_change`. ``among`` (S,): which samples change; if it is
    empty, all do.
    """
    if change[0] == 0.0 and change[1] < 0.0 and change[2] == 0.0 and change[3] == 0.0:
        return
    columns, last = raw.shape[1], np.int32(len(raw) - 1)
    for block in prange((len(raw) + LANES - 1) // LANES):
        out = np.empty((3, LANES), np.float32)
        row = minimum(lane_numbers() + block * LANES, splat(last)) * columns + column
        red = maximum(gather(raw, row) + colour[0], splat(ZERO32))
        green = maximum(gather(raw, row + 1) + colour[1], splat(ZERO32))
        blue = maximum(gather(raw, row + 2) + colour[2], splat(ZERO32))
        value = maximum(red, maximum(green, blue))
        chroma = value - minimum(red, minimum(green, blue))
        grey, one = chroma <= TINY32, splat(ONE32)
        over = ONE32 / select(grey, one, chroma)
        hue = select(value == green, TWO32 + (blue - red) * over, np.float32(4.0) + (red - green) * over)
        hue = select(value == red, (green - blue) * over, hue)
        hue = select(grey, splat(ZERO32), hue) + SIX32 * change[0]
        if change[1] >= ZERO32:
            hue = splat(SIX32 * change[1])
        dark = value <= TINY32
        saturation = select(dark, splat(ZERO32), chroma / select(dark, one, value)) + change[2]
        saturation = minimum(maximum(saturation, splat(ZERO32)), one)
        value = minimum(maximum(value + change[3], splat(ZERO32)), one)
        store(out, 0, _channel(np.float32(5.0), hue, saturation, value) - colour[0])
        store(out, LANES, _channel(np.float32(3.0), hue, saturation, value) - colour[1])
        store(out, 2 * LANES, _channel(ONE32, hue, saturation, value) - colour[2])
        for lane in range(min(LANES, len(raw) - block * LANES)):
            i = block * LANES + lane
            if len(among) == 0 or among[i]:
                for c in range(3):
                    raw[i, column + c] = out[c, lane]
