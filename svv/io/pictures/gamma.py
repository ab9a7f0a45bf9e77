"""Pictures whose levels are not those of sRGB, by the gAMA chunk of a PNG (PNG specification, 11.3.2.2 and 12)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile

from svv.core.colour.srgb import encoded, linear

USUAL = 0.43, 0.48
"""Exponents that writers give for sRGB: 1/2.2 is 0.45455."""

Array = NDArray[np.float64]


def exponent_of(image: Image.Image) -> float | None:
    """Return the power of light that a picture's levels are, 1 if they are linear; None if they are those of sRGB.

    A profile (iCCP, cICP) and the chunk sRGB win over gAMA.
    """
    exponent = image.info.get("gamma")
    known = any(name in image.info for name in ("srgb", "icc_profile", "cicp"))
    if known or not isinstance(exponent, float) or not exponent > 0.0 or USUAL[0] <= exponent <= USUAL[1]:
        return None
    return exponent


def as_srgb(levels: Array, exponent: float) -> Array:
    """Return levels of sRGB (IEC 61966-2-1) for levels that are a power of light, all in [0, 1]."""
    return encoded(np.power(levels, 1.0 / exponent))


def stored(exponent: float | None) -> NDArray[np.uint8]:
    """Return the 8-bit level that a file stored for each of sRGB. (256,)"""
    levels = np.arange(256) / 255.0
    if exponent is not None:
        levels = np.power(linear(levels), exponent)
    return np.rint(255.0 * levels).astype(np.uint8)


def converted(path: Path, image: Image.Image, exponent: float) -> Image.Image:
    """Return a picture of a file, not loaded yet, as 8-bit sRGB: L, LA, RGB or RGBA; 16 bits count in full.

    Pillow reduces 16 bits of colours to the upper 8: the lower ones are what it takes for the upper ones if it is told
    that bytes are in the other order.
    """
    grey = image.mode in ("1", "L", "LA")
    mode = ("LA" if grey else "RGBA") if image.has_transparency_data else ("L" if grey else "RGB")
    assert isinstance(image, ImageFile.ImageFile)
    deep = image.mode == mode and any(str(tile.args) in ("RGB;16B", "RGBA;16B") for tile in image.tile)
    exif = image.info.get("exif")
    upper = np.asarray(image.convert(mode))
    levels = upper.reshape(*upper.shape[:2], -1) / 255.0
    if deep:
        with Image.open(path) as again:
            again.tile = [tile._replace(args=str(tile.args).replace("16B", "16L")) for tile in again.tile]
            levels = (256.0 * upper + np.asarray(again)) / 65535.0
    colours = levels.shape[-1] - (mode in ("LA", "RGBA"))
    levels[..., :colours] = as_srgb(levels[..., :colours], exponent)
    result = Image.fromarray(np.rint(255.0 * levels).astype(np.uint8).reshape(upper.shape))
    if exif:
        result.info["exif"] = exif
    return result
