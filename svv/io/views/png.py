"""Pixels of PNG files, decoded by several threads at a time.

Pillow holds the interpreter's lock while it decodes a PNG file, so that threads wait for each other; zlib and numba do
not. What is not an ordinary picture of 8 bits, or is damaged, is left to Pillow, which reads it or says what is wrong.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.io.files.declared_sizes import check_pixels

SIGNATURE = b"\x89PNG\r\n\x1a\n"

CHANNELS = {2: 3, 6: 4}
"""Numbers of channels of the types of colour that are read here: RGB and RGBA."""

OTHERS = (b"tRNS", b"acTL")
"""Chunks of pictures that are not read here: with a transparent colour, or with several frames."""


def read_png(file: Path) -> NDArray[np.uint8] | None:
    """Return the pixels of a PNG file with 8 bits a channel, without interlacing; None for all other files.

    Args:
        file: The file.

    Returns:
        RGB or straight RGBA (height, width, 3 or 4), or None.

    Raises:
        BadInput: It has too many pixels.
    """
    with file.open("rb") as stream:
        content = _chunks(stream.read()) if stream.read(len(SIGNATURE)) == SIGNATURE else None
    if content is None:
        return None
    (width, height, bits, kind, packing, filtering, interlaced), packed = content
    if bits != 8 or kind not in CHANNELS or packing or filtering or interlaced or not width or not height:
        return None
    check_pixels(file, width, height)
    row = width * CHANNELS[kind]
    unpacking = zlib.decompressobj()
    try:
        lines = unpacking.decompress(packed, height * (row + 1) + 1)  # no more than one byte too many
    except zlib.error:
        return None
    if len(lines) != height * (row + 1) or not unpacking.eof:
        return None
    from svv.io.views.png_kernels import undo_filters  # numba takes half a second to load

    pixels = np.zeros((height + 1, row + CHANNELS[kind]), np.uint8)
    if not undo_filters(np.frombuffer(lines, np.uint8).reshape(height, row + 1), CHANNELS[kind], pixels):
        return None
    return pixels.reshape(height + 1, width + 1, CHANNELS[kind])[1:, 1:]


def _chunks(data: bytes) -> tuple[tuple[int, ...], bytes] | None:
    """Return the header and the packed pixels of a PNG file; None if it is damaged or has several frames.

    Args:
        data: What follows its signature.
    """
    header: tuple[int, ...] | None = None
    place, parts = 0, []
    while place + 12 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, place)
        body, end = data[place + 8 : place + 8 + size], place + 12 + size
        if end > len(data) or struct.unpack_from(">I", data, end - 4)[0] != zlib.crc32(body, zlib.crc32(kind)):
            return None
        if kind == b"IHDR" and size == 13:
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            parts.append(body)
        elif kind in OTHERS:
            return None
        elif kind == b"IEND":
            return None if header is None else (header, b"".join(parts))
        place = end
    return None
