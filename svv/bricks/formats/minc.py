"""MINC files, versions 1 and 2, by nibabel: values by their slices' ranges, placed as MINC places them.

Coordinates are the file's, in mm: x to the right, y to the front and z upwards. VTK reads version 1 alone, and without
its direction cosines.

Source: https://en.wikibooks.org/wiki/MINC/Reference.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from svv.bricks.formats.axes import Choice, picked
from svv.bricks.formats.chunked import package
from svv.bricks.formats.stored import too_large
from svv.bricks.source import ArraySource, level_of
from svv.errors import BadInput
from svv.io.files.memory import memory_there

OTHERS = {"time": "t", "vector_dimension": "c"}
"""Axes that are not in space, by their names."""


def open_minc(path: Path, choice: Choice = Choice()) -> ArraySource:  # noqa: B008 - frozen
    """Read a MINC file.

    Args:
        path: The file.
        choice: The time point and the channel (MINC's vector dimension) that are shown.

    Raises:
        BadInput: It is damaged or something that nibabel does not read, such as uneven planes; it has several time
            points or channels of which none is chosen; or nibabel is not installed.
    """
    nibabel = package("nibabel", path)
    try:
        image = nibabel.load(path)
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
    sides = pick.sides(shape)
    if 8 * int(np.prod(sides, dtype=object)) > memory_there():
        raise too_large(path, sides[::-1])
    steps, origin = place[:3, 2::-1], place[:3, 3]  # columns for x, y, z; nibabel has those of the stored order
    level_of(sides, steps, origin, path.name)
    index = tuple(slice(None) if k is None else slice(k, k + 1) for k in pick.fixed)
    values = np.asarray(image.dataobj[index]).reshape([side for side, k in zip(shape, pick.fixed) if k is None])
    narrow = values.astype(np.float32 if stored.itemsize <= 2 else values.dtype, copy=False)
    return ArraySource(narrow, steps, origin, path.name)
