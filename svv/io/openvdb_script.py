"""A program for any Python that has OpenVDB's module, as a system or Blender has: writes grids from NumPy files.

It needs nothing of svv. Arguments: a folder with ``density.npy`` float32 (X, Y, Z), ``colour.npy`` float32 (X, Y, Z, 3)
and ``told.json`` (``origin`` and ``spacing`` of the points, ``metadata`` of the file), and the file to write.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def main(folder: str, out: str) -> None:
    """Write the file."""
    try:
        import openvdb as vdb  # OpenVDB 11 and newer, and Blender 4.4 and newer
    except ImportError:
        import pyopenvdb as vdb
    import numpy as np

    told = json.loads((Path(folder) / "told.json").read_text())
    step, (x, y, z) = told["spacing"], told["origin"]
    # Rows of the matrix are multiplied from the left, and a point of the array is a voxel's centre.
    place = [[step, 0.0, 0.0, 0.0], [0.0, step, 0.0, 0.0], [0.0, 0.0, step, 0.0], [x, y, z, 1.0]]

    def grid_of(name: str, kind: Any) -> Any:
        grid = kind()
        grid.copyFromArray(np.load(Path(folder) / f"{name}.npy"))
        grid.transform = vdb.createLinearTransform(matrix=place)
        return grid

    density, colour = grid_of("density", vdb.FloatGrid), grid_of("colour", vdb.Vec3SGrid)
    density.name, density.gridClass = "density", vdb.GridClass.FOG_VOLUME
    colour.name, colour.saveFloatAsHalf = "Cd", True
    vdb.write(out, grids=[density, colour], metadata=told["metadata"])


if __name__ == "__main__":
    main(*sys.argv[1:])
