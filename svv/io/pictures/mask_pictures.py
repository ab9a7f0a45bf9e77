"""Pictures that show masks: a style picture with its selection, its points or its numbered regions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt

from svv.io.pictures.mask_file import Mask, Selection
from svv.io.pictures.output import to_bytes

Colours = NDArray[np.float32]

WANTED, UNWANTED = "#1fb24a", "#e0261b"
"""Colours of positive and negative points."""

PAINTS = ((0.90, 0.16, 0.22), (0.12, 0.47, 0.71), (0.20, 0.63, 0.17), (1.0, 0.60, 0.0), (0.55, 0.25, 0.75),
          (0.0, 0.70, 0.72), (0.95, 0.45, 0.70), (0.55, 0.40, 0.20))  # fmt: skip
"""Colours of regions, sRGB in [0, 1]; they are easy to tell apart."""


def mask_overlay(picture: ArrayLike, mask: Mask, selection: Selection | None = None) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3), sRGB in [0, 1], as levels: dark outside the mask, with its outline and its points."""
    values = np.asarray(picture, np.float32)
    grey = values.mean(-1, keepdims=True) * 0.28 + 0.06
    shown = np.where(mask[..., None], values, grey)
    shown = _outlined(shown, mask.astype(np.int64), np.asarray((1.0, 0.95, 0.2), np.float32))
    image = Image.fromarray(to_bytes(shown))
    if selection is not None:
        draw = ImageDraw.Draw(image)
        size = max(4, max(mask.shape) // 70)
        for points, colour in zip(selection.scaled(mask.shape), (WANTED, UNWANTED), strict=True):
            for x, y in points:
                rim, arm, thick = max(1, size // 5), 0.55 * size, max(1, size // 3)
                draw.ellipse((x - size, y - size, x + size, y + size), fill=colour, outline="white", width=rim)
                draw.line((x - arm, y, x + arm, y), fill="white", width=thick)
                if colour == WANTED:
                    draw.line((x, y - arm, x, y + arm), fill="white", width=thick)
    return np.asarray(image)


def regions_overlay(picture: ArrayLike, labels: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Return the picture with its regions tinted, outlined and numbered, as 8-bit levels. (h, w, 3)"""
    values = np.asarray(picture, np.float32)
    paints = np.asarray(PAINTS, np.float32)
    shown = 0.62 * values + 0.38 * paints[labels % len(paints)]
    shown = _outlined(shown, labels, np.ones(3, np.float32))
    return _numbered(to_bytes(shown), labels)


def region_map_overlay(region: NDArray[np.integer], colours: ArrayLike | None = None) -> NDArray[np.uint8]:
    """Return a scene's regions (h, w) in flat colours with numbers, as 8-bit levels; clear where they are -1. (h, w, 4)

    ``colours`` (regions, 3) are in [0, 1], by default clearly distinguishable ones.
    """
    paints = np.asarray(PAINTS if colours is None else colours, np.float32)
    shown = paints[np.maximum(region, 0) % len(paints)]
    alpha = np.where(region >= 0, 255, 0).astype(np.uint8)
    return np.concatenate([_numbered(to_bytes(shown), np.asarray(region, np.int64)), alpha[..., None]], axis=2)


def with_rulers(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return levels (h, w, 3) with rulers along upper and left edges, in pixels of a file of this ``size``."""
    height, width = picture.shape[:2]
    text = max(12, max(height, width) // 36)
    dark = np.arange(height)[:, None] < 1.9 * text, np.arange(width)[None] < 2.9 * text
    image = Image.fromarray(np.where((dark[0] | dark[1])[..., None], picture // 3, picture))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(text)
    least = 3.5 * text * max(size) / max(height, width)  # distance between two numbers, in pixels of the file
    step = next(s for k in range(9) for s in (10**k, 2 * 10**k, 5 * 10**k) if s >= least)
    for horizontal, length, pixels in ((True, size[0], width), (False, size[1], height)):
        for place in range(step, length - step // 4, step):
            at = place * pixels / length
            ends = (at, 0, at, text / 2) if horizontal else (0, at, text / 2, at)
            draw.line(ends, fill="black", width=4)
            draw.line(ends, fill="white", width=2)
            xy, anchor = ((at, 0.7 * text), "mt") if horizontal else ((0.7 * text, at), "lm")
            draw.text(xy, str(place), "white", font, anchor, stroke_width=1, stroke_fill="black")
    return np.asarray(image)


def _numbered(levels: NDArray[np.uint8], labels: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Write the number of each label (h, w) that is not negative onto a picture (h, w, 3), where it has most room."""
    image = Image.fromarray(levels)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(max(18, max(labels.shape) // 14))
    for number in range(int(labels.max()) + 1):
        room = np.asarray(distance_transform_edt(np.pad(labels == number, 1)))[1:-1, 1:-1]
        if not room.any():
            continue
        y, x = np.unravel_index(int(room.argmax()), room.shape)
        draw.text(
            (float(x), float(y)), str(number), fill="white", stroke_width=1, stroke_fill="black", anchor="mm", font=font
        )
    return np.asarray(image)


def _outlined(shown: Colours, labels: NDArray[np.integer], colour: Colours) -> Colours:
    edge = np.zeros(labels.shape, bool)
    edge[1:] |= labels[1:] != labels[:-1]
    edge[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    return np.where(edge[..., None], colour, shown)
