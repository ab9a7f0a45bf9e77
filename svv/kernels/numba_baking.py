"""Colours of the empty points around what a volume shows, compiled with numba."""

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
