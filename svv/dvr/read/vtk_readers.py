"""Running of VTK's readers: their errors become one sentence, and headers that exceed the memory are rejected."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkCommonDataModel import (
    vtkCompositeDataSet,
    vtkDataObject,
    vtkDataSet,
    vtkHyperTreeGrid,
    vtkImageData,
    vtkRectilinearGrid,
)
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm, vtkStreamingDemandDrivenPipeline

from svv.bricks.formats.axes import Choice, check_alone, picked
from svv.bricks.formats.stored import damaged, too_large
from svv.errors import BadInput
from svv.io.files.memory import memory_there

EVEN = 4 * float(np.finfo(np.float32).eps)
"""Relative tolerance of even steps: files store coordinates in single precision."""


@contextmanager
def vtk_messages() -> Iterator[Callable[[], str]]:
    """Collect VTK's messages; the function that it yields returns the text so far.

    What VTK's logger and libraries (MetaIO, libtiff) write to standard error meanwhile is discarded.
    """
    before, window = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    kept = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield window.GetOutput
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        vtkOutputWindow.SetInstance(before)


def run(reader: vtkAlgorithm, path: Path, choice: Choice = Choice()) -> vtkDataObject:  # noqa: B008 - frozen
    """Run a VTK reader on a file or folder, at the time point that is chosen if there are several.

    Returns an image, or a grid of another kind if it contains that (:func:`svv.dvr.read.meshes.is_mesh`). Raises
    BadInput if VTK reported an error, the data is no grid, or there are several time points of which none is chosen.
    """
    with vtk_messages() as messages:
        # A folder has the first of these names, EnSight's files the last.
        named = ("SetDirectoryName",) * path.is_dir() + ("SetFileName", "SetCaseFileName")
        next(getattr(reader, name) for name in named if hasattr(reader, name))(str(path))
        check_size(reader, path)
        _read_at(reader, path, choice)
        output = reader.GetOutputDataObject(0)
        said = messages()
    # Some readers only warn about missing data and leave the rest of the memory uninitialised.
    if output is None or reader.GetErrorCode() or re.search("error|fail", said, re.IGNORECASE):
        raise damaged(path)
    if output.IsA("vtkRectilinearGrid"):
        return _evenly_spaced(output)
    if not isinstance(output, (vtkDataSet, vtkCompositeDataSet, vtkHyperTreeGrid)):
        raise BadInput(f"{path} contains a {output.GetClassName()}, not a volume.")
    return output


def _read_at(reader: vtkAlgorithm, path: Path, choice: Choice) -> None:
    """Let a reader read the time point that is chosen, or the only one."""
    about, key = reader.GetOutputInformation(0), vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    times = about.Get(key) if about.Has(key) else ()
    if len(times) < 2:
        check_alone(choice, path)
        reader.Update()
        return
    sides = {"t": len(times), "z": 2, "y": 2, "x": 2}  # of these, only the number of times is known yet
    reader.UpdateTimeStep(times[picked(list(sides), list(sides.values()), choice, path.name).fixed[0] or 0])


def failed(path: Path, error: Exception) -> BadInput:
    """Return the error to raise for a file on which a reader raised what it should not."""
    said = str(error).strip().splitlines()
    text = f"{type(error).__name__}: {said[0].rstrip('.')}" if said else type(error).__name__
    return BadInput(
        f"Cannot read {path}: its reader failed ({text}), which does not mean that the file is damaged. If ParaView "
        "opens it, save it there as .vti, or as .vtu if it is a mesh."
    )


def _evenly_spaced(grid: vtkRectilinearGrid) -> vtkImageData | vtkRectilinearGrid:
    """Return a rectilinear grid as image data if its planes are evenly spaced within single precision."""
    image = vtkImageData()
    image.SetDimensions(grid.GetDimensions())
    origin, spacing = [0.0] * 3, [1.0] * 3
    for axis, planes in enumerate((grid.GetXCoordinates(), grid.GetYCoordinates(), grid.GetZCoordinates())):
        places = vtk_to_numpy(planes).astype(np.float64)
        steps = np.diff(places)
        origin[axis] = places[0]
        if steps.size:
            spacing[axis] = steps.mean()
            if np.abs(steps - spacing[axis]).max() > EVEN * max(np.abs(places).max(), abs(spacing[axis])):
                return grid
    image.SetOrigin(origin)
    image.SetSpacing(spacing)
    image.GetPointData().ShallowCopy(grid.GetPointData())
    image.GetCellData().ShallowCopy(grid.GetCellData())
    return image


def check_size(reader: vtkAlgorithm, file: Path) -> None:
    """Reject a header that asks for more memory than there is, for which VTK would end the process."""
    reader.UpdateInformation()
    about = reader.GetOutputInformation(0)
    key = vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT()
    if not about.Has(key):
        return
    extent = [about.Get(key, i) for i in range(6)]
    size = [extent[2 * i + 1] - extent[2 * i] + 1 for i in range(3)]
    if min(size) < 1:
        raise damaged(file)
    check_memory(size, 1, file)


def check_memory(size: Sequence[int], bytes_each: int, file: Path) -> None:
    """Reject a volume of ``size`` voxels along x, y, z that exceeds the memory that this process may use."""
    if size[0] * size[1] * size[2] * bytes_each > memory_there():
        raise too_large(file, size)
