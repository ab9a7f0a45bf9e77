"""Large arrays of pictures that take memory only where something is drawn."""

from __future__ import annotations

import mmap
import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def blank(shape: Sequence[int]) -> NDArray[np.uint8]:
    """Return uint8 zeros of this shape, whose pages the system provides when something is written to them.

    NumPy's own zeros are in pages of 2 MiB where the system has them, of which a picture would touch all. Raises
    MemoryError if there are not enough addresses or, where the system counts them, pages.

    >>> pictures = blank((2, 3, 4, 4))
    >>> draw_into(pictures[0], np.full((3, 4, 4), 7, np.uint8))
    >>> pictures.sum(axis=(1, 2, 3))
    array([336,   0], dtype=uint64)
    """
    size = int(np.prod(shape))
    if not size:
        return np.zeros(shape, np.uint8)
    try:
        if sys.platform == "win32":
            pages = mmap.mmap(-1, size)
        else:
            pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:  # of an anonymous mapping, it has no other reason
        raise MemoryError(f"an array of {size} bytes") from error
    if hasattr(mmap, "MADV_NOHUGEPAGE"):
        pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.ndarray(tuple(shape), np.uint8, pages)


def draw_into(place: NDArray[np.uint8], picture: NDArray[np.uint8]) -> None:
    """Write a picture to its place in a :func:`blank` array, except its first and last rows if all in them is 0."""
    filled = np.flatnonzero(picture.reshape(len(picture), -1).any(axis=1))
    if len(filled):
        rows = slice(filled[0], filled[-1] + 1)
        place[rows] = picture[rows]
