"""Style pictures from files of any common format, as sRGB in [0, 1]."""

from __future__ import annotations

import io
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps, UnidentifiedImageError

from svv.errors import BadInput
from svv.io.files.declared_sizes import check_pixels
from svv.io.pictures.deep_tiff import deep_tiff, scaled
from svv.io.pictures.gamma import as_srgb, converted, exponent_of

SMALLEST = 16
"""Minimum side of a style picture in pixels; smaller pictures have no strokes to match."""
LARGEST = 1024
"""Maximum long side in pixels; larger styles are shrunk to it. Matching uses a few hundred pixels."""
NEARLY_BLACK = 15
"""Largest level of a picture with 12 bits in 16, read as if it had 16."""
MOST_PIXELS = 600_000_000
"""Maximum number of pixels in formats that cannot be shrunk while decoding."""


def read_style(path: str | Path, long_side: int = LARGEST) -> NDArray[np.float32]:
    """Read a style picture.

    Greyscale becomes RGB, 16 bits are kept until the end (if they hold 8, 10 or 12, these count), transparent pictures
    are placed on white, CMYK, other colour profiles and linear PNG files (gAMA) become sRGB, a camera's rotation is
    undone, and large pictures are shrunk (JPEG while decoding).

    Args:
        path: PNG, JPEG, TIFF, WebP, GIF (first frame), BMP ...
        long_side: Maximum long side of the result in pixels.

    Returns:
        float32 sRGB in [0, 1], row 0 at the top. (h, w, 3)

    Raises:
        BadInput: The file is missing, not a readable picture, smaller than 16 x 16, far too large, or
            completely transparent.

    >>> svv.write_png("style.png", np.random.default_rng(0).random((48, 64, 3)))
    >>> svv.read_style("style.png").shape
    (48, 64, 3)
    """
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"There is no style picture at {path}; check the path.")
    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None  # our own, checked below, gives a clear message
    try:
        # From a path, Pillow 12 and 13 garble turned TIFF files of some modes, which they map into memory.
        with path.open("rb") as file, Image.open(file) as image:
            check_pixels(path, *image.size)
            _check_size(path, *image.size, decoder_shrinks=image.format == "JPEG")
            if (deep := deep_tiff(path)) is not None:
                return _pixels(path, deep, long_side)
            if (exponent := exponent_of(image)) is not None and not image.mode.startswith("I"):
                return _pixels(path, converted(path, image, exponent), long_side)
            wide = any("16" in str(tile.args) for tile in image.tile)
            image.draft(image.mode, (2 * long_side, 2 * long_side))
            image.load()
            if wide and image.mode.startswith("RGB") and np.asarray(image)[..., :3].max() <= NEARLY_BLACK:
                raise BadInput(
                    f"The style picture {path} is almost black, as if its 16 bits held 12: multiply its values by 16, "
                    "or save it with 8 bits."
                )
            return _pixels(path, image, long_side)
    except UnidentifiedImageError as error:
        if (deep := _deep(path)) is not None:
            return _pixels(path, deep, long_side)
        raise BadInput(f"{path} is not a picture that can be read: save it as PNG or JPEG.") from error
    except BadInput:
        raise
    except Exception as error:  # damaged files make Pillow raise all kinds of errors
        raise BadInput(f"The style picture {path} is damaged or unusual ({error}): save it again.") from error
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _deep(path: Path) -> Image.Image | None:
    """Return a picture that Pillow does not know at all; None if tifffile does not know it either."""
    try:
        deep = deep_tiff(path)
    except Exception:  # damaged files make tifffile raise all kinds of errors: Pillow's is reported
        return None
    if deep is not None:
        _check_size(path, *deep.size, decoder_shrinks=False)
    return deep


def _check_size(path: Path, width: int, height: int, decoder_shrinks: bool) -> None:
    if min(width, height) < SMALLEST:
        raise BadInput(
            f"The style picture {path} has {width} x {height} pixels: at least {SMALLEST} x {SMALLEST} are needed."
        )
    if width * height > MOST_PIXELS and not decoder_shrinks:
        raise BadInput(f"The style picture {path} has {width} x {height} pixels: shrink it to a few thousand first.")


def _pixels(path: Path, image: Image.Image, long_side: int) -> NDArray[np.float32]:
    deep = image.mode.startswith(("I", "F"))
    if deep:  # 16-bit, 32-bit or floating-point greyscale, which Pillow would clip to 8 bits
        upright = ImageOps.exif_transpose(image)
        values = np.asarray(upright)
        if image.mode.startswith("I"):
            values = np.clip(values, 0, None).astype(np.uint16 if values.max() < 65536 else np.uint32)
        exponent, levels = exponent_of(image), scaled(values)
        levels = levels if exponent is None else as_srgb(levels, exponent)
        grey = Image.fromarray(levels.astype(np.float32), "F")
        values = np.asarray(grey.resize(_size(grey, long_side), Image.Resampling.BOX, reducing_gap=2))
        return np.repeat(values[..., None], 3, 2)
    image = ImageOps.exif_transpose(image)
    if image.has_transparency_data:
        has_one_channel = image.mode in ("1", "L", "LA")
        image = image.convert("LA" if has_one_channel else "RGBA")
        if image.getchannel("A").getextrema() == (0, 0):
            raise BadInput(f"The style picture {path} is completely transparent: choose one that shows something.")
        if max(image.size) > 2 * long_side:  # compositing needs a second copy, so shrink first
            image = image.resize(_size(image, 2 * long_side), Image.Resampling.BOX)
        colours = _srgb(image.convert("L" if has_one_channel else "RGB"))
        colours.putalpha(image.getchannel("A"))
        image = Image.alpha_composite(Image.new("RGBA", image.size, "white"), colours).convert("RGB")
    else:
        image = _srgb(image)
    image = image.resize(_size(image, long_side), Image.Resampling.LANCZOS, reducing_gap=3)
    return np.asarray(image, np.float32) / np.float32(255)


def _size(image: Image.Image, long_side: int) -> tuple[int, int]:
    """Return the size after shrinking: never enlarged, and with a short side of at least ``SMALLEST``."""
    factor = min(1.0, max(long_side / max(image.size), SMALLEST / min(image.size)))
    return max(1, round(image.width * factor)), max(1, round(image.height * factor))


def _srgb(image: Image.Image) -> Image.Image:
    profile = image.info.get("icc_profile")
    if image.mode in ("P", "PA"):
        image = image.convert("RGB")  # profiles are of the palette's colours
    if profile and image.mode in ("RGB", "CMYK", "L"):
        with suppress(ImageCms.PyCMSError, OSError):  # viewers ignore damaged profiles, too
            source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
            converted = ImageCms.profileToProfile(image, source, ImageCms.createProfile("sRGB"), outputMode="RGB")
            assert converted is not None  # only an in-place conversion returns None
            return converted
    return image.convert("RGB")
