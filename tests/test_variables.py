"""Several arrays of one data set, and several members of an ensemble, as layers of one scene."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.draw.views import make_views
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from svv.fields.following.followed_scene import at_step
from svv.fields.scene.joined import joined, members
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import write_json
from svv.job.layers import MOST, layers
from svv.job.series import Step, with_time_steps
from svv.options.making import ShownVolumeOptions
from svv.train.pipeline import train_scene
from tests.test_from_values import SHORT, TWO, moved_ball
from tests.test_ranges import BLUE, RED, bumps
from tests.test_time_steps import command

HEAT, SPEED = bumps((0.7, 0.3, 0.8, RED)), bumps((140.0, 60.0, 0.8, BLUE))


def reading(**given: object) -> ShownVolumeOptions:
    return ShownVolumeOptions(**given)  # type: ignore[arg-type]


def test_each_array_is_a_layer_with_its_own_function_or_the_common_one() -> None:
    volume, (a, b) = Path("flow.vti"), (Path("a.json"), Path("b.json"))
    found = layers([volume], reading(array=("heat", "speed"), tf=(a, b)))
    assert [(name, one.array, one.tf) for name, (_, one) in found.items()] == [
        ("heat", ("heat",), (a,)), ("speed", ("speed",), (b,)),
    ]  # fmt: skip
    assert [one.tf for _, one in layers([volume], reading(array=("heat", "speed"), tf=(a,))).values()] == [(a,), (a,)]
    assert [one.tf for _, one in layers([volume], reading(array=("heat", "speed"))).values()] == [(), ()]


def test_each_member_of_an_ensemble_is_a_layer() -> None:
    members = [Path(f"runs/{k}.nii.gz") for k in range(3)]
    found = layers(members, reading(tf=(Path("a.json"),), array=("rain",)))
    assert [*found] == ["0", "1", "2"] and [volume for volume, _ in found.values()] == members
    assert all(one.array == ("rain",) and one.tf == (Path("a.json"),) for _, one in found.values())


def test_one_volume_is_as_before() -> None:
    volume, functions = Path("flow.vti"), (Path("a.json"), Path("x/b.json"))
    assert layers([volume], reading()) == {"": (volume, reading())}
    assert [*layers([volume], reading(tf=functions, array=("heat",)))] == ["a", "b"]


@pytest.mark.parametrize(
    ("volumes", "given", "says"),
    [
        (["a.vti"], {"array": ("heat", "speed", "heat")}, "'heat', would share a folder: name each array once"),
        (["a.vti"], {"array": ("u/x", "u_x")}, "would share a folder"),
        (["a.vti", "x/a.vti"], {}, "'a', would share a folder: rename one of the files, or name each once"),
        (["a.vti", "b.vti"], {"array": ("heat", "speed")}, "not both: join the scenes of each with svv join"),
        (["a.vti"], {"tf": (Path("a.json"), Path("x/a.json"))}, "Transfer functions of the same name"),
        (["a.vti"], {"array": ("u", "v", "w"), "tf": (Path("a.json"), Path("b.json"))}, "3 layers and 2 --tf"),
        ([f"{k}.vti" for k in range(12)], {}, f"12 layers are more than the {MOST} that one scene holds.*svv figure"),
    ],
)
def test_layers_that_cannot_be_say_why(volumes: list[str], given: dict[str, object], says: str) -> None:
    with pytest.raises(BadInput, match=says):
        layers([Path(name) for name in volumes], reading(**given))


@pytest.fixture(scope="module")
def flow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two arrays of different types and units in one file, and their transfer functions."""
    folder = tmp_path_factory.mktemp("flow")
    image = pv.wrap(moved_ball(0.0))
    heat = image.point_data.active_scalars
    other = pv.wrap(moved_ball(0.3)).point_data.active_scalars
    image.clear_data()
    image.point_data["heat"] = heat.astype(np.float32)
    image.point_data["speed"] = np.rint(200.0 * other).astype(np.uint8)
    image.save(folder / "flow.vti")
    for name, function in (("heat", HEAT), ("speed", SPEED)):
        write_json(folder / f"{name}.json", function.to_dict())
    return folder


def test_two_arrays_make_one_scene_of_two_layers(flow: Path) -> None:
    functions = ("--tf", flow / "heat.json", "--tf", flow / "speed.json")
    sizes = ("--n", "6", "--test", "0", "--size", "40", "--mapper", "cpu")
    both = ("views", flow / "flow.vti", "--array", "heat", "--array", "speed", *functions, *sizes)
    assert command(*both, "--out", flow / "views") == 0
    learning = ("--preset", "draft", "--encoding", "values", "--time-limit", "1")
    assert command("train", flow / "views", *learning, "--out", flow / "both.svv") == 0
    scene = Scene.load(flow / "both.svv")
    assert [r.layer for r in scene.regions] == [0, 1]
    assert [r.name for r in scene.regions] == ["heat", "speed"]
    red, blue = (r.colour for r in scene.regions)
    assert red[0] > red[2] and blue[2] > blue[0], "each array keeps its own function"
    camera = scene.rig.orbit(5, 48)[1]
    alone = [scene.isolated(k).render(camera).rgba[..., 3] for k in (0, 1)]
    assert np.abs(alone[0] - alone[1]).max() > 0.3
    together = scene.render(camera).rgba[..., 3]
    np.testing.assert_allclose(together, 1 - (1 - alone[0]) * (1 - alone[1]), atol=0.02)


