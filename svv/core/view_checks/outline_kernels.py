"""Outlines of pictures at several levels in one pass over their pixels, compiled with numba.

Each picture is looked at by one thread, so results do not depend on the number of threads. Letters: N pictures, L
levels, H rows and W columns of those pixels that are looked at.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit


@njit(parallel=True, cache=True)
def trace(images, which, step, background, tables, ends, whole, codes):  # type: ignore[no-untyped-def]
    """Find the outermost pixels of pictures at all levels, row by row.

    A pixel's code has a bit for each level that it belongs to; tables give the bits.

    Args:
        images: RGBA with straight alpha, 0 to 255. (pictures, height, width, 4)
        which: The pictures to look at. (N,)
        step: Only every so many-th pixel is looked at, from ``step // 2`` on, in both directions.
        background: RGB from which contrast is measured where there is something; its first number is negative if
            contrast is brightness over black. int64 (3,)
        tables: Bits of each alpha; bits of each contrast, the largest difference of a channel; what each alpha adds to
            the two counts of a square of 3 x 3 pixels, which take four bits each and so share a byte; and bits of each
            pair of counts. int64 (4, 256)
        ends: Result: first and last column in each row, of those alone that may be outermost in some direction, and
            otherwise -1. int16 (N, L, 2, H)
        whole: Result: whether something is there and does not touch the edge of the picture. bool (N, L)
        codes: Result: which codes there are, to be False before. bool (N, 1 << L)
    """
    for n in prange(len(which)):
        _trace_one(images[which[n]], step, background, tables, ends[n], whole[n], codes[n])


@njit(cache=True)
def _trace_one(image, step, background, tables, ends, whole, codes):  # type: ignore[no-untyped-def]
    of_alpha, of_contrast, of_pixel, of_square = tables[0], tables[1], tables[2], tables[3]
    levels, _, height = ends.shape
    start = step // 2
    width = (image.shape[1] - start + step - 1) // step
    touched, found = 0, 0  # a bit for each level
    row, alone = np.empty(width, np.int64), np.empty(height, np.bool_)
    counts = np.zeros((3, width), np.uint8)  # of three pixels in a row, of this row and its neighbours
    for y in range(2):  # beyond the edge, pixels are those at the edge
        _count(image[start], start, step, of_pixel, counts[y])
    for y in range(height):
        _count(image[start + min(y + 1, height - 1) * step], start, step, of_pixel, counts[(y + 2) % 3])
        pixels, there, last_code = image[start + y * step], 0, -1
        for x in range(width):
            square = counts[0, x] + counts[1, x] + counts[2, x]
            code, pixel = of_square[square], pixels[start + x * step]
            alpha = np.int64(pixel[3])
            if alpha > 0:
                code |= of_alpha[alpha] | of_contrast[_contrast(pixel, alpha, background)]
            row[x] = code
            if code != last_code:
                codes[code], last_code = True, code
            there |= code
        found |= there
        if y == 0 or y == height - 1:
            touched |= there
        else:
            touched |= row[0] | row[width - 1]
        _note_ends(row, there, ends[:, :, y])
    for level in range(levels):
        whole[level] = found >> level & 1 and not touched >> level & 1
        left, right = ends[level, 0], ends[level, 1]
        for y in range(height):
            alone[y] = left[y] == right[y]
        _leave_outermost(left, 1)
        _leave_outermost(right, -1)
        for y in range(height):  # of pixels that are equally far out, left ends come first, so none may be missing
            if alone[y] and right[y] >= 0:
                left[y] = right[y]


@njit(cache=True)
def _contrast(pixel, alpha, background):  # type: ignore[no-untyped-def]
    """Return how much a pixel that is not empty differs from the background, 0 to 255."""
    red, green, blue = np.int64(pixel[0]), np.int64(pixel[1]), np.int64(pixel[2])
    if background[0] < 0:
        return max(red, max(green, blue)) * alpha // 255
    return max(abs(red - background[0]), max(abs(green - background[1]), abs(blue - background[2])))


@njit(cache=True)
def _count(pixels, start, step, of_pixel, counts):  # type: ignore[no-untyped-def]
    """Add what a pixel and those to its left and right count, for each pixel of a row. counts: (W,)"""
    width = len(counts)
    before = here = of_pixel[pixels[start, 3]]
    for x in range(width):
        after = of_pixel[pixels[start + min(x + 1, width - 1) * step, 3]]
        counts[x] = before + here + after
        before, here = here, after


@njit(cache=True)
def _note_ends(row, there, ends):  # type: ignore[no-untyped-def]
    """Note the first and last column of each level in the codes of a row. (W,), (L, 2)"""
    for side in range(2):
        for level in range(len(ends)):
            ends[level, side] = -1
        left, x = there, 0  # levels that are not found yet
        while left:
            column = len(row) - 1 - x if side else x
            new = row[column] & left
            if new:
                left ^= new
                for level in range(len(ends)):
                    if new >> level & 1:
                        ends[level, side] = column
            x += 1


@njit(cache=True)
def _leave_outermost(columns, sign):  # type: ignore[no-untyped-def]
    """Set to -1 all columns (H,) that lie inside of the convex outline of the others, on its left (1) or right (-1).

    Those on straight lines of it stay (Andrew 1979, without removing them).
    """
    rows, count = np.empty(len(columns), np.int64), 0
    for y in range(len(columns)):
        if columns[y] < 0:
            continue
        while count > 1:
            a, b = rows[count - 2], rows[count - 1]
            along = np.int64(columns[y] - columns[a]) * (b - a)
            if sign * (np.int64(columns[b] - columns[a]) * (y - a) - along) <= 0:
                break
            columns[b] = -1
            count -= 1
        rows[count] = y
        count += 1
