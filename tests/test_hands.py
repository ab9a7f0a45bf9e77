"""Named hands: glazes multiply, washes dry with a rim, the paper's tooth shows; and which hand a picture shows."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from skimage.color import rgb2lab

from svv.core.strokes.stroke_reference import paint_at
from svv.core.strokes.strokes import Brush, Strokes, joined, straight_stroke
from svv.errors import BadInput, silent
from svv.fields.scene.scene import Scene
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.options.making import AskedHandName, HandName
from svv.styles.gallery import gallery_picture
from svv.styles.hand import Hand, measure_hand
from svv.train.paint.brushwork import Brushwork, Painter
from svv.train.paint.ink import StyleInput
from svv.train.paint.manner import manner_of, technique_of
from svv.train.paint.techniques import TECHNIQUES
from svv.train.pipeline import stylize_scene
from svv.train.run.report import Report
from tests.balls import SHORT
from tests.nightly import nightly
from tests.test_brushing import EMPTY, WIDTH, ball
from tests.test_strokes import curved

PAPER = (0.9, 0.95, 1.0)
GLAZE = Brush(0.0, 0.0, 0.0, body=0.0, blunt=1.0, ground=PAPER)
ACROSS = np.stack([np.full(401, 0.5), np.linspace(0.4, 0.6, 401), np.full(401, 0.5)], 1)


def wet(strokes: Strokes, wash: int) -> Strokes:
    """The strokes, laid by a wet brush into the wash of a number."""
    return replace(strokes, bristles=np.full(len(strokes), wash / 8.0, np.float32))


def crossing(first: int, second: int) -> Strokes:
    """Two strokes that cross at the middle, in washes of these numbers."""
    low = straight_stroke((0.3, 0.5, 0.5), (0.7, 0.5, 0.5), 0.05, (0.8, 0.5, 0.4))
    top = straight_stroke((0.5, 0.3, 0.5), (0.5, 0.7, 0.5), 0.05, (0.5, 0.9, 0.6))
    return joined([wet(low, first), wet(top, second)])


# --- paint -----------------------------------------------------------------------------------------------------------


def test_glazes_multiply() -> None:
    found = StrokePaint(crossing(1, 2), GLAZE, 0.002)(np.array([[0.5, 0.5, 0.5], [0.6, 0.5, 0.5], [0.5, 0.6, 0.5]]))
    low, top = np.array([0.8, 0.5, 0.4]), np.array([0.5, 0.9, 0.6])
    assert found[0] == pytest.approx(np.array(PAPER) * low * top, abs=1e-4)
    assert found[1] == pytest.approx(np.array(PAPER) * low, abs=1e-4)
    assert found[2] == pytest.approx(np.array(PAPER) * top, abs=1e-4)


def test_strokes_of_one_wash_flow_into_each_other() -> None:
    paint = StrokePaint(crossing(1, 1), GLAZE, 0.002)
    found = paint(np.array([[0.5, 0.5, 0.5]]))[0] / np.array(PAPER)
    assert found == pytest.approx([0.65, 0.7, 0.5], abs=0.01)  # the mean of both, not their product


def test_bare_ground_is_paper() -> None:
    assert StrokePaint(crossing(1, 2), GLAZE, 0.002)(np.array([[0.8, 0.8, 0.5]]))[0] == pytest.approx(PAPER)


def test_washes_dry_with_a_darker_rim_all_around() -> None:
    stroke = wet(straight_stroke((0.3, 0.5, 0.5), (0.7, 0.5, 0.5), 0.05, (0.6, 0.6, 0.6)), 1)
    paint = StrokePaint(stroke, replace(GLAZE, rim=1.0), 0.001)
    light = paint(ACROSS)[:, 0]
    covered = np.flatnonzero(paint.coverage(ACROSS)[:, 3] > 0.99)
    assert light[covered[2]] < 0.8 * light[200] and light[covered[-3]] < 0.8 * light[200]
    along = np.stack([np.linspace(0.2, 0.5, 601), np.full(601, 0.5), np.full(601, 0.5)], 1)
    first = np.flatnonzero(paint.coverage(along)[:, 3] > 0.99)[2]
    assert paint(along)[first, 0] < 0.8 * light[200]
    # Two strokes of one wash have no rim between them; of two washes, they have.
    middle = np.array([[0.5, 0.545, 0.5]])
    one, two = (StrokePaint(crossing(1, n), replace(GLAZE, rim=1.0), 0.001)(middle)[0, 0] for n in (1, 2))
    assert one > 1.2 * two


def test_a_rim_finer_than_a_pixel_fades() -> None:
    stroke = wet(straight_stroke((0.3, 0.5, 0.5), (0.7, 0.5, 0.5), 0.05, (0.6, 0.6, 0.6)), 1)
    fine, blurred = (StrokePaint(stroke, replace(GLAZE, rim=1.0), soft)(ACROSS)[:, 0].min() for soft in (0.001, 0.03))
    assert blurred > fine + 0.05


@pytest.mark.parametrize("body", [0.0, 1.0])
def test_the_tooth_of_the_paper_fades_when_finer_than_a_pixel_and_keeps_its_mean(body: float) -> None:
    stroke = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.1, (0.5, 0.5, 0.5))
    brush = replace(GLAZE, body=body, grain=0.8, tooth=0.05)
    generator = np.random.default_rng(1)
    place = np.concatenate([generator.uniform([0.3, 0.46], [0.7, 0.54], (5000, 2)), np.full((5000, 1), 0.5)], 1)
    sharp, blunt = (StrokePaint(wet(stroke, 1), brush, soft)(place)[:, 0] for soft in (0.0005, 0.03))
    assert sharp.std() > 0.04 and blunt.std() < 1e-3
    assert sharp.mean() == pytest.approx(blunt.mean(), abs=0.05)


def test_the_tooth_stays_where_it_is_whatever_stroke_lies_there() -> None:
    brush = replace(GLAZE, grain=0.8, tooth=0.05)
    one = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.1, (0.5, 0.5, 0.5))
    other = straight_stroke((0.5, 0.2, 0.5), (0.5, 0.8, 0.5), 0.1, (0.5, 0.5, 0.5))
    place = np.random.default_rng(1).uniform(0.46, 0.54, (500, 3)) * [1, 1, 0] + [0, 0, 0.5]
    a, b = (StrokePaint(wet(s, 1), brush, 0.001)(place) for s in (one, other))
    assert np.abs(a - b).max() < 1e-5


@pytest.mark.parametrize("name", get_args(HandName))
@pytest.mark.parametrize("soft", [0.002, 0.01])
def test_the_kernel_equals_the_reference_for_every_hand(name: HandName, soft: float) -> None:
    brush = replace(TECHNIQUES[name].brush, ground=(0.9, 0.85, 0.8))
    layers = TECHNIQUES[name].layers
    parts = [curved(k, 6) for k in range(len(layers))]
    strokes = joined([wet(p, at.wash) if at.wash else p for p, at in zip(parts, layers, strict=True)])
    generator = np.random.default_rng(2)
    place = strokes.where[generator.integers(0, len(strokes.where), 4000)] + generator.normal(0.0, 0.012, (4000, 3))
    place = place.astype(np.float32)
    expected, found = paint_at(strokes, brush, place, soft), StrokePaint(strokes, brush, soft).coverage(place)
    assert (expected[:, 3] > 0.3).sum() > 500
    assert (np.abs(expected - found).max(1) < 3e-3).mean() > 0.995


# --- files -----------------------------------------------------------------------------------------------------------


def test_brushes_survive_a_file_and_those_of_earlier_scenes_are_oil() -> None:
    for technique in TECHNIQUES.values():
        brush = replace(technique.brush, ground=(0.5, 0.25, 1.0))
        assert Brush.from_json(json.loads(json.dumps(vars(brush)))) == brush
    old = {"relief": 0.3, "dry": 0.1, "mixed": 0.4, "rim": 0.0, "light": [-0.447, 0.744, 0.496]}
    assert Brush.from_json(old) == Brush()


@pytest.mark.parametrize(
    "wrong",
    [{"body": 2.0}, {"grain": -0.1}, {"tooth": 0.0}, {"flow": float("nan")}, {"ground": [0.1, 0.2]},
     {"ground": [2.0, 0.0, 0.0]}, {"feather": -1.0}, {"rim": "dark"}],
)  # fmt: skip
def test_brushes_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises((ValueError, TypeError)):
        Brush.from_json({**vars(Brush()), **wrong})


def test_wet_brushes_stay_in_their_wash_when_packed() -> None:
    again = Strokes.unpacked(crossing(1, 3).packed())
    assert again.bristles.tolist() == [0.125, 0.375]


# --- which hand ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("impasto", "oil"), ("mosaic", "oil"),
        *(pytest.param(name, "oil", marks=pytest.mark.slow)
          for name in ("oil", "pastel", "charcoal", "screen-print", "stipple")),
        ("woodcut", "print"), ("watercolour", "watercolour"), ("ink-wash", "ink-wash"), ("pointillism", "dots"),
    ],
)  # fmt: skip
def test_the_hand_is_measured_where_it_can_be_and_oil_in_doubt(name: str, expected: str) -> None:
    hand = measure_hand(gallery_picture(name))
    technique, reason = technique_of(hand)
    assert technique == expected and reason
    assert technique == "oil" or manner_of(hand) == ("strokes", reason)


def letters(seed: int) -> np.ndarray:
    """Short black lines on white, as of text."""
    generator, page = np.random.default_rng(seed), np.ones((240, 240, 3), np.float32)
    for row in range(8, 230, 12):
        for column in range(8, 230, 7):
            page[row : row + generator.integers(2, 9), column : column + generator.integers(1, 5)] = 0.0
    return page


@pytest.mark.parametrize("name", nightly(["noise", "plain", "text", "grey gradient", "grey noise"], "noise", "text"))
def test_pictures_without_a_hand_are_oil(name: str) -> None:
    noise = np.random.default_rng(0).random((200, 200, 3)).astype(np.float32)
    picture = {
        "noise": noise,
        "plain": np.full((64, 64, 3), 0.9, np.float32),
        "text": letters(0),
        "grey gradient": np.tile(np.linspace(0.0, 1.0, 200, dtype=np.float32)[:, None, None], (1, 200, 3)),
        "grey noise": np.repeat(noise[..., :1], 3, 2),
    }[name]
    assert technique_of(measure_hand(picture))[0] == "oil"


# --- laying ----------------------------------------------------------------------------------------------------------


@cache
def hand_of(picture: str) -> Hand:
    """The hand of a picture of the gallery."""
    return measure_hand(gallery_picture(picture, 300))


def laid(name: HandName, picture: str = "oil", alpha: float = 1.0) -> tuple[Painter, Brushwork]:
    """A ball of some opacity painted in a hand."""
    hand: Hand = replace(hand_of(picture), technique=name)
    surface = ball()
    surface = replace(surface, alpha=np.full(len(surface), alpha, np.float32))
    painter = Painter(hand, surface, EMPTY, 64, WIDTH, 0.004, 0)
    work = painter.painted(silent)
    assert work is not None
    return painter, work


def test_the_lights_of_a_watercolour_are_paper() -> None:
    painter, work = laid("watercolour")
    assert work.brush.body == 0.0 and work.brush.relief == 0.0 and work.brush.ground is not None
    assert min(work.brush.ground) > 0.8
    paint = StrokePaint(work.strokes, work.brush, 0.002)
    tone, points = painter.tone, painter.surface.points
    light, dark = (rgb2lab(paint(points[rows]))[:, 0].mean() for rows in (tone > 0.95, tone < 0.2))
    paper = rgb2lab(np.array(work.brush.ground))[0]
    assert light > paper - 12.0 and dark < light - 20.0


def test_dots_are_round_and_of_broken_colour() -> None:
    _, work = laid("dots")
    first = work.strokes.start[:-1]
    assert (work.strokes.length < 0.1 * work.strokes.radius[first]).all()
    hues = [np.arctan2(*rgb2lab(w.strokes.colour)[:, :0:-1].T) for w in (work, laid("oil")[1])]
    straight = [np.hypot(np.cos(h).mean(), np.sin(h).mean()) for h in hues]
    assert straight[0] < straight[1]


def test_ink_is_nearly_neutral_and_its_lines_are_thin_at_their_ends() -> None:
    _, work = laid("ink-wash")
    lab = rgb2lab(work.strokes.colour)
    assert np.hypot(lab[:, 1], lab[:, 2]).max() < 25.0
    strokes = work.strokes
    lines = np.flatnonzero((strokes.bristles >= 0.5) & (np.diff(strokes.start) >= 7))
    ends = np.array([strokes.radius[strokes.start[q]] for q in lines])
    middles = np.array([strokes.radius[(strokes.start[q] + strokes.start[q + 1]) // 2] for q in lines])
    assert len(lines) > 3 and (ends < 0.6 * middles).mean() > 0.9


def test_a_print_has_the_inks_of_its_picture_and_one_in_each_patch_of_a_block() -> None:
    painter, work = laid("print", "woodcut")
    colours, inks = rgb2lab(work.strokes.colour), painter.hand.inks
    away = np.linalg.norm(colours[:, None] - inks, axis=2)
    assert away.min(1).max() < 1.5 and (work.strokes.colour == work.strokes.second).all()
    assert len(np.unique(away.argmin(1))) >= 3
    middle = work.strokes.where[(work.strokes.start[:-1] + work.strokes.start[1:]) // 2]
    patch = painter.map.tree.query(middle)[1]
    for wash in (0.125, 0.25, 0.375):
        block = np.flatnonzero(work.strokes.bristles == wash)
        kept = [np.bincount(away[block].argmin(1)[patch[block] == p]).max(initial=0) for p in np.unique(patch[block])]
        # Strokes whose middle lies in another patch than their seed have that one's ink.
        assert sum(kept) > 0.7 * len(block)


def test_blocks_of_a_print_are_darker_the_darker_the_form() -> None:
    painter, work = laid("print", "woodcut")
    light = rgb2lab(work.strokes.colour)[:, 0]
    means = [light[work.strokes.bristles == wash].mean() for wash in (0.125, 0.25, 0.375)]
    assert means[0] > means[1] + 10.0 > means[2] + 15.0
    tone = painter.tone[painter.surface.tree.query(work.strokes.where)[1]]
    dark = np.array([tone[work.strokes.bristles[work.strokes.stroke] == wash].mean() for wash in (0.125, 0.25, 0.375)])
    assert (np.diff(dark) < -0.1).all()


def test_prints_on_glass_take_the_vivid_inks() -> None:
    chroma = [np.hypot(*rgb2lab(laid("print", "woodcut", a)[1].strokes.colour)[:, 1:].T).mean() for a in (1.0, 0.05)]
    assert chroma[1] > 1.15 * chroma[0]


def test_grey_prints_on_glass_keep_all_their_inks() -> None:
    grey = np.repeat(gallery_picture("woodcut", 300).mean(2, keepdims=True), 3, 2)
    surface = ball()
    surface = replace(surface, alpha=np.zeros(len(surface), np.float32))
    painter = Painter(replace(measure_hand(grey), technique="print"), surface, EMPTY, 64, WIDTH, 0.004, 0)
    work = painter.painted(silent)
    assert work is not None and len(np.unique(work.strokes.colour.round(2), axis=0)) >= 2


def test_rims_and_teeth_are_as_large_as_the_washes_below_the_lines() -> None:
    lines = straight_stroke((0.3, 0.5, 0.5), (0.7, 0.5, 0.5), 0.002, points=90)
    assert joined([crossing(1, 1), lines]).unit == crossing(1, 1).unit == pytest.approx(0.1)
    assert lines.unit == pytest.approx(0.004)


def test_oil_is_painted_as_it_is_measured() -> None:
    hand = hand_of("oil")
    _, work = laid("oil")
    assert work.brush.relief == pytest.approx(np.clip(hand.relief / 9.0, 0.08, 0.55))
    assert replace(work.brush, relief=0.3, dry=0.1, mixed=0.4) == Brush()


# --- scenes ----------------------------------------------------------------------------------------------------------


def painted(scene: Scene, name: str, **options) -> tuple[Scene, Report]:
    return stylize_scene(scene, [StyleInput(gallery_picture(name, 300), name)], SHORT, stroke_size=2.0, **options)


def test_a_named_hand_is_honoured_and_kept_in_the_file(balls: Scene, tmp_path: Path) -> None:
    scene, report = painted(balls, "mosaic", hand="watercolour")
    assert set(report["manner"].values()) == {"strokes"} and set(report["hand"].values()) == {"watercolour"}
    scene.save(tmp_path / "painted.svv")
    again = Scene.load(tmp_path / "painted.svv")
    brushes = []
    for one in (scene, again):
        assert one.styled is not None and one.styled.brushed is not None
        brushes.append({k: brush for k, (_, brush) in one.styled.brushed.regions.items()})
    assert brushes[0] == brushes[1] and all(brush.body == 0.0 for brush in brushes[0].values())


def test_the_hand_that_a_picture_shows_is_told(balls: Scene) -> None:
    _, report = painted(balls, "pointillism")
    assert set(report["hand"].values()) == {"dots"}
    assert any("as dots: its marks are round" in note and "--hand" in note for note in report["notes"])
    _, report = painted(balls, "pointillism", hand="oil")
    assert set(report["hand"].values()) == {"oil"} and not any("--hand" in note for note in report["notes"])


def test_pieces_in_a_named_hand_are_refused(balls: Scene) -> None:
    with pytest.raises(BadInput, match="leave out --manner pieces"):
        painted(balls, "mosaic", hand="pastel", manner="pieces")


def test_every_hand_can_be_asked_for() -> None:
    assert set(get_args(AskedHandName)) == {"auto", *get_args(HandName)} == {"auto", *TECHNIQUES}
