"""Scenes with the time steps of their volume: one file, without views or training, and paint that follows matter."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
import torch
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.cli import app
from svv.dvr.draw.views import make_views
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from svv.fields.following.followed_scene import at_step, at_time
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.of_values import TABLES
from svv.fields.scene.joined import joined
from svv.fields.scene.parts import no_parts
from svv.fields.scene.scene import Scene
from svv.fields.strokes.lives import Lives
from svv.io.scene_file import read_scene_file
from svv.io.series_file import read_series
from svv.io.shot_file import read_shot
from svv.job.series import Step, with_time_steps
from svv.render.pictures import read_png
from svv.render.shots.film import Film
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from tests.test_brushing import painted as brushed
from tests.test_from_values import SHORT, TWO, moved_ball

SHIFTS = 0.0, 0.1, 0.3


@pytest.fixture(scope="module")
def followed() -> Scene:
    """A trained scene of the ball in the middle."""
    views, _ = make_views(moved_ball(0.0), TWO, n=12, test=3, size=64, mapper="cpu")
    return train_scene(views, SHORT)[0]


@pytest.fixture(scope="module")
def series(followed: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Scene]:
    """A folder with the ball at three places, and the scene with these time steps, as a file holds it."""
    folder = tmp_path_factory.mktemp("series")
    files = []
    for number, shift in enumerate(SHIFTS):
        files.append(folder / f"ball_{number}.vti")
        pv.wrap(moved_ball(shift)).save(files[-1])
    painted(followed).save(folder / "scene.svv")
    assert command("follow", folder / "scene.svv", *files, "--out", folder / "series.svv") == 0
    return folder, Scene.load(folder / "series.svv")


def test_scenes_between_filters_look_as_in_files_to_the_bit(series: tuple[Path, Scene]) -> None:
    """Tables that follow from the values are not packed, or pictures would hang on what is still in memory."""
    for step in range(len(SHIFTS)):
        scene = at_step(series[1], step)
        camera = scene.rig.orbit(181, 48, frames=[60])[0]
        passed = Scene.from_bytes(scene.to_bytes())
        assert np.array_equal(passed.render(camera, "pcn").rgba, scene.render(camera, "pcn").rgba), step


def command(*words: object) -> object:
    """Run the command; returns its exit code."""
    before, sys.argv = sys.argv, ["svv", *map(str, words)]
    try:
        with pytest.raises(SystemExit) as ended:
            app.main()
    finally:
        sys.argv = before
    return ended.value.code


def painted(scene: Scene) -> Scene:
    """The scene, painted red to the left of its middle and green to the right."""
    paint = UnrestrictedField(scene.settings, scene.occupancy, direct=True)
    lattice, where = paint.encoding, (scene.occupancy.occupied, scene.occupancy.cells)
    assert isinstance(lattice, SparseLattice)
    with torch.no_grad():
        vertices = lattice.vertices_of_level(0, *where)
        right = torch.from_numpy(scene.occupancy.box.to_world(vertices / lattice.resolutions[0])[:, 0] > 0).float()
        lattice.table.copy_(torch.stack([1 - right, right, 0 * right], dim=1))
    return scene.painted(paint.requires_grad_(False), {0: "a", 1: "a"}, {})


def test_one_file_holds_all_time_steps(series: tuple[Path, Scene]) -> None:
    """Each is as good as a scene that follows alone, in a fraction of a scene's bytes."""
    folder, scene = series
    assert scene.info()["times"] == (0.0, 1.0, 2.0)
    for step, shift in enumerate(SHIFTS):
        there = at_step(scene, step)
        _, test = make_views(moved_ball(shift), TWO, n=3, test=3, size=64, mapper="cpu")
        assert test is not None
        assert evaluate_scene(there, test, "pcn").psnr > 28.0
        assert (
            np.abs(at_time(scene, step + 0.4).render(test.cameras[0]).rgba - there.render(test.cameras[0]).rgba).max()
            == 0
        )
    assert scene.steps is not None
    assert len(scene.steps.codes[1]) < 0.2 * (folder / "scene.svv").stat().st_size


def test_time_steps_do_not_know_their_errors(followed: Scene, series: tuple[Path, Scene]) -> None:
    scene = series[1]
    assert scene.steps is not None and followed.expected is not None
    for number in range(len(scene.steps)):
        with pytest.raises(BadInput, match="time step"):
            at_step(scene, number).doubt("xy")


