"""A scene that is edited without its networks is, byte for byte, the one that is edited with them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra import numpy as drawn
from typer.testing import CliRunner

from svv.cli.app import app
from svv.core.volumes.classified import grid_shape
from svv.errors import BadInput
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.scene.array_sizes import count_vertices
from svv.fields.scene.closed import NeedsNetworks, read_closed
from svv.fields.scene.expected import CELLS, ExpectedErrors
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.io.scene_file import read_scene_file, write_scene_file
from svv.job.looks.file import to_json
from svv.job.looks.look import Look
from tests.cube import cube_scene, hash_cube_scene, lit_cube_scene

EDITS: dict[str, list[tuple[Any, ...]]] = {
    "colour": [("edited", 0, {"colour": (0.1, 0.2, 0.3), "name": "bone"})],
    "several": [("hidden", 0), ("edited", 1, {"opacity": 0.5, "lighting": 2.0, "recolour_in": "oklab"}), ("shown",)],
    "undone": [("edited", 0, {"name": "é\u4e2d"}), ("isolated", 1), ("undone",)],
    "redone": [("cut", "x>50%&y<40%"), ("undone",), ("redone",)],
    "cuts": [("cut", "0=x>50%", "sphere:0,0,0:0.3"), ("with_section", "hatched", 0, {"line": 2.0})],
    "uncut": [("cut", "x>50%"), ("uncut",)],
    "paint": [("with_strength", 0.5), ("with_paint_light", 0.25, 0), ("with_stroke_opacity", -0.5, 1)],
    "outline": [("with_outline", 0.5, {"width": 3.0, "colour": (0.0, 0.5, 1.0)})],
    "shadow": [("with_shadow", 0.5, (20.0, 30.0), 3.0), ("edited", 0, {"opacity": 0.5})],
    "no shadow": [("with_shadow", 0.5), ("with_shadow", 0.0)],
    "occlusion": [("with_occlusion", 0.5, 1)],
    "matcap": [("edited", 0, {"matcap": "jade"})],
    "light": [("with_light", 20.0, -30.0, {"intensity": 2.0})],
    "reset": [("edited", 1, {"name": "b", "opacity": 0.0}), ("reset", 1), ("reset",)],
    "nothing": [("with_strength", 1.0)],
}


def doubting() -> Scene:
    cube = cube_scene()
    level = np.ones(grid_shape(cube.occupancy.box, CELLS), np.uint8)
    return replace(cube, expected=ExpectedErrors(level, 0.2, 0.1, 0.1, 0.15, (0.1, 0.2, 0.3)))


MAKE: dict[str, Callable[[], Scene]] = {
    "lattice": cube_scene, "hash": hash_cube_scene, "lit": lit_cube_scene, "doubting": doubting,
}  # fmt: skip


def after(scene: Any, steps: Sequence[tuple[Any, ...]]) -> Any:
    """The scene after these edits."""
    for name, *given in steps:
        told = given.pop() if given and isinstance(given[-1], dict) else {}
        scene = getattr(scene, name)(*given, **told)
    return scene


def outcome(scene: Any, steps: Sequence[tuple[Any, ...]], path: Path) -> bytes | str:
    """The content of the file after these edits, or what is wrong with them."""
    try:
        after(scene, steps).save(path)
    except BadInput as error:
        return str(error)
    return path.read_bytes()


@pytest.fixture(scope="module", params=MAKE)
def file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("closed") / "a.svv"
    MAKE[request.param]().edited(0, name="first").save(path)
    return path


def test_the_file_is_that_of_the_whole_scene(file: Path, tmp_path: Path) -> None:
    """Or the error is: for a hash grid, whose shadows cannot be computed, and light that a network learned."""
    closed, whole = read_closed(file), Scene.load(file)
    assert closed is not None
    for edit, steps in EDITS.items():
        found = outcome(closed, steps, tmp_path / "a.svv")
        assert found == outcome(whole, steps, tmp_path / "b.svv"), edit
    assert to_json(Look.of(cast("Scene", closed))) == to_json(Look.of(whole))


def test_what_needs_networks_is_not_guessed(tmp_path: Path) -> None:
    path = tmp_path / "a.svv"
    lit_cube_scene().save(path)
    closed: Any = read_closed(path)
    with pytest.raises(NeedsNetworks):
        closed.edited(0, specular=0.5).save(path)
    for name in ("render", "probe", "base", "with_variant"):
        with pytest.raises(NeedsNetworks):
            getattr(closed, name)
    doubting().edited(0, name="b").edited(1, name="b").edited(2, name="b").save(path)
    closed = read_closed(path)
    with pytest.raises(NeedsNetworks):
        closed.edited(0, name="c").save(path)


@pytest.mark.parametrize("kind", ["older", "joined", "damaged"])
def test_other_scenes_are_loaded_whole(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.svv"
    scene = joined([cube_scene(0), cube_scene(1)]) if kind == "joined" else cube_scene()
    scene.save(path)
    header, arrays = read_scene_file(path)
    if kind == "older":
        write_scene_file(path, {**header, "told": {**header["told"], "svv": "0.0.1"}}, arrays)
    if kind == "damaged":
        write_scene_file(path, header, {**arrays, "base.geometry_mlp.0.weight": np.full((2, 2), np.nan, np.float32)})
    assert read_closed(path) is None


@pytest.mark.parametrize("kind", MAKE)
def test_arrays_of_other_sizes_are_refused_before_the_file_is_written_again(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.svv"
    MAKE[kind]().save(path)
    header, arrays = read_scene_file(path)
    needed = [name for name in arrays if re.match(r"(base|pcn|styled|variant\d)\.", name) or name == "occupied"]
    for name in needed:
        write_scene_file(path, header, {**arrays, name: np.concatenate([arrays[name], arrays[name][:1]])})
        if header["settings"]["encoding"] == "lattice":
            assert read_closed(path) is None, name
            with pytest.raises(BadInput, match="is damaged"):
                Scene.load(path)
    write_scene_file(path, header, arrays)
    assert read_closed(path) is not None


OCCUPIED = drawn.arrays(np.uint8, drawn.array_shapes(min_dims=3, max_dims=3, max_side=5), elements=st.integers(0, 1))


@hypothesis.given(OCCUPIED, st.integers(0, 4))
def test_vertices_are_counted_as_lattices_have_them(occupied: Any, power: int) -> None:
    lattice = SparseLattice(occupied, 4, (2**power,), 1)
    assert count_vertices(occupied, 4, 2**power) == len(lattice.table)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.svv"
    cube_scene().save(path)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(BadInput, match="truncated or damaged"):
        read_closed(path)


@pytest.mark.parametrize(
    "options", [["--region", "0", "--specular", "0.5"], ["--region", "1", "--opacity", "0.5", "--hide", "0"]]
)
def test_the_command_edits_either_way(options: list[str], tmp_path: Path) -> None:
    path, out = tmp_path / "a.svv", tmp_path / "b.svv"
    lit_cube_scene().save(path)
    done = CliRunner().invoke(app, ["edit", str(path), *options, "--out", str(out)])
    assert done.exit_code == 0 and done.output.split() == [str(out)]
    found = Scene.load(out)
    assert (found.regions[0].specular, found.regions[1].opacity) in ((0.5, 1.0), (None, 0.5))
    assert found.undone().regions == Scene.load(path).regions
