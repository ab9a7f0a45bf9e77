"""Formats beyond ours, by PyVista's list of VTK's readers: in the standalone installation, never inside ParaView.

PyVista stands on the VTK from PyPI, and a second VTK beside ParaView's own ends the process.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm

from svv.dvr.vtk_readers import vtk_messages


def reader_of(path: Path) -> Any | None:
    """VTK's reader of a file or of a folder of DICOM slices, as PyVista chooses it.

    Returns:
        A ``vtkAlgorithm`` whose file name is still to be set; None for a kind that PyVista reads without VTK or does
        not know, without PyVista, and inside ParaView.
    """
    if "paraview" in sys.modules or find_spec("pyvista") is None:
        return None
    import pyvista

    suffix = path.suffix.lower()
    if path.is_dir():
        suffix = ".dcm" if any(file.suffix.lower() == ".dcm" for file in path.iterdir()) else ""
    try:
        with vtk_messages():
            reader = pyvista.get_reader(str(path), force_ext=suffix).reader
    except (ValueError, ImportError):  # unknown to it, or served by a package that is not installed
        return None
    return reader if isinstance(reader, vtkAlgorithm) else None
