"""The empty points around what a volume shows, compiled with numba: their colours, and the edges of hidden regions."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(parallel=True, cache=True)
def extend_colours(rgba, near):  # type: ignore[no-untyped-def]
    """Give each empty point beside visible ones their mean colour, so that interpolation between both keeps it.

    ``rgba`` (Z, Y, X, 4) uint8 is changed in place; a point is empty if its fourth byte is 0. ``near`` (N,): flat
    indices of the points to look at. Only empty points are written and only others are read.
    """
    depth, height, width = rgba.shape[:3]
    for i in prange(near.shape[0]):
        z, rest = divmod(near[i], height * width)
        y, x = divmod(rest, width)
        if rgba[z, y, x, 3] == 0:
            count = red = green = blue = 0
            for c in range(max(z - 1, 0), min(z + 2, depth)):
                for b in range(max(y - 1, 0), min(y + 2, height)):
                    for a in range(max(x - 1, 0), min(x + 2, width)):
                        if rgba[c, b, a, 3] > 0:
                            count += 1
                            red += rgba[c, b, a, 0]
                            green += rgba[c, b, a, 1]
                            blue += rgba[c, b, a, 2]
            if count > 0:
                half = count // 2
                rgba[z, y, x, 0] = np.uint8((red + half) // count)
                rgba[z, y, x, 1] = np.uint8((green + half) // count)
                rgba[z, y, x, 2] = np.uint8((blue + half) // count)


@njit(parallel=True, cache=True)
def soften_edges(codes, places, own, drop, out):  # type: ignore[no-untyped-def]
    """Compute codes for the hidden points beside visible ones.

    ``codes`` (Z, Y, X) uint8; ``places`` (N,): flat indices of hidden points; ``own`` (N,) uint8: their codes if they
    were visible; ``drop``: how far below the mean of its visible neighbours along the axes a point lies. Writes ``out``
    (N,) uint8: 0 for points without such neighbours.
    """
    depth, height, width = codes.shape
    for i in prange(places.shape[0]):
        z, rest = divmod(places[i], height * width)
        y, x = divmod(rest, width)
        count = total = 0
        for axis in range(3):
            for side in (-1, 1):
                c, b, a = z + side * (axis == 0), y + side * (axis == 1), x + side * (axis == 2)
                if 0 <= c < depth and 0 <= b < height and 0 <= a < width and codes[c, b, a] > 0:
                    count += 1
                    total += codes[c, b, a]
        out[i] = max(min(total // count, own[i]) - drop, 0) if count > 0 else 0
