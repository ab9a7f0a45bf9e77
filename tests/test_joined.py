"""Scenes of several transfer functions: alone each is what it was, together their extinctions add."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
import torch

from svv.cli import app
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput
from svv.fields.scene.joined import joined, members
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import write_json
from svv.train.correct import correct_palette
from tests.cube import cube_camera, cube_paint, cube_scene, faint, lit_cube_scene
from tests.test_from_values import moved_ball
from tests.test_ranges import BLUE, RED, bumps
from tests.test_time_steps import command


def alpha(scene: Scene, camera: Camera) -> np.ndarray:
    return scene.render(camera).rgba[..., 3]


@pytest.fixture(scope="module")
def both() -> tuple[Scene, Scene, Scene]:
    """Two scenes, and both joined."""
    first, second = faint(cube_scene(0)), faint(lit_cube_scene(), 0.2)
    return first, second, joined([first, second])


def test_regions_are_those_of_all_with_their_edits(both: tuple[Scene, Scene, Scene]) -> None:
    whole = both[2]
    assert [r.layer for r in whole.regions] == [0, 0, 0, 1, 1, 1]
    assert [r.opacity for r in whole.regions] == [0.3] * 3 + [0.2] * 3
    assert [len(m.regions) for m in members(whole)] == [3, 3]
    assert len(whole.info()["reflects"] if "reflects" in whole.info() else whole.regions) == 6


@pytest.mark.parametrize("number", [0, 1])
def test_alone_each_is_what_it_was(both: tuple[Scene, Scene, Scene], number: int) -> None:
    whole, own = both[2], (range(3), range(3, 6))[number]
    camera = cube_camera()
    alone, before = whole.isolated(*own).render(camera), both[number].render(camera)
    np.testing.assert_allclose(alone.rgba, before.rgba, atol=2e-3)
    np.testing.assert_allclose(alone.depth, before.depth, atol=2e-3)
    seen = before.region >= 0
    assert (alone.region[seen] == before.region[seen] + 3 * number).mean() > 0.99


def test_together_transmittances_multiply(both: tuple[Scene, Scene, Scene]) -> None:
    """Beer's law: extinctions add, wherever the two overlap."""
    first, second, whole = both
    camera = cube_camera()
    expected = 1.0 - (1.0 - alpha(first, camera)) * (1.0 - alpha(second, camera))
    np.testing.assert_allclose(alpha(whole, camera), expected, atol=3e-3)


def test_the_nearer_one_hides_the_other() -> None:
    """An opaque cube half a side nearer: from either side, the pixel shows the one in front."""
    back = cube_scene()
    box = Box((-0.5, -0.5, 0.0), 1.0, (1.0,) * 3)
    front = replace(back, occupancy=replace(back.occupancy, box=box))
    opaque = [faint(scene, 400.0) for scene in (back, front)]
    whole, camera = joined(opaque), cube_camera()
    pose = np.diag([-1.0, 1.0, -1.0, 1.0])
    pose[2, 3] = -3.0
    behind = Camera(pose, camera.fov_x, camera.width, camera.height)
    for at, owner in ((camera, 1), (behind, 0)):
        picture, alone = whole.render(at), opaque[owner].render(at)
        middle = slice(8, 16), slice(8, 16)
        np.testing.assert_allclose(picture.rgba[middle], alone.rgba[middle], atol=0.02)
        assert {whole.regions[r].layer for r in picture.region[middle].ravel()} == {owner}


def test_files_keep_all(both: tuple[Scene, Scene, Scene], tmp_path: Path) -> None:
    first, second, _ = both
    paint = replace(second, styled=cube_paint(second, 5), painting="p")
    painted = replace(paint, regions=tuple(replace(r, style="s") for r in paint.regions))
    whole = joined([first, painted]).hidden(1).undone()
    whole.save(tmp_path / "both.svv")
    for again in (Scene.load(tmp_path / "both.svv"), Scene.from_bytes(whole.to_bytes())):
        assert again.regions == whole.regions and len(again.layers) == 1
        assert again.networks == ("base", "pcn", "styled")
        for network in again.networks:
            a, b = (scene.render(cube_camera(), network).rgba for scene in (again, whole))
            np.testing.assert_allclose(a, b, atol=0.02)
    assert len(joined([whole, first]).layers) == 2, "joined scenes can be joined again"
    assert whole.on(torch.device("cpu")) is whole


def test_what_cannot_be_joined_says_why(both: tuple[Scene, Scene, Scene]) -> None:
    first, second, _ = both
    far = replace(second, occupancy=replace(second.occupancy, box=Box((5.0,) * 3, 1.0, (1.0,) * 3)))
    with pytest.raises(BadInput, match="different places"):
        joined([first, far])
    with pytest.raises(BadInput, match="2 to 8"):
        joined([first])
    with pytest.raises(BadInput, match="without regions"):
        joined([first, replace(second, palette_network=None, regions=())])


def test_the_palette_of_a_joined_scene_is_corrected_before_joining(both: tuple[Scene, Scene, Scene]) -> None:
    with pytest.raises(BadInput, match="before svv join"):
        correct_palette(both[2], None, None)  # type: ignore[arg-type]


