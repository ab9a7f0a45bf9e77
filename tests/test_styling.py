"""Styles in a scene: masks limit what is learned, strokes scale, and painting goes on from an existing painting."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.images.nnfm import luminance
from svv.errors import BadInput, Cancelled
from svv.fields.radiance.networks import FieldSettings
from svv.fields.scene.scene import Scene
from svv.options.making import MannerName, PaintOptions
from svv.styles import weights
from svv.styles.features import load_features
from svv.train import pipeline
from svv.train.base.resolutions import paint_resolutions
from svv.train.match.style_loss import StyleLossSettings, StyleTarget
from svv.train.paint.ink import StyleInput
from svv.train.paint.pieces import PieceSettings, PieceStyle, piece_style
from svv.train.paint.styled_views import stylization_cameras, visible_from
from svv.train.pipeline import stylize_scene
from svv.train.run import config
from svv.train.run.config import Preset
from svv.train.run.report import Report
from tests.balls import MATCHED, SHORT
from tests.cube import hash_cube_scene
from tests.nightly import nightly

SMALL = PieceSettings(size=96)
MANNERS: tuple[MannerName, ...] = ("strokes", "pieces")
PRESETS = [(SHORT, {"manner": "pieces", "pieces": SMALL}), (MATCHED, {"features": "embedded"})]
"""Both ways to paint: paint is laid, or learned as in the paper."""
STAGES = [("laying strokes", "contrast"), ("distillation", "stylization")]
"""Labels of the parts of each: what a checkpoint keeps, and what comes after it."""
RED, GREEN = np.array([0.85, 0.2, 0.1]), np.array([0.1, 0.7, 0.25])
SIZE = 96


@pytest.fixture
def scene(balls: Scene) -> Scene:
    return balls


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    """Red stripes at the left, green dots at the right."""
    y, x = np.mgrid[:SIZE, :SIZE]
    left = x < SIZE // 2
    mark = np.where(left, y // 4 % 2, (x // 4 % 2) * (y // 4 % 2))
    return (np.where(left[..., None], RED, GREEN) * (1 - 0.3 * mark[..., None])).astype(np.float32)


LEFT = np.arange(SIZE)[None].repeat(SIZE, 0) < SIZE // 2


def style(scene: Scene, styles: list[np.ndarray | StyleInput], **options) -> tuple[Scene, Report]:
    return stylize_scene(scene, styles, SHORT, **{"manner": "pieces", "pieces": SMALL, **options})


def shown(scene: Scene, region: int) -> np.ndarray:
    """Mean of a region's own colours, without light."""
    view = visible_from(scene, stylization_cameras(scene, SHORT.stylize)[:1], lambda fraction, label: None)[0]
    assert scene.palette_network is not None and scene.styled is not None
    with torch.no_grad():
        colours = scene.styled(view.position[view.region == region])
    return colours.mean(0).numpy()


# --- how fine paint is ------------------------------------------------------------------------------------------------


