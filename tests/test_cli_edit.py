"""`svv edit`, and edited scenes in `svv render` and `svv info`: each command is one step, which can be undone."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.cli import app as cli
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from tests.cube import cube_paint
from tests.loose_balls import from_front, loose_balls

Run = Callable[..., None]


@pytest.fixture
def svv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cube: Scene) -> Run:
    """Run a command in a folder with `cube.svv` and the painted `two.svv`."""
    monkeypatch.chdir(tmp_path)
    cube.save("cube.svv")
    ink = cube.painted(cube_paint(cube, 1), {0: "brush"}, {}, "ink")
    ink.painted(cube_paint(cube, 2), {0: "oil", 1: "oil"}, {}, "oil").save("two.svv")

    def run(*arguments: str) -> None:
        cli.app(list(arguments), prog_name="svv", standalone_mode=False)

    return run


def test_one_command_is_one_step(svv: Run) -> None:
    svv("edit", "cube.svv", "--region", "0", "--opacity", "0.5", "--hide", "1,2", "--out", "a.svv")
    edited = Scene.load("a.svv")
    assert edited.regions[0].opacity == 0.5
    assert [r.hidden for r in edited.regions] == [False, True, True]
    assert len(edited.history.past) == 1
    svv("edit", "a.svv", "--show", "all", "--out", "b.svv")
    assert [r.hidden for r in Scene.load("b.svv").regions] == [False] * 3
    svv("edit", "b.svv", "--undo", "--undo", "--out", "c.svv")
    assert Scene.load("c.svv").regions == Scene.load("cube.svv").regions
    svv("edit", "c.svv", "--redo", "--out", "c.svv")
    assert Scene.load("c.svv").regions == edited.regions
    svv("edit", "c.svv", "--reset", "0", "--isolate", "1", "--out", "d.svv")
    assert Scene.load("d.svv").regions[0].opacity == 1.0
    assert [r.hidden for r in Scene.load("d.svv").regions] == [True, False, True]


def test_a_picture_of_each_variant(svv: Run) -> None:
    pictures = {}
    for name in ("ink", "oil"):
        svv("render", "two.svv", "--variant", name, "--size", "32", "--out", f"{name}.png")
        pictures[name] = np.asarray(Image.open(f"{name}.png"))
    svv("edit", "two.svv", "--drop-variant", "oil", "--out", "one.svv")
    svv("render", "one.svv", "--size", "32", "--out", "one.png")
    np.testing.assert_array_equal(np.asarray(Image.open("one.png")), pictures["ink"])
    assert not np.array_equal(pictures["ink"], pictures["oil"])
    svv("edit", "two.svv", "--show-variant", "ink", "--strength", "0", "--out", "faint.svv")
    svv("render", "faint.svv", "--size", "32", "--out", "faint.png")
    svv("render", "two.svv", "--network", "pcn", "--size", "32", "--out", "plain.png")
    faint, plain = (np.asarray(Image.open(f"{name}.png"), int) for name in ("faint", "plain"))
    np.testing.assert_allclose(faint, plain, atol=1)


def test_light_on_paint_of_a_region_or_of_all(svv: Run) -> None:
    svv("edit", "two.svv", "--paint-light", "0", "--out", "flat.svv")
    flat = Scene.load("flat.svv")
    assert [r.paint_light for r in flat.regions] == [0.0] * 3
    assert [step.what for step in flat.history.past] == ["light on paint 0"]
    svv("edit", "flat.svv", "--region", "1", "--paint-light", "1", "--strength", "0.5", "--out", "one.svv")
    assert [r.paint_light for r in Scene.load("one.svv").regions] == [0.0, 1.0, 0.0]
    svv("edit", "one.svv", "--undo", "--undo", "--out", "back.svv")
    assert Scene.load("back.svv").regions == Scene.load("two.svv").regions
    pictures = {}
    for name in ("two", "flat"):
        svv("render", f"{name}.svv", "--size", "32", "--out", f"{name}.png")
        pictures[name] = np.asarray(Image.open(f"{name}.png"), int)
    assert not np.array_equal(pictures["two"], pictures["flat"])


def test_opacity_along_strokes_of_a_region_or_of_all(svv: Run) -> None:
    svv("edit", "two.svv", "--stroke-opacity", "0.6", "--out", "strokes.svv")
    strokes = Scene.load("strokes.svv")
    assert [r.stroke_opacity for r in strokes.regions] == [0.6] * 3
    assert [step.what for step in strokes.history.past] == ["stroke opacity 0.6"]
    svv("edit", "strokes.svv", "--region", "1", "--stroke-opacity", "-1", "--out", "one.svv")
    assert [r.stroke_opacity for r in Scene.load("one.svv").regions] == [0.6, -1.0, 0.6]
    svv("edit", "one.svv", "--undo", "--undo", "--out", "back.svv")
    assert Scene.load("back.svv").regions == Scene.load("two.svv").regions


def test_outlines_of_a_region_or_of_all(svv: Run) -> None:
    svv("edit", "two.svv", "--outline", "0.8", "--outline-width", "4", "--out", "inked.svv")
    inked = Scene.load("inked.svv")
    assert [(r.outline, r.outline_width) for r in inked.regions] == [(0.8, 4.0)] * 3
    assert [step.what for step in inked.history.past] == ["outline 0.8, 4 px wide"]
    svv("edit", "inked.svv", "--region", "1", "--outline", "0", "--outline-colour", "#ff0000", "--out", "one.svv")
    one = Scene.load("one.svv")
    assert [(r.outline, r.outline_colour == (1.0, 0.0, 0.0)) for r in one.regions] == [(0.8, False), (0.0, True),
                                                                                   (0.8, False)]  # fmt: skip
    svv("edit", "one.svv", "--undo", "--undo", "--out", "back.svv")
    assert Scene.load("back.svv").regions == Scene.load("two.svv").regions
    pictures = {}
    for name in ("two", "inked", "back"):
        svv("render", f"{name}.svv", "--size", "96", "--out", f"{name}.png")
        pictures[name] = np.asarray(Image.open(f"{name}.png"), int)
    np.testing.assert_array_equal(pictures["back"], pictures["two"])
    assert not np.array_equal(pictures["inked"], pictures["two"])


def test_a_part_is_split_off_at_a_pixel_or_at_a_point(svv: Run, capsys: pytest.CaptureFixture[str]) -> None:
    loose_balls().save("balls.svv")
    front = from_front()
    pose = {"camera_to_world": front.camera_to_world.tolist(), "camera_angle_x": front.fov_x}
    Path("front.json").write_text(json.dumps(pose))
    seen = ("--camera", "front.json", "--size", "80x60")
    svv("render", "balls.svv", *seen, "--out", "balls.png")
    rows, columns = np.nonzero(np.asarray(Image.open("balls.png"))[..., 3] > 250)
    left = columns < 40
    pixel = f"{columns[left].mean():.0f},{rows[left].mean():.0f}"
    edits = ("--region", "2", "--colour", "#ff0000", "--hide", "0")
    svv("edit", "balls.svv", "--split-at", pixel, *seen, *edits, "--out", "a.svv")
    assert "Region 2 was part of region 0: 50 % of it" in capsys.readouterr().err
    scene = Scene.load("a.svv")
    assert [(r.part_of, r.hidden) for r in scene.regions] == [(None, True), (None, False), (0, False)]
    assert [step.what for step in scene.history.past] == ["split region 0; hide 0; region 2: colour #ff0000"]
    svv("render", "a.svv", *seen, "--out", "a.png")
    picture = np.asarray(Image.open("a.png"))
    assert (picture[rows[left], columns[left], 3] > 240).all() and picture[:, 40:, 3].max() == 0
    svv("edit", "a.svv", "--undo", "--out", "b.svv")
    assert Scene.load("b.svv").regions == Scene.load("balls.svv").regions
    svv("edit", "b.svv", "--redo", "--out", "b.svv")
    assert Scene.load("b.svv").regions == scene.regions
    svv("edit", "balls.svv", "--split-at", "400,400", "--out", "c.svv")  # `svv render` shows the right ball in front
    svv("edit", "balls.svv", "--split-at", "0.28,0,0", "--split-level", "0.5", "--out", "d.svv")
    for name in "cd":
        svv("edit", f"{name}.svv", "--hide", "2", "--out", f"{name}.svv")
        svv("render", f"{name}.svv", *seen, "--out", f"{name}.png")
        alpha = np.asarray(Image.open(f"{name}.png"))[..., 3]
        assert alpha[:, :40].max() > 250 and alpha[:, 40:].max() == 0


def test_info_lists_variants_and_history(svv: Run, capsys: pytest.CaptureFixture[str]) -> None:
    svv("edit", "two.svv", "--isolate", "1", "--out", "a.svv")
    capsys.readouterr()
    svv("info", "a.svv", "--json", "a.json")
    shown, content = capsys.readouterr().out, json.loads(Path("a.json").read_text())
    assert content["variants"] == {"ink": {"0": "brush"}, "oil": {"0": "oil", "1": "oil"}}
    assert (content["variant"], content["undo"], content["redo"]) == ("oil", ["isolate 1"], [])
    assert "isolate 1" in shown and "ink" in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["edit", "cube.svv"], "Nothing to change"),
        (["edit", "cube.svv", "--region", "0"], "Nothing to change"),
        (["edit", "cube.svv", "--outline-width", "99"], "at most 16 pixels wide"),
        (["edit", "cube.svv", "--outline-width", "0"], "wider than 0"),
        (["edit", "cube.svv", "--outline", "1", "--region", "7"], "no region 7"),
        (["edit", "cube.svv", "--opacity", "0.5"], "--region K"),
        (["edit", "cube.svv", "--region", "9", "--opacity", "0.5"], "no region 9"),
        (["edit", "cube.svv", "--isolate", "9"], "no region 9"),
        (["edit", "cube.svv", "--hide", "all"], "whole numbers"),
        (["edit", "cube.svv", "--show", "x"], "whole numbers"),
        (["edit", "cube.svv", "--reset", "4"], "no region 4"),
        (["edit", "cube.svv", "--undo"], "nothing to undo"),
        (["edit", "cube.svv", "--redo"], "nothing to redo"),
        (["edit", "cube.svv", "--undo", "--hide", "0"], "not more than one"),
        (["edit", "cube.svv", "--undo", "--redo"], "not more than one"),
        (["edit", "cube.svv", "--show-variant", "ink"], "never painted"),
        (["edit", "two.svv", "--drop-variant", "gold"], "no variant 'gold'"),
        (["edit", "two.svv", "--region", "0", "--colour", "#ff0000"], "is styled"),
        (["edit", "cube.svv", "--split-at", "1"], "needs a pixel"),
        (["edit", "cube.svv", "--split-at", "1,nan"], "needs a pixel"),
        (["edit", "cube.svv", "--split-at", "0,0"], "Nothing is visible at the pixel 0,0"),
        (["edit", "cube.svv", "--split-at", "900,0"], "outside the picture of 800 x 800 pixels"),
        (["edit", "cube.svv", "--split-at", "9,9,9"], "There is nothing at 9, 9, 9"),
        (["edit", "cube.svv", "--split-at", "0,0,0", "--size", "80"], "belong to a pixel"),
        (["edit", "cube.svv", "--split-at", "0,0,0", "--split-level", "0"], "level of a split must be above 0"),
        (["edit", "cube.svv", "--split-level", "0.5"], "need --split-at"),
        (["edit", "cube.svv", "--hide", "0", "--camera", "x.json"], "need --split-at"),
        (["edit", "cube.svv", "--undo", "--split-at", "1,1"], "not more than one"),
        (["render", "two.svv", "--variant", "gold"], "no variant 'gold'"),
        (["render", "two.svv", "--variant", "ink", "--network", "pcn"], "leave out --network pcn"),
        (["palette", "cube.svv", "--views", "none", "--set", "0"], "does not set a colour"),
        (["palette", "cube.svv", "--views", "none", "--set", "x=#ff0000"], "does not set a colour"),
        (["palette", "cube.svv", "--views", "none", "--merge", "0;1"], "whole numbers"),
        (["palette", "cube.svv", "--views", "none", "--add", "red"], "is not a colour"),
        (["palette", "cube.svv", "--views", "none", "--point", "1,2"], "does not point at a place"),
        (["palette", "cube.svv", "--views", "none", "--merge", "0,1", "--size", "64"], "need --point"),
        (["palette", "cube.svv", "--views", "none", "--add", "#ff0000"], "none"),
        (["stylize", "two.svv", "--style", "none.png", "--variant", "ink"], "none.png"),
    ],
)
def test_bad_use_is_one_sentence_and_writes_nothing(
    svv: Run, arguments: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(Path().iterdir())
    monkeypatch.setattr(sys, "argv", ["svv", *arguments, "--out", "x.svv" if arguments[0] != "render" else "x.png"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    error = capsys.readouterr().err
    assert ended.value.code == 2
    assert error.startswith("svv: ") and error.count("\n") == 1 and said in error, error
    assert sorted(Path().iterdir()) == before


def test_a_painting_of_a_name_that_is_there_is_refused_before_work_begins(svv: Run) -> None:
    Image.fromarray(np.zeros((32, 32, 3), np.uint8)).save("style.png")
    with pytest.raises(BadInput, match="already a variant 'ink'"):
        svv("stylize", "two.svv", "--style", "style.png", "--variant", "ink", "--out", "x.svv")
    assert not Path("x.svv").exists()
