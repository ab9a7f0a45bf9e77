"""Style pictures that may be hard to paint with."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.io.pictures.style_picture import read_style

STYLE_SIZE = 128
"""Side of the style pictures in pixels."""


def strokes() -> NDArray[np.float32]:
    """Return a painting made by this package, (h, w, 3) in [0, 1]."""
    from svv.styles.gallery.textures import style_picture

    return style_picture("brush strokes", STYLE_SIZE).astype(np.float32)


def flat() -> NDArray[np.float32]:
    """Return a picture of one colour."""
    return np.full((STYLE_SIZE, STYLE_SIZE, 3), (0.2, 0.55, 0.5), np.float32)


def dark() -> NDArray[np.float32]:
    """Return a nearly black picture."""
    return np.float32(0.06) * strokes()


def grey() -> NDArray[np.float32]:
    """Return a picture in shades of grey."""
    return np.repeat(strokes().mean(axis=2, keepdims=True), 3, axis=2)


def tiny() -> NDArray[np.float32]:
    """Return a picture of the smallest accepted size, 16 x 16."""
    return strokes()[:16, :16]


def barely_masked() -> NDArray[np.float32]:
    """Return a picture, read from a file, that is transparent except for 1 % of its area."""
    rgba = np.zeros((STYLE_SIZE, STYLE_SIZE, 4), np.uint8)
    rgba[..., :3] = np.rint(255 * strokes())
    side = STYLE_SIZE // 10
    rgba[:side, :side, 3] = 255
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "style.png"
        Image.fromarray(rgba).save(path)
        return read_style(path)
