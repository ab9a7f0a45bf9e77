"""Scenes drawn in ink: without features, combined with pictures, in files, with edits, and on the command line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from svv.cli import app as cli
from svv.errors import BadInput, Cancelled
from svv.fields.scene.paint_light import lights_of
from svv.fields.scene.scene import Scene
from svv.options.editing import PAINT_LIGHT
from svv.train.paint.ink import PAPER, Ink, ink_colour
from svv.train.paint.styled_views import stylization_cameras, visible_from
from svv.train.pipeline import stylize_scene
from svv.train.run.config import PRESETS
from svv.train.run.report import Report
from tests.balls import SHORT
from tests.test_styling import SMALL

HATCHED, DOTTED = Ink("hatching"), Ink("stippling")
RED = np.full((48, 48, 3), (0.85, 0.2, 0.1), np.float32)


def draw(scene: Scene, styles: list, **options) -> tuple[Scene, Report]:
    return stylize_scene(scene, styles, SHORT, **{"manner": "pieces", "pieces": SMALL, **options})


def colours(scene: Scene, region: int) -> np.ndarray:
    """Colours of what is seen of a region, without light. (S, 3)"""
    view = visible_from(scene, stylization_cameras(scene, SHORT.stylize)[:1], lambda fraction, label: None)[0]
    assert scene.styled is not None
    with torch.no_grad():
        return scene.styled(view.position[view.region == region]).numpy()


@pytest.fixture(scope="module")
def drawn(balls: Scene) -> tuple[Scene, Report]:
    return draw(balls, [HATCHED, DOTTED])


def test_a_scene_in_ink_is_paper_and_the_inks_of_its_regions(drawn: tuple[Scene, Report]) -> None:
    scene, report = drawn
    assert [r.style for r in scene.regions] == ["ink:hatching", "ink:stippling"]
    assert report["styles"] == {"0": "ink:hatching", "1": "ink:stippling"}
    assert report["features"] == "none" and set(report["seconds"]) == {"paint", "total"}
    for k, region in enumerate(scene.regions):
        found, ink = colours(scene, k), ink_colour(region.colour)
        share = ((found - PAPER) @ (ink - PAPER)) / ((ink - PAPER) @ (ink - PAPER))
        mixed = PAPER + share[:, None] * (ink - PAPER)
        assert np.abs(found - mixed).mean() < 0.02, "nothing but paper and ink"
        assert (share < 0.2).mean() > 0.2 and (share > 0.8).mean() > 0.05


def test_ink_and_pictures_go_together(balls: Scene, drawn: tuple[Scene, Report]) -> None:
    scene, report = draw(balls, [HATCHED, RED], mapping={0: 0, 1: 1})
    assert [r.style for r in scene.regions] == ["ink:hatching", "style 1"] and report["manner"] == {
        "0": "ink",
        "1": "pieces",
    }
    assert np.abs(colours(scene, 0) - colours(drawn[0], 0)).mean() < 0.01
    assert np.abs(colours(scene, 1).mean(0) - RED[0, 0]).max() < 0.15
    assert [r.paint_light for r in scene.regions] == [0.0, PAINT_LIGHT]


def test_going_on_keeps_the_others_and_draws_anew(balls: Scene, drawn: tuple[Scene, Report]) -> None:
    scene, report = draw(drawn[0], [DOTTED], mapping={0: 0}, go_on=True)
    assert [r.style for r in scene.regions] == ["ink:stippling", "ink:stippling"] and report["continued"] == []
    np.testing.assert_allclose(colours(scene, 1), colours(drawn[0], 1), atol=0.02)
    np.testing.assert_allclose(colours(scene, 0), colours(draw(balls, [DOTTED])[0], 0), atol=0.05)


def test_a_checkpoint_and_a_preview_know_ink(balls: Scene, drawn: tuple[Scene, Report], tmp_path: Path) -> None:
    shown: list[Scene] = []
    first = draw(balls, [HATCHED, DOTTED], checkpoint=tmp_path / "c", preview=shown.append)[0]
    assert len(shown) >= 3 and [r.style for r in shown[0].regions] == ["ink:hatching", "ink:stippling"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("svv.train.paint.laying.painted_start", None)
        again = draw(balls, [HATCHED, DOTTED], checkpoint=tmp_path / "c")[0]
        with pytest.raises(TypeError):  # another ink is another painting
            draw(balls, [DOTTED, DOTTED], checkpoint=tmp_path / "c")
    for k in (0, 1):
        np.testing.assert_array_equal(colours(again, k), colours(first, k))
        np.testing.assert_array_equal(colours(again, k), colours(drawn[0], k))


def test_it_stops_when_progress_raises(balls: Scene) -> None:
    said: list[str] = []

    def stop(fraction: float, label: str) -> None:
        said.append(label)
        if label == "drawing lines":
            raise Cancelled

    with pytest.raises(Cancelled):
        draw(balls, [HATCHED], progress=stop)
    assert "stylization views" in said


# --- light ------------------------------------------------------------------------------------------------------------


def test_ink_is_unlit_and_can_be_lit(drawn: tuple[Scene, Report]) -> None:
    scene = drawn[0]
    assert lights_of(scene, "styled")[:, 0].tolist() == [0.0, 0.0]
    assert not scene.history.past, "that is no edit"
    lit = scene.with_paint_light(0.4)
    assert [r.paint_light for r in lit.regions] == [0.4, 0.4]
    assert [r.paint_light for r in lit.reset().regions] == [0.0, 0.0]
    assert lit.undone().regions == scene.regions and lit.undone().redone().regions == lit.regions


def test_the_light_on_paint_is_that_of_the_variant_shown_unless_edited(drawn: tuple[Scene, Report]) -> None:
    scene = drawn[0]
    assert scene.styled is not None
    both = scene.painted(scene.styled, {0: "oil", 1: "ink:hatching"}, {}, "oil")
    assert [r.paint_light for r in both.regions] == [PAINT_LIGHT, 0.0]
    assert [r.paint_light for r in both.with_variant("styled").regions] == [0.0, 0.0]
    edited = both.with_paint_light(0.3, 0)
    assert [r.paint_light for r in edited.with_variant("styled").regions] == [0.3, 0.0]
    assert [r.paint_light for r in edited.with_variant("styled").undone().regions] == [0.0, 0.0]
    assert [r.paint_light for r in both.without_variant("oil").without_variant("styled").regions] == [PAINT_LIGHT] * 2
    plain = scene.without_variant("styled")
    assert [r.paint_light for r in plain.with_edits_of(edited).regions] == [0.3, PAINT_LIGHT]


# --- the command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def svv(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, balls: Scene) -> Callable[..., object]:
    """Run the command in an empty folder with the scene in it; gives its exit code."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PRESETS, "draft", SHORT)
    balls.save("balls.svv")

    def run(*words: str) -> object:
        monkeypatch.setattr(sys, "argv", ["svv", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code

    return run


def test_the_command_draws_and_the_file_says_how(svv: Callable[..., object]) -> None:
    words = ("--map", "0=0,1=1", "--preset", "draft", "--preview", "now.png", "--json", "how.json", "--out", "ink.svv")
    assert not svv("stylize", "balls.svv", "--style", "ink:cross-hatching", "--style", "ink:stippling", *words)
    scene = Scene.load("ink.svv")
    assert [r.style for r in scene.regions] == ["ink:cross-hatching", "ink:stippling"]
    assert [r.paint_light for r in scene.regions] == [0.0, 0.0]
    assert json.loads(Path("how.json").read_text())["features"] == "none"
    assert Path("now.png").is_file()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--style", "ink:scribble"), "There is no 'ink:scribble'; choose one of ink:stippling"),
        (("--style", "ink:hatching", "--style-mask", "0=m.png"), "leave out its mask"),
        (("--style", "ink:hatching", "--preset", "paper"), "Ink is drawn, not matched"),
        (("--style", "ink:hatching", "--stroke-size", "9"), "stroke size must lie between"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    svv: Callable[..., object],
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    sentence: str,
) -> None:
    assert svv("stylize", "balls.svv", *words, "--out", "x.svv") == 2
    said = capsys.readouterr().err
    assert sentence in said and "Traceback" not in said
    assert not Path("x.svv").exists()


def test_a_picture_is_asked_for_where_one_is_needed(tmp_path: Path) -> None:
    from svv.render.gallery import style_file

    with pytest.raises(BadInput, match="a picture is needed here"):
        style_file("ink:hatching", tmp_path)
