"""Pictures as text inside other files: data URIs (RFC 2397) of JPEG and PNG, which name no path and run no code."""

from __future__ import annotations

import base64
import binascii
import io
import re

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.errors import BadInput

LONG_SIDE, QUALITY, SHARP = 512, 88, 96
"""Long side in pixels to which pictures are shrunk, and quality of their JPEG: about 100 kB each; and where edges of
colours must stay sharp."""

PNG = b"\x89PNG"
"""First bytes of a PNG."""

SMALLEST, LARGEST = 16, 2048
"""Bounds of a picture's sides in pixels."""

MOST_BYTES = 16 << 20
"""Largest size of a picture in a file."""

URI = re.compile(r"data:image/(jpeg|png);base64,([A-Za-z0-9+/=\s]*)")


def as_data(picture: NDArray[np.floating], long_side: int = LONG_SIDE, sharp: bool = False) -> str:
    """Return a picture (h, w, 3), sRGB in [0, 1], as a data URI of a JPEG of at most ``long_side`` pixels a side.

    A ``sharp`` one keeps edges of colours, as in a cartoon, and is larger.
    """
    image = Image.fromarray(np.rint(255.0 * np.clip(np.asarray(picture, np.float32), 0.0, 1.0)).astype(np.uint8))
    image.thumbnail((long_side, long_side), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    how = {"quality": SHARP, "subsampling": 0} if sharp else {"quality": QUALITY}
    image.save(stream, "JPEG", optimize=True, **how)
    return as_text(stream.getvalue())


def mask_as_data(mask: NDArray[np.bool_], long_side: int = LONG_SIDE) -> str:
    """Return a mask (h, w) as a data URI, as large as :func:`as_data` makes its picture."""
    image = Image.fromarray(255 * np.asarray(mask, np.uint8))
    image.thumbnail((long_side, long_side), Image.Resampling.BOX)
    stream = io.BytesIO()
    image.point(lambda level: 255 * (level >= 128)).convert("1").save(stream, "PNG", optimize=True)
    return as_text(stream.getvalue())


def picture_in(text: object, name: str) -> NDArray[np.float32]:
    """Return the picture of a data URI, float32 sRGB in [0, 1]. (h, w, 3)

    Raises BadInput, with its name, if it is something else, for example a path, broken, too small or too large.

    >>> picture_in(as_data(np.ones((16, 20, 3))), "It").shape
    (16, 20, 3)
    """
    return np.asarray(_image(text, name).convert("RGB"), np.float32) / np.float32(255)


def mask_in(text: object, shape: tuple[int, ...], name: str) -> NDArray[np.bool_]:
    """Return the mask of a data URI, as large as its picture (h, w, ...); raises BadInput as :func:`picture_in`. (h, w)

    >>> bool(mask_in(mask_as_data(np.ones((16, 20), bool)), (16, 20), "It").all())
    True
    """
    found = np.asarray(_image(text, name).convert("L")) >= 128
    if found.shape != tuple(shape[:2]):
        raise BadInput(f"{name} has another size than its picture: make the file again.")
    return found


def as_text(content: bytes) -> str:
    """Return the data URI of a JPEG's or PNG's bytes.

    >>> content_of(as_text(PNG)) == PNG
    True
    """
    kind = "png" if content.startswith(PNG) else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def content_of(text: str) -> bytes:
    """Return the bytes of a data URI that :func:`as_text` made."""
    return base64.b64decode(text.split(",", 1)[1])


def _image(text: object, name: str) -> Image.Image:
    """Return the decoded picture of a data URI."""
    if not isinstance(text, str) or (found := URI.fullmatch(text)) is None:
        shown = text if isinstance(text, str) and len(text) <= 60 else "something else"
        raise BadInput(
            f"{name} must be a JPEG or PNG inside the file (data:image/...;base64,...), not '{shown}': pictures "
            "are never read from paths that a file names."
        )
    try:
        content = base64.b64decode(found[2], validate=False)
        if len(content) > MOST_BYTES:
            raise BadInput(f"{name} is larger than {MOST_BYTES >> 20} MB: shrink it.")
        image = Image.open(io.BytesIO(content), formats=[found[1].upper()])
        if not (SMALLEST <= min(image.size) and max(image.size) <= LARGEST):
            raise BadInput(
                f"{name} has {image.width} x {image.height} pixels; sides of {SMALLEST} to {LARGEST} are needed."
            )
        image.load()
    except BadInput:
        raise
    except (binascii.Error, OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
        raise BadInput(f"{name} is broken: make the file again.") from error
    return image
