"""Other opacities of a scene of learned features, from its volume: as the volume rendering shows them, or refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.core.volumes.classified import cells_with
from svv.dvr.draw.classify import classified_as
from svv.dvr.draw.other_functions import exponents_over
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
from svv.fields.following.other_cells import on_cells
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.job.opacities import with_opacities
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from svv.train.run.config import ReconstructSettings, preset
from tests.nightly import nightly
from tests.test_from_values import moved_ball
from tests.test_ranges import BLUE, RED, bumps
from tests.test_time_steps import command, painted
from tests.volume_files import write_image

SHELL, CORE = (0.3, 0.2, 0.1, BLUE), (0.8, 0.3, 0.8, RED)
BALL = moved_ball(0.0)
SHORT = replace(
    preset("draft", "lattice"), reconstruct=ReconstructSettings(iterations=60, rays=512, cells=32),
    recolour=replace(preset("draft", "lattice").recolour, iterations=80, rays=512),
)  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A trained scene of a ball with a shell."""
    views, _ = make_views(BALL, bumps(SHELL, CORE), n=12, test=1, size=64, mapper="cpu")
    return train_scene(views, SHORT)[0]


def function(shell: float, core: float, place: float = 0.3) -> TransferFunction:
    """The function of the ball with other opacities, and the shell at another value."""
    return bumps((place, 0.2, shell, BLUE), (*CORE[:2], core, RED))


def views_of(shown: TransferFunction) -> ViewSet:
    _, test = make_views(BALL, shown, n=3, test=3, size=64, mapper="cpu")
    assert test is not None
    return test


def psnr(scene: Scene, shown: TransferFunction) -> float:
    return evaluate_scene(scene, views_of(shown), "pcn").psnr


def test_the_same_opacities_are_the_same_scene(scene: Scene) -> None:
    assert with_opacities(scene, function(0.1, 0.8), BALL) is scene


def test_features_on_the_same_cells_stay_as_they_are(scene: Scene) -> None:
    camera = scene.rig.orbit(5, 40)[1]
    assert scene.base.density is not None
    same = on_cells(scene, scene.occupancy, scene.base.density)
    for network in ("base", "pcn"):
        assert (same.render(camera, network).rgba == scene.render(camera, network).rgba).all()


@pytest.mark.parametrize(
    ("shell", "core", "place"),
    nightly(
        [(0.4, 0.8, 0.3), (0.05, 0.8, 0.3), (0.1, 0.4, 0.3), (0.0, 0.8, 0.3), (0.3, 0.0, 0.3), (0.1, 0.8, 0.33)],
        (0.05, 0.8, 0.3),
        (0.3, 0.0, 0.3),
        (0.1, 0.8, 0.33),
    ),
)
def test_other_opacities_are_those_of_the_volume_rendering(
    scene: Scene, shell: float, core: float, place: float
) -> None:
    """Fainter, more opaque, moved or gone: much nearer to it than the scene was, and about as near as it was before."""
    shown = function(shell, core, place)
    changed = psnr(with_opacities(scene, shown, BALL), shown)
    assert changed > psnr(scene, shown) + 3.0
    assert changed > psnr(scene, function(0.1, 0.8)) - 8.0


def test_what_becomes_transparent_is_background(scene: Scene) -> None:
    shown = function(0.0, 0.8)
    changed, test = with_opacities(scene, shown, BALL), views_of(shown)
    for camera, image in zip(test.cameras, test.images, strict=True):
        empty = image[..., 3] == 0
        assert np.quantile(changed.render(camera, "pcn").rgba[..., 3][empty], 0.99) < 0.02
    assert changed.occupancy.fraction < scene.occupancy.fraction


@pytest.mark.slow
def test_what_was_hidden_is_told(scene: Scene) -> None:
    """The inside of an opaque ball, which is then a fog."""
    solid, fog = (bumps((0.55, 0.9, opacity, RED)) for opacity in (1.0, 0.02))
    views, _ = make_views(BALL, solid, n=12, test=1, size=64, mapper="cpu")
    ball = train_scene(views, SHORT)[0]
    changed = with_opacities(ball, fog, BALL)
    (said,) = changed.made["approximate"]
    assert "of what the function shows was hidden when the scene was trained" in said
    assert psnr(changed, fog) > psnr(ball, fog) + 20.0
    assert with_opacities(scene, function(0.1, 0.4), BALL).made["approximate"] == []


