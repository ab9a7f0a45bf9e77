"""Volumes as they are given in Python: files, images, grids of any kind, and large volumes."""

from __future__ import annotations

from pathlib import Path
from typing import TypeGuard

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData

from svv.dvr.draw.appearance import without_interpolation
from svv.dvr.draw.large import LargeVolume, open_volume
from svv.dvr.read.grids import as_volume
from svv.dvr.read.meshes import is_mesh, resampled
from svv.errors import BadInput, Progress, silent
from svv.options.making import ViewOptions

ARRAY = (
    "An array of numbers does not say in which order its axes are, and how large a voxel is: give "
    "svv.dvr.read.grids.from_array(array, spacing=(x, y, z)) for one indexed [z, y, x], or pyvista.wrap(array) for "
    "[x, y, z]."
)
OTHER = "A volume is a file, a VTK or PyVista image or grid, or blocks of these, not one of the type {kind}."
MEANS = (
    "The large volume has coarser levels of mean values, which no voxel has: open it with open_volume(path, "
    "nearest=True)."
)


def given_volume(
    volume: object,
    nearest: bool = False,
    options: ViewOptions = ViewOptions(),
    progress: Progress = silent,
) -> vtkImageData | LargeVolume:
    """Return a volume that is ready to be drawn.

    Args:
        volume: A file (see :func:`svv.dvr.draw.large.open_volume`), a large volume, an image, or another grid or blocks
            of grids, which are resampled to an image (:func:`svv.dvr.read.meshes.resampled`); all of them VTK's or
            PyVista's.
        nearest: Whether voxels are shown without interpolation; otherwise as the image says, and with it by default.
        options: How it is to be drawn.
        progress: Called often; the work stops when it raises.

    Raises:
        BadInput: It is none of these, or is rejected by what reads, resamples or checks it.
    """
    if isinstance(volume, (str, Path)):
        return open_volume(volume, mapper=options.mapper, memory=options.memory, progress=progress, nearest=nearest)
    if isinstance(volume, LargeVolume):
        if nearest and not volume.nearest:
            raise BadInput(MEANS)
        return volume
    if isinstance(volume, np.ndarray):
        raise BadInput(ARRAY)
    if _is_grid(volume):
        volume = resampled(volume, name="The volume")
    if not isinstance(volume, vtkImageData):
        raise BadInput(OTHER.format(kind=type(volume).__name__))
    image = as_volume(volume)
    return without_interpolation(image) if nearest else image


def _is_grid(volume: object) -> TypeGuard[vtkDataObject]:
    return is_mesh(volume)