def test_paint_moves_with_the_matter(series: tuple[Path, Scene]) -> None:
    """The border between the colours stays in the middle of the ball."""
    for step, shift in enumerate(SHIFTS):
        there = at_step(series[1], step)
        assert there.styled is not None
        sides = np.array([[shift - 0.2, 0.3, 0.0], [shift + 0.2, 0.3, 0.0]])
        left, right = there.styled(torch.tensor(there.occupancy.box.to_box(sides), dtype=torch.float32)).tolist()
        assert left == pytest.approx([1.0, 0.0, 0.0], abs=0.1)
        assert right == pytest.approx([0.0, 1.0, 0.0], abs=0.1)


def test_a_step_of_a_scene_with_an_undone_split_is_read_again(series: tuple[Path, Scene]) -> None:
    scene, filled = series[1], series[1].occupancy
    territory = no_parts(filled.occupied.shape, filled.cells).with_part(filled.occupied > 0)
    step = at_step(replace(scene.with_part(0, 0.5), parts=territory).undone(), 2)
    again = Scene.from_bytes(step.to_bytes())
    assert again.every_region == scene.regions and not again.history.future


def test_a_scene_keeps_its_values_instead_of_tables(followed: Scene, tmp_path: Path) -> None:
    """What is read back is what was trained, to the last bit."""
    followed.save(tmp_path / "a.svv")
    again = Scene.load(tmp_path / "a.svv")
    assert again.steps is not None and len(again.steps) == 1
    for (name, mine), its in zip(followed.base.state_dict().items(), again.base.state_dict().values(), strict=True):
        torch.testing.assert_close(its, mine, atol=1e-5, rtol=0.0, msg=name)
    assert set(TABLES) & set(followed.to_arrays(packed=False)[1]) and not set(TABLES) & set(
        read_scene_file(tmp_path / "a.svv")[1]
    )
    with pytest.raises(BadInput, match="no time step 3"):
        at_step(again, 3)


def test_the_command_makes_a_scene_of_each_step(series: tuple[Path, Scene]) -> None:
    folder, scene = series
    files = sorted(folder.glob("ball_*.vti"))
    assert command("follow", folder / "scene.svv", *files, "--out", folder / "steps") == 0
    for step in range(len(SHIFTS)):
        alone = Scene.load(folder / "steps" / f"ball_{step}.svv")
        camera = scene.rig.orbit(5, 48)[step]
        assert np.abs(alone.render(camera).rgba - at_step(scene, step).render(camera).rgba).mean() < 5e-3


def test_lists_of_time_steps_tell_their_times(series: tuple[Path, Scene]) -> None:
    folder, _ = series
    listed = [{"name": f"ball_{k}.vti", "time": 0.5 * k - 1} for k in range(3)]
    (folder / "ball.vti.series").write_text(json.dumps({"file-series-version": "1.0", "files": listed}))
    rows = "".join(f'<DataSet timestep="{f["time"]}" file="{f["name"]}"/>' for f in listed)
    (folder / "ball.pvd").write_text(f'<VTKFile type="Collection"><Collection>{rows}</Collection></VTKFile>')
    for name in ("ball.vti.series", "ball.pvd"):
        assert command("follow", folder / "scene.svv", folder / name, "--out", folder / "timed.svv") == 0
        assert Scene.load(folder / "timed.svv").info()["times"] == (-1.0, -0.5, 0.0)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "no list of time steps"), ('{"files": []}', "lists no time steps"),
        ('{"files": [{"name": "a"}]}', "no list"),
        ('{"files": [{"name": "a", "time": 1}, {"name": "b", "time": 1}]}', "the same time"),
    ],
)  # fmt: skip
def test_damaged_lists_say_so(content: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "a.series").write_text(content)
    with pytest.raises(BadInput, match=says):
        read_series(tmp_path / "a.series")


def test_frames_play_the_time_steps(series: tuple[Path, Scene]) -> None:
    folder, _ = series
    assert command("render", folder / "series.svv", "--play", "--size", "32", "--out", folder / "frames") == 0
    frames = [read_png(path) for path in sorted((folder / "frames").glob("*.png"))]
    assert len(frames) == 3
    one = ("render", folder / "series.svv", "--size", "32", "--out", folder / "one.png")
    assert command(*one, "--time", "2") == 0
    assert np.array_equal(read_png(folder / "one.png"), frames[2])
    assert not np.array_equal(frames[0], frames[2])
    assert command(*one, "--play") == 2 and command(*one, "--play", "--time", "1") == 2
    assert command("render", folder / "scene.svv", "--time", "1", "--out", folder / "one.png") == 2


