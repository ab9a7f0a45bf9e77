"""Pictures next to each other: contact sheets and the frames of comparison movies; and what a picture shows in words.

Images are (h, w, 3) uint8 unless stated otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from svv.core.colour.colour import over
from svv.io.pictures.output import to_bytes

Picture = NDArray[np.uint8]

INK = (60, 60, 60)


def sheet(
    rows: Sequence[Sequence[Picture]], labels: Sequence[str], gap: int = 6, captions: Sequence[str] | None = None
) -> Picture:
    """Draw a contact sheet: rows of pictures of one size on white, with labels and captions above the columns."""
    height, width = rows[0][0].shape[:2]
    line = max(18, width // 11)
    head = line if captions is None else line + max(12, line * 2 // 3)
    canvas = Image.new("RGB", (len(labels) * (width + gap) - gap, head + len(rows) * (height + gap) - gap), "white")
    draw = ImageDraw.Draw(canvas)
    for column, label in enumerate(labels):
        x = column * (width + gap)
        draw.text((x + width / 2, line / 2), label, fill=INK, font=_font(label, width, line), anchor="mm")
        if captions is not None:
            below, text = head - line, captions[column]
            draw.text((x + width / 2, line + below / 2), text, INK, _font(text, width, below), anchor="mm")
        for row, pictures in enumerate(rows):
            canvas.paste(Image.fromarray(pictures[column]), (x, head + row * (height + gap)))
    return np.asarray(canvas)


def cropped(rows: Sequence[Sequence[Picture]], margin: int = 12) -> list[list[Picture]]:
    """Crop all pictures alike, to the pixels that are not white in any of them and a margin in pixels around them."""
    seen = np.any([picture.min(axis=2) < 250 for row in rows for picture in row], axis=0)
    if not seen.any():
        return [list(row) for row in rows]
    (y, x), (bottom, right) = (np.argwhere(seen).min(0) - margin).clip(min=0), np.argwhere(seen).max(0) + margin + 1
    return [[picture[y:bottom, x:right] for picture in row] for row in rows]


def error_picture(truth: Picture, shown: Picture, gain: float = 4.0) -> Picture:
    """Show the largest difference of each pixel's channels, times ``gain``, from white (none) to dark red."""
    difference = np.abs(truth.astype(np.float32) - shown.astype(np.float32)).max(axis=-1) / 255.0
    strength = np.clip(gain * difference, 0.0, 1.0)[..., None]
    colour = (1.0 - strength) * 255.0 + strength * np.array([150.0, 0.0, 20.0])
    return np.rint(colour).astype(np.uint8)


def over_white(image: NDArray[np.floating] | Picture) -> Picture:
    """Blend straight-alpha RGBA (h, w, 4), values in [0, 1] or levels (uint8), over white."""
    values = image.astype(np.result_type(image.dtype, np.float32))
    return to_bytes(over(values / 255.0 if image.dtype == np.uint8 else values))


def read_png(path: Path) -> Picture:
    """Read a PNG file as RGBA levels (h, w, 4)."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGBA"))


def fitted(image: NDArray[np.float32], across: int, down: int | None = None) -> Picture:
    """Fit RGB in [0, 1] (h, w, 3) into the middle of a white picture, a square unless ``down`` is given."""
    down = across if down is None else down
    scale = min(across / image.shape[1], down / image.shape[0])
    height, width = (max(1, round(scale * n)) for n in image.shape[:2])
    small = Image.fromarray(to_bytes(image)).resize((width, height), Image.Resampling.LANCZOS)
    canvas = Image.new("RGB", (across, down), "white")
    canvas.paste(small, ((across - width) // 2, (down - height) // 2))
    return np.asarray(canvas)


def shrunk(image: Picture, width: int, height: int) -> Picture:
    """Shrink RGBA levels; they are averaged premultiplied to keep the colours of empty pixels from bleeding in."""
    with Image.fromarray(image) as picture:
        small = picture.convert("RGBa").resize((width, height), Image.Resampling.BOX)
        return np.asarray(small.convert("RGBA"))


def _font(label: str, width: int, head: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the largest font in which the label fits its column."""
    draw, size = ImageDraw.Draw(Image.new("L", (1, 1))), int(head * 0.66)
    while size > 8 and draw.textlength(label, ImageFont.load_default(size)) > 0.96 * width:
        size -= 1
    return ImageFont.load_default(size)