@given(cell=st.floats(1e-4, 0.4), coarsest=st.sampled_from([8, 16, 64]), most=st.sampled_from([32, 128]))
def test_a_cell_of_paint_is_no_coarser_than_asked(cell: float, coarsest: int, most: int) -> None:
    """Or the next finer level would be beyond what the occupancy tells; no level is finer than needed."""
    field = FieldSettings(resolutions=(coarsest,), finer=(2 * coarsest,))
    levels = paint_resolutions(field, cell, most)
    own = field.resolutions + field.finer
    assert levels[: len(own)] == own
    assert 1 / levels[-1] <= cell or 2 * levels[-1] > most
    added = levels[len(own) :]
    assert all(1 / (level // 2) > cell and level <= most for level in added)
    assert paint_resolutions(field, None, most) == own
    assert paint_resolutions(FieldSettings("hash", (16, 4096)), cell, most) == (16, 4096)


# --- what a mask does to a target ------------------------------------------------------------------------------------


def target(picture: np.ndarray, mask: np.ndarray | None) -> StyleTarget:
    network = load_features("embedded")
    tensor = torch.from_numpy(picture).permute(2, 0, 1)
    chosen = StyleLossSettings(style_size=max(picture.shape[:2]))
    return StyleTarget(network, tensor, chosen, 0, None if mask is None else torch.from_numpy(mask))


def pieces_of(picture: np.ndarray, mask: np.ndarray | None) -> PieceStyle:
    return piece_style(picture, mask, PieceSettings(size=max(picture.shape[:2])))


def test_only_masked_patches_and_colours_teach(picture: np.ndarray) -> None:
    """What a target learns from a half is what it learns from a picture of that half alone."""
    masked, alone = target(picture, LEFT), target(picture[:, : SIZE // 2], None)
    torch.testing.assert_close(masked.statistics[0], alone.statistics[0], atol=2e-3, rtol=0)
    torch.testing.assert_close(masked.statistics[1], alone.statistics[1], atol=2e-3, rtol=0)
    assert masked.background == pytest.approx(float(luminance(masked.statistics[0])))
    assert masked.background == pytest.approx(alone.background, abs=2e-3)
    # The cells of the left half but for the rim: patches whose centre lies in the mask.
    assert len(masked.vectors) == (SIZE // 4 - 2) * (SIZE // 8 - 1)
    away = (masked.mean - alone.mean).norm()
    assert away < 0.15 * masked.mean.norm()  # patches at the mask's rim look a little over it


def test_pieces_are_cut_from_the_masked_part_alone(picture: np.ndarray) -> None:
    masked, alone = pieces_of(picture, LEFT), pieces_of(picture[:, : SIZE // 2], None)
    torch.testing.assert_close(masked.mean, alone.mean, atol=2e-3, rtol=0)
    assert masked.picture[1].max() < 0.35  # the solid texture has nothing of the green
    np.testing.assert_array_equal(masked.inside, LEFT)


def test_a_mask_of_everything_is_none(picture: np.ndarray) -> None:
    whole, none = target(picture, np.ones((SIZE, SIZE), bool)), target(picture, None)
    torch.testing.assert_close(whole.statistics, none.statistics)
    torch.testing.assert_close(whole.vectors, none.vectors)
    every, plain = pieces_of(picture, np.ones((SIZE, SIZE), bool)), pieces_of(picture, None)
    torch.testing.assert_close(every.picture, plain.picture)
    torch.testing.assert_close(every.mean, plain.mean)


def test_barely_masked_styles_still_teach(picture: np.ndarray) -> None:
    mask = np.zeros((SIZE, SIZE), bool)
    mask[40, 20:23] = True
    made = target(picture, mask)
    assert len(made.vectors) >= 1 and bool(torch.isfinite(made.vectors).all())
    np.testing.assert_allclose(pieces_of(picture, mask).mean, picture[mask].mean(0), atol=0.05)
    np.testing.assert_allclose(made.statistics[0], picture[mask].mean(0), atol=0.05)
    render = torch.rand(3, 64, 64, requires_grad=True)
    made.loss(render, torch.ones(64, 64)).backward()
    assert render.grad is not None and bool(torch.isfinite(render.grad).all())


@pytest.mark.parametrize(
    "colours", [np.full((32, 32, 3), 0.5), np.zeros((32, 32, 3)), np.full((16, 16, 3), 0.03), np.ones((24, 400, 3))]
)
def test_flat_dark_grey_and_tiny_styles_teach_their_colour(colours: np.ndarray) -> None:
    made = target(colours.astype(np.float32), None)
    render = torch.full((3, 64, 64), 0.4, requires_grad=True)
    loss = made.loss(render, torch.ones(64, 64))
    loss.backward()
    assert 0 <= loss.item() < 1000 and render.grad is not None
    np.testing.assert_allclose(made.statistics[0], colours.mean((0, 1)), atol=1e-3)
    np.testing.assert_allclose(pieces_of(colours, None).mean, colours.mean((0, 1)), atol=1e-3)


# --- scenes ----------------------------------------------------------------------------------------------------------


def test_one_picture_is_two_styles_and_one_goes_on(scene: Scene, picture: np.ndarray) -> None:
    count = len(scene.regions)
    assert count >= 2
    first, report = style(
        scene,
        [StyleInput(picture, "left", LEFT), StyleInput(picture, "right", ~LEFT)],
        mapping={0: 0, 1: 1},
        strength=0.8,
    )
    assert report["styles"] == {"0": "left", "1": "right"} and report["masked"] == ["left", "right"]
    assert [(r.style, r.strength) for r in first.regions[:2]] == [("left", 0.8), ("right", 0.8)]
    red, green = shown(first, 0), shown(first, 1)
    assert red[0] > red[1] + 0.2 and green[1] > green[0] + 0.2
    # Another mask for region 0: it is painted anew, and region 1 keeps what it has.
    again, report = style(first, [StyleInput(picture, "other", ~LEFT)], mapping={0: 0}, go_on=True)
    assert report["continued"] == []
    assert [r.style for r in again.regions[:2]] == ["other", "right"]
    assert again.styled is not first.styled
    moved = shown(again, 0)
    assert np.linalg.norm(moved - GREEN) < 0.3 * np.linalg.norm(red - GREEN)
    np.testing.assert_allclose(shown(again, 1), green, atol=0.02)
    np.testing.assert_allclose(shown(first, 0), red)  # the scene given is as it was
    # Anew, without going on, region 1 is the palette's again.
    anew, _ = style(first, [picture], mapping={0: 0})
    assert [r.style for r in anew.regions[:2]] == ["style 0", None]


def test_a_new_region_joins_those_that_are_styled(scene: Scene, picture: np.ndarray) -> None:
    first, _ = style(scene, [StyleInput(picture, mask=LEFT)], mapping={0: 0})
    both, report = style(first, [StyleInput(picture, mask=~LEFT)], mapping={1: 0}, go_on=True)
    assert report["continued"] == [] and report["seconds"]["paint"] > 0
    assert both.regions[0].style and both.regions[1].style
    np.testing.assert_allclose(shown(both, 0), shown(first, 0), atol=0.12)
    new = shown(both, 1)
    assert new[1] > new[0] + 0.15


@pytest.mark.parametrize(("preset", "options"), PRESETS, ids=["laid", "matched"])
def test_stopped_work_goes_on_only_with_the_same_masks(
    scene: Scene, picture: np.ndarray, tmp_path: Path, preset: Preset, options: dict[str, Any]
) -> None:
    first, then = STAGES[preset is MATCHED]
    saved = {**options, "checkpoint": tmp_path / "x.checkpoint"}

    def stop(fraction: float, label: str) -> None:
        if label == then:
            raise Cancelled

    labels: list[str] = []

    def note(fraction: float, label: str) -> None:
        labels.append(label)

    with pytest.raises(Cancelled):
        stylize_scene(scene, [StyleInput(picture, mask=LEFT)], preset, **saved, progress=stop)
    stylize_scene(scene, [StyleInput(picture, mask=LEFT)], preset, **saved, progress=note)
    assert first not in labels and then in labels
    with pytest.raises(Cancelled):
        stylize_scene(scene, [StyleInput(picture, mask=LEFT)], preset, **saved, progress=stop, seed=1)
    stylize_scene(scene, [StyleInput(picture, mask=~LEFT)], preset, **saved, progress=note, seed=1)
    assert first in labels


@pytest.mark.parametrize(
    "other",
    [lambda p: p[:, ::-1], pytest.param(lambda p: np.roll(p, 7, 1), marks=pytest.mark.slow)],
    ids=["mirrored", "moved"],
)
def test_another_picture_of_the_same_pixels_does_not_go_on(
    scene: Scene, picture: np.ndarray, tmp_path: Path, other: Callable[[np.ndarray], np.ndarray]
) -> None:
    """A mirror image has the same sum, mean and histogram."""
    labels: list[str] = []

    def stop(fraction: float, label: str) -> None:
        if label == "contrast":
            raise Cancelled

    with pytest.raises(Cancelled):
        style(scene, [picture], checkpoint=tmp_path / "c", progress=stop)
    style(scene, [other(picture)], checkpoint=tmp_path / "c", progress=lambda fraction, label: labels.append(label))
    assert "laying strokes" in labels


@pytest.mark.parametrize(
    ("preset", "manner"),
    nightly(
        [("draft", "strokes"), ("fast", "pieces"), ("balanced", "pieces")], ("draft", "strokes"), ("fast", "pieces")
    ),
)
def test_nothing_is_matched_and_no_weights_are_looked_for(
    scene: Scene, picture: np.ndarray, monkeypatch: pytest.MonkeyPatch, preset: str, manner: MannerName
) -> None:
    for name in ("load_features", "Matching"):
        monkeypatch.delattr(pipeline, name)
    for name in ("load", "first_use", "get"):
        monkeypatch.delattr(weights, name)
    short = replace(config.PRESETS[preset], stylize=SHORT.stylize)
    painted, report = stylize_scene(scene, [picture], short, manner=manner, stroke_size=2.0)
    assert painted.styled is not None and painted.styled.direct
    assert report["features"] == "none" and set(report["manner"].values()) == {manner}
    assert not any("weights" in note or "svv features" in note for note in report["notes"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"preset": "balanced", "features": "vgg16"}, "leave out --features, or paint with --preset paper"),
        ({"preset": "draft", "features": "embedded"}, "matches no features"),
        ({"preset": "paper", "manner": "strokes"}, "leave out --manner"),
        ({"preset": "paper", "manner": "pieces"}, "leave out --manner"),
        ({"preset": "fast", "change": ("stylize.style_iterations=9",)}, "no setting 'stylize.style_iterations'"),
    ],
)
def test_options_without_an_effect_are_refused(
    scene: Scene, picture: np.ndarray, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        stylize_scene(scene, [picture], PaintOptions(**options))


@pytest.mark.slow
def test_a_scene_of_the_paper_s_hash_grid_is_painted_and_kept_too(picture: np.ndarray) -> None:
    cube = hash_cube_scene()
    assert cube.camera_rig is not None
    camera = cube.rig.sphere(3, 32)[0]
    for manner in MANNERS:
        painted, _ = stylize_scene(
            cube, [picture], SHORT, manner=manner, variant=manner, mapping={0: 0}, stroke_size=2.0
        )
        assert painted.styled is not None and painted.styled.direct
        again = Scene.from_bytes(painted.to_bytes())
        np.testing.assert_allclose(again.render(camera).rgba, painted.render(camera).rgba, atol=0.02)
        assert np.abs(again.render(camera).rgba - cube.render(camera).rgba).mean() > 0.005


def test_the_paper_s_way_goes_on_from_laid_paint(scene: Scene, picture: np.ndarray) -> None:
    """It has no network to start from, so one is distilled; the region that is not named keeps its colours."""
    first, _ = style(scene, [picture])
    again, report = stylize_scene(
        first, [StyleInput(picture, mask=~LEFT)], MATCHED, features="embedded", mapping={0: 0}, go_on=True
    )
    assert again.styled is not None and not again.styled.direct
    assert report["continued"] == [0] and report["manner"] == {"0": "matched"} and report["seconds"]["distil"] > 0
    assert np.abs(shown(again, 1) - shown(first, 1)).max() < 0.25
    refined, report = stylize_scene(again, [picture], MATCHED, features="embedded", mapping={0: 0}, go_on=True)
    assert report["continued"] == [0] and set(report["seconds"]) == {"stylize", "total"}
    assert refined.regions[1].style == first.regions[1].style


def test_strokes_scale_with_their_size(picture: np.ndarray, monkeypatch: pytest.MonkeyPatch, scene: Scene) -> None:
    sides = []

    def watched(*arguments: Any) -> PieceStyle:
        made = piece_style(*arguments)
        sides.append(max(made.picture.shape[1:]))
        return made

    monkeypatch.setattr("svv.train.paint.laying.piece_style", watched)
    for stroke_size in (0.5, 2.0):
        style(scene, [picture], mapping={0: 0}, stroke_size=stroke_size)
    assert sides == [48, 192]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"strength": 0.0}, "more than 0.*style would be invisible"),
        ({"strength": 1.5}, "at most 1"),
        ({"strength": float("nan")}, "more than 0"),
        ({"stroke_size": 0.0}, "between 0.25 and 4"),
        ({"stroke_size": 9.0}, "between 0.25 and 4"),
        ({"mask": np.zeros((SIZE, SIZE), bool)}, "is empty"),
        ({"mapping": {9: 0}}, "no region 9"),
        ({"mapping": {0: 1}}, "no style 1"),
        ({"mapping": "colour", "keep": tuple(range(8))}, "no region"),
        ({"go_on": True}, "no styled network to continue with"),
    ],
)
def test_stylizations_that_cannot_be(scene: Scene, picture: np.ndarray, options: dict, words: str) -> None:
    mask = options.pop("mask", None)
    with pytest.raises(BadInput, match=words):
        style(scene, [StyleInput(picture, mask=mask)], **options)


def test_styles_left_over_are_said(scene: Scene, picture: np.ndarray) -> None:
    last = len(scene.regions)
    _, report = style(scene, [picture] * (last + 1))
    assert report["notes"] == [f"Style {last} (style {last}) has no region and is not used; assign regions with --map."]
    assert all(name in report for name in ("stroke_size", "strength", "continued"))


def test_likeness_of_colour_pairs_regions_and_styles(scene: Scene) -> None:
    styles = [np.full((32, 32, 3), r.colour, np.float32) for r in scene.regions]
    _, report = style(scene, styles[::-1], mapping="colour")
    assert report["styles"] == {str(k): f"style {len(styles) - 1 - k}" for k in range(len(styles))}


@pytest.mark.parametrize(
    ("preset", "options"),
    [*PRESETS, (SHORT, {"manner": "strokes", "stroke_size": 2.0})],
    ids=["laid", "matched", "strokes"],
)
def test_progress_ends_where_the_work_does(
    scene: Scene, picture: np.ndarray, preset: Preset, options: dict[str, Any]
) -> None:
    told: list[float] = []
    stylize_scene(scene, [picture], preset, **options, progress=lambda fraction, label: told.append(fraction))
    assert told[-1] == pytest.approx(1.0) and all(b >= a - 1e-9 for a, b in itertools.pairwise(told))
