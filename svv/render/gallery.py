"""The gallery of style pictures written to a folder, with a contact sheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from svv.errors import BadInput, Progress, part, silent
from svv.io.atomic import make_folder
from svv.io.output import to_bytes, write_png, write_small_png
from svv.options.making import DRAWN, PREFIX
from svv.render.pictures import Picture, sheet
from svv.styles.gallery import gallery_name, gallery_picture

COLUMNS, SIDE = 4, 180
"""Pictures beside each other on the contact sheet, and how large."""


def write_gallery(folder: Path, names: Sequence[str], size: int, seed: int = 0, progress: Progress = silent) -> Path:
    """Write style pictures of the gallery as ``NAME.png``, and ``gallery.png`` with all of them.

    Args:
        folder: Made where it is missing.
        names: Of :data:`svv.styles.gallery.GALLERY`.
        size: Side in pixels, 16 to 1024.
        seed: Of all of them.
        progress: Called before each.

    Returns:
        The contact sheet.

    Raises:
        BadInput: an unknown name, a size out of range, or a folder that cannot be written to.
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
    """The file of a style: the one named, or for ``gallery:NAME`` one that is written to a folder, if it is not there.

    Raises:
        BadInput: an unknown name, or a folder that cannot be written to.
    """
    if source.startswith(DRAWN):
        raise BadInput(f"{source} is drawn without a picture, and here one is needed; svv stylize takes it.")
    if not source.startswith(PREFIX):
        return Path(source)
    path = make_folder(folder) / f"{gallery_name(source.removeprefix(PREFIX))}.png"
    if not path.is_file():  # else what was made of it would seem to be of another picture
        write_png(path, to_bytes(gallery_picture(path.stem)))
    return path


def contact_sheet(pictures: Sequence[Picture], names: Sequence[str]) -> Picture:
    """Square pictures in rows of four, each under its name, on white."""
    small = [np.asarray(Image.fromarray(p).resize((SIDE, SIDE), Image.Resampling.LANCZOS)) for p in pictures]
    columns = min(COLUMNS, len(small))
    rows = [
        sheet([small[first : first + columns]], names[first : first + columns])
        for first in range(0, len(small), columns)
    ]
    width = max(row.shape[1] for row in rows)
    whole = np.concatenate(
        [np.pad(row, ((0, 8), (0, width - row.shape[1]), (0, 0)), constant_values=255) for row in rows]
    )
    return whole
