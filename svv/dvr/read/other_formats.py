"""Further file formats, by way of PyVista's list of VTK readers: in the standalone installation, never inside ParaView.

PyVista depends on the VTK from PyPI, and loading a second VTK next to ParaView's own ends the process.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm

from svv.dvr.read.vtk_readers import vtk_messages


def reader_of(path: Path) -> vtkAlgorithm | None:
    """Return the VTK reader that PyVista chooses for a file.

    Returns:
        A ``vtkAlgorithm`` whose file name is not yet set; None for formats that PyVista does not know or reads without
        VTK, if PyVista is not installed, and inside ParaView.
    """
    if path.is_dir() or "paraview" in sys.modules or find_spec("pyvista") is None:
        return None
    import pyvista

    try:
        with vtk_messages():
            reader = pyvista.get_reader(str(path), force_ext=path.suffix.lower()).reader
    except (ValueError, ImportError):  # unknown to PyVista, or needs a package that is not installed
        return None
    return reader if isinstance(reader, vtkAlgorithm) else None