def test_edits_paint_and_files_stay(scene: Scene, tmp_path: Path) -> None:
    red = painted(scene).edited(0, opacity=0.5)
    red.save(tmp_path / "scene.svv")
    write_image(tmp_path / "ball.vti", BALL)
    write_image(tmp_path / "other.vti", moved_ball(0.3))
    shown = function(0.4, 0.3, 0.33)
    (tmp_path / "tf.json").write_text(json.dumps([shown.to_dict()]))
    given = "--tf", tmp_path / "tf.json", "--out", tmp_path / "new.svv"
    assert command("opacities", tmp_path / "scene.svv", tmp_path / "other.vti", *given) == 2
    assert command("opacities", tmp_path / "scene.svv", tmp_path / "ball.vti", *given[2:]) == 2
    assert not (tmp_path / "new.svv").exists()
    assert command("opacities", tmp_path / "scene.svv", tmp_path / "ball.vti", *given) == 0
    expected = with_opacities(red, shown, BALL)
    again = Scene.load(tmp_path / "new.svv")
    assert again.regions[0].opacity == 0.5 and again.styled is not None
    camera = again.rig.orbit(5, 40)[1]
    picture = again.render(camera).rgba
    assert np.abs(picture - expected.render(camera).rgba).mean() < 2e-3
    assert np.abs(picture - scene.render(camera).rgba)[..., :3].max() > 0.3  # the paint


def test_what_cannot_be_shown_says_why(scene: Scene) -> None:
    with pytest.raises(BadInput, match="name its volume"):
        with_opacities(scene, function(0.4, 0.8))
    with pytest.raises(BadInput, match="was not trained on this volume"):
        with_opacities(scene, function(0.4, 0.8), moved_ball(0.2))
    with pytest.raises(BadInput, match="svv edit --colour"):
        with_opacities(scene, bumps((*SHELL[:3], RED), CORE), BALL)
    with pytest.raises(BadInput, match="transparent everywhere"):
        with_opacities(scene, function(0.0, 0.0), BALL)
    with pytest.raises(BadInput, match="more than the space that the scene fills"):
        with_opacities(scene, function(0.1, 0.8, 0.12), BALL)
    with pytest.raises(BadInput, match=r"has no colours for .* at values of"):
        with_opacities(scene, bumps((0.5, 0.15, 0.9, (0.1, 0.9, 0.1)), CORE), BALL)
    alone = replace(scene, made={**scene.made, "learned_from": "views only"})
    with pytest.raises(BadInput, match="not learned from its volume"):
        with_opacities(alone, function(0.4, 0.8), BALL)


def test_a_grid_of_exponents_is_that_of_the_classified_volume() -> None:
    """Whatever part of the volume its stage shows."""
    shown = function(0.1, 0.8)
    volume = classified_as(BALL, shown)
    values, (found,) = exponents_over(BALL, (shown,), volume.box, volume.cells)
    assert values.shape == found.shape == volume.exponent.shape
    np.testing.assert_allclose(found.astype(float), volume.exponent.astype(float), atol=0.05)
    assert volume.values is not None
    middle = tuple(n // 2 for n in values.shape)
    assert values[middle] == pytest.approx(np.asarray(BALL.GetPointData().GetScalars()).max(), abs=0.1)


@pytest.mark.parametrize(("own", "cells"), [(8, 4), (4, 4), (4, 8)])
def test_a_cell_counts_if_one_of_its_vertices_does(own: int, cells: int) -> None:
    there = np.zeros((own + 1,) * 3, bool)
    there[own // 2, 0, own] = True
    found = cells_with(there, own, np.array([cells] * 3), cells)
    expected = np.zeros_like(found)
    width = max(1, cells // own)
    expected[cells // 2 - width : cells // 2 + width, :width, cells - width :] = 1
    assert (found == expected).all()
