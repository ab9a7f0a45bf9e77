"""Pictures of a Cinema database, with alpha: their own, or that of two pictures over different backgrounds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput, Progress, part
from svv.io.cinema.hdf5 import SUFFIXES, read_channels
from svv.io.views.straight import AlphaName
from svv.io.views.view_images import decode, in_threads, with_alpha

Images = NDArray[np.uint8]

LEAST_CONTRAST = 64
"""Levels by which the backgrounds of a pair must differ."""


def read_pictures(files: Sequence[Path], progress: Progress) -> tuple[list[Images], list[dict[str, object]]]:
    """Decode pictures (height, width, 3 or 4), and HDF5 files' metadata; BadInput if sizes differ or one is damaged."""
    read = list(in_threads(_read, files, progress, "Reading images"))
    first = read[0][0].shape
    for file, (picture, _) in zip(files, read, strict=True):
        if picture.shape[:2] != first[:2]:
            raise BadInput(
                f"All images of a database must have the same size, but {files[0].name} has {first[1]} x {first[0]} "
                f"and {file.name} has {picture.shape[1]} x {picture.shape[0]} pixels."
            )
    return [picture for picture, _ in read], [meta for _, meta in read]


def transparent(
    pictures: list[Images], files: Sequence[Path], alpha: AlphaName | None = None
) -> tuple[Images, str | None]:
    """Return pictures as RGBA with straight alpha, and a sentence on what was assumed about it."""
    images, assumed = with_alpha(pictures, list(files), alpha, "give --alpha {alpha}")
    return np.stack(images), assumed


def read_pair(first: Sequence[Path], second: Sequence[Path], progress: Progress) -> Images:
    """Return RGBA uint8 from files of the same views over two backgrounds, usually white and black.

    (n, height, width, 4) Over a background b, a picture is C = alpha c + (1 - alpha) b, so that two of them give alpha
    = 1 - mean (C1 - C2) / (b1 - b2) and c = (C2 - (1 - alpha) b2) / alpha (Smith and Blinn 1996), straight. Raises
    BadInput if the pictures differ in size, already have alpha, or their backgrounds are not uniform or too similar.
    """
    ones, _ = read_pictures(first, part(progress, 0.0, 0.45))
    others, _ = read_pictures(second, part(progress, 0.45, 0.9))
    if ones[0].shape[:2] != others[0].shape[:2]:
        raise BadInput("The images over black have another size than those over white; write both at one size.")
    backgrounds = [_background(p, f) for p, f in ((ones, first), (others, second))]
    contrast = backgrounds[0] - backgrounds[1]
    if np.abs(contrast).min() < LEAST_CONTRAST:
        raise BadInput(
            f"The backgrounds of the two databases are too similar ({_shown(backgrounds[0])} and "
            f"{_shown(backgrounds[1])}) to give alpha; write one over white and one over black."
        )
    images = np.empty((len(ones), *ones[0].shape[:2], 4), np.uint8)
    for k, (one, other) in enumerate(zip(ones, others, strict=True)):
        a, b = one[..., :3].astype(np.float64), other[..., :3].astype(np.float64)
        alpha = np.clip(1.0 - ((a - b) / contrast).mean(axis=-1, keepdims=True), 0.0, 1.0)
        level = np.rint(255.0 * alpha)
        # Both pictures show the colour; their mean halves the error of rounding.
        behind = (1.0 - alpha) * 0.5 * (backgrounds[0] + backgrounds[1])
        colour = (0.5 * (a + b) - behind) / np.maximum(alpha, 1.0 / 510.0)
        images[k, ..., :3] = np.where(level > 0, np.clip(np.rint(colour), 0, 255), 0)
        images[k, ..., 3:] = level
        progress(0.9 + 0.1 * (k + 1) / len(ones), "Joining images")
    return images


def _read(file: Path) -> tuple[Images, dict[str, object]]:
    return read_channels(file) if file.suffix.lower() in SUFFIXES else (decode(file), {})


def _background(pictures: list[Images], files: Sequence[Path]) -> NDArray[np.float64]:
    if any(p.shape[-1] == 4 and p[..., 3].min() < 255 for p in pictures):
        raise BadInput(f"The images in {files[0].parent} already have alpha: leave out --black.")
    corners = np.concatenate([p[:: len(p) - 1 or 1, :: p.shape[1] - 1 or 1, :3].reshape(-1, 3) for p in pictures])
    background = np.median(corners.astype(np.float64), axis=0)
    if np.abs(corners - background).max() > 2.0:
        raise BadInput(f"The images in {files[0].parent} have no uniform background in their corners.")
    return background


def _shown(colour: NDArray[np.float64]) -> str:
    return ", ".join(f"{int(c)}" for c in colour)
