"""Philips' research files (``.PAR`` with ``.REC``), as nibabel reads them: scaled by each slice's factor, placed in mm.

Coordinates are nibabel's: x to the right, y to the front and z upwards.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from svv.bricks.formats.axes import Choice, picked
from svv.bricks.formats.chunked import ChunkedSource, package
from svv.bricks.formats.source import level_of
from svv.errors import BadInput


def par_of(file: Path) -> Path | None:
    """Return the ``.PAR`` file of a pair of which either is named; None if it is none (maps may end in .rec)."""
    beside = (file.with_suffix(ending) for ending in (".PAR", ".par"))
    if file.suffix.lower() == ".par":
        return file
    return next((one for one in beside if one.is_file()), None) if file.suffix.lower() == ".rec" else None


def open_par(file: Path, choice: Choice = Choice()) -> ChunkedSource:  # noqa: B008 - frozen
    """Open a volume of Philips' scanners, which is decoded as a whole.

    Args:
        file: The ``.PAR`` file.
        choice: The time point (of dynamics, or whatever else there are several of) that is shown.

    Raises:
        BadInput: It is damaged or cut off, lacks its ``.REC``, has several volumes of which none is chosen, or nibabel
            is not installed.
    """
    parrec, holder = package("nibabel.parrec", file), package("nibabel", file).FileHolder
    rec = next((one for end in (".REC", ".rec") if (one := file.with_suffix(end)).is_file()), None)
    if rec is None:
        raise BadInput(f"{file} needs its values, {file.stem}.REC, beside it.")
    try:
        with warnings.catch_warnings():  # of what is told about gradients and repetition times
            warnings.simplefilter("ignore")
            with file.open() as head, rec.open("rb") as stored:  # nibabel itself leaves them open
                parts = {"header": holder(fileobj=head), "image": holder(fileobj=stored)}
                image = parrec.PARRECImage.from_file_map(parts)
                place, shape = np.asarray(image.affine, np.float64), image.shape
                values = np.asarray(image.dataobj, np.float32).T
    except Exception as error:  # a damaged file makes nibabel raise all kinds of errors
        said = " ".join(str(error).split())[:200].strip(". ")
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or of another version ({said}).") from error
    pick = picked("tzyx"[-len(shape) :], values.shape, choice, file.name)
    level = level_of(pick.sides(values.shape), place[:3, :3], place[:3, 3], file.name)
    return ChunkedSource(file.name, [lambda start, stop: pick.box(values, start, stop)], values.dtype, [level])