@pytest.mark.parametrize("words", [("--array", "heat", "--array", "cold"), ("--array", "heat", "--array", "heat")])
def test_a_missing_array_is_told_before_anything_is_drawn(
    words: tuple[str, ...], flow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("views", flow / "flow.vti", *words, "--out", tmp_path / "views") == 2
    assert ("cold" if "cold" in words else "heat") in capsys.readouterr().err
    assert not (tmp_path / "views").exists()


def test_members_of_different_places_are_refused(
    flow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pv.wrap(from_array(np.zeros((4, 4, 4)), origin=(50.0, 0.0, 0.0))).save(tmp_path / "far.vti")
    near = tmp_path / "near.vti"
    pv.wrap(moved_ball(0.0)).save(near)
    assert command("views", near, tmp_path / "far.vti", "--out", tmp_path / "views") == 2
    assert "different places" in capsys.readouterr().err


def test_several_arrays_where_one_is_meant(flow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ("run", flow / "flow.vti", "--array", "heat", "--array", "speed", "--out", tmp_path / "job")
    assert command(*asked) == 2
    assert "Give one --array here" in capsys.readouterr().err


@pytest.fixture(scope="module")
def alone() -> list[Scene]:
    """Scenes of two volumes, each with two time steps of its own."""
    found = []
    for shift in (0.0, 0.2):
        views, _ = make_views(moved_ball(shift), TWO, n=8, test=1, size=48, mapper="cpu")
        found.append(train_scene(views, SHORT)[0])
    return found


def steps_of(*shifts: float) -> list[Step]:
    return [Step(f"{k}", float(k), partial(moved_ball, shift)) for k, shift in enumerate(shifts)]


def test_layers_with_values_of_their_own_do_not_follow_one_volume(alone: list[Scene]) -> None:
    """They would be shown with the values of another volume."""
    with pytest.raises(BadInput, match="follow the scene of each with its own volumes"):
        with_time_steps(joined(alone), steps_of(0.0, 0.1))


def test_series_are_joined_and_each_layer_keeps_its_values(alone: list[Scene], tmp_path: Path) -> None:
    first, _ = with_time_steps(alone[0], steps_of(0.0, 0.1))
    second, _ = with_time_steps(alone[1], steps_of(0.2, 0.3))
    whole = joined([first, second])
    whole.save(tmp_path / "both.svv")
    again = Scene.load(tmp_path / "both.svv")
    camera = again.rig.orbit(5, 40)[1]
    for step in (0, 1):
        both = at_step(again, step)
        at_step(both, 0).save(tmp_path / "step.svv")
        saved = Scene.load(tmp_path / "step.svv")
        for scene in (both, saved):
            for number, series in enumerate((first, second)):
                expected = at_step(series, step).render(camera).rgba[..., 3]
                found = members(scene)[number].render(camera).rgba[..., 3]
                np.testing.assert_allclose(found, expected, atol=0.02)


def test_series_of_other_times_are_not_joined(alone: list[Scene]) -> None:
    first, _ = with_time_steps(alone[0], steps_of(0.0, 0.1))
    with pytest.raises(BadInput, match="Only some of the scenes have time steps"):
        joined([first, alone[1]])
    assert first.steps is not None
    other = replace(first, steps=replace(first.steps, times=(0.0, 5.0)))
    with pytest.raises(BadInput, match="at different times"):
        joined([first, other])
    later, _ = with_time_steps(alone[1], steps_of(0.3, 0.2))
    with pytest.raises(BadInput, match="trained on different time steps, 0 and 1"):
        joined([first, later])


def empty(_: object = None) -> vtkImageData:
    return from_array(np.zeros((8, 8, 8), np.float32), (2 / 7,) * 3, (-1.0,) * 3)


@pytest.mark.parametrize("side", [16, 40])
def test_a_step_of_another_size_or_without_anything_is_followed(alone: list[Scene], side: int) -> None:
    """It is sampled on the grid of the others."""
    other = from_array(
        np.asarray(pv.wrap(moved_ball(0.0)).resample(side / 24).point_data.active_scalars).reshape((side,) * 3),
        (2 / (side - 1),) * 3, (-1.0,) * 3,
    )  # fmt: skip
    steps = [*steps_of(0.0), Step("other", 1.0, lambda: other), Step("nothing", 2.0, empty)]
    found, notes = with_time_steps(alone[0], steps)
    assert "nothing shows nothing." in notes
    camera = found.rig.orbit(5, 40)[1]
    images = [at_step(found, k).render(camera).rgba[..., 3] for k in range(3)]
    assert np.abs(images[1] - images[0]).mean() < 0.03 and images[2].max() < 0.02
