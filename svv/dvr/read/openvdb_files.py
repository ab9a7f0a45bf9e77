"""OpenVDB files: a grid of numbers, with a voxel of its background around what is active, read by OpenVDB itself."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.bricks.formats.axes import Choice, check_alone
from svv.bricks.formats.source import level_of
from svv.dvr.read.grids import from_array, set_geometry
from svv.errors import BadInput
from svv.io import openvdb_script
from svv.io.files.memory import memory_there
from svv.io.files.temporary import work_folder
from svv.io.openvdb_python import python_with_openvdb


def read_vdb(file: Path, choice: Choice, array: str | None) -> vtkImageData:
    """Read a grid of an OpenVDB file; by default the only one of numbers, or ``density``.

    Raises BadInput if it is damaged, has no such grid, one that is empty, sheared or too large; or no Python here has
    OpenVDB's module.
    """
    check_alone(choice, file)
    python = python_with_openvdb()
    with work_folder() as folder:
        most = str(memory_there() // 16)  # of voxels, with copies
        command = [python, openvdb_script.__file__, "read", str(file), str(folder), most, *([array] if array else [])]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        if done.returncode != 0:
            said = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1].rstrip(".")
            raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or no OpenVDB file ({said}).")
        told = json.loads((folder / "told.json").read_text())
        if "refused" in told:
            raise BadInput(f"{file} {told['refused'].rstrip('.')}.")
        values = np.load(folder / "values.npy").transpose(2, 1, 0)
    steps, origin = np.array(told["steps"], np.float64).T, np.array(told["origin"], np.float64)
    level_of(values.shape, steps, origin, file.name)
    image = from_array(np.ascontiguousarray(values), name=told["name"] or file.stem)
    set_geometry(image, steps, origin)
    return image
