"""Undoing the filters of PNG, compiled with numba."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def undo_filters(lines, width, pixels):  # type: ignore[no-untyped-def]
    """Undo the filters of the lines of an image (section 9 of the PNG specification, W3C 2025).

    Args:
        lines: The kind of filter of each line, 0 to 4, and its filtered bytes. uint8 (H, 1 + B)
        width: Bytes of a pixel.
        pixels: Result; its first line and first pixel of each line stand for those before the image, and are 0 before.
            uint8 (1 + H, width + B)

    Returns:
        Whether all kinds of filters are known.
    """
    for y in range(len(lines)):
        kind, line, above, here = lines[y, 0], lines[y, 1:], pixels[y], pixels[y + 1]
        if kind == 0:
            for i in range(len(line)):
                here[i + width] = line[i]
        elif kind == 1:
            for i in range(len(line)):
                here[i + width] = line[i] + here[i]
        elif kind == 2:
            for i in range(len(line)):
                here[i + width] = line[i] + above[i + width]
        elif kind == 3:
            for i in range(len(line)):
                here[i + width] = line[i] + (here[i] + above[i + width]) // 2
        elif kind == 4:
            for i in range(len(line)):
                left, up, corner = np.int64(here[i]), np.int64(above[i + width]), np.int64(above[i])
                a, b, c = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
                here[i + width] = line[i] + (left if a <= b and a <= c else up if b <= c else corner)
        else:
            return False
    return True
