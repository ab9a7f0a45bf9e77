"""Volumes as they are given in Python: files, arrays, images, grids of any kind, plotters, and large volumes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData
from vtkmodules.vtkRenderingCore import vtkProp3D, vtkRenderer, vtkVolumeProperty

from svv.core.geometry.given_cameras import Plotter
from svv.dvr.draw.large import LargeVolume, open_volume
from svv.dvr.draw.plotted import function_of, image_shown
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import without_interpolation
from svv.dvr.read.grids import Triple, as_volume, assumed_of, from_array, put_assumed
from svv.dvr.read.meshes import describe_resampling, is_mesh, resampled
from svv.errors import BadInput, Progress, silent
from svv.options.making import ViewOptions

GivenVolume = (
    str | Path | NDArray[Any] | vtkDataObject | LargeVolume | vtkProp3D | vtkRenderer | Plotter | Sequence[vtkProp3D]
)

GivenFunction = TransferFunction | str | Path | vtkVolumeProperty | vtkProp3D | vtkRenderer | Plotter

NO_FUNCTION = (
    "A transfer function is an svv.TransferFunction, a file, a vtkVolumeProperty, or an actor or plotter that has one, "
    "not one of the type {kind}."
)

TAKEN = (
    "The array was taken for [z, y, x], with voxels of 1 x 1 x 1: spacing=(x, y, z) gives another size, and "
    "array.transpose(2, 1, 0) is what to give of an array [x, y, z]."
)
PLACED = "spacing and origin are for arrays; {kind} has its own."
OTHER = (
    "A volume is a file, a NumPy array, a VTK or PyVista image or grid, blocks of these, or a plotter or actor that "
    "shows one, not one of the type {kind}."
)
MEANS = (
    "The large volume has coarser levels of mean values, which no voxel has: open it with open_volume(path, "
    "nearest=True)."
)


def given_volume(
    volume: object,
    nearest: bool = False,
    options: ViewOptions = ViewOptions(),
    progress: Progress = silent,
    spacing: Triple | None = None,
    origin: Triple | None = None,
) -> vtkImageData | LargeVolume:
    """Return a volume that is ready to be drawn.

    It is given as a file (:func:`svv.dvr.draw.large.open_volume`); as an array of numbers [z, y, x], with its
    ``spacing`` (1 by default) and ``origin`` (0) in world units, (x, y, z) each; as a large volume; as an image, grid
    or blocks of grids, which are resampled (:func:`svv.dvr.read.meshes.resampled`); or by what shows one
    (:func:`svv.dvr.draw.plotted.image_shown`), of VTK or PyVista. With ``nearest``, voxels are shown without
    interpolation, otherwise as the image says.

    Raises BadInput if it is none of these, or is rejected by what reads, resamples or checks it.
    """
    if isinstance(volume, np.ndarray):
        image = _of_array(volume, spacing, origin)
        return without_interpolation(image) if nearest else image
    if spacing is not None or origin is not None:
        raise BadInput(PLACED.format(kind="a file" if isinstance(volume, (str, Path)) else "what was given"))
    if isinstance(volume, (str, Path)):
        return open_volume(volume, mapper=options.mapper, memory=options.memory, progress=progress, nearest=nearest)
    if isinstance(volume, LargeVolume):
        if nearest and not volume.nearest:
            raise BadInput(MEANS)
        return volume
    shown = image_shown(volume)
    if shown is None and is_mesh(volume):
        shown = as_volume(resampled(volume, name="The volume"))
        put_assumed(shown, " ".join(filter(None, (assumed_of(shown), describe_resampling(volume, shown)))))
    elif shown is None and isinstance(volume, vtkImageData):
        shown = as_volume(volume)
    elif shown is None:
        raise BadInput(OTHER.format(kind=type(volume).__name__))
    return without_interpolation(shown) if nearest else shown


def given_function(tf: GivenFunction | None, volume: object) -> tuple[TransferFunction | None, bool]:
    """Return a transfer function, and whether it is one of VTK's objects; None stands for a default.

    It is given as a function, a file, or what has one (:func:`svv.dvr.draw.plotted.function_of`); without one, what
    shows the volume has it. Raises BadInput if it is none of these, or is rejected by what reads or checks it.
    """
    if isinstance(tf, (str, Path)):
        return TransferFunction.read(tf), False
    if tf is None or isinstance(tf, TransferFunction):
        own = function_of(volume) if tf is None else None
        return own or tf, own is not None
    found = function_of(tf)
    if found is None:
        raise BadInput(NO_FUNCTION.format(kind=type(tf).__name__))
    return found, True


def _of_array(values: NDArray[Any], spacing: Triple | None, origin: Triple | None) -> vtkImageData:
    """Return an array indexed [z, y, x] as an image, and let it carry what was assumed."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        real = np.promote_types(values.dtype, np.float32) if values.dtype.kind in "buif" else values.dtype
        values = np.ma.filled(values.astype(real), np.nan) if real.kind == "f" else values
    if not values.size:
        raise BadInput(f"The array is empty: its shape is {values.shape}.")
    steps = _three(spacing, "spacing", (1.0, 1.0, 1.0))
    if min(steps) <= 0.0:
        raise BadInput(f"The spacing needs three positive numbers (x, y, z), not {spacing}.")
    image = as_volume(from_array(np.asarray(values), steps, _three(origin, "origin", (0.0, 0.0, 0.0))))
    put_assumed(image, " ".join(filter(None, (assumed_of(image), TAKEN if spacing is None else None))) or None)
    return image


def _three(numbers: Any, name: str, otherwise: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return three finite numbers; raises BadInput for anything else."""
    if numbers is None:
        return otherwise
    try:
        x, y, z = (float(number) for number in numbers)
    except (TypeError, ValueError):
        x = y = z = np.nan
    if not np.isfinite((x, y, z)).all():
        raise BadInput(f"The {name} needs three finite numbers (x, y, z), not {numbers}.")
    return x, y, z
