"""How the pixels of TIFF files are packed, and which packings can be undone.

tifffile undoes few of them without the package imagecodecs. Pillow's libtiff knows more, but Pillow makes pictures of
what it reads: it turns values of white-is-zero pages round, spreads 2 and 4 bits over 8, and turns pages upright. So
bytes are unpacked by libtiff alone, as a page of plain bytes, and tifffile makes of them what the file says.

Source: TIFF 6.0, sections 13 and 14; Adobe Photoshop TIFF Technical Note 3 (the predictor of real numbers).
"""

from __future__ import annotations

import io
import struct
from collections import ChainMap
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from svv.errors import BadInput

if TYPE_CHECKING:
    from tifffile import TiffFrame, TiffPage

LZW, ZSTD = 5, 50000
"""Numbers of the packings of bytes that libtiff undoes and tifffile does not."""

BY_PILLOW = {2: (1,), 3: (1,), 4: (1,), 5: (1,), 6: (8,), 7: (8,), 50000: (1,)}
"""Bits of grey pixels of which Pillow reads whole pages, by the number of the packing: those of faxes, and JPEG."""

WHOLE_BITS = (1, 8, 16, 32, 64)
"""Bits of values that tifffile separates by itself."""


def with_libtiff() -> None:
    """Let tifffile use Pillow's libtiff for what it cannot unpack, unless imagecodecs is installed."""
    import tifffile

    if find_spec("imagecodecs") is None and not isinstance(tifffile.TIFF.DECOMPRESSORS, ChainMap):
        ours: dict[int, Callable[..., Any]] = {number: _unpacker(number) for number in (LZW, ZSTD)}
        tifffile.TIFF.DECOMPRESSORS = ChainMap(ours, tifffile.TIFF.DECOMPRESSORS)  # type: ignore[arg-type]
        tifffile.TIFF.UNPREDICTORS = ChainMap({3: _summed}, tifffile.TIFF.UNPREDICTORS)  # type: ignore[arg-type]


def decodes_pages(path: Path, one: TiffPage | TiffFrame) -> bool:
    """Return whether tifffile decodes pages like one of them; otherwise, :func:`by_pillow` does.

    Raises:
        BadInput: Neither does.
    """
    import tifffile

    page = _like(one)
    packing, predictor = int(page.compression), int(page.predictor)
    unpacks = packing == 1 or packing in tifffile.TIFF.DECOMPRESSORS
    adds = predictor == 1 or predictor in tifffile.TIFF.UNPREDICTORS
    if find_spec("imagecodecs") is not None:
        if unpacks and adds:
            return True
    elif page.samplesperpixel == 1 and page.bitspersample in BY_PILLOW.get(packing, ()):
        return False
    elif unpacks and adds and page.bitspersample in WHOLE_BITS:
        return True
    raise no_unpacker(path, page)


def by_pillow(path: Path, page: TiffPage | TiffFrame) -> NDArray[np.generic]:
    """Decode a page of a file by Pillow. (height, width)

    Raises:
        BadInput: Pillow does not read it either.
    """
    try:
        with Image.open(path) as image:
            image.seek(page.index)
            image.getexif().pop(274, None)  # the orientation: pages are read as they are stored
            values = np.asarray(image)
    except UnidentifiedImageError as error:
        raise no_unpacker(path, _like(page)) from error
    if values.shape != page.shape:
        raise BadInput(f"{path} has pages that lie on their side and are packed as pictures: save them upright.")
    return ~values if int(_like(page).photometric) == 0 else values  # Pillow makes white the largest value


def _like(page: TiffPage | TiffFrame) -> TiffPage:
    """Return the page that tells how the pixels of a page are stored: itself, or one that is alike."""
    assert page.keyframe is not None
    return page.keyframe


def no_unpacker(path: Path, page: TiffPage) -> BadInput:
    """Return the error to raise for a file that is packed in a way that cannot be undone here."""
    from tifffile import COMPRESSION

    try:
        how = COMPRESSION(page.compression).name
    except ValueError:
        how = f"the method {int(page.compression)}"
    bits = "" if page.bitspersample in WHOLE_BITS else f" in {page.bitspersample} bits per value"
    how = f"packed by {how}{bits}" if int(page.compression) != 1 else f"stored{bits}"
    return BadInput(
        f"{path} is {how}, which tifffile reads only with the package imagecodecs: pip install imagecodecs, or save "
        "the file without compression or packed by deflate or LZW, in 8, 16 or 32 bits."
    )


def _unpacker(packing: int) -> Callable[..., bytes]:
    """Return a function as tifffile wants it, which unpacks a strip or a tile of ``out`` bytes."""

    def unpacked(data: bytes, *, out: int) -> bytes:
        with Image.open(io.BytesIO(_page_of_bytes(data, packing, out))) as image:
            return image.tobytes()

    return unpacked


def _page_of_bytes(data: bytes, packing: int, size: int) -> bytes:
    """Return a TIFF file of one row of ``size`` grey pixels of 8 bits, which are packed in ``data``."""
    fields = {
        256: size, 257: 1, 258: 8, 259: packing, 262: 1, 273: 8 + 2 + 9 * 12 + 4, 277: 1, 278: 1, 279: len(data),
    }  # fmt: skip
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in fields.items())
    return b"II*\0" + struct.pack("<IH", 8, len(fields)) + entries + bytes(4) + data


def _summed(data: NDArray[np.generic], axis: int = -2, out: object = None) -> NDArray[np.generic]:
    """Undo the predictor of real numbers, which stores the differences of their bytes, the highest bytes first.

    Args:
        data: Rows as they are stored, seen as real numbers in the machine's order of bytes. (..., width, samples)
        axis: The axis of the pixels of a row, which is the last but one.
        out: Not used.
    """
    *before, width, samples = data.shape
    size = data.dtype.itemsize
    stored = np.ascontiguousarray(data).view(np.uint8).reshape(*before, size * width, samples)
    planes = np.cumsum(stored, axis=-2, dtype=np.uint8).reshape(*before, size, width * samples)
    values = np.ascontiguousarray(np.moveaxis(planes, -2, -1)).view(data.dtype.newbyteorder(">"))
    return values.astype(data.dtype).reshape(data.shape)
