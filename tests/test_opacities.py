"""Other opacities of a scene's transfer function, at once: what a scene trained with them would show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.core.colour.correction import Correction
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.job.opacities import with_opacities
from svv.train.correct import correct_palette
from svv.train.evaluate import evaluate_scene
from svv.train.palette import recolour
from svv.train.pipeline import train_scene
from tests.cube import cube_scene
from tests.nightly import nightly
from tests.test_from_values import SHORT, moved_ball
from tests.test_ranges import BLUE, RED, bumps
from tests.test_time_steps import command, painted

SHELL, CORE = (0.3, 0.2, 0.1, BLUE), (0.8, 0.3, 0.8, RED)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A trained scene of a ball with a shell."""
    views, _ = make_views(moved_ball(0.0), bumps(SHELL, CORE), n=12, test=1, size=64, mapper="cpu")
    return train_scene(views, SHORT)[0]


def function(scene: Scene, shell: float, core: float) -> TransferFunction:
    """The scene's function with other opacities."""
    unit = TransferFunction.from_dict(scene.made["source"]["tf"]).unit_distance
    parts = bumps((*SHELL[:2], shell, BLUE), (*CORE[:2], core, RED))
    return replace(parts, unit_distance=unit)


def psnr(scene: Scene, shown: TransferFunction) -> float:
    _, test = make_views(moved_ball(0.0), shown, n=3, test=3, size=64, mapper="cpu")
    assert test is not None
    return evaluate_scene(scene, test, "pcn").psnr


def test_the_same_opacities_change_nothing(scene: Scene) -> None:
    camera = scene.rig.orbit(5, 40)[1]
    same = with_opacities(scene, function(scene, 0.1, 0.8))
    assert np.abs(same.render(camera).rgba - scene.render(camera).rgba).mean() < 3e-3


@pytest.mark.parametrize(
    ("shell", "core"), nightly([(0.4, 0.8), (0.02, 0.8), (0.1, 0.2), (0.0, 0.8), (0.3, 0.0)], (0.02, 0.8), (0.3, 0.0))
)
def test_other_opacities_are_those_of_the_volume_rendering(scene: Scene, shell: float, core: float) -> None:
    """Much nearer to it than the scene was, and about as near as that to its own function, though hardly trained."""
    shown = function(scene, shell, core)
    changed = psnr(with_opacities(scene, shown), shown)
    assert changed > psnr(scene, shown) + 3.0
    assert changed > psnr(scene, function(scene, 0.1, 0.8)) - 6.0


def test_a_palette_is_not_corrected_with_views_of_other_opacities(scene: Scene) -> None:
    """Its regions would learn the colours of pictures in which other things hide each other."""
    views, _ = make_views(moved_ball(0.0), bumps(SHELL, CORE), n=12, test=1, size=64, mapper="cpu")
    changed = with_opacities(scene, function(scene, 0.02, 0.8))
    with pytest.raises(BadInput, match=r"other opacities than these views.*views of the transfer function as it is"):
        correct_palette(changed, views, Correction(merge=((0, 1),)), "draft")


def test_what_others_hid_has_the_colours_of_the_function() -> None:
    """The views show nothing of a core behind an opaque shell, but the transfer function tells its colour."""
    views, _ = make_views(moved_ball(0.0), bumps((*SHELL[:2], 0.98, BLUE), CORE), n=12, test=1, size=64, mapper="cpu")
    scene = train_scene(views, SHORT)[0]
    shown = function(scene, 0.05, 0.8)
    assert psnr(with_opacities(scene, shown), shown) > 29.0  # without being told: 26.4, a yellow core


def test_what_was_hidden_and_never_learned_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recolour, "FUNCTION_WEIGHT", 0.0)
    views, _ = make_views(moved_ball(0.0), bumps((*SHELL[:2], 0.98, BLUE), CORE), n=12, test=1, size=64, mapper="cpu")
    scene = train_scene(views, SHORT)[0]
    with pytest.raises(BadInput, match="hidden behind others when the scene was trained"):
        with_opacities(scene, function(scene, 0.05, 0.8))
    with_opacities(scene, function(scene, 0.99, 0.8))  # hides no less


def test_edits_paint_and_files_stay(scene: Scene, tmp_path: Path) -> None:
    red = painted(scene).edited(0, opacity=0.5)
    red.save(tmp_path / "scene.svv")
    (tmp_path / "tf.json").write_text(json.dumps([function(scene, 0.4, 0.3).to_dict()]))
    asked = ("opacities", tmp_path / "scene.svv", "--tf", tmp_path / "tf.json", "--out", tmp_path / "new.svv")
    assert command(*asked) == 0
    again = Scene.load(tmp_path / "new.svv")
    assert again.regions[0].opacity == 0.5 and again.styled is not None
    expected = with_opacities(red, function(scene, 0.4, 0.3))
    camera = again.rig.orbit(5, 40)[1]
    np.testing.assert_allclose(again.render(camera).rgba, expected.render(camera).rgba, atol=0.02)
    back = with_opacities(again, function(scene, 0.1, 0.8))
    assert np.abs(back.render(camera).rgba - red.render(camera).rgba).mean() < 0.01


def test_what_cannot_be_shown_says_why(scene: Scene) -> None:
    """Values without a colour, other colours, nothing at all, or scenes of another kind."""
    unit = function(scene, 0.1, 0.8).unit_distance
    wider = replace(bumps((0.5, 0.3, 0.5, BLUE)), unit_distance=unit)
    with pytest.raises(BadInput, match="has no colour for them: train a scene"):
        with_opacities(scene, wider)
    with pytest.raises(BadInput, match="svv edit --colour"):
        with_opacities(scene, replace(bumps((*SHELL[:3], RED), CORE), unit_distance=unit))
    with pytest.raises(BadInput, match="shows none of the scene's values"):
        with_opacities(scene, function(scene, 0.0, 0.0))
    with pytest.raises(BadInput, match="does not know its volume's values"):
        with_opacities(cube_scene(), wider)
    with pytest.raises(BadInput, match="one transfer function"):
        with_opacities(joined([scene, scene]), function(scene, 0.4, 0.8))
