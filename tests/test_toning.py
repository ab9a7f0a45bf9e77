"""Tones of painted regions: those of their pictures, and apart from one another, as views show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from skimage.color import rgb2lab

from svv.core.colour.colour import lab_to_rgb
from svv.core.strokes.strokes import Brush, Strokes, joined, straight_stroke
from svv.fields.scene.seen_colours import Seen
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.styles.gallery import gallery_picture
from svv.styles.hand import Hand, measure_hand
from svv.train.paint.brushwork import Brushwork
from svv.train.paint.legibility import AWAY, MOST_DIMMED, Legibility
from svv.train.paint.styled_views import StyledView
from svv.train.paint.toning import Laid, Toned, toned
from svv.train.paint.view_pixels import ViewPixels

SIDE, SOFT = 32, 0.004
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def hand() -> Hand:
    return measure_hand(gallery_picture("oil", 300))


def strokes_over(depth: float, low: float, high: float, colours: np.ndarray) -> Strokes:
    """Broad horizontal strokes at a depth, from left to right, of colours (N, 3) in turn."""
    rows = np.linspace(0.0, 1.0, 24)
    return joined([
        straight_stroke((low, y, depth), (high, y, depth), 0.05, tuple(colours[k % len(colours)]))
        for k, y in enumerate(rows)
    ])  # fmt: skip


def laid(strokes: Strokes, hand: Hand, clear: float = 0.0) -> Laid:
    brush = Brush(relief=0.0, dry=0.0, mixed=0.0)
    return Laid(Brushwork(strokes, brush, np.ones(len(strokes.seed))), hand, clear)


def view_of(*layers: tuple[int, float, np.ndarray, float]) -> StyledView:
    """A view along z of layers, front to back: region, depth, pixels that it covers (SIDE, SIDE) and weight there."""
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    at = np.stack([(x + 0.5) / SIDE, (y + 0.5) / SIDE], -1).reshape(-1, 2)
    rows = []
    for region, depth, mask, weight in layers:
        own = np.flatnonzero(mask.reshape(-1))
        rows.append(np.column_stack([at[own], np.full(len(own), depth), np.full(len(own), weight), own,
                                     np.full(len(own), region)]))  # fmt: skip
    every = np.concatenate(rows)
    every = every[np.argsort(every[:, 4], kind="stable")]
    tensor = torch.from_numpy(every)
    return StyledView(tensor[:, :3].float(), tensor[:, 3].float(), tensor[:, 4].int(), tensor[:, 5].short(), SIDE, SIDE)


LEFT = np.arange(SIDE)[None] < SIDE // 2
HALVES = view_of((0, 0.5, LEFT & np.ones((SIDE, 1), bool), 1.0), (1, 0.5, ~LEFT & np.ones((SIDE, 1), bool), 1.0))


def mean_of(found: Toned, region: int, view: StyledView) -> np.ndarray:
    """The mean colour that a view shows of a region alone, CIELAB. (3,)"""
    pixels = ViewPixels([view], np.ones(2))
    work, own = found.laid[region].work, pixels.region == region
    shown = pixels.mixed(region, StrokePaint(work.strokes, work.brush, SOFT)(pixels.where[own]))
    return np.asarray(rgb2lab(shown[np.unique(pixels.pixel[own])]).mean(0))


def lit(*colours: tuple[float, float, float], shade: float) -> dict[int, Seen]:
    """Regions of which images show the colours darkened by a factor."""
    return {k: Seen(str(k), shade * np.array([colour]), np.ones(1)) for k, colour in enumerate(colours)}


def halves(hand: Hand, colours: tuple[tuple[float, float, float], ...], shade: float | None = None) -> Toned:
    """Two opaque regions side by side, painted by strokes of the same colours."""
    every = hand.colours[:: max(len(hand.colours) // 40, 1)]
    own = lab_to_rgb(every)
    works = {0: laid(strokes_over(0.5, 0.0, 0.47, own), hand), 1: laid(strokes_over(0.5, 0.53, 1.0, own), hand)}
    flats = np.array(colours)
    return toned(
        works, [HALVES] * 5, flats, flats, np.ones(2), SOFT, lambda: {} if shade is None else lit(*colours, shade=shade)
    )


def apart(found: Toned) -> float:
    return found.legibility.differences(found.legibility.shown(found.lab))[0, 1]


def test_regions_with_the_same_strokes_are_moved_apart(hand: Hand) -> None:
    found = halves(hand, (RED, BLUE))
    assert found.legibility.asked[0, 1] == 12.0
    assert apart(found) >= 12.0


def test_in_the_shade_regions_are_moved_farther_apart(hand: Hand) -> None:
    asked = []
    for shade in (1.0, 0.6, 0.01):
        found = halves(hand, (RED, BLUE), shade)
        asked.append(found.legibility.asked[0, 1])
        assert apart(found) >= asked[-1]
    assert asked[0] == pytest.approx(12.0, rel=0.01)
    assert asked[0] < asked[1] <= asked[2] == pytest.approx(12.0 * MOST_DIMMED)


def test_regions_that_the_volume_rendering_does_not_tell_apart_stay_alike(hand: Hand) -> None:
    found = halves(hand, (RED, RED))
    assert found.legibility.asked[0, 1] == pytest.approx(0.0, abs=1e-6) and apart(found) < 5.0


def test_moving_apart_keeps_hues_and_stays_in_the_range_of_the_picture(hand: Hand) -> None:
    found, low, high = halves(hand, (RED, BLUE)), hand.gamut[0], hand.gamut[1]
    for k in (0, 1):
        assert low - 2.0 <= mean_of(found, k, HALVES)[0] <= high + 2.0
    for k in (0, 1):
        before = rgb2lab(found.laid[k].work.strokes.colour)
        vivid = np.hypot(before[:, 1], before[:, 2]) > 10.0
        plain = rgb2lab(halves(hand, (RED, RED)).laid[k].work.strokes.colour)
        turn = np.angle((before[:, 1] + 1j * before[:, 2]) * np.conj(plain[:, 1] + 1j * plain[:, 2]))[vivid]
        assert np.median(np.abs(turn)) < 0.1
    assert abs(mean_of(found, 0, HALVES)[0] - mean_of(found, 1, HALVES)[0]) <= 2.0 * AWAY


def test_what_encloses_stays_lighter_than_what_it_encloses(hand: Hand) -> None:
    everywhere, middle = np.ones((SIDE, SIDE), bool), np.zeros((SIDE, SIDE), bool)
    middle[8:24, 8:24] = True
    view = view_of((0, 0.6, everywhere & ~middle, 0.9), (0, 0.6, middle, 0.3), (1, 0.4, middle, 0.65))
    light, dark = np.array([(0.8, 0.7, 0.3)]), np.array([(0.2, 0.25, 0.35)])
    # The enclosing region is painted dark and the enclosed one light, against what the volume rendering shows.
    bright, dim = (replace(hand, colours=rgb2lab(c[None])[0].repeat(100, 0).astype(np.float32)) for c in (light, dark))
    works = {0: laid(strokes_over(0.6, 0.0, 1.0, dark), dim), 1: laid(strokes_over(0.4, 0.2, 0.8, light), bright)}
    colours = np.array([(0.9, 0.9, 0.8), (0.3, 0.0, 0.0)])
    found = toned(works, [view] * 5, colours, colours, np.ones(2), SOFT)
    around, within = mean_of(found, 0, view)[0], mean_of(found, 1, view)[0]
    assert 0.9 * around + 0.1 * 100.0 > 0.3 * around + 0.65 * within + 0.05 * 100.0


def test_views_that_show_hardly_anything_ask_for_nothing() -> None:
    one = np.zeros((SIDE, SIDE), bool)
    one[0, :3] = True
    pixels = ViewPixels([view_of((0, 0.5, one, 1.0), (1, 0.4, one, 0.0))], np.ones(2))
    found = Legibility(pixels, np.array([RED, BLUE]), np.array([RED, BLUE]))
    lab = {k: np.zeros((pixels.pixels, 3)) for k in (0, 1)}
    assert found.asked == {} and found.moves(lab, {}, {}, {}) == {} and not found.doubtful(lab)


# --- pixels ----------------------------------------------------------------------------------------------------------


def test_what_is_before_most_of_another_encloses_it() -> None:
    everywhere, middle = np.ones((SIDE, SIDE), bool), np.zeros((SIDE, SIDE), bool)
    middle[10:20, 10:20] = True
    view = view_of((0, 0.7, everywhere, 0.2), (1, 0.5, middle, 0.5), (0, 0.2, middle, 0.06))
    pixels = ViewPixels([view], np.ones(2))
    assert pixels.encloses.tolist() == [[False, True], [False, False]]
    assert pixels.together[0, 1] == 1.0
    assert pixels.inside.sum(1).max() == pytest.approx(0.76)


def test_hidden_regions_let_what_is_behind_them_be_seen() -> None:
    everywhere = np.ones((SIDE, SIDE), bool)
    view = view_of((0, 0.7, everywhere, 0.8), (1, 0.5, everywhere, 0.1))  # the second has an opacity of one half
    pixels = ViewPixels([view], np.array([0.0, 1.0]))
    assert pixels.inside == pytest.approx(np.tile([0.0, 0.5], (SIDE * SIDE, 1)), abs=1e-6)


def test_chosen_pixels_keep_all_their_samples() -> None:
    everywhere = np.ones((SIDE, SIDE), bool)
    view = view_of((0, 0.7, everywhere, 0.3), (1, 0.5, LEFT & everywhere, 0.5))
    pixels = ViewPixels([view], np.ones(2), [1], 64)
    assert pixels.pixels == 64 and (pixels.inside == pytest.approx(np.tile([0.3, 0.5], (64, 1)), abs=1e-6))
