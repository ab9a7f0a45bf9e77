"""Volumes as OpenVDB, read back by OpenVDB's own module in another Python."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from svv.cli.app import app
from svv.core.volumes.opacity_code import depths
from svv.errors import BadInput, Cancelled
from svv.io.openvdb_python import PYTHON, python_with_openvdb
from svv.options.baking import BakeOptions
from svv.render.baking.baked import bake
from svv.render.baking.baked_volume import BakedVolume
from svv.render.baking.openvdb import write_vdb
from tests.cube import cube_scene
from tests.nightly import nightly
from tests.solid_ball import solid_ball

READ = """
import json, sys
import numpy as np
try:
    import openvdb as vdb
except ImportError:
    import pyopenvdb as vdb
path, folder, shape = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
grids, about = vdb.readAll(path)
told = {}
for grid in grids:
    array = np.zeros(shape if grid.name == "density" else shape + [3], np.float32)
    grid.copyToArray(array)
    np.save(f"{folder}/{grid.name}.npy", array)
    first, last = grid.evalActiveVoxelBoundingBox()
    told[grid.name] = {"class": str(grid.gridClass), "type": grid.valueTypeName, "active": grid.activeVoxelCount(),
                       "places": [list(grid.transform.indexToWorld(at)) for at in ((0, 0, 0), (2, 1, 0))],
                       "unit": about["world_units"],
                       "inside": min(first) >= 0 and all(a < b for a, b in zip(last, shape))}
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def python() -> str:
    """A Python with OpenVDB's module."""
    try:
        return python_with_openvdb()
    except BadInput as missing:
        pytest.skip(str(missing))


def read(python: str, path: Path, volume: BakedVolume) -> tuple[dict, np.ndarray, np.ndarray]:
    """What another program finds: facts on the grids, density (X, Y, Z) and colour (X, Y, Z, 3)."""
    command = [python, "-c", READ, str(path), str(path.parent), json.dumps(volume.grid.shape)]
    told = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return told, np.load(path.parent / "density.npy"), np.load(path.parent / "Cd.npy")


def test_another_program_finds_extinction_and_colours_where_they_are(python: str, tmp_path: Path) -> None:
    volume = bake(cube_scene(), BakeOptions(resolution=16))
    write_vdb(tmp_path / "cube.vdb", volume)
    told, density, colour = read(python, tmp_path / "cube.vdb", volume)
    assert sorted(told) == ["Cd", "density"]
    assert told["density"]["type"] == "float" and told["Cd"]["type"] == "vec3s"
    assert "fog" in told["density"]["class"].lower()
    codes = volume.rgba[..., 3].transpose(2, 1, 0)
    assert told["density"]["active"] == (codes > 0).sum()
    step, origin = volume.grid.spacing, np.array(volume.grid.origin)
    for grid in told.values():
        assert grid["inside"]
        np.testing.assert_allclose(grid["places"], [origin, origin + np.array([2, 1, 0]) * step], atol=1e-9)
    # Opacity over the unit distance is what the volume's opacity function says.
    np.testing.assert_allclose(density * volume.grid.unit_distance, depths(volume.most)[codes], rtol=1e-5)
    shown = colour[codes > 0]
    encoded = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    assert np.abs(255 * encoded - volume.rgba.transpose(2, 1, 0, 3)[codes > 0][:, :3]).max() < 0.6  # half precision


