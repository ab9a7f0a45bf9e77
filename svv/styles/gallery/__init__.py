"""The gallery: style pictures that this package paints when they are first asked for, and then caches.

All of them are generated from a seed and belong to the project. Wherever a style picture is expected,
``gallery:NAME`` names one of these instead of a file.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv._version import __version__
from svv.errors import BadInput, Progress, silent
from svv.io.files.cache import Cache, cache_folder
from svv.io.pictures.output import to_bytes, write_png
from svv.io.pictures.style_picture import SMALLEST, read_style
from svv.options.making import DRAWN, PREFIX
from svv.styles.gallery.offered import GALLERY

SIZE = 512
LARGEST = 1024
"""Largest side in pixels of a painted picture; styles are never used larger."""
VERSION = 1
"""To be raised with any change of a painter; cached pictures of older versions are then painted again."""

BOUND = 100_000_000
"""Maximum size in bytes of all pictures that are kept; those that were painted first are removed first."""

NAME = re.compile(r"[a-z-]+-\d+-\d+-[\w.+]+-\d+(\.png)?")
"""Pattern of their names: picture, side, seed, and versions."""


def pictures() -> Cache:
    """Return the cache of the gallery's pictures, the folder ``gallery`` of the user's cache."""
    return Cache(cache_folder() / "gallery", BOUND, NAME)


def gallery_name(text: str) -> str:
    """Normalize a gallery picture's name, in any case, with spaces or underscores; raises BadInput if unknown."""
    name = text.strip().lower().replace("_", "-").replace(" ", "-")
    if name not in GALLERY:
        raise BadInput(f"There is no '{text}' in the gallery; choose one of {', '.join(GALLERY)}.")
    return name


def gallery_picture(name: str, size: int = SIZE, seed: int = 0, progress: Progress = silent) -> NDArray[np.float32]:
    """Return a style picture of the gallery, from the user's cache or painted (1 to 10 s at 512 pixels) and cached.

    ``name`` is one of :data:`GALLERY`, ``size`` the side in pixels, 16 to 1024, with which strokes scale; each ``seed``
    gives another picture in the same manner. The picture (size, size, 3) is float32 sRGB in [0, 1] in 8-bit levels,
    also if not cached. Raises BadInput if the name is unknown, the size is out of range, or the seed is negative.
    """
    name = gallery_name(name)
    if not SMALLEST <= size <= LARGEST:
        raise BadInput(f"Pictures of the gallery have {SMALLEST} to {LARGEST} pixels a side, not {size}.")
    if seed < 0:
        raise BadInput(f"The seed must be a whole number of at least 0, not {seed}.")
    kept = pictures().folder / f"{name}-{size}-{seed}-{__version__}-{VERSION}.png"
    if kept.is_file():
        try:
            found = read_style(kept)
        except BadInput:  # damaged: it is painted again
            found = None
        if found is not None and found.shape == (size, size, 3):
            return found
    progress(0.0, f"painting {name}")
    levels = to_bytes(_painted(name, size, seed))
    with suppress(BadInput, OSError):  # without a writable home with space left, it is painted every time
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_png(kept, levels)
        pictures().trim(kept)
    return levels.astype(np.float32) / np.float32(255)


def _painted(name: str, size: int, seed: int) -> NDArray[np.float32]:
    # Some steps of the painters take a whole number of pixels, which would be zero below this side.
    side = max(size, 128)
    picture = GALLERY[name][0](np.random.default_rng(seed), side)
    if side == size:
        return picture
    from skimage.transform import resize

    return np.asarray(resize(picture, (size, size), anti_aliasing=True), dtype=np.float32)


def open_style(source: str | Path, progress: Progress = silent) -> tuple[str, NDArray[np.float32]]:
    """Return name and content of a style picture, ``gallery:NAME`` or a file; BadInput if unreadable, or an ink."""
    text = str(source)
    if text.startswith(DRAWN):
        raise BadInput(f"{text} is drawn without a picture, but a picture is needed here: name a file or {PREFIX}NAME.")
    if text.startswith(PREFIX):
        name = gallery_name(text.removeprefix(PREFIX))
        return name, gallery_picture(name, progress=progress)
    if text in GALLERY and not Path(text).exists():
        raise BadInput(f"There is no style picture at {text}; for the one in the gallery, write {PREFIX}{text}.")
    return Path(text).stem, read_style(text)
