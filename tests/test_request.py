"""One request makes the same scene through every door; ParaView's are in `tests/paraview/test_panels_requests.py`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import svv
from svv.cli.app import app
from svv.errors import BadInput, Cancelled, Progress
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import write_png
from svv.job.request import Correct, Paint, Request, learn, paint, run
from svv.job.workshop import Workshop
from svv.styles.gallery.textures import style_picture
from svv.train.paint import stroke_painting
from svv.train.paint.ink import StyleInput, style_named
from svv.train.run.config import PRESETS, settings_of
from tests.conftest import on_all_threads
from tests.nightly import nightly

SMALL = svv.ViewOptions(n=8, test=0, size=48)

STEPS = ("reconstruct.iterations=60", "recolour.iterations=40")
"""So few steps that the doors differ no less, but sooner."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a volume, its views and a style picture."""
    folder = tmp_path_factory.mktemp("request")
    z, y, x = np.mgrid[-1:1:20j, -1:1:20j, -1:1:20j]
    np.save(folder / "ball.npy", (1.0 - np.sqrt(x**2 + 2.0 * y**2 + 3.0 * (z - 0.2) ** 2)).astype(np.float32))
    svv.make_views(folder / "ball.npy", None, SMALL)[0].write(folder / "views")
    write_png(folder / "brush.png", style_picture("brush strokes"))
    return folder


def styles(place: Path) -> list[StyleInput]:
    name, style = style_named(place / "brush.png")
    return [StyleInput(style, name)]


def of_request(place: Path, out: Path) -> Scene:
    painting = Paint.of(styles(place), svv.PaintOptions(preset="draft"))
    request = Request(svv.ViewSet.read(place / "views"), train=svv.TrainOptions("draft"), paint=painting)
    return run(request).scene


def of_volume(place: Path, out: Path) -> Scene:
    changes = {"preset": "draft", "n": 8, "size": 48, "tell": lambda said: None}
    return svv.paint(place / "ball.npy", place / "brush.png", **changes)


def of_python(place: Path, out: Path) -> Scene:
    trained, _ = svv.train_scene(svv.ViewSet.read(place / "views"), "draft")
    trained.save(out / "scene.svv")
    return svv.stylize_scene(Scene.load(out / "scene.svv"), styles(place), "draft")[0]


def of_background(place: Path, out: Path) -> Scene:
    few = svv.TrainOptions("draft", change=STEPS)  # in another process, which has the preset as it is
    trained, _ = svv.train_scene(svv.ViewSet.read(place / "views"), few, background=True).wait()
    return svv.stylize_scene(trained, styles(place), "draft")[0]


def of_command(place: Path, out: Path) -> Scene:
    scene, painted = out / "scene.svv", out / "painted.svv"
    for words in (
        ["train", place / "views", "--preset", "draft", "--out", scene],
        ["stylize", scene, "--style", place / "brush.png", "--preset", "draft", "--out", painted],
    ):
        done = CliRunner().invoke(app, list(map(str, words)))
        assert done.exit_code == 0, done.output
    return Scene.load(painted)


def of_assistant(place: Path, out: Path) -> Scene:
    workshop = Workshop(place)
    folder = out.relative_to(place)
    workshop.train("views", f"{folder}/scene.svv", "draft")
    workshop.stylize(f"{folder}/scene.svv", ["brush.png"], f"{folder}/painted.svv", "draft")
    return Scene.load(out / "painted.svv")


DOORS = (of_request, of_volume, of_python, of_background, of_command, of_assistant)


@pytest.fixture(scope="module", autouse=True)
def threads() -> Iterator[None]:
    """As many threads as another process has, on which sums depend."""
    with on_all_threads():
        yield


@pytest.fixture(scope="module", autouse=True)
def hurry() -> Iterator[None]:
    """The draft preset takes a few steps, and looks at the style in few and small views, and strokes are broad."""
    few = settings_of(svv.TrainOptions("draft", change=STEPS))
    few = replace(few, stylize=replace(few.stylize, style_views=6, style_size=64))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "draft", few)
        patch.setattr(stroke_painting, "WIDTH", 2.0 * stroke_painting.WIDTH)
        yield


@pytest.fixture(scope="module")
def first(place: Path, threads: None, hurry: None) -> dict[str, np.ndarray]:
    return tables(of_request(place, place))


def tables(scene: Scene) -> dict[str, np.ndarray]:
    """All that has been learned and painted, as the scene's file keeps it."""
    return Scene.from_bytes(scene.to_bytes()).to_arrays()[1]


@pytest.mark.parametrize("door", nightly(DOORS[1:], of_command), ids=lambda door: door.__name__)
def test_the_same_request_makes_the_same_scene_through_every_door(
    place: Path, first: dict[str, np.ndarray], door: Callable[[Path, Path], Scene]
) -> None:
    out = place / door.__name__
    out.mkdir()
    found = tables(door(place, out))
    assert found.keys() == first.keys() and {"styled", "pcn"} <= {name.split(".")[0] for name in found}
    for name, values in found.items():
        assert np.array_equal(values, first[name]), name


def test_work_stops_where_its_progress_raises_and_says_what_is_missing(place: Path) -> None:
    views = svv.ViewSet.read(place / "views")

    def stop(fraction: float, label: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        run(Request(views, train=svv.TrainOptions("draft")), stop)
    with pytest.raises(BadInput, match="No style is given"):
        paint(Request(views), learn(Request(views, train=svv.TrainOptions("draft", time_limit=1.0)))[0])


def test_progress_runs_once_from_0_to_1(place: Path) -> None:
    heard: list[float] = []
    views = svv.ViewSet.read(place / "views")

    def draw(options: svv.ViewOptions, progress: Progress) -> svv.ViewSet:
        assert options == SMALL
        progress(1.0, "drawn")
        return views

    painting = Paint.of(styles(place), svv.PaintOptions(preset="draft", stroke_size=4.0))
    train = svv.TrainOptions("draft", time_limit=1.0)
    result = run(Request(draw, SMALL, train, paint=painting), lambda fraction, label: heard.append(fraction))
    assert heard == sorted(heard) and 0.0 <= heard[0] and heard[-1] <= 1.0 and len(heard) > 5
    assert result.learned is not None and result.painted is not None and result.scene.styled is not None


def test_a_palette_is_corrected_and_says_where_it_comes_from(place: Path) -> None:
    views = svv.ViewSet.read(place / "views")
    scene, _ = learn(Request(views, train=svv.TrainOptions("draft", time_limit=1.0), noted={"key": "a key"}))
    assert scene.made["key"] == "a key" and len(scene.regions) > 1
    correct = Correct(svv.Correction(merge=((0, 1),)), lambda progress: views, svv.PaletteOptions("draft", 1.0))
    result = run(Request(scene, correct=correct, noted={"of": "another"}))
    assert result.scene.made["of"] == "another" and len(result.scene.regions) == len(scene.regions) - 1
