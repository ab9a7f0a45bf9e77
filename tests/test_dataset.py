"""Scenes in PyVista: the reader, the accessor, and the dataset that stands for a scene."""

from __future__ import annotations

import copy
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

pyvista = pytest.importorskip("pyvista", minversion="0.48")

from svv.errors import BadInput  # noqa: E402
from svv.fields.scene.scene import Scene  # noqa: E402
from svv.job.dataset import dataset_of, read_dataset  # noqa: E402
from tests.balls import SHORT  # noqa: E402
from tests.cube import cube_camera, cube_scene  # noqa: E402
from tests.loose_balls import LEFT, RIGHT, in_world, loose_balls  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def file(tmp_path: Path, cube: Scene) -> Path:
    cube.save(tmp_path / "cube.svv")
    return tmp_path / "cube.svv"


def test_pyvista_reads_scenes(file: Path, cube: Scene) -> None:
    if ".svv" not in pyvista.core.utilities.reader_registry._custom_ext_readers:  # installed before it was declared
        pyvista.register_reader(".svv", read_dataset, override=True)
    grid = pyvista.read(file)
    assert isinstance(grid, pyvista.ImageData)
    assert grid.svv.scene.regions == cube.regions
    shown = grid.svv.scene.render(cube_camera())
    np.testing.assert_array_equal(shown.rgba, cube.render(cube_camera()).rgba)
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(BadInput, match="truncated"):
        pyvista.read(file)


def test_the_entry_points_name_what_is_there() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    for group, name, value in (
        ("readers", '".svv"', "svv.job.dataset:read_dataset"),
        ("accessors", "svv", "svv.job.dataset"),
    ):
        assert f'[project.entry-points."pyvista.{group}"]\n{name} = "{value}"\n' in text
        module, _, what = value.partition(":")
        assert hasattr(import_module(module), what or "SceneAccessor")


def test_cells_are_where_the_scene_is() -> None:
    scene = loose_balls().split_at(in_world(LEFT)).edited(0, opacity=2.0)
    grid = dataset_of(scene)
    np.testing.assert_allclose(grid.bounds, (-0.5, 0.5) * 3, atol=1e-6)
    for centre, region in ((LEFT, 2), (RIGHT, 0)):
        cell = grid.find_containing_cell(in_world(centre))
        assert grid["Region"][cell] == region
        assert grid["Opacity"][cell] == pytest.approx(
            1.0 - np.exp(-np.exp(5.0) / 32 * (2.0 if region == 0 else 1.0)), abs=0.01
        )
    outside = grid.find_containing_cell((0.0, 0.4, 0.4))
    assert (grid["Region"][outside], grid["Opacity"][outside]) == (-1, 0.0)
    assert dataset_of(scene.hidden(0))["Opacity"][cell] == 0.0
    left = grid.threshold((2, 2), scalars="Region")
    assert left.bounds[1] < 0.0 < grid.threshold((0, 0), scalars="Region").bounds[0]


def test_edits_give_another_dataset(file: Path, cube: Scene) -> None:
    grid = read_dataset(file)
    red = grid.svv.recolour(0, "#ff0000")
    assert red.svv.scene.regions == cube.edited(0, colour=(1.0, 0.0, 0.0)).regions
    assert red.svv.recolour(1, (0.0, 1.0, 0.0)).svv.scene.regions[1].edited_colour == (0.0, 1.0, 0.0)
    assert grid.svv.scene.regions == cube.regions
    assert grid.svv.edited(lambda scene: scene.hidden(0, 1, 2))["Opacity"].max() == 0.0
    for region, colour, said in ((0, "redd", "not a colour"), (0, (1, 2), "not a colour"), (9, "red", "no region 9")):
        with pytest.raises(BadInput, match=said):
            grid.svv.recolour(region, colour)


def test_the_scene_travels_with_the_dataset(file: Path, tmp_path: Path) -> None:
    red = read_dataset(file).svv.recolour(0, "#ff0000")
    red.save(tmp_path / "red.vti")
    for other in (red.copy(), copy.deepcopy(red), pyvista.read(tmp_path / "red.vti")):
        assert other.svv.scene.regions == red.svv.scene.regions
    with pytest.raises(BadInput, match="holds no scene"):
        pyvista.ImageData(dimensions=(2, 2, 2)).svv.plot()


def test_a_dataset_is_shown_by_our_renderer(file: Path, cube: Scene) -> None:
    picture = read_dataset(file).svv.plot(camera=cube_camera(), size=(24, 24), off_screen=True)
    expected = np.rint(255.0 * cube.render(cube_camera(), background=(1, 1, 1)).rgba[..., :3])
    assert np.abs(np.asarray(picture).astype(int) - expected).max() <= 1


def test_regions_are_painted() -> None:
    grid = dataset_of(loose_balls())
    drawn = grid.svv.restyle("ink:hatching", options=SHORT, keep=(1,), variant="drawn")
    assert [r.style for r in drawn.svv.scene.regions] == ["ink:hatching", None]
    assert drawn.svv.scene.variant == "drawn"
    with pytest.raises(BadInput, match=r"none\.png"):
        grid.svv.restyle("none.png")


def test_a_scene_without_a_palette_is_one_region() -> None:
    from dataclasses import replace

    grid = dataset_of(replace(cube_scene(), palette_network=None, regions=()))
    assert set(np.unique(grid["Region"])) == {0} and grid["Opacity"].max() > 0.0