def test_a_light_that_was_moved_lights_all_that_have_one_and_what_changes_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain, lit = cube_scene(), lit_cube_scene()
    aside, camera = lit.with_light(60, 20), cube_camera()
    alone = joined([plain, aside]).hidden(*range(len(plain.regions)))
    np.testing.assert_allclose(alone.render(camera).rgba, aside.render(camera).rgba, atol=2e-3)
    assert alone.with_light(60, 20) == alone and alone.edited(3, specular=0.5).regions[3].specular == 0.5
    with pytest.raises(BadInput, match="cannot be moved"):
        alone.edited(0, specular=0.5)
    for name, scene in (("plain", plain), ("lit", lit), ("aside", aside)):
        scene.save(tmp_path / f"{name}.svv")
    for first, second, said in (("plain", "aside", False), ("lit", "aside", True), ("aside", "lit", True)):
        assert not command(
            "join", tmp_path / f"{first}.svv", tmp_path / f"{second}.svv", "--out", tmp_path / "both.svv"
        )
        assert (f"{second}.svv gets the light of the others" in capsys.readouterr().err) == said


def test_the_command_joins_files(
    both: tuple[Scene, Scene, Scene],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for number in (0, 1):
        both[number].save(tmp_path / f"{number}.svv")
    words = ["svv", "join", tmp_path / "0.svv", tmp_path / "1.svv", "--out", tmp_path / "both.svv"]
    monkeypatch.setattr(sys, "argv", [str(word) for word in words])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert not ended.value.code
    assert "3 + 3 regions" in capsys.readouterr().out
    assert Scene.load(tmp_path / "both.svv").regions == both[2].regions


def test_several_transfer_functions_make_one_scene(tmp_path: Path) -> None:
    """The views of each have a folder, and its scene is saved beside the joined one."""
    for name, function in (("shell", bumps((0.3, 0.2, 0.1, BLUE))), ("core", bumps((0.8, 0.3, 0.8, RED)))):
        write_json(tmp_path / f"{name}.json", function.to_dict())
    functions = ("--tf", tmp_path / "shell.json", "--tf", tmp_path / "core.json")
    sizes = ("--n", "8", "--test", "0", "--size", "48", "--mapper", "cpu")
    volume = tmp_path / "ball.vti"
    pv.wrap(moved_ball(0.0)).save(volume)
    assert command("views", volume, *functions, *sizes, "--out", tmp_path / "views") == 0
    learning = ("--preset", "draft", "--encoding", "values", "--time-limit", "1")
    assert command("train", tmp_path / "views", *learning, "--out", tmp_path / "both.svv") == 0
    both = Scene.load(tmp_path / "both.svv")
    counts = [len(Scene.load(tmp_path / f"both.{name}.svv").regions) for name in ("core", "shell")]
    assert [sum(r.layer == k for r in both.regions) for k in (0, 1)] == counts
    assert not list(tmp_path.glob("*.checkpoint"))
    assert command("run", volume, *functions, "--out", tmp_path / "job") == 2
    (tmp_path / "again").mkdir()
    same = tmp_path / "again" / "shell.json"
    same.write_text((tmp_path / "shell.json").read_text())
    assert command("views", volume, "--tf", same, "--tf", tmp_path / "shell.json", "--out", tmp_path / "x") == 2


def test_a_file_without_its_tables_is_damaged() -> None:
    """Only a scene that keeps its values may leave out what follows from them."""
    header, tensors = cube_scene().to_arrays()
    for name in ("base.density.table", "pcn.encoding.table"):
        with pytest.raises(KeyError):
            Scene.from_arrays(header, {key: array for key, array in tensors.items() if not key.startswith(name)})


def test_layers_of_one_volume_that_show_different_places_are_joined_and_framed_together(
    both: tuple[Scene, Scene, Scene],
) -> None:
    """Arrays of a data set need not be visible where others are: cloud is above rain."""
    first, second, _ = both
    grid = {
        "dimensions": [11, 11, 11], "spacing": [1.0, 1.0, 1.0], "origin": [-2.0, 8.0, -2.0],
        "direction": [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "type": "uint8", "range": [0.0, 1.0],
    }  # fmt: skip
    far = replace(
        second, occupancy=replace(second.occupancy, box=Box((5.0, 0.0, 0.0), 1.0, (1.0,) * 3)),
        camera_rig=replace(second.rig, centre=(5.5, 0.5, 0.5)),
    )  # fmt: skip
    known = [replace(scene, made={**scene.made, "source": {"grid": grid}}) for scene in (first, far)]
    whole = joined(known)
    assert joined([first, second]).rig == first.rig, "where nothing is cut off, the first rig stays"
    for scene in (first, far):
        away = np.linalg.norm(np.subtract(scene.rig.centre, whole.rig.centre))
        assert away + 0.5 * scene.rig.view_width <= 0.5 * whole.rig.view_width * (1 + 1e-6)
    assert whole.rig.view_width < first.rig.view_width + far.rig.view_width + 6.0
    elsewhere = {**grid, "origin": [100.0, 0.0, 0.0]}
    apart = replace(known[1], made={"source": {"grid": elsewhere}})
    with pytest.raises(BadInput, match="different places"):
        joined([known[0], apart])