def test_both_transfer_functions_follow_together(followed: Scene, series: tuple[Path, Scene]) -> None:
    """A joined scene has the same time steps as one of its members, and they cost it no more bytes."""
    folder, alone = series
    both = joined([painted(followed), followed.edited(0, opacity=0.5)])
    steps = [Step(f"{k}", float(k), partial(moved_ball, shift)) for k, shift in enumerate(SHIFTS)]
    found, notes = with_time_steps(both, steps)
    assert notes == []
    found.save(folder / "both.svv")
    again = Scene.load(folder / "both.svv")
    camera = again.rig.orbit(5, 48)[1]
    there = at_step(again, 2).isolated(0, 1).render(camera).rgba
    assert np.abs(there - at_step(alone, 2).render(camera).rgba).mean() < 0.01
    extra = (folder / "both.svv").stat().st_size - (folder / "series.svv").stat().st_size
    assert extra < 0.9 * (folder / "scene.svv").stat().st_size


def test_series_that_do_not_fit_say_why(followed: Scene, series: tuple[Path, Scene]) -> None:
    """Steps without the trained one, of equal times, or of which nothing is visible."""

    def steps(*volumes: tuple[float, vtkImageData]) -> list[Step]:
        return [
            Step(f"volume {n}", time, partial(lambda found: found, image)) for n, (time, image) in enumerate(volumes)
        ]

    with pytest.raises(BadInput, match="trained on none of these"):
        with_time_steps(followed, steps((0, moved_ball(0.3)), (1, moved_ball(0.5))))
    with pytest.raises(BadInput, match="same time"):
        with_time_steps(followed, steps((0, moved_ball(0)), (0, moved_ball(0.5))))
    nothing = from_array(np.full((8, 8, 8), 0.05), (2 / 7,) * 3, (-1.0,) * 3)
    found, notes = with_time_steps(followed, steps((0, moved_ball(0)), (1, nothing)))
    assert notes == ["volume 1 shows nothing."]
    assert at_step(found, 1).render(found.rig.orbit(5, 32)[1]).rgba.max() < 0.02
    folder, _ = series
    assert command("follow", folder / "scene.svv", folder / "ball_0.vti", "--out", folder / "x.svv") == 2
    assert (
        command("follow", folder / "scene.svv", folder / "ball_0.vti", folder / "gone.vti", "-o", folder / "x.svv") == 2
    )
    assert not (folder / "x.svv").exists()


def test_a_shot_plays_time_steps_at_its_own_pace(series: tuple[Path, Scene]) -> None:
    scene = series[1]
    film = Film(scene, read_shot({"keys": [{"time": 0, "step": 0}, {"time": 1, "step": 2}]}), (24, 24), fps=4)
    for number, step in enumerate([0, 0, 1, 1, 2]):
        camera = film.cameras[number]
        np.testing.assert_array_equal(film.at(number).render(camera).rgba, at_step(scene, step).render(camera).rgba)
    assert film.told(1) != film.told(2) == film.told(3)


def test_strokes_that_live_at_steps_there_are_not_are_damage(series: tuple[Path, Scene]) -> None:
    scene, _ = brushed(series[1])
    assert scene.styled is not None and scene.styled.brushed is not None and scene.steps is not None
    strokes, count = scene.styled.brushed, len(scene.styled.brushed.regions[0][0])
    assert len(scene.steps) == 3
    good = replace(strokes, lives={0: Lives(np.tile([0, 2], (count, 1)))})
    scene.styled.brushed = good
    again = Scene.from_bytes(scene.to_bytes(), "a.svv").styled
    assert again is not None and again.brushed is not None and again.brushed.lives[0].are_within(3)
    for last in (3, 60_000):
        scene.styled.brushed = replace(good, lives={0: Lives(np.tile([0, last], (count, 1)))})
        with pytest.raises(BadInput, match=r"a\.svv is damaged"):
            Scene.from_bytes(scene.to_bytes(), "a.svv")
