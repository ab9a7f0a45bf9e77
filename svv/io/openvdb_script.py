"""A program for any Python that has OpenVDB's module: turns NumPy files into grids, and back. It needs nothing of svv.

OpenVDB comes with a system or with Blender, seldom with the Python that runs svv, whose NumPy it may not fit; so
:mod:`svv.render.baking.openvdb` and :mod:`svv.dvr.read.openvdb_files` run this file:

- ``write FOLDER FILE``: the folder has ``density.npy`` float32 (X, Y, Z), ``colour.npy`` float32 (X, Y, Z, 3) and
  ``told.json`` (``origin`` and ``spacing`` of the points, ``metadata`` of the file).
- ``read FILE FOLDER MOST [NAME]``: writes ``values.npy`` float32 (X, Y, Z) and ``told.json`` (``name``, ``origin``,
  ``steps`` along x, y, z) of a grid of numbers of at most MOST voxels, or ``told.json`` with the key ``refused``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

NUMBERS = ("float", "double", "half", "int32", "int64", "bool")
"""Types of values that can be shown."""


def module() -> Any:
    """Return OpenVDB's module."""
    try:
        import openvdb as vdb  # OpenVDB 11 and newer, and Blender 4.4 and newer
    except ImportError:
        import pyopenvdb as vdb
    return vdb


def write(folder: str, out: str) -> None:
    """Write a file."""
    import numpy as np

    vdb, told = module(), json.loads((Path(folder) / "told.json").read_text())
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


def read(file: str, folder: str, most: str, name: str = "") -> None:
    """Read a grid: the named one, the only one of numbers, or the one called density."""
    told = _read(file, Path(folder), int(most), name)
    (Path(folder) / "told.json").write_text(json.dumps(told))


def _read(file: str, folder: Path, most: int, name: str) -> dict[str, Any]:
    import numpy as np

    vdb = module()
    known = {grid.name: str(grid.valueTypeName) for grid in vdb.readAllGridMetadata(file)}
    numbers = [one for one, kind in known.items() if kind in NUMBERS]
    listed = ", ".join(f"{one or 'unnamed'} ({kind})" for one, kind in known.items()) or "none"
    chosen = [name] if name else ["density"] if "density" in numbers else numbers
    if len(chosen) != 1 or chosen[0] not in numbers:
        said = f"no grid of numbers '{name}'" if name else f"{'several grids' if numbers else 'no grid'} of numbers"
        return {"refused": f"has {said}; its grids: {listed}. Choose one with --array."}
    grid = vdb.read(file, chosen[0])
    if grid.empty():
        return {"refused": f"has nothing in the grid {chosen[0]}"}
    if not grid.transform.isLinear:
        return {"refused": "has the grid of a camera (a frustum), which is not linear: resample it first"}
    low, high = (np.array(corner) for corner in grid.evalActiveVoxelBoundingBox())
    low, shape = low - 1, high - low + 3  # with a voxel of the background on each side
    if int(np.prod(shape.astype(object))) > most:
        return {"refused": f"has {' x '.join(map(str, shape))} voxels, more than memory can hold"}
    values = np.zeros(shape, np.bool_ if known[chosen[0]] == "bool" else np.float32)
    grid.copyToArray(values, ijk=tuple(int(k) for k in low))
    np.save(folder / "values.npy", values.astype(np.float32))
    at = [np.array(grid.transform.indexToWorld(tuple(float(k) for k in low + axis))) for axis in np.eye(3)]
    origin = np.array(grid.transform.indexToWorld(tuple(float(k) for k in low)))
    return {"name": chosen[0], "origin": origin.tolist(), "steps": [(one - origin).tolist() for one in at]}


if __name__ == "__main__":
    (read if sys.argv[1] == "read" else write)(*sys.argv[2:])
