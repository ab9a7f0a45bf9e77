"""Pictures in TIFF files of more than 8 bits, which Pillow reads wrongly if their colours lie in planes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

BLACK_IS_ZERO, WHITE_IS_ZERO, RGB = 1, 0, 2
"""TIFF's photometric interpretations that are read here."""

TIFFFILE_DECODES = (1, 8, 32773, 32946)
"""Compressions that tifffile decodes by itself: none, deflate, PackBits, and the old number of deflate."""

NARROW = (8, 10, 12)
"""Bits of cameras and microscopes that store their values in 16."""


def deep_tiff(path: Path) -> Image.Image | None:
    """Return the first picture of a TIFF file of more than 8 bits per sample; None for files that Pillow reads as well.

    Those are of other formats, depths, colour spaces or compressions. Greys are an image of mode F from 0 to 1, colours
    are RGB or RGBA. Raises ValueError, or any other error of tifffile, if the file is damaged.
    """
    with path.open("rb") as opened:
        if opened.read(4) not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return None
    import tifffile  # only here: it is slow to import

    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        kind, photometric = np.dtype(page.dtype), int(page.photometric)
        if (
            kind.itemsize == 1 or kind.kind not in "uif" or int(page.compression) not in TIFFFILE_DECODES
            or photometric not in (BLACK_IS_ZERO, WHITE_IS_ZERO, RGB) or page.axes not in ("YX", "YXS", "SYX")
        ):  # fmt: skip
            return None
        values = page.asarray()
        values = np.moveaxis(values, 0, -1) if page.axes == "SYX" else values
        profile, orientation = (page.tags[t].value if t in page.tags else None for t in (34675, 274))
        most = page.tags[281].value if 281 in page.tags else None
        alpha = page.samplesperpixel - len(page.extrasamples)
    values = values[..., None] if values.ndim == 2 else values
    colours = values[..., :alpha]
    levels = scaled(colours, None if most is None else float(np.max(most)))
    if photometric == WHITE_IS_ZERO:
        levels = 1.0 - levels
    if values.shape[-1] == 1:
        image = Image.fromarray(levels[..., 0].astype(np.float32), "F")
    else:
        levels = np.repeat(levels, 3, -1) if levels.shape[-1] == 1 else levels
        if values.shape[-1] > alpha:
            levels = np.concatenate([levels, scaled(values[..., alpha : alpha + 1], full_of(kind))], -1)
        image = Image.fromarray(np.rint(255.0 * levels).astype(np.uint8))
    if profile:
        image.info["icc_profile"] = bytes(profile)
    if orientation:
        image.getexif()[274] = int(orientation)
    return image


def scaled(values: NDArray[np.generic], most: float | None = None) -> NDArray[np.float64]:
    """Return values as levels from 0 to 1; ``most`` is the value of white, if the file gives it."""
    known = np.nan_to_num(values.astype(np.float64))
    white = most or white_of(known, values.dtype)
    return np.clip(known / max(white, float(known.max()), 1e-300), 0.0, 1.0)


def full_of(kind: np.dtype[np.generic]) -> float:
    """Return the largest value of a type; 1 for real numbers."""
    return 1.0 if kind.kind == "f" else float(np.iinfo(kind.name).max)


def white_of(values: NDArray[np.generic], kind: np.dtype[np.generic]) -> float:
    """Return the value of white of values of a type; 16 bits may hold 8, 10 or 12, which would look black."""
    largest = float(values.max())
    if kind.kind == "u" and kind.itemsize == 2 and largest > 0:
        return next((2.0**bits - 1 for bits in NARROW if largest < 2**bits), full_of(kind))
    return full_of(kind)
