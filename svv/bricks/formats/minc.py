"""MINC 2: HDF5 files of medical imaging, read through nibabel, which knows their scales of single slices."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from svv.bricks.formats.axes import Choice, picked, roles
from svv.bricks.formats.chunked import ChunkedSource, package
from svv.bricks.source import level_of

if TYPE_CHECKING:
    import h5py


class _Scaled:
    """The values of a file, of which boxes are read."""

    def __init__(self, minc: Any) -> None:
        self._minc = minc

    def __getitem__(self, index: tuple[int | slice, ...]) -> Any:
        return self._minc.get_scaled_data(index)


def minc_source(opened: h5py.File, file: Path, choice: Choice) -> ChunkedSource:
    """Return the volume of an open MINC 2 file, in its own coordinates: x to the right, y to the front, z upwards.

    Raises:
        BadInput: It is no volume, has several time points of which none is chosen, or nibabel is not installed.
    """
    package("nibabel", file)
    from nibabel.minc2 import Minc2File

    minc = Minc2File(opened)
    shape, affine, stored = minc.get_data_shape(), minc.get_affine(), opened["minc-2.0/image/0/image"].dtype
    dimensions = opened["minc-2.0/image/0/image"].attrs["dimorder"]
    text = dimensions.decode() if isinstance(dimensions, bytes) else str(dimensions)
    names, _ = roles(text.split(","), shape)
    pick = picked(names, shape, choice, file.name)
    space = [name for name in names if name in ("x", "y", "z")]
    columns = [space.index(letter) for letter in "xyz"]
    level = level_of(pick.sides(shape), affine[:3, columns], affine[:3, 3], file.name)
    kind = stored if stored.kind == "f" else np.dtype(np.float32 if stored.itemsize <= 2 else np.float64)
    return ChunkedSource(file.name, [partial(pick.box, _Scaled(minc))], kind, [level])
