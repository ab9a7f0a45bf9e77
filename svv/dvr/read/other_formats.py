"""Further file formats, by way of PyVista's list of VTK readers: in the standalone installation, never inside ParaView.

PyVista depends on the VTK from PyPI, and loading a second VTK next to ParaView's own ends the process.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm

from svv.dvr.read.plotfiles import is_plotfile, plotfile_reader
from svv.dvr.read.vtk_readers import failed, vtk_messages

DIRECT = dict.fromkeys((".xdmf", ".xmf"), ("vtkIOXdmf2", "vtkXdmfReader"))
"""Modules and names of VTK's readers that are taken without PyVista, by the ending: PyVista's asks XDMF for times."""


def reader_of(path: Path) -> vtkAlgorithm | None:
    """Return the VTK reader that PyVista chooses for a file, not yet named to it; BadInput if PyVista fails on it.

    None inside ParaView, without PyVista, and for formats that PyVista does not know or reads without VTK.
    """
    if path.suffix.lower() in DIRECT:
        module, name = DIRECT[path.suffix.lower()]
        try:
            return getattr(import_module(f"vtkmodules.{module}"), name)()
        except ImportError:  # a ParaView without it
            return None
    if is_plotfile(path):
        return plotfile_reader(path)
    if path.is_dir() or "paraview" in sys.modules or find_spec("pyvista") is None:
        return None
    import pyvista

    try:
        with vtk_messages():
            reader = pyvista.get_reader(str(path), force_ext=path.suffix.lower()).reader
    except (ValueError, ImportError):  # unknown to PyVista, or needs a package that is not installed
        return None
    except Exception as error:  # it already asks the file for times, arrays and more, which may not be there
        raise failed(path, error) from error
    return reader if isinstance(reader, vtkAlgorithm) else None
