"""How far pictures can be trusted: errors that a scene expects are those of views that it never saw."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.stats import spearmanr

from svv.cli import app
from svv.core.geometry.cameras import sphere_cameras
from svv.errors import BadInput
from svv.fields.scene.expected import CELLS, LEVELS, ExpectedErrors
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import darkest_from, doubt_picture
from svv.io.views.viewset import ViewSet
from svv.render.frames import RenderSettings, orbit, write_movie, write_view
from svv.train.doubt_scores import DoubtScores, doubt_scores, scores_of, tiles
from svv.train.expected_errors import FEW, UNSEEN, _cells, expected_errors
from tests.balls import balls_views, two_balls
from tests.cube import cube_paint
from tests.solid_ball import solid_ball


def constant(error: float = 0.1, edge: float = 0.0) -> ExpectedErrors:
    """The same error everywhere in the unit box."""
    return ExpectedErrors(np.full((CELLS,) * 3, 255, np.uint8), error, edge, error, error, (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def cube_that_knows(cube: Scene) -> Scene:
    """The cube, with errors that differ from cell to cell."""
    level = np.random.default_rng(0).integers(1, 256, (CELLS,) * 3).astype(np.uint8)
    return replace(cube, expected=ExpectedErrors(level, 0.2, 0.1, 0.1, 0.15, (0.1, 0.2, 0.3)))


def test_in_the_middle_of_cells_errors_are_theirs_and_between_them_means() -> None:
    level = np.random.default_rng(1).integers(0, 256, (CELLS, CELLS // 2, 3)).astype(np.uint8)
    known = ExpectedErrors(level, 0.25, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0))
    at = np.argwhere(level >= 0)
    own = 0.25 * (level / LEVELS) ** 2
    middles = torch.tensor((at + 0.5) / CELLS, dtype=torch.float32)
    np.testing.assert_allclose(known.of(middles).numpy(), own[tuple(at.T)], atol=1e-6)
    between = torch.tensor((at[at[:, 0] < CELLS - 1] + [1.0, 0.5, 0.5]) / CELLS, dtype=torch.float32)
    np.testing.assert_allclose(known.of(between).numpy(), (0.5 * (own[1:] + own[:-1])).ravel(), atol=1e-6)
    assert known.of(torch.zeros(0, 3)).shape == (0,)


def test_where_all_errors_are_alike_a_pixel_has_them_by_its_alpha(cube: Scene) -> None:
    camera = orbit(cube, 5, 24, 20)[1]
    image = replace(cube, joined=0.0).render(camera, "pcn")
    found = replace(cube, joined=0.0, expected=constant()).doubt(camera)
    assert np.array_equal(np.isnan(found), np.isnan(image.depth)) and np.isfinite(found).sum() > 100
    np.testing.assert_allclose(np.nan_to_num(found), 0.1 * image.rgba[..., 3], atol=2e-4)


def test_edges_add_what_neighbours_differ_by() -> None:
    ball = replace(solid_ball(), expected=constant(0.0, 0.5))
    found = ball.doubt(orbit(ball, 5, 64, 64)[2])
    inside, rim = found[28:36, 28:36], np.nanmax(found)
    assert rim > 5.0 * max(float(np.nanmax(inside)), 0.01)


def test_an_edge_counts_the_same_in_pictures_of_any_size() -> None:
    ball = replace(solid_ball(densest=0.0), expected=constant(0.0, 0.5))  # a fog, whose edges are soft
    sizes = [np.nanmean(ball.doubt(orbit(ball, 5, side, side)[2])) for side in (48, 96, 192)]
    assert max(sizes) < 1.3 * min(sizes) and min(sizes) > 0.0


def test_a_painting_is_doubted_as_the_scene_below_it(cube_that_knows: Scene) -> None:
    styled = tuple(replace(region, style="a picture") for region in cube_that_knows.regions)
    painted = replace(cube_that_knows, styled=cube_paint(cube_that_knows, 1), regions=styled)
    camera = orbit(painted, 5, 20, 20)[2]
    assert np.abs(painted.render(camera).rgba - cube_that_knows.render(camera).rgba).max() > 0.1
    np.testing.assert_array_equal(painted.doubt(camera), cube_that_knows.doubt(camera))


def test_what_is_cut_off_or_hidden_is_not_doubted(cube_that_knows: Scene) -> None:
    camera = orbit(cube_that_knows, 5, 24, 24)[2]
    hidden = replace(cube_that_knows, regions=tuple(replace(r, hidden=True) for r in cube_that_knows.regions))
    assert np.isnan(hidden.doubt(camera)).all()
    half = cube_that_knows.cut("x>50%")
    assert np.isnan(half.doubt(camera)).sum() > np.isnan(cube_that_knows.doubt(camera)).sum()


@pytest.mark.parametrize("section", ["flat", "hatched"])
def test_faces_of_cuts_are_doubted_as_they_were_learned(section: str, cube_that_knows: Scene) -> None:
    half = cube_that_knows.cut("x>50%")
    drawn = half.with_section(section)
    camera = orbit(half, 5, 24, 24)[2]
    assert np.abs(drawn.render(camera).rgba - half.render(camera).rgba).max() > 0.1
    np.testing.assert_array_equal(drawn.doubt(camera), half.doubt(camera))


def test_files_keep_expected_errors(cube_that_knows: Scene, tmp_path: Path) -> None:
    cube_that_knows.save(tmp_path / "a.svv")
    again = Scene.load(tmp_path / "a.svv")
    assert again.expected is not None and cube_that_knows.expected is not None
    np.testing.assert_array_equal(again.expected.level, cube_that_knows.expected.level)
    assert replace(again.expected, level=None) == replace(cube_that_knows.expected, level=None)  # type: ignore[arg-type]
    camera = orbit(again, 5, 16, 16)[2]
    np.testing.assert_array_equal(again.doubt(camera), cube_that_knows.doubt(camera))
    assert "10.0%" in again.info()["doubt"] and "x 0.1, y 0.2, z 0.3" in again.info()["doubt"]


@pytest.mark.parametrize(
    "change", [{"cells": 8}, {"most": -1.0}, {"edge": float("nan")}, {"place": [0.0]}, {"mean": 2}]
)
def test_damaged_errors_are_refused(cube_that_knows: Scene, change: dict[str, object]) -> None:
    header, arrays = cube_that_knows.to_arrays()
    header["expected"] |= change
    with pytest.raises((KeyError, TypeError, ValueError, BadInput)):
        Scene.from_arrays(header, arrays)
    header, arrays = cube_that_knows.to_arrays()
    arrays["expected.level"] = arrays["expected.level"][1:]
    with pytest.raises(ValueError, match="does not fit"):
        Scene.from_arrays(header, arrays)


def test_scenes_that_do_not_know_say_so(cube: Scene, cube_that_knows: Scene) -> None:
    camera = orbit(cube, 5, 8, 8)[2]
    with pytest.raises(BadInput, match="train it again"):
        cube.doubt(camera)
    assert cube.info()["doubt"] is None
    with pytest.raises(BadInput, match="one transfer function"):
        joined([cube_that_knows, cube_that_knows]).doubt(camera)


# --- learned --------------------------------------------------------------------------------------------------------


def unseen_views() -> ViewSet:
    cameras = sphere_cameras(7, (0.0, 0.0, 0.0), 4.0, np.radians(30), 56)
    return ViewSet(tuple(cameras), np.stack([two_balls(c) for c in cameras]), tuple(f"t_{k}" for k in range(7)))


def test_training_learns_which_pixels_of_unseen_views_are_wrong(balls: Scene) -> None:
    scores = doubt_scores(balls, unseen_views())
    assert scores.doubt_rank >= 0.6 and scores.doubt_area <= 0.15, scores  # of 24 views of 56 pixels
    assert 0.9 < doubt_scores(balls, balls_views()).doubt_ratio < 1.1


def test_a_wrong_place_is_doubted_and_found(balls: Scene) -> None:
    views = balls_views()
    wrong = views.images.copy()
    wrong[wrong[..., 2] > wrong[..., 0], :3] = (20, 200, 60)  # the blue ball is green in every view
    known = expected_errors(balls, replace(views, images=wrong), 10**6, 0)
    assert known.place[0] > 0.1 and known.worst > 1.5 * known.mean  # half of the light is wrong
    there, elsewhere = (balls.occupancy.box.to_box([[x, 0.0, 0.28]]) for x in (0.35, -0.35))
    errors = known.of(torch.tensor(np.concatenate([there, elsewhere]), dtype=torch.float32))
    assert errors[0] > 3.0 * errors[1]


def test_the_same_seed_gives_the_same_errors(balls: Scene) -> None:
    one, other = (expected_errors(balls, balls_views(), 10**5, 3) for _ in range(2))
    np.testing.assert_array_equal(one.level, other.level)
    assert one.to_json() == other.to_json()


def test_what_no_view_shows_is_doubted_like_the_worst_of_what_they_show() -> None:
    random = np.random.default_rng(0)
    weight = np.where(random.uniform(size=(8, 8, 8)) < 0.5, 0.0, 50.0)
    errors = random.uniform(0.0, 0.2, weight.shape)
    found = _cells(weight, weight * errors)
    seen = weight > FEW
    worst = np.quantile(errors[seen], UNSEEN)
    np.testing.assert_allclose(found[~seen], worst)
    np.testing.assert_allclose(found[seen], errors[seen], atol=0.2 / 50.0)
    assert np.isfinite(_cells(np.zeros((2, 2, 2)), np.zeros((2, 2, 2)))).all()


# --- scores -----------------------------------------------------------------------------------------------------------


@given(st.lists(st.floats(0.001, 1.0), min_size=3, max_size=40, unique=True), st.floats(0.2, 5.0))
def test_doubts_in_the_right_order_are_perfect(values: list[float], power: float) -> None:
    errors = np.array(values)
    doubts = np.array(errors) ** power
    if len(np.unique(doubts)) < len(doubts):
        return
    scores = scores_of(doubts, errors)
    assert scores.doubt_rank == pytest.approx(1.0) and scores.doubt_area == pytest.approx(0.0, abs=1e-9)
    backwards = scores_of(-doubts, errors)
    assert backwards.doubt_rank == pytest.approx(-1.0) and backwards.doubt_area > 0.0


def test_scores_are_those_of_brute_force() -> None:
    random = np.random.default_rng(2)
    errors, doubts = random.uniform(size=30), random.uniform(size=30)
    area = 0.0
    for left in range(1, 31):
        kept, best = (np.argsort(order, kind="stable")[:left] for order in (doubts, errors))
        area += (errors[kept].mean() - errors[best].mean()) / errors.mean() / 30
    scores = scores_of(doubts, errors)
    assert scores.doubt_area == pytest.approx(area) and scores.doubt_rank == pytest.approx(spearmanr(doubts, errors)[0])
    assert np.isnan(scores_of(np.ones(3), errors[:3]).doubt_rank)
    assert DoubtScores(np.nan, 0.1, 1.0).to_json() == {"doubt_rank": None, "doubt_area": 0.1, "doubt_ratio": 1.0}
    assert tiles(np.arange(200.0).reshape(10, 20)).shape == (1, 2) and tiles(np.ones((3, 9))).tolist() == [[1.0]]


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_a_picture_holds_the_errors(cube_that_knows: Scene, tmp_path: Path) -> None:
    camera, shown = orbit(cube_that_knows, 5, 24, 16)[2], RenderSettings(what="doubt")
    doubt = cube_that_knows.doubt(camera)
    write_view(tmp_path / "d.png", cube_that_knows, camera, shown)
    with Image.open(tmp_path / "d.png") as picture:
        levels, largest = np.asarray(picture).astype(np.float64), float(picture.info["svv:largest"])
    np.testing.assert_array_equal(levels == 0, np.isnan(doubt))
    np.testing.assert_allclose((levels - 1)[levels > 0] / 65534 * largest, doubt[levels > 0], atol=largest / 65534)
    write_view(tmp_path / "d.vti", cube_that_knows, camera, shown)
    pyvista = pytest.importorskip("pyvista")
    held = np.flipud(pyvista.read(tmp_path / "d.vti")["Doubt"].reshape(doubt.shape))
    np.testing.assert_array_equal(held, doubt)
    write_view(tmp_path / "c.vti", cube_that_knows, camera)
    assert "Doubt" not in pyvista.read(tmp_path / "c.vti").array_names


def test_colours_get_darker_with_the_error() -> None:
    errors = np.linspace(0.0, 0.2, 60)[None]
    picture = doubt_picture(errors, 0.2)
    assert (np.diff(picture[0, :, :3] @ (0.2126, 0.7152, 0.0722)) < 0.0).all() and (picture[..., 3] == 1.0).all()
    assert darkest_from(np.full((2, 2), np.nan)) == 0.0 and darkest_from([[0.1, 0.1]]) == pytest.approx(0.1)


@pytest.mark.slow  # a movie of depths holds the same law
def test_a_movie_of_errors_is_written(cube_that_knows: Scene, tmp_path: Path) -> None:
    write_movie(tmp_path / "d.mp4", cube_that_knows, orbit(cube_that_knows, 2, 16, 16), RenderSettings(what="doubt"))
    assert (tmp_path / "d.mp4").stat().st_size > 500


def test_the_command_shows_errors_or_says_why_not(
    cube: Scene, cube_that_knows: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    ends = []
    for name, scene in (("knows", cube_that_knows), ("old", cube)):
        scene.save(tmp_path / f"{name}.svv")
        words = [
            "svv",
            "render",
            tmp_path / f"{name}.svv",
            "--what",
            "doubt",
            "--size",
            16,
            "-o",
            tmp_path / f"{name}.png",
        ]
        monkeypatch.setattr(sys, "argv", [*map(str, words)])
        with pytest.raises(SystemExit) as ended:
            app.main()
        ends.append(ended.value.code or 0)
    assert ends == [0, 2] and (tmp_path / "knows.png").exists() and not (tmp_path / "old.png").exists()
    assert "train it again" in capsys.readouterr().err
