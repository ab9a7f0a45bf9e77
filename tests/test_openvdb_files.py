"""OpenVDB files that other programs wrote are read: values, places, choice of a grid, and damage."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from svv.dvr.read.grids import to_array
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from svv.io.openvdb_python import python_with_openvdb
from tests.ell_volume import FIRST, assert_shown, ell

WRITE = """
import json, sys
import numpy as np
try:
    import openvdb as vdb
except ImportError:
    import pyopenvdb as vdb
grids = []
for name, kind, matrix in json.loads(sys.argv[2]):
    grid = getattr(vdb, kind)()
    if kind != "Vec3SGrid" and name != "empty":
        grid.copyFromArray(np.load("ell.npy").astype(bool if kind == "BoolGrid" else np.float32))
    grid.transform = vdb.createLinearTransform(matrix=matrix)
    grid.name = name
    grids.append(grid)
vdb.write(sys.argv[1], grids=grids)
"""

PLACE = [[1.5, 0, 0, 0], [0, 2, 0, 0], [0, 0, 3, 0], [10, 20, 30, 1]]

TURNED = [[0, 1.5, 0, 0], [-2, 0, 0, 0], [0, 0, 3, 0], [10, 20, 30, 1]]


def vdb(folder: Path, *grids: tuple[str, str, list[list[float]]]) -> Path:
    """Write an L as grids (name, type, rows of the matrix) by OpenVDB's own module."""
    try:
        python = python_with_openvdb()
    except BadInput as missing:
        pytest.skip(str(missing))
    np.save(folder / "ell.npy", np.ascontiguousarray(ell().transpose(2, 1, 0)))
    command = [python, "-c", WRITE, str(folder / "l.vdb"), json.dumps(grids)]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "l.vdb"


def test_a_grid_is_in_its_place(tmp_path: Path) -> None:
    assert_shown(vdb(tmp_path, ("density", "FloatGrid", PLACE)))
    file = vdb(tmp_path, ("density", "FloatGrid", TURNED))
    assert_shown(file, np.array(TURNED, float)[:3, :3].T, FIRST)
    values = to_array(read_here(file))
    assert values.shape == (5, 7, 10), "what is active, with a voxel of the background around it"


def test_one_of_several_grids_is_chosen(tmp_path: Path) -> None:
    grids = [("heat", "FloatGrid", PLACE), ("mask", "BoolGrid", PLACE), ("v", "Vec3SGrid", PLACE)]
    file = vdb(tmp_path, *grids)
    with pytest.raises(
        BadInput, match=r"several grids of numbers; its grids: heat \(float\), mask \(bool\), v \(vec3s"
    ):
        read_here(file)
    assert_shown(file, array="heat")
    assert set(np.unique(to_array(read_here(file, array="mask")))) == {0.0, 1.0}
    with pytest.raises(BadInput, match="no grid of numbers 'v'"):
        read_here(file, array="v")
    assert_shown(vdb(tmp_path, *grids, ("density", "FloatGrid", PLACE)))
    with pytest.raises(BadInput, match="nothing in the grid empty"):
        read_here(vdb(tmp_path, ("empty", "FloatGrid", PLACE)))
    sheared = [[1.5, 1, 0, 0], [0, 2, 0, 0], [0, 0, 3, 0], [0, 0, 0, 1]]
    with pytest.raises(BadInput, match="sheared"):
        read_here(vdb(tmp_path, ("density", "FloatGrid", sheared)))


def test_other_files_and_a_missing_module_are_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = vdb(tmp_path, ("density", "FloatGrid", PLACE))
    (tmp_path / "text.vdb").write_text("no grid at all")
    with pytest.raises(BadInput, match="no OpenVDB file") as caught:
        read_here(tmp_path / "text.vdb")
    assert "\n" not in str(caught.value)
    with pytest.raises(BadInput, match="--time"):
        read_here(file, time=1)
    monkeypatch.setenv("SVV_OPENVDB_PYTHON", str(tmp_path / "none"))
    with pytest.raises(BadInput, match="apt-get install python3-openvdb"):
        read_here(file)


def test_a_grid_too_large_for_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = vdb(tmp_path, ("density", "FloatGrid", PLACE))
    monkeypatch.setattr("svv.dvr.read.openvdb_files.memory_there", lambda: 1000)
    with pytest.raises(BadInput, match="10 x 7 x 5 voxels, more than memory can hold"):
        read_here(file)
