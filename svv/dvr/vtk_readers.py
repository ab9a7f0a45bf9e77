"""Running VTK's readers: what they complain about becomes one sentence, and no header asks for more than there is."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkRectilinearGrid
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

from svv.errors import BadInput

EVEN = 4 * float(np.finfo(np.float32).eps)
"""Part of a coordinate by which even steps may differ: files hold coordinates in single precision."""


@contextmanager
def vtk_messages() -> Iterator[Callable[[], str]]:
    """Collect what VTK has to say; the function that it gives returns the text so far.

    VTK's logger, and the libraries below it (MetaIO, libtiff), also write to the process's standard error without
    asking; that goes nowhere meanwhile.
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


def run(reader: Any, path: Path) -> vtkImageData:
    """Run a VTK reader on a file or a folder.

    Raises:
        BadInput: VTK complained, or what it read is no regular grid.
    """
    with vtk_messages() as messages:
        (reader.SetDirectoryName if path.is_dir() else reader.SetFileName)(str(path))
        check_size(reader, path)
        reader.Update()
        output = reader.GetOutputDataObject(0)
        said = messages()
    # Some readers only warn about missing data and leave the rest of the memory as it was.
    if output is None or reader.GetErrorCode() or re.search("error|fail", said, re.IGNORECASE):
        raise damaged(path)
    if output.IsA("vtkRectilinearGrid"):
        return _evenly_spaced(output, path)
    if not output.IsA("vtkImageData"):
        raise BadInput(f"{path} holds a {output.GetClassName()}, not a regular volume (image data).")
    return output


def _evenly_spaced(grid: vtkRectilinearGrid, path: Path) -> vtkImageData:
    """A rectilinear grid as image data, where its planes lie as far apart from each other as single precision tells."""
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
                raise BadInput(
                    f"{path} is a grid with uneven steps along {'xyz'[axis]}; resample it to image data first."
                )
    image.SetOrigin(origin)
    image.SetSpacing(spacing)
    image.GetPointData().ShallowCopy(grid.GetPointData())
    image.GetCellData().ShallowCopy(grid.GetCellData())
    return image


def check_size(reader: Any, file: Path) -> None:
    """Refuse a header that asks for more than there is, which VTK would answer by ending the process."""
    reader.UpdateInformation()
    about = reader.GetOutputInformation(0)
    key = vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT()
    if not about.Has(key):
        return
    extent = [about.Get(key, i) for i in range(6)]
    size = [extent[2 * i + 1] - extent[2 * i] + 1 for i in range(3)]
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 2**40
    if min(size) < 1:
        raise damaged(file)
    if size[0] * size[1] * size[2] > memory:
        shape = " x ".join(str(d) for d in size)
        raise BadInput(f"{file} says that it holds {shape} voxels, more than this computer's memory can hold.")


def damaged(file: Path) -> BadInput:
    """What to raise for a file that its reader stumbles over."""
    return BadInput(f"Cannot read {file}: it is damaged, incomplete, or not what its name says.")
