"""Compression of smooth grids of whole numbers.

A number of a smooth grid is nearly the one that its neighbours predict (Lorenzo predictor, Ibarria et al. 2003): the
differences along all axes, one after another, are small. Deflate then needs few bits for each.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def packed(numbers: NDArray[np.int16] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return a grid of numbers of 16 bits, of any dimensions, compressed without loss. (N,)"""
    rest = numbers.astype(np.uint16)
    for axis in range(rest.ndim):
        rest = np.diff(rest, axis=axis, prepend=rest.dtype.type(0))  # modulo 65536
    signed = rest.view(np.int16)
    folded = ((signed << 1) ^ (signed >> 15)).view(np.uint16).ravel()  # 0, -1, 1, -2, 2 ... become 0, 1, 2, 3, 4 ...
    stream = zlib.compressobj(memLevel=9, strategy=zlib.Z_RLE)
    halves = (folded & 255).astype(np.uint8), (folded >> 8).astype(np.uint8)
    return np.frombuffer(b"".join(stream.compress(half.tobytes()) for half in halves) + stream.flush(), np.uint8)


def unpacked(content: NDArray[np.uint8], shape: Sequence[int]) -> NDArray[np.uint16]:
    """Return the numbers of a grid of this shape, from :func:`packed`; ValueError if the content does not fit."""
    count = int(np.prod(shape))
    stream = zlib.decompressobj()
    try:
        both = np.frombuffer(stream.decompress(content.tobytes(), 2 * count), np.uint8)
    except zlib.error as error:
        raise ValueError(f"a compressed grid is damaged: {error}") from error
    if len(both) != 2 * count or stream.unconsumed_tail or not stream.eof:
        raise ValueError("a compressed grid is longer or shorter than it says")
    folded = both[:count].astype(np.uint16) | (both[count:].astype(np.uint16) << 8)
    numbers: NDArray[np.uint16] = np.asarray((folded >> 1) ^ (0 - (folded & 1)), np.uint16).reshape(tuple(shape))
    for axis in range(numbers.ndim):
        numbers = np.cumsum(numbers, axis=axis, dtype=np.uint16).astype(np.uint16, copy=False)
    return numbers
