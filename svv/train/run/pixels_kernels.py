"""A list of pixels in two bytes each, and pixels drawn from it, compiled with numba, for :mod:`svv.train.run.pixels`.

Pixels are listed by their step of contrast, view and place. The last 16 bits of their places are written down; the
others are those of the block of 65,536 pixels that a rank in the list belongs to.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit

BLOCK = np.int64(1 << 16)


@njit(nogil=True, cache=True)
def list_pixels(steps, coming, low, counts):  # type: ignore[no-untyped-def]
    """Write the pixels of a view to their ranks in ``low``, uint16, and count those of each step and block.

    ``steps`` (height * width,), uint8, are beyond the last one where a pixel is not listed. ``coming`` (STEPS,) are the
    ranks of the first pixel of each step, and are counted up; ``counts`` (STEPS, blocks), all int64.
    """
    for pixel in range(len(steps)):
        step = steps[pixel]
        if step < len(coming):
            low[coming[step]] = np.uint16(pixel % BLOCK)
            coming[step] += 1
            counts[step, pixel // BLOCK] += 1


@njit(parallel=True, error_model="numpy", cache=True)
def draw(random, share, ends, first, low, starts, size, out, weight):  # type: ignore[no-untyped-def]
    """Write the flat indices of pixels that ``random`` numbers in [0, 1) draw, int64, and their weights. (R,) each

    ``share``, ``ends`` and ``first`` are those of :func:`svv.train.run.pixels.steps_to_draw`; ``starts`` (STEPS * views
    * blocks + 1,) are the ranks of the first pixel of each block of a view of ``size`` pixels, int64.
    """
    groups = (len(starts) - 1) // len(share)
    for number in prange(len(random)):
        where, step = random[number] * ends[-1], 0
        while step < len(share) - 1 and where >= ends[step + 1]:
            step += 1
        rank = np.int64(min(first[step] + (where - ends[step]) / share[step], first[step + 1] - 1.0))
        out[number] = _pixel(rank, low, starts, size, step * groups, (step + 1) * groups)
        weight[number] = np.float32(1.0 / share[step])


@njit(parallel=True, cache=True)
def find(ranks, low, starts, size, steps, out):  # type: ignore[no-untyped-def]
    """Write the flat indices, int64, of the pixels with some ranks among those of so many ``steps``. (R,)"""
    groups = (len(starts) - 1) // steps
    for number in prange(len(ranks)):
        step = np.searchsorted(starts[::groups], ranks[number], side="right") - 1
        out[number] = _pixel(ranks[number], low, starts, size, step * groups, (step + 1) * groups)


@njit
def _pixel(rank, low, starts, size, begin, end):  # type: ignore[no-untyped-def]
    """Return the flat index of the pixel with a rank that one of the groups from ``begin`` to ``end`` has."""
    group, after = begin, end
    while after - group > 1:
        middle = (group + after) // 2
        if starts[middle] <= rank:
            group = middle
        else:
            after = middle
    blocks = (size + BLOCK - 1) // BLOCK
    view, block = (group - begin) // blocks, (group - begin) % blocks
    return view * size + block * BLOCK + np.int64(low[rank])


@njit(parallel=True, cache=True)
def read(levels, pixels, out):  # type: ignore[no-untyped-def]
    """Write the premultiplied RGBA in [0, 1] of pixels (R,) with straight ``levels`` (N, 4), uint8. (R, 4) float32"""
    most = np.float32(255.0)
    for number in prange(len(pixels)):
        pixel = pixels[number]
        alpha = np.float32(levels[pixel, 3]) / most
        for k in range(3):
            out[number, k] = np.float32(levels[pixel, k]) / most * alpha
        out[number, 3] = alpha
