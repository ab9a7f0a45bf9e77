"""Pages of pictures for the documentation: strips of labels, frames, files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from svv.pv.panel import tooltips

IMAGES = Path(__file__).resolve().parent / "images"

TOOLTIP = 640
"""Width of the pictures in tooltips in pixels."""

WHITE, INK = (1.0, 1.0, 1.0), (60, 60, 60)

Pixels = NDArray[np.float64]


def over_white(rgba: NDArray[np.uint8]) -> Pixels:
    """Return an image with straight alpha (height, width, 4; 0 to 255) over white (height, width, 3), in [0, 1]."""
    levels = rgba.astype(np.float64) / 255
    return levels[..., :3] * levels[..., 3:] + (1 - levels[..., 3:])


def halved(picture: Pixels) -> Pixels:
    """Return a picture at half its size, by means of 2 x 2 pixels."""
    height, width = picture.shape[:2]
    return picture.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))


def labelled(labels: Sequence[str], width: int, height: int = 44) -> Pixels:
    """Return a white strip with labels above columns of a width."""
    strip = Image.new("RGB", (width * len(labels), height), "white")
    pen, font = ImageDraw.Draw(strip), ImageFont.load_default(height // 2)
    for column, label in enumerate(labels):
        pen.text(((column + 0.5) * width, height / 2), label, INK, font, anchor="mm")
    return np.asarray(strip, np.float64) / 255


def write(name: str, pictures: Sequence[Pixels], below: bool = False, width: int = 0) -> None:
    """Write pictures (height, width, 3), in [0, 1], side by side or below each other, in a white frame of a width.

    Drawings, with few colours and sharp edges, are PNG files; the others are compressed.
    """
    page = np.clip(np.concatenate(pictures, axis=0 if below else 1), 0.0, 1.0)
    spare = max(width - page.shape[1], 0)
    page = np.pad(page, ((0, 0), (spare // 2, spare - spare // 2), (0, 0)), constant_values=1.0)
    image = Image.fromarray(np.rint(255 * page).astype(np.uint8))
    how = {} if name.endswith(".png") else {"quality": 90, "subsampling": 0, "progressive": True}
    image.save(IMAGES / name, optimize=True, **how)
    if name in tooltips.PICTURED.values():
        write_tooltip(name, image)


def write_tooltip(name: str, page: Image.Image) -> None:
    """Write a picture of what can be chosen, small, for a tooltip in ParaView's panel."""
    small = page.convert("RGB").resize((TOOLTIP, round(page.height * TOOLTIP / page.width)), Image.Resampling.LANCZOS)
    small.save(tooltips.PICTURES / name, quality=80, optimize=True)
