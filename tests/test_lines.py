"""The distance between the lines of pictures, which is smaller to a style's strokes than to its blurred colours."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from svv.errors import BadInput
from svv.styles.gallery import gallery_picture
from svv.styles.gallery.textures import style_picture
from svv.train.lpips import Lpips
from svv_bench.styles.lines import LEAST_PIXELS, MEASURES, StyleLines, find_ridges, interior, shuffled, traced, turned
from svv_bench.styles.statistics import StyleJudge
from tests.nightly import nightly

Picture = NDArray[np.floating]
SIZE = 256


@pytest.fixture(scope="module")
def drawn() -> dict[str, Picture]:
    """Styles; of each one half is compared with the other."""
    gallery = {name: gallery_picture(name, SIZE) for name in ("mosaic", "woodcut")}
    return {**gallery, "brush strokes": style_picture("brush strokes", SIZE)}


@pytest.fixture(scope="module")
def judged(drawn: dict[str, Picture]) -> dict[str, StyleLines]:
    return {name: StyleLines.of(picture[:, SIZE // 2 :]) for name, picture in drawn.items()}


def left(picture: Picture) -> Picture:
    return picture[:, : SIZE // 2]


def mud(picture: Picture, blur: float = 2.0) -> Picture:
    """A style's colours without its strokes: blurred, with noise upon it."""
    noise = np.random.default_rng(0).normal(0, 0.05, picture.shape)
    return np.clip(gaussian_filter(picture, (blur, blur, 0)) + noise, 0, 1)


def drawing(size: int = 128) -> Picture:
    """Ink on paper: circles around the middle and a few straight lines."""
    y, x = np.mgrid[:size, :size].astype(float)
    radius = np.hypot(y - size / 2, x - size / 2)
    ink = (np.abs(radius % 14 - 7) < 1.2) | (np.abs((x + 2 * y) % 60 - 30) < 1.5)
    return np.repeat(
        np.where(gaussian_filter(ink.astype(float), 0.6), 1 - gaussian_filter(ink * 0.9, 0.6), 1)[..., None], 3, 2
    )


# --- the distance ------------------------------------------------------------------------------------------------


def test_equal_pictures_have_none(drawn: dict[str, Picture]) -> None:
    for picture in drawn.values():
        found = StyleLines.of(picture).distances(picture)
        assert list(found) == ["lines", *(f"lines: {name}" for name in MEASURES)]
        assert set(found.values()) == {0.0}


def test_noise_of_a_style_s_colours_is_the_unit(drawn: dict[str, Picture]) -> None:
    picture = drawn["woodcut"]
    found = StyleLines.of(picture).distances(shuffled(picture))
    for name in ("length", "turn", "coherence 2", "coherence 4", "coherence 8"):
        assert found[f"lines: {name}"] == pytest.approx(1)
    assert found["lines: strength"] < 1  # noise has strokes' strengths, without their form


@pytest.mark.parametrize("by", nightly([1, 37, 100], 37))
def test_a_shift_with_what_leaves_coming_in_changes_little(
    drawn: dict[str, Picture], judged: dict[str, StyleLines], by: int
) -> None:
    for name, picture in drawn.items():
        whole = StyleLines.of(picture)
        other = min(whole.distances(q)["lines"] for n, q in drawn.items() if n != name)
        assert whole.distances(np.roll(picture, by, 1))["lines"] < min(0.03, 0.2 * other)


def test_the_more_a_drawing_is_blurred_the_further_it_is() -> None:
    picture = drawing()
    lines = StyleLines.of(picture)
    distances = [lines.distances(gaussian_filter(picture, (s, s, 0)))["lines"] for s in (0, 0.5, 1, 1.5, 2, 2.5)]
    assert distances[0] == 0
    assert (np.diff(distances) > 0).all()


def test_a_style_s_other_half_is_nearer_than_other_styles(
    drawn: dict[str, Picture], judged: dict[str, StyleLines]
) -> None:
    for name, lines in judged.items():
        own = lines.distances(left(drawn[name]))["lines"]
        assert all(own < 0.5 * lines.distances(left(p))["lines"] for n, p in drawn.items() if n != name)


@pytest.mark.parametrize("blur", [1.5, 3.0])
def test_mud_is_further_than_a_crisp_crop(
    drawn: dict[str, Picture], judged: dict[str, StyleLines], blur: float
) -> None:
    for name, lines in judged.items():
        crisp = left(drawn[name])
        assert lines.distances(crisp)["lines"] < 0.5 * lines.distances(mud(crisp, blur))["lines"]


