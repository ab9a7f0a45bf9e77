"""Previews of a painting while it is made: when they appear, what they show, and that they change nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.render.frames import SHOWN_SIZE, orbit, previews_in
from svv.train.pipeline import stylize_scene
from svv.train.run import previews
from svv.train.run.config import MatchSettings, Preset
from svv.train.run.report import Report
from tests.balls import MATCHED, SHORT
from tests.cube import cube_paint


@given(step=st.floats(0.01, 3.0), cost=st.floats(0.0, 2.0))
def test_they_come_early_and_then_take_a_hundredth_of_the_time(cube: Scene, step: float, cost: float) -> None:
    paint = cube_paint(cube, 1)
    now, shown = [100.0], []

    def show(scene: Scene) -> None:
        shown.append(now[0])
        now[0] += cost

    made = previews.Previews(show, lambda colours: cube, clock=lambda: now[0])
    now[0] += 2.0  # styles are read
    while now[0] < 700.0:
        now[0] += step
        made.look(paint)
    assert previews.FIRST <= shown[0] - 102.0 - step <= previews.FIRST + step + 1e-6
    assert made.seconds == pytest.approx([t + cost - 100.0 for t in shown])
    waits = np.diff(shown) - cost
    assert len(shown) > 1
    assert waits.min() >= max(previews.EVERY, 100.0 * cost) - 1e-6
    assert waits.max() <= max(previews.EVERY, 100.0 * cost) + step + 1e-6


def painted(scene: Scene, preset: Preset, **options) -> tuple[Scene, Report]:
    style = np.random.default_rng(0).random((48, 48, 3)).astype(np.float32)
    return stylize_scene(scene, [style], preset, **options)


@pytest.mark.parametrize(
    ("preset", "options"),
    [
        (SHORT, {"manner": "pieces"}),
        (SHORT, {"manner": "strokes", "stroke_size": 2.0}),
        (MATCHED, {"features": "embedded"}),
    ],
    ids=["pieces", "strokes", "matched"],
)
def test_they_show_the_painting_come_and_leave_it_as_it_is(
    balls: Scene, monkeypatch: pytest.MonkeyPatch, preset: Preset, options: dict[str, Any]
) -> None:
    """Laid paint after each region, or all that are in strokes at once; learned paint after every step."""
    for name in ("FIRST", "EVERY"):
        monkeypatch.setattr(previews, name, 0.0)
    monkeypatch.setattr(previews, "SHARE", 1e9)
    camera, seen = orbit(balls, 181, 32, 32)[90], []

    def show(scene: Scene) -> None:
        seen.append((scene, scene.render(camera).rgba))

    plain, report = painted(balls, preset, **options)
    assert report["previews"] == []
    watched, report = painted(balls, preset, preview=show, **options)
    how = preset.stylize
    steps = how.distil_iterations + how.style_iterations if isinstance(how, MatchSettings) else 0
    laid = {"pieces": 1 + len(balls.regions), "strokes": 2}.get(options.get("manner", ""), steps)
    assert len(report["previews"]) == laid and report["previews"] == sorted(report["previews"])
    assert len(seen) == laid + 1 and seen[-1][0].styled is watched.styled
    assert plain.styled is not None and watched.styled is not None
    for name, value in plain.styled.state_dict().items():
        assert torch.equal(value, watched.styled.state_dict()[name]), name
    # Each is a copy: the training that went on has not changed it. And each comes nearer to the result.
    for scene, rgba in seen[:: max(1, laid // 6)]:
        np.testing.assert_array_equal(scene.render(camera).rgba, rgba)
    away = [float(np.abs(rgba - seen[-1][1]).mean()) for _, rgba in seen]
    assert away[0] > 1.5 * away[-2] and away[-1] == 0.0


def test_a_file_holds_the_last_of_them(cube: Scene, tmp_path: Path) -> None:
    path = tmp_path / "now.png"
    show = previews_in(path)
    pictures = []
    for paint in (1, 2):
        show(cube.painted(cube_paint(cube, paint), {0: "a", 1: "a", 2: "a"}, {}))
        pictures.append(np.asarray(Image.open(path)))
    assert pictures[0].shape == (SHOWN_SIZE, SHOWN_SIZE, 3) and (pictures[0][0, 0] == 255).all()
    assert (pictures[0] != pictures[1]).any()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("name", "words"), [("now.jpg", "name it .png"), ("nowhere/now.png", "folder does not exist")])
def test_files_that_cannot_hold_them_are_refused_at_once(tmp_path: Path, name: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        previews_in(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