def test_extinction_is_in_world_units(python: str, tmp_path: Path) -> None:
    ball = solid_ball(1.5)
    write_vdb(tmp_path / "ball.vdb", volume := bake(ball))
    _, density, colour = read(python, tmp_path / "ball.vdb", volume)
    middle = tuple(n // 2 for n in density.shape)
    assert density[middle] == pytest.approx(np.exp(1.5) / ball.occupancy.box.size, rel=0.03)
    empty = density == 0.0
    beside = np.zeros_like(empty)
    for axis in range(3):
        for way in (1, -1):
            beside |= np.roll(~empty, way, axis)
    coloured = colour.max(axis=-1) > 0
    assert coloured[empty & beside].mean() > 0.99, "programs interpolate colours at the border"
    assert coloured[empty].mean() < 0.5, "the rest is not stored"


@pytest.mark.parametrize("size", nightly([1e-12, 1e-9, 3e-5, 1e-4, 1.0, 1e4, 3e4, 1e9, 1e15], 1e-12, 1.0, 1e15))
def test_volumes_of_all_sizes_are_kept(python: str, tmp_path: Path, size: float) -> None:
    """What is read back is the volume, in a unit that the file and the sentence tell."""
    cube = bake(cube_scene(), BakeOptions(resolution=16))
    origin = tuple(float(x) * size / cube.grid.spacing for x in cube.grid.origin)
    volume = replace(cube, grid=replace(cube.grid, origin=origin, spacing=size))
    notes = write_vdb(tmp_path / "cube.vdb", volume)
    told, density, _ = read(python, tmp_path / "cube.vdb", volume)
    unit = told["density"]["unit"]
    assert notes == ([] if 1e-4 <= size <= 1e4 else [
        f"A unit of the file is {unit:g} world units, because OpenVDB and Blender do not keep such voxels."
    ])  # fmt: skip
    assert 1e-4 <= size / unit <= 1e4
    for grid in told.values():
        corner = np.array(origin)
        np.testing.assert_allclose(
            np.array(grid["places"]) * unit, [corner, corner + np.array([2, 1, 0]) * size], rtol=1e-6, atol=1e-6 * size
        )
    codes = volume.rgba[..., 3].transpose(2, 1, 0)
    np.testing.assert_allclose(density / unit * volume.grid.unit_distance, depths(volume.most)[codes], rtol=1e-5)


def test_a_volume_far_from_the_origin_is_told(python: str, tmp_path: Path) -> None:
    cube = bake(cube_scene(), BakeOptions(resolution=16))
    far = replace(cube, grid=replace(cube.grid, origin=(0.0, 2e6 * cube.grid.spacing, 0.0)))
    assert ["so far from the origin" in note for note in write_vdb(tmp_path / "far.vdb", far)] == [True]


def test_command(python: str, tmp_path: Path) -> None:
    cube_scene().save(tmp_path / "cube.svv")
    out = tmp_path / "cube.vdb"
    done = CliRunner().invoke(app, ["export", str(tmp_path / "cube.svv"), "--out", str(out), "--light", "baked"])
    assert done.exit_code == 0 and "9 x 9 x 9 points" in done.output
    assert read(python, out, bake(cube_scene()))[0]["density"]["active"] > 0


def test_it_says_what_is_missing_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cube_scene().save(tmp_path / "cube.svv")
    monkeypatch.setenv(PYTHON, str(tmp_path / "no-python"))
    done = CliRunner().invoke(app, ["export", str(tmp_path / "cube.svv"), "--out", str(tmp_path / "cube.vdb")])
    assert isinstance(done.exception, BadInput) and "apt-get install python3-openvdb" in str(done.exception)
    assert "no-python does not have" in str(done.exception)
    with pytest.raises(BadInput, match="Nothing in the scene is visible"):
        write_vdb(tmp_path / "a.vdb", bake(solid_ball().hidden(0)))
    assert [path.name for path in tmp_path.iterdir()] == ["cube.svv"]


def test_a_failing_module_is_reported_and_writing_can_be_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pyopenvdb.py").write_text("raise ImportError('libopenvdb.so.10.0 is missing')")
    (tmp_path / "openvdb.py").write_text("raise ImportError('libopenvdb.so.10.0 is missing')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv(PYTHON, sys.executable)
    with pytest.raises(BadInput, match=r"a\.vdb: OpenVDB in .* failed \(ImportError: libopenvdb"):
        write_vdb(tmp_path / "a.vdb", bake(solid_ball()))

    def stop(fraction: float, label: str) -> None:
        if label == "writing":
            raise Cancelled

    (tmp_path / "openvdb.py").write_text("import time; time.sleep(600)")
    with pytest.raises(Cancelled):
        write_vdb(tmp_path / "a.vdb", bake(solid_ball()), stop)
    assert not list(tmp_path.glob("*a*.vdb"))
