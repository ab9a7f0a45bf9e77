"""The volume rendering beside a painting: drawn from the volume that the scene knows again, or said not to be."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import svv
from svv.cli import app as cli
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.views import render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array, to_array
from svv.errors import BadInput, silent
from svv.fields.following.followed_scene import FOLLOWED
from svv.fields.scene.scene import Rendering, Scene
from svv.io.views.drawn_views import DrawnViews
from svv.job.source import VolumeSource
from svv.job.volume_panels import panel_of, remembered
from svv.job.workshop import Workshop
from svv.options.figures import FigureOptions
from svv.options.making import ViewOptions
from svv.render.figures.figure import drawing_of
from svv.render.frames import seen_from
from tests.cube import cube_paint
from tests.test_figures import SMALL, texts_of
from tests.test_ranges import RED, bumps
from tests.volume_files import write_function, write_image

pytest.importorskip("matplotlib")
pytestmark = pytest.mark.filterwarnings("ignore:(Regions look alike|Panel a is)")


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svv.render.figures.figure.SWATCH_VIEW", 48)
    monkeypatch.setattr("svv.render.figures.swatches.LIGHT_VIEW", 24)
    monkeypatch.setattr("svv.render.figures.framing.PREVIEW", 64)
    monkeypatch.setattr("svv.fields.scene.seen_colours.VIEW_SIZE", 24)


def ball(radius: float) -> Any:
    """A ball in the box of the cube."""
    axis = np.linspace(-0.5, 0.5, 20)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return from_array(np.clip(1.2 * radius - np.sqrt(x**2 + y**2 + z**2), 0, 1), (1 / 19,) * 3, (-0.5,) * 3)


@pytest.fixture
def volume(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    return write_image(tmp_path / "data" / "ball.vti", ball(0.4))


@pytest.fixture
def learned(cube: Scene, volume: Path, tmp_path: Path) -> Scene:
    """The cube as if it had been trained on views of the ball."""
    tf = write_function(tmp_path / "tf.json", bumps((0.3, 0.4, 0.9, RED)))
    views, unseen = VolumeSource(volume, tf).draw(
        ViewOptions(n=3, test=1, size=8), silent, DrawnViews(tmp_path / "kept", "key")
    )
    assert unseen is not None and unseen.meta.file == views.meta.file is not None
    return replace(cube, made={"source": json.loads(json.dumps(views.meta.to_json()))})


def found(scene: Scene, *named: Any, folder: Path = Path("nowhere")) -> Any:
    return remembered(scene, named, [folder])


def test_the_panel_is_the_volume_as_its_views_were_drawn(learned: Scene, volume: Path) -> None:
    camera = seen_from(learned, 20.0, 10.0, 40, 30)
    panel = svv.volume_panel(learned, volume, camera)
    assert (panel.shows, panel.note) == ("volume rendering", "is drawn from ball.vti.") and panel.draw is not None
    tf = TransferFunction.from_dict(learned.made["source"]["tf"])
    np.testing.assert_array_equal(panel.draw(camera) * 255, render_views(ball(0.4), tf, [camera])[0])
    flat = Camera.orthographic(camera.camera_to_world, 1.5, 40, 30, (12.0, 9.0))
    np.testing.assert_array_equal(panel.draw(flat) * 255, render_views(ball(0.4), tf, [flat])[0])


def test_a_volume_is_known_again_wherever_it_is(
    learned: Scene, volume: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert str(tmp_path) not in json.dumps(learned.made), "a scene that is given to others does not say where"
    for folder in (volume.parent, volume.parent / "scenes"):
        folder.mkdir(exist_ok=True)
        assert found(learned, folder=folder).draw is not None
    moved = volume.rename(tmp_path / "other.vti")
    assert found(learned, moved).said == "other.vti" and found(learned, folder=volume.parent).draw is None
    old = {key: value for key, value in learned.made["source"].items() if key != "file"}
    before = replace(learned, made={"source": old})
    assert found(before, moved).said == "other.vti is not the volume that the scene was trained on, or has changed"
    tf = TransferFunction.from_dict(old["tf"])

    def render(self: Scene, camera: Camera, network: str) -> Rendering:
        """As a scene that has learned the ball."""
        rgba = render_views(ball(0.4), tf, [camera])[0] / np.float32(255)
        return Rendering(rgba, rgba[..., 3], np.zeros(rgba.shape[:2], np.int16))

    monkeypatch.setattr(Scene, "render", render)
    assert found(before, moved).said == "other.vti, known by its grid and how it looks"
    assert found(before, ball(0.4)).draw is not None, "as make_views takes it"
    values = np.roll(to_array(ball(0.4)), 5, axis=2)
    aside = from_array(values, (1 / 19,) * 3, (-0.5,) * 3)
    assert aside.GetScalarRange() == ball(0.4).GetScalarRange()
    assert found(before, aside).said == "What was given is not the volume that the scene was trained on, or has changed"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda v, made: v.unlink(), "the volume ball.vti is not beside the scene; name its file with --volume"),
        (lambda v, made: write_image(v, ball(0.41)), "ball.vti is not the volume that the scene was trained on"),
        pytest.param(
            lambda v, made: v.write_bytes(b"nothing"),
            "ball.vti is not the volume that the scene was trained on",
            marks=pytest.mark.slow,
        ),
        (lambda v, made: made.pop("source"), "does not say which volume it was trained on"),
        (lambda v, made: made.update({FOLLOWED: True}), "shows another time step"),
        pytest.param(
            lambda v, made: made["source"].update(volume="../data/ball.vti"),
            "is not beside the scene",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            lambda v, made: made["source"]["file"].update(dims="many"),
            "must be a list of 3 values",
            marks=pytest.mark.slow,
        ),
        (lambda v, made: made["source"]["file"].pop("content") and write_image(v, ball(0.3)), "or has changed"),
    ],
)
def test_otherwise_the_palette_network_is_shown_and_that_is_said(
    learned: Scene, volume: Path, change: Callable[..., Any], why: str
) -> None:
    made = json.loads(json.dumps(learned.made))
    change(volume, made)
    panel = panel_of(replace(learned, made=made), found(replace(learned, made=made), folder=volume.parent))
    assert panel.draw is None and (panel.network, panel.shows) == ("pcn", "palette network")
    assert panel.note.startswith("shows the palette network, not the volume rendering, because ") and why in panel.note
    with pytest.warns(UserWarning, match="Panel a shows the palette network, not the volume rendering, because"):
        figure = svv.figure([panel, learned], **SMALL)
    assert "palette network" in texts_of(figure)


def test_without_vtk_or_palette_or_alone_that_is_said(
    learned: Scene, volume: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = replace(learned, palette_network=None, regions=())
    assert panel_of(bare, found(bare)).shows == "base network"
    joined = replace(learned, layers=(replace(learned, regions=()),))
    assert found(joined, volume).said == "the scene is joined from several"
    with pytest.raises(BadInput, match=r"There is no volume nothing\.vti; check the path"):
        found(learned, Path("nothing.vti"))

    def missing(*_: object, **__: object) -> None:
        raise BadInput("Volumes need VTK, which is not installed; install it with: pip install 'svv[standalone]'.")

    monkeypatch.setattr(VolumeSource, "image", missing)
    assert found(learned, volume).said.startswith("Volumes need VTK, which is not installed")


def test_the_volume_shows_what_edits_hide_and_that_is_said(learned: Scene, volume: Path) -> None:
    edited = learned.edited(0, name="bone", colour=(0.0, 1.0, 0.0)).hidden(1)
    panel = svv.volume_panel(edited, volume)
    assert panel.note == "is drawn from ball.vti, without the edits of the scene."
    assert [r.hidden for r in panel.scene.regions] == [False] * 3 and panel.scene.regions[0].name == "bone"
    assert panel.scene.regions[0].edited_colour is None
    renamed = learned.edited(0, name="bone")
    assert svv.volume_panel(renamed, volume).note == "is drawn from ball.vti.", "a name is no other picture"


@pytest.mark.parametrize("frame", ["content", "camera"])
def test_both_panels_show_the_same_part_at_the_same_scale(learned: Scene, volume: Path, frame: str) -> None:
    """The window of the ball is that of the cube around it, so a pixel of one panel is that of the other."""
    cameras: list[list[Camera]] = [[], []]
    panel = svv.volume_panel(learned, volume)
    assert panel.draw is not None
    draw, render = panel.draw, Scene.render

    def noted(camera: Camera) -> Any:
        cameras[0].append(camera)
        return draw(camera)

    def rendered(self: Scene, camera: Camera, *rest: Any) -> Any:
        cameras[1].append(camera)
        return render(self, camera, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Scene, "render", rendered)
        svv.figure([replace(panel, draw=noted), learned.hidden(0)], frame=frame, parallel=True, **SMALL)
    one, other = cameras[0][-1], cameras[1][-1]
    assert (one.width, one.height, one.span_x) == (other.width, other.height, other.span_x)
    assert one.principal_point == pytest.approx(other.principal_point)


def test_what_a_panel_shows_is_said_before_it_is_drawn(learned: Scene, volume: Path) -> None:
    panel = svv.volume_panel(learned, volume)
    assert panel.draw is not None
    told: list[str] = []
    before: list[list[str]] = []

    def noted(camera: Camera, draw: Any = panel.draw) -> Any:
        before.append(list(told))
        return draw(camera)

    svv.figure([replace(panel, draw=noted), learned.hidden(0)], tell=told.append, **SMALL)
    assert before[0] == ["Panel a is drawn from ball.vti."]


def test_the_command(
    learned: Scene, volume: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    painted = learned.painted(cube_paint(learned, 1), {0: "oil"}, {}, "oil")
    painted.painted(cube_paint(learned, 2), {0: "ink"}, {}, "ink").save("data/scene.svv")

    def run(*words: str) -> Any:
        cli.app(["figure", "data/scene.svv", *words, "--dpi", "50"], prog_name="svv", standalone_mode=False)
        return json.loads(Path("report.json").read_text())

    told = run(*"--panel dvr --variant oil --variant ink --view 0,0 --view 90,0 --json report.json -o a.png".split())
    assert [p["shows"] for p in told["panels"]] == ["volume rendering"] * 2 + ["painting"] * 4
    assert "svv: Panel b is drawn from ball.vti." in capsys.readouterr().err
    volume.unlink()
    told = run(*"--panel dvr --title one --legend none --json report.json -o a.png".split())
    why = "Panel a shows the palette network, not the volume rendering, because the volume ball.vti is not beside"
    assert [p["shows"] for p in told["panels"]] == ["palette network", "painting"] and told["panels"][0][
        "title"
    ] == "one"
    assert why in told["panels"][0]["note"] and f"svv: {why}" in capsys.readouterr().err
    with pytest.raises(BadInput, match="--volume names the volume for --panel dvr: give both"):
        run(*f"--volume {tmp_path / 'tf.json'} -o a.png".split())


def test_an_assistants_figure_reads_nothing_beyond_its_folder(
    learned: Scene, volume: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "root"
    (root / "in").mkdir(parents=True)
    outside = volume.rename(tmp_path / "ball.vti")
    assert remembered(learned, [], [root]).draw is not None
    assert remembered(learned, [], [root], root).draw is None, "beside the folder, but beyond it"
    (root / "ball.vti").symlink_to(outside)
    assert remembered(learned, [], [root], root).draw is None, "a link leads there, too"
    (root / "ball.vti").unlink()
    outside.rename(root / "ball.vti")
    learned.save(root / "in" / "scene.svv")
    monkeypatch.setattr("svv.render.figures.figure.FigureOptions", lambda: FigureOptions(**SMALL))
    assert Workshop(root).figure(["in/scene.svv"], "a.png", volume=True)[0] == "Panel a is drawn from ball.vti."


def test_a_figure_tells_the_colours_of_the_volume_rendering(learned: Scene, volume: Path, tmp_path: Path) -> None:
    from svv.render.figures.colour_check import report_on, seen_in_picture

    drawing = drawing_of([svv.volume_panel(learned, volume), learned], tmp_path / "a.png", **SMALL)
    told, report = seen_in_picture(tmp_path / "a.png"), drawing.report()
    for panel, seen in zip(report["panels"], told, strict=True):
        assert panel["colours"]["smallest"]["normal"]["difference"] == pytest.approx(
            report_on(seen)["smallest"]["normal"]["difference"], abs=0.05
        )
    reds = told[0][0].colours
    assert (reds[:, 0] > reds[:, 2]).all(), "the ball is red, whatever the cube is"
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.info["Description"].startswith("A volume rendering of 3 regions")
