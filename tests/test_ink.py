"""Drawings in ink: dots and lines on surfaces, where they may lie, and how dark they are in total."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from svv.errors import BadInput, silent
from svv.styles.gallery import open_style
from svv.styles.gallery.offered import INKS
from svv.train.paint.ink import (
    BLANK,
    NEAREST,
    SQUEEZED,
    STEP,
    SURFACE,
    Drawing,
    Ink,
    Sheet,
    StyleInput,
    dots,
    ink_colour,
    ink_named,
    lines,
    picture_of,
    style_named,
)
from svv.train.paint.ink_kernels import flat_distance
from svv.train.paint.quilt import LIGHT
from svv.train.paint.style_choice import mean_colour, validate_masks
from svv.train.paint.surface_form import form_of_opacity
from tests.nightly import nightly
from tests.test_painting import CELLS, GRID, UP, on_tube, tube

HATCHING = INKS["hatching"]

UNIT = 1 / 200
RADIUS = 0.3
AXES = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.3)


def on_ball(count: int, seed: int = 0) -> np.ndarray:
    outward = np.random.default_rng(seed).normal(size=(count, 3))
    return (0.5 + RADIUS * outward / np.linalg.norm(outward, axis=1, keepdims=True)).astype(np.float32)


BALL = form_of_opacity(
    np.clip((RADIUS - np.linalg.norm(GRID, axis=-1)) * CELLS + 0.5, 0, 1).astype(np.float32), CELLS, UP
)


@pytest.fixture(scope="module")
def sheet() -> Sheet:
    return Sheet.of(BALL, on_ball(60_000), SURFACE * UNIT)


@cache
def drawn(kind: str, seed: int = 0, size: float = 1.0) -> Drawing:
    return Drawing(Ink(kind, size), (0.2, 0.5, 0.9), BALL, on_ball(60_000), UNIT, UNIT, seed, silent)


# --- the surface ------------------------------------------------------------------------------------------------------


def test_the_surface_is_found_amid_points_of_a_thick_rim(sheet: Sheet) -> None:
    """What is seen of a surface lies at several depths."""
    rng = np.random.default_rng(1)
    points = on_ball(60_000)
    thick = 0.5 + (points - 0.5) * (1.0 + rng.uniform(-0.02, 0.02, (len(points), 1)))
    found = Sheet.of(BALL, thick.astype(np.float32), SURFACE * UNIT)
    depth = np.linalg.norm(found.points - 0.5, axis=1)
    assert depth.std() < 0.5 * np.linalg.norm(thick - 0.5, axis=1).std()
    assert abs(depth.mean() - RADIUS) < UNIT
    outward = (sheet.points - 0.5) / np.linalg.norm(sheet.points - 0.5, axis=1, keepdims=True)
    assert (outward * sheet.normals).sum(1).min() > 0.97
    np.testing.assert_allclose((sheet.tangents * sheet.normals).sum(1), 0.0, atol=1e-5)


def test_tone_falls_with_the_light_and_all_tones_are_as_frequent(sheet: Sheet) -> None:
    lit = sheet.normals @ LIGHT
    assert np.corrcoef(np.argsort(np.argsort(-lit)), sheet.tones)[0, 1] > 0.98
    np.testing.assert_allclose(np.histogram(sheet.tones, 10, (0, 1))[0] / len(sheet.tones), 0.1, atol=0.01)


def test_hollows_are_darker_than_ridges() -> None:
    """Waves that all get the same light: of those that face it alike, what lies deep is darker."""
    x, y = GRID[..., 0], GRID[..., 1]
    form = form_of_opacity((y < 0.1 * np.cos(4 * np.pi * x)).astype(np.float32), CELLS, UP)
    places = np.array([(0.5, 0.6, 0.5), (0.75, 0.4, 0.5)], np.float32)  # a crest and a trough: both look up
    crest, trough = form.hollowness(places)
    assert crest < 0.45 and trough > 0.55


# --- dots -------------------------------------------------------------------------------------------------------------


def test_dots_stay_apart_and_lie_closer_where_it_is_darker(sheet: Sheet) -> None:
    made = dots(sheet, UNIT, UNIT, 0)
    near, _ = cKDTree(made.where).query(made.where, 2)
    tone = sheet.tones[cKDTree(sheet.points).query(made.where)[1]]
    light, dark = (near[:, 1][(tone > a) & (tone < b)] for a, b in ((0.2, 0.4), (0.8, 1.0)))
    assert np.median(dark) < 0.75 * np.median(light)
    # The length of a chord on the ball is at least that of its shadow, by which they are apart.
    assert near[:, 1].min() > 1.5 * UNIT
    assert tone.min() > BLANK - 0.1, "there are none in the light"
    assert (light > 1.9 * made.radius.min()).all(), "in the light they do not touch"


# --- lines ------------------------------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(AXES, st.floats(0.1, 0.2))
def test_lines_run_along_a_tube_whatever_its_direction(axis: tuple[float, ...], radius: float) -> None:
    direction = np.array(axis) / np.linalg.norm(axis)
    surface = Sheet.of(tube(direction, radius), on_tube(direction, radius, 40_000)[0], SURFACE * UNIT)
    made = lines(surface, HATCHING, UNIT, UNIT, 0, silent)
    number = np.cumsum(np.r_[0, (np.diff(made.line) != 0) | (np.diff(made.layer) != 0)])
    within = np.diff(number) == 0
    step = np.diff(made.where, axis=0)[within]
    length = np.linalg.norm(step, axis=1)
    assert np.abs(step @ direction / length).mean() > 0.95
    np.testing.assert_allclose(length, STEP * UNIT, rtol=0.3)


def test_no_line_comes_nearer_to_another_than_it_may(sheet: Sheet) -> None:
    made = lines(sheet, HATCHING, UNIT, UNIT, 0, silent)
    assert set(made.layer) == {0, 1}
    number = made.layer * 1_000_000 + made.line
    for pick, least in ((made.layer == 0, HATCHING[0].apart), (made.layer >= 0, SQUEEZED * HATCHING[1].apart)):
        tree = cKDTree(made.where[pick])
        pairs = tree.query_pairs(0.99 * NEAREST * least * UNIT, output_type="ndarray")
        a, b = number[pick][pairs].T
        assert (a == b).all(), "only points of one line"


def test_lines_end_in_the_light_and_swell_in_the_dark(sheet: Sheet) -> None:
    made = lines(sheet, HATCHING[:1], UNIT, UNIT, 0, silent)
    tone = sheet.tones[cKDTree(sheet.points).query(made.where)[1]]
    assert tone.min() > HATCHING[0].tone - 0.15
    assert np.corrcoef(tone, made.radius)[0, 1] > 0.8
    ends = np.flatnonzero(np.diff(made.line))
    assert made.radius[ends].mean() < 0.6 * made.radius.mean()


# --- a region ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", INKS)
def test_the_darker_the_tone_the_more_ink(kind: str, sheet: Sheet) -> None:
    ink, order = drawn(kind).covered(sheet.points), np.argsort(sheet.tones)
    share = [part.mean() for part in np.array_split(ink[order], 5)]
    assert np.all(np.diff(share) > 0.03), share
    assert share[0] < 0.1 and 0.45 < share[-1] < 0.85
    assert ink.min() >= 0.0 and ink.max() == 1.0


@pytest.mark.parametrize("kind", INKS)
def test_a_seed_decides_and_equal_seeds_are_equal(kind: str) -> None:
    place = on_ball(5000, 3)
    again = Drawing(Ink(kind), (0.2, 0.5, 0.9), BALL, on_ball(60_000), UNIT, UNIT, 0, silent)
    made = [drawing(place) for drawing in (drawn(kind), again, drawn(kind, 1))]
    np.testing.assert_array_equal(made[0], made[1])
    assert np.abs(made[0] - made[2]).mean() > 0.05


@pytest.mark.parametrize("kind", INKS)
def test_a_stroke_is_the_same_through_the_thickness_of_a_shell(kind: str) -> None:
    drawing, place = drawn(kind), on_ball(5000, 3)
    above, below = (drawing.covered((0.5 + (place - 0.5) * (1 + d)).astype(np.float32)) for d in (-0.02, 0.02))
    assert np.corrcoef(above, below)[0, 1] > 0.9


def test_larger_strokes_are_larger() -> None:
    few, many = drawn("stippling", size=2.0).strokes, drawn("stippling").strokes
    assert few.radius.mean() == pytest.approx(2.0 * many.radius.mean(), rel=0.05)
    assert 3.0 < len(many.where) / len(few.where) < 5.0


@pytest.mark.parametrize("kind", INKS)
@pytest.mark.parametrize("size", nightly([0.25, 4.0], 0.25))
@pytest.mark.parametrize("radius", [0.004, 0.03])
def test_what_is_thinner_than_a_stroke_is_drawn_too(kind: str, size: float, radius: float) -> None:
    axis = np.array([0.0, 1.0, 0.0])
    for surface in (on_tube(axis, radius, 500)[0], on_tube(axis, radius, 1)[0]):
        made = Drawing(Ink(kind, size), (1, 1, 1), tube(axis, max(radius, 0.02)), surface, UNIT, UNIT, 0, silent)
        assert np.isfinite(made(surface)).all()


@given(st.tuples(*[st.floats(0, 1)] * 3))
def test_ink_is_dark_and_of_the_region_s_hue(colour: tuple[float, float, float]) -> None:
    ink = ink_colour(colour)
    assert ink.min() >= 0 and ink @ [0.299, 0.587, 0.114] < 0.25
    if max(colour) - min(colour) > 0.5:
        assert np.argmax(ink) == np.argmax(colour) or np.ptp(np.sort(colour)[1:]) < 0.35


def test_distance_leaves_out_the_normal_but_not_the_far_side() -> None:
    up = np.array([0.0, 0.0, 1.0])
    assert flat_distance(3.0, 4.0, 1.0, up, up, 2.0, 0.5) == 5.0
    assert flat_distance(3.0, 4.0, 2.5, up, up, 2.0, 0.5) == np.inf
    assert flat_distance(3.0, 4.0, 0.4, up, -up, 2.0, 0.5) == 5.0
    assert flat_distance(3.0, 4.0, 0.6, up, -up, 2.0, 0.5) == np.inf
    assert flat_distance(3.0, 4.0, 0.0, up, np.array([1.0, 0.0, 0.0]), 2.0, 0.5) == np.inf


# --- names ------------------------------------------------------------------------------------------------------------


def test_an_ink_is_named_as_a_style_is(tmp_path: Path) -> None:
    assert ink_named("ink:Cross hatching") == Ink("cross-hatching")
    assert ink_named("ink.png") is None and ink_named(tmp_path) is None
    assert style_named("ink:stippling") == ("ink:stippling", Ink("stippling"))
    with pytest.raises(BadInput, match="no 'ink:scribble'; choose one of ink:stippling, ink:hatching, ink:cross-h"):
        style_named("ink:scribble")
    with pytest.raises(BadInput, match="drawn without a picture, but a picture is needed here"):
        open_style("ink:hatching")


def test_there_is_no_part_of_an_ink() -> None:
    with pytest.raises(BadInput, match="leave out its mask"):
        validate_masks([StyleInput(Ink("hatching"), mask=np.ones((4, 4), bool))])
    with pytest.raises(BadInput, match="leave out its mask"):
        picture_of(Ink("hatching"))
    assert mean_colour(Ink("hatching")).min() > 0.9
