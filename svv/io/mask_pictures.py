"""Pictures that show masks: a style picture with what is selected, its points, or its numbered regions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt

from svv.io.mask_file import Mask, Selection
from svv.io.output import to_bytes

Colours = NDArray[np.float32]

WANTED, UNWANTED = "#1fb24a", "#e0261b"

PAINTS = ((0.90, 0.16, 0.22), (0.12, 0.47, 0.71), (0.20, 0.63, 0.17), (1.0, 0.60, 0.0), (0.55, 0.25, 0.75),
          (0.0, 0.70, 0.72), (0.95, 0.45, 0.70), (0.55, 0.40, 0.20))  # fmt: skip


def mask_overlay(picture: ArrayLike, mask: Mask, selection: Selection | None = None) -> NDArray[np.uint8]:
    """The picture with what is not in the mask darkened and grey, the outline drawn, and the points: + and -.

    Args:
        picture: (h, w, 3) in [0, 1].
        mask: (h, w).
        selection: Whose points are shown.

    Returns:
        (h, w, 3) levels.
    """
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
    """The picture with its regions tinted, outlined and numbered: (h, w, 3) levels."""
    values = np.asarray(picture, np.float32)
    paints = np.asarray(PAINTS, np.float32)
    shown = 0.62 * values + 0.38 * paints[labels % len(paints)]
    shown = _outlined(shown, labels, np.ones(3, np.float32))
    image = Image.fromarray(to_bytes(shown))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(max(14, max(labels.shape) // 24))
    for number in range(int(labels.max()) + 1):
        room = np.asarray(distance_transform_edt(np.pad(labels == number, 1)))[1:-1, 1:-1]
        y, x = np.unravel_index(int(room.argmax()), room.shape)
        draw.text(
            (float(x), float(y)), str(number), fill="white", stroke_width=2, stroke_fill="black", anchor="mm", font=font
        )
    return np.asarray(image)


def _outlined(shown: Colours, labels: NDArray[np.integer], colour: Colours) -> Colours:
    edge = np.zeros(labels.shape, bool)
    edge[1:] |= labels[1:] != labels[:-1]
    edge[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    return np.where(edge[..., None], colour, shown)