@pytest.mark.slow
def test_alexnet_too_puts_mud_behind_a_crisp_crop(drawn: dict[str, Picture], published) -> None:
    network = Lpips()
    network.load_state_dict(published("alexnet"))
    for picture in drawn.values():
        judge = StyleJudge(picture[:, SIZE // 2 :], network.eval())
        crisp, muddy, noise = (judge.figures(p) for p in (left(picture), mud(left(picture)), shuffled(left(picture))))
        for figure in ("adain", "neighbours"):
            assert crisp[figure] < 0.85 * muddy[figure]
            assert noise[figure] == pytest.approx(1, abs=0.25)
            assert judge.figures(picture[:, SIZE // 2 :])[figure] == pytest.approx(0, abs=1e-5)


def test_twice_the_contrast_is_as_far_as_half() -> None:
    """Within a factor: the eye sees ratios."""
    picture = 0.5 + 0.4 * (drawing() - 0.5)
    lines = StyleLines.of(picture)
    half, double = (lines.distances(0.5 + f * (picture - 0.5))["lines: strength"] for f in (0.5, 2))
    assert 0.5 < half / double < 2


# --- lines -------------------------------------------------------------------------------------------------------


@given(st.floats(-1.5, 1.5))
@settings(max_examples=20)
def test_a_straight_edge_is_one_line_in_its_direction(angle: float) -> None:
    y, x = np.mgrid[:64, :64] - 31.5
    side = x * np.sin(angle) - y * np.cos(angle)
    ridges = find_ridges(np.repeat(1 / (1 + np.exp(-2 * side))[..., None], 3, 2))
    number = traced(ridges, ridges.scale)
    on = (number >= 0) & (np.maximum(np.abs(x), np.abs(y)) < 26)  # derivatives reach over the picture's border
    assert np.abs(side[on]).max() < 1
    assert len(np.unique(number[on])) <= 3 and np.bincount(number[on]).max() > 45
    assert turned(ridges.angle[on], angle).max() < 0.1
    assert ridges.coherence[0][on].min() > 0.99


# --- masks -------------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**31))
@settings(max_examples=10)
def test_what_lies_outside_the_mask_does_not_count(seed: int) -> None:
    random = np.random.default_rng(seed)
    picture = gaussian_filter(random.random((48, 56, 3)), (1, 1, 0))
    mask = gaussian_filter(random.random((48, 56)), 6) > 0.5
    lines = StyleLines.of(picture)
    if interior(mask).sum() < LEAST_PIXELS:
        return
    other = np.where(mask[..., None], picture, random.random(picture.shape))
    assert lines.distances(picture, mask) == lines.distances(other, mask)


def test_a_region_s_border_is_no_line() -> None:
    picture = np.full((64, 64, 3), 0.5)
    mask = np.hypot(*(np.mgrid[:64, :64] - 31.5)) < 25
    ridges = find_ridges(np.where(mask[..., None], picture, 1.0), mask)
    assert (traced(ridges, ridges.scale) < 0).all()


@pytest.mark.slow
def test_part_of_a_style_under_a_mask_is_near_to_it(drawn: dict[str, Picture]) -> None:
    y, x = np.mgrid[:SIZE, :SIZE]
    mask = np.sin(x / 9) + np.sin(y / 13) > 0.2  # as narrow as tubes are
    for picture in drawn.values():
        lines = StyleLines.of(picture)
        assert lines.distances(picture, mask)["lines"] < 0.5 * lines.distances(mud(picture), mask)["lines"]


# --- bad input and plain pictures --------------------------------------------------------------------------------


def test_pictures_and_styles_of_one_colour_are_judged() -> None:
    grey, picture = np.full((64, 64, 3), 0.4), drawing()
    assert set(StyleLines.of(grey).distances(grey).values()) == {0.0}
    assert all(
        np.isfinite(list(StyleLines.of(a).distances(b).values())).all() for a, b in ((grey, picture), (picture, grey))
    )
    assert StyleLines.of(picture).distances(grey)["lines"] > 1


def test_what_has_no_lines_to_look_at_is_refused() -> None:
    picture = np.zeros((32, 32, 3))
    with pytest.raises(BadInput, match="in colour"):
        find_ridges(picture[..., 0])
    with pytest.raises(BadInput, match="picture's size"):
        find_ridges(picture, np.ones((32, 31)))
    with pytest.raises(BadInput, match="inside the mask"):
        find_ridges(picture, np.zeros((32, 32)))


def test_without_weights_lines_alone_are_judged() -> None:
    judge = StyleJudge(drawing(), None)
    found = judge.figures(drawing())
    assert found["lines"] == 0 and not {"adain", "neighbours"} & found.keys()
    assert judge.figures(drawing(), np.zeros((128, 128))) == {}
    small = StyleJudge(drawing()[:24, :60], Lpips())
    assert "adain" not in small.figures(drawing()) and "adain" not in StyleJudge(drawing(), Lpips()).figures(
        drawing()[:24]
    )
