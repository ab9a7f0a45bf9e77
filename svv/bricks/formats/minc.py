"""MINC files, versions 1 and 2, by nibabel: values by their slices' ranges, placed as MINC places them.

Coordinates are the file's, in mm: x to the right, y to the front and z upwards. VTK reads version 1 alone, and without
its direction cosines.

Source: https://en.wikibooks.org/wiki/MINC/Reference.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from svv.bricks.formats.axes import Choice, picked
from svv.bricks.formats.chunked import ChunkedSource, package
from svv.bricks.formats.source import level_of
from svv.errors import BadInput

OTHERS = {"time": "t", "vector_dimension": "c"}
"""Axes that are not in space, by their names."""


def open_minc(path: Path, choice: Choice = Choice()) -> ChunkedSource:  # noqa: B008 - frozen
    """Open a MINC file, whatever its name.

    Args:
        path: The file.
        choice: The time point and the channel (MINC's vector dimension) that are shown.

    Raises:
        BadInput: It is damaged or something that nibabel does not read, such as uneven planes; it has several time
            points or channels of which none is chosen; or nibabel is not installed.
    """
    nibabel = package("nibabel", path)
    try:
        with path.open("rb") as opened:
            kind = nibabel.Minc1Image if opened.read(3) == b"CDF" else nibabel.Minc2Image
        image = kind.from_file_map({"image": nibabel.FileHolder(str(path))})  # whatever the name
        names, shape, stored = image.dataobj.minc_file._dim_names, image.shape, image.get_data_dtype()
        place = np.asarray(image.affine, float)
    except Exception as error:  # a damaged file makes nibabel, h5py and SciPy raise all kinds of errors
        said = str(error).strip().splitlines() or [type(error).__name__]
        raise BadInput(
            f"nibabel cannot read {path} ({said[0].strip('.')}): it is damaged, or of a kind that has to be converted "
            "first, such as by mnc2nii."
        ) from error
    space = iter("zyx")
    axes = [next(space, "?") if name.endswith("space") else OTHERS.get(name, name) for name in names]
    pick = picked(axes, shape, choice, path.name)
    steps, origin = place[:3, 2::-1], place[:3, 3]  # columns for x, y, z; nibabel has those of the stored order
    level = level_of(pick.sides(shape), steps, origin, path.name)
    scaled = stored if stored.kind == "f" else np.dtype(np.float32 if stored.itemsize <= 2 else np.float64)
    return ChunkedSource(path.name, [partial(pick.box, image.dataobj)], scaled, [level])
