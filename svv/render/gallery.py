"""The gallery of style pictures written to a folder, with a contact sheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from svv.errors import BadInput, Progress, part, silent
from svv.io.files.atomic import make_folder
from svv.io.pictures.output import to_bytes, write_png, write_small_png
from svv.options.making import DRAWN, PREFIX
from svv.render.pictures import Picture, sheet
from svv.styles.gallery import gallery_name, gallery_picture

COLUMNS, SIDE = 4, 180
"""Number of pictures in a row of the contact sheet, and their side in pixels."""


def write_gallery(folder: Path, names: Sequence[str], size: int, seed: int = 0, progress: Progress = silent) -> Path:
    """Write style pictures of the gallery (:data:`svv.styles.gallery.GALLERY`) as ``NAME.png``, 16 to 1024 pixels.

    All have one seed. Returns the contact sheet, ``gallery.png``. Raises BadInput if a name is unknown, the size is out
    of range, or the folder cannot be written to.
    """
    make_folder(folder)
    pictures = []
    for number, name in enumerate(names):
        here = part(progress, number / len(names), (number + 1) / len(names))
        here(0.0, name)
        picture = to_bytes(gallery_picture(name, size, seed, here))
        write_png(folder / f"{name}.png", picture)
        pictures.append(picture)
    path = folder / "gallery.png"
    write_small_png(path, contact_sheet(pictures, names))
    progress(1.0, "")
    return path


def style_file(source: str, folder: Path) -> Path:
    """Return the file of a style, for ``gallery:NAME`` one in ``folder``; BadInput if unknown or without a picture."""
    if source.startswith(DRAWN):
        raise BadInput(f"{source} is drawn without a picture, but a picture is needed here; use it with svv stylize.")
    if not source.startswith(PREFIX):
        return Path(source)
    path = make_folder(folder) / f"{gallery_name(source.removeprefix(PREFIX))}.png"
    if not path.is_file():  # rewriting it would make results based on it look outdated
        write_png(path, to_bytes(gallery_picture(path.stem)))
    return path


def contact_sheet(pictures: Sequence[Picture], names: Sequence[str]) -> Picture:
    """Arrange square pictures in rows of four on white, each under its name."""
    small = [np.asarray(Image.fromarray(p).resize((SIDE, SIDE), Image.Resampling.LANCZOS)) for p in pictures]
    columns = min(COLUMNS, len(small))
    slices = [slice(first, first + columns) for first in range(0, len(small), columns)]
    rows = [sheet([small[own]], names[own]) for own in slices]
    width = max(row.shape[1] for row in rows)
    padded = [np.pad(row, ((0, 8), (0, width - row.shape[1]), (0, 0)), constant_values=255) for row in rows]
    return np.concatenate(padded)
