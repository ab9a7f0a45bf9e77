"""Pictures of MatCaps as regions hold them (:mod:`svv.core.colour.matcaps`): a name of one that ships, or text.

A picture from a file is kept small, as text, which scene files hold like any other edit.
:mod:`svv.fields.scene.matcaps` draws them.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.matcaps import MATCAPS, matcap_picture
from svv.errors import BadInput
from svv.io.pictures.picture_data import as_data, picture_in
from svv.io.pictures.style_picture import read_style

if TYPE_CHECKING:
    from torch import Tensor

STORED = 160
"""Side in pixels of MatCaps from files: they are smooth, and every step of a history holds them."""

NOT_SQUARE = 0.02
"""Largest difference of a MatCap's sides, as a fraction of its width."""

NONE = "none"


def validate_matcap(text: str) -> str | None:
    """Return a MatCap as a region holds it, from a name, a file, or what a region holds; None for none.

    Raises BadInput if it is neither a name nor a file, or the picture is broken or not square.
    """
    text = str(text).strip()
    if text.lower() in (NONE, ""):
        return None
    name = text.lower().replace("_", "-").replace(" ", "-")
    if name in MATCAPS:
        return name
    if text.startswith("data:"):
        _check_square(picture_in(text, "The picture of a MatCap").shape, "The picture of a MatCap")
        return text
    if not Path(text).is_file():
        raise BadInput(
            f"There is no MatCap '{text}': choose one of {', '.join(MATCAPS)}, {NONE}, or the file of a square "
            "picture of a sphere."
        )
    picture = read_style(text)
    _check_square(picture.shape, text)
    return as_data(picture, STORED, sharp=True)


def describe_matcap(text: str | None) -> str:
    """Return a few words about a region's MatCap, or its name; a picture is not spelled out."""
    return (text and ("of a picture" if text.startswith("data:") else text)) or "none"


def _check_square(shape: tuple[int, ...], name: str) -> None:
    height, width = shape[:2]
    if abs(width - height) > NOT_SQUARE * max(width, height):
        raise BadInput(
            f"{name} has {width} x {height} pixels, but a MatCap is square, filled by a sphere: cut it to the sphere."
        )


def read_matcap(matcap: str) -> NDArray[np.floating]:
    """Return the picture of a region's MatCap, sRGB in [0, 1]; raises BadInput if there is none. (H, W, 3)"""
    if matcap.startswith("data:"):
        return picture_in(matcap, "The picture of a MatCap")
    if matcap not in MATCAPS:
        raise BadInput(f"This version of svv has no MatCap '{matcap}': choose one of {', '.join(MATCAPS)}.")
    return matcap_picture(matcap)


@lru_cache(maxsize=32)
def picture_of(matcap: str) -> Tensor:
    """Return what :func:`read_matcap` does, to be drawn. (H, W, 3)"""
    import torch

    return torch.from_numpy(read_matcap(matcap).copy())
