"""Palettes of constructed scenes whose colours are known: shading, highlights, mixtures, noise and 8 bits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from svv.core.colour.colour import hsb_array, hue_distance, rgb_array
from svv.core.colour.palette import Array, Palette, PaletteSettings, extract_palette
from svv.errors import BadInput
from tests.nightly import nightly

RED, GREEN, BLUE = (0.9, 0.15, 0.1), (0.15, 0.85, 0.3), (0.1, 0.3, 1.0)
YELLOW, ORANGE = (1.0, 0.85, 0.15), (1.0, 0.5, 0.2)
WHITE, IVORY = (1.0, 1.0, 1.0), (1.0, 0.95, 0.85)

Colours = list[tuple[float, float, float]]


def scene(
    colours: Colours,
    pixels: int = 6_000,
    mixed: float = 0.3,
    highlights: float = 0.1,
    shares: list[float] | None = None,
    seed: int = 0,
) -> tuple[Array, Array]:
    """Pixels (N, 3) and alphas (N,) as ray casting makes them, rounded to 8 bits after division by alpha.

    Each pixel is one colour, or (a part ``mixed`` of them) a mixture of two, times headlight shading, plus white
    light at a part ``highlights`` of them.
    """
    draw = np.random.default_rng(seed)
    table = np.array(colours)
    front = draw.choice(len(table), pixels, p=shares)
    behind = draw.choice(len(table), pixels, p=shares)
    cover = np.where(draw.random(pixels) < mixed, draw.random(pixels), 1.0)[:, None]
    colour = cover * table[front] + (1 - cover) * table[behind]
    shading = 0.15 + 0.85 * np.sqrt(draw.random(pixels))
    shine = np.where(draw.random(pixels) < highlights, draw.random(pixels) ** 2, 0.0)
    lit = np.clip(colour * shading[:, None] + shine[:, None], 0, 1)
    alpha = np.clip(draw.beta(1.5, 1.0, pixels), 1 / 255, 1)
    premultiplied = np.rint(lit * alpha[:, None] * 255)
    alpha = np.rint(alpha * 255) / 255
    return np.clip(premultiplied / 255 / alpha[:, None], 0, 1), alpha


def assert_hues(palette: Palette, colours: Colours, within: float = 0.03) -> None:
    """Each colour is in the palette once, and nothing else is."""
    assert len(palette.colours) == len(colours), palette.steps
    expected, found = hsb_array(np.array(colours))[:, 0], hsb_array(palette.colours)[:, 0]
    distance = hue_distance(expected[:, None], found[None])
    assert sorted(distance.argmin(1)) == list(range(len(colours))), palette.steps
    assert distance.min(1).max() < within


@pytest.mark.parametrize(
    "colours",
    [[RED], [YELLOW], [RED, BLUE], [ORANGE, BLUE], [RED, YELLOW, BLUE], [BLUE, GREEN, RED], [RED, YELLOW, GREEN, BLUE]],
    ids=str,
)
@pytest.mark.parametrize("seed", [0, 1])
def test_one_colour_for_each_range(colours: Colours, seed: int) -> None:
    palette = extract_palette(*scene(colours, seed=seed))
    assert_hues(palette, colours)
    order = hsb_array(palette.colours)[:, 0].argsort()
    expected = np.array(colours)[hsb_array(np.array(colours))[:, 0].argsort()]
    np.testing.assert_allclose(palette.colours[order], expected, atol=0.12)


@example(0.0, 2, 0.71875, 0.5, 44)  # opposite hues that mix to more grey than highlights give
@settings(max_examples=10)
@given(st.floats(0, 1), st.integers(1, 4), st.floats(0.7, 0.95), st.floats(0.4, 1.0), st.integers(0, 99))
def test_any_spread_of_hues(start: float, count: int, saturation: float, value: float, seed: int) -> None:
    hues = start + np.arange(count) / count
    colours = rgb_array(np.stack([hues, np.full(count, saturation), np.full(count, value)], 1))
    assert_hues(extract_palette(*scene(colours.tolist(), 4000, seed=seed)), colours.tolist(), within=0.05)


@pytest.mark.parametrize("count", nightly([5, 6, 7, 8], 5, 8))
@pytest.mark.parametrize("step", ["even", "golden"])
@pytest.mark.parametrize("mixed", [0.05, 0.5])
def test_up_to_eight_ranges_though_some_could_be_mixed_of_others(count: int, step: str, mixed: float) -> None:
    """Among so many hues one lies between two others, on the face of the cone that they span or inside of it."""
    hues = 0.05 + np.arange(count) * (1 / count if step == "even" else 0.618034)
    colours = rgb_array(np.stack([hues % 1.0, np.full(count, 0.85), np.full(count, 0.95)], 1)).tolist()
    palette = extract_palette(*scene(colours, 12_000, mixed=mixed))
    assert_hues(palette, colours)
    found = hsb_array(palette.colours)
    assert found[:, 1].min() > 0.7 and found[:, 2].min() > 0.75, palette.steps


@pytest.mark.parametrize("pair", [[RED, GREEN], [RED, BLUE]], ids=str)
def test_a_mixture_in_any_proportion_is_no_range_however_much_of_it_there_is(pair: Colours) -> None:
    assert_hues(extract_palette(*scene(pair, 12_000, mixed=0.8)), pair)


def test_mixtures_shades_and_highlights_are_no_ranges() -> None:
    everything = extract_palette(*scene([RED, BLUE], mixed=0.9, highlights=0.3))
    assert_hues(everything, [RED, BLUE])


def test_a_range_never_seen_alone_is_found_as_it_is_seen() -> None:
    blue = np.array(BLUE) * 0.4
    pixels, alpha = scene([tuple(0.6 * np.array(GREEN) + blue), BLUE, RED])
    assert len(extract_palette(pixels, alpha).colours) == 3


def test_a_small_range_is_found_and_a_handful_of_pixels_is_none() -> None:
    assert_hues(extract_palette(*scene([RED, BLUE], shares=[0.98, 0.02])), [RED, BLUE])
    assert_hues(extract_palette(*scene([RED, BLUE], shares=[0.999, 0.001])), [RED])


def test_nearly_transparent_pixels_have_no_say() -> None:
    pixels, alpha = scene([RED, BLUE])
    noise = np.random.default_rng(0).random((6_000, 3))
    with_haze = extract_palette(np.concatenate((pixels, noise)), np.concatenate((alpha, np.full(6_000, 3 / 255))))
    assert_hues(with_haze, [RED, BLUE])


def test_scattered_outliers_have_no_say() -> None:
    pixels, alpha = scene([RED, BLUE])
    pixels[:15] = np.random.default_rng(0).random((15, 3))
    assert_hues(extract_palette(pixels, alpha), [RED, BLUE])


def test_camera_noise() -> None:
    pixels, alpha = scene([RED, YELLOW, BLUE])
    noisy = pixels + np.random.default_rng(0).normal(0, 3 / 255, pixels.shape)
    assert_hues(extract_palette(noisy, alpha), [RED, YELLOW, BLUE])


def test_hue_wraps_and_the_colour_with_more_pixels_stays() -> None:
    # hues 0.99 and 0.02 are neighbours across red, whatever their difference says
    rose, vermilion = (1.0, 0.1, 0.154), (1.0, 0.208, 0.1)
    for shares, kept in (([0.7, 0.3], rose), ([0.3, 0.7], vermilion)):
        palette = extract_palette(*scene([rose, vermilion], shares=shares, mixed=0.0))
        assert_hues(palette, [kept], within=0.02)


def test_orange_and_amber_are_two_regions() -> None:
    """Hues 0.07 and 0.12, which the paper's threshold of 0.1 joins."""
    orange, amber = (0.95, 0.45, 0.1), (0.95, 0.72, 0.1)
    pixels, alpha = scene([orange, amber], shares=[0.3, 0.7])
    assert_hues(extract_palette(pixels, alpha), [orange, amber], within=0.02)
    assert len(extract_palette(pixels, alpha, PaletteSettings(hue_distance=0.1)).colours) == 1


@pytest.mark.parametrize("colour", [WHITE, IVORY, (0.4, 0.4, 0.4), (0.05, 0.05, 0.05), (0.0, 0.0, 0.0)], ids=str)
def test_a_grey_scene_has_one_colour(colour: tuple[float, float, float]) -> None:
    palette = extract_palette(*scene([colour], highlights=0.0))
    assert len(palette.colours) == 1
    assert palette.share == pytest.approx([1.0])
    np.testing.assert_allclose(palette.colours[0], colour, atol=0.08)


def test_greyness_is_told_by_saturation_and_not_by_brightness() -> None:
    dark, pale = (0.25, 0.02, 0.02), (0.8, 0.76, 0.8)
    assert_hues(extract_palette(*scene([dark, BLUE], highlights=0.0)), [dark, BLUE], within=0.05)
    # as many pale pixels as highlights make: a range of light grey would be 20 times that
    pixels, alpha = scene([RED, pale], shares=[0.98, 0.02], mixed=0.0)
    assert_hues(extract_palette(pixels, alpha), [RED])


@pytest.mark.parametrize("bone", [WHITE, IVORY], ids=["white", "ivory"])
def test_a_large_grey_range_is_a_range_beside_colours(bone: tuple[float, float, float]) -> None:
    palette = extract_palette(*scene([bone, RED], highlights=0.02))
    assert len(palette.colours) == 2, palette.steps
    greyest = palette.colours[hsb_array(palette.colours)[:, 1].argmin()]
    np.testing.assert_allclose(greyest, bone, atol=0.1)


def test_flat_unlit_colours() -> None:
    """Shading off: two colours and nothing else, too few for a hull."""
    palette = extract_palette(np.array([RED] * 300 + [BLUE] * 100), np.ones(400))
    np.testing.assert_allclose(palette.colours, [RED, BLUE], atol=1e-9)
    np.testing.assert_allclose(palette.share, [0.75, 0.25])


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_few_pixels_are_enough(count: int) -> None:
    palette = extract_palette(np.tile(np.array([ORANGE]), (count, 1)), np.full(count, 0.5))
    np.testing.assert_allclose(palette.colours, [ORANGE], atol=1e-9)


def test_haze_alone_has_a_palette_and_nothing_has_none() -> None:
    pixels, alpha = scene([RED, BLUE])
    assert len(extract_palette(pixels, alpha * 0.05).colours) >= 1
    for weights in (alpha * 0, alpha[:0]):
        with pytest.raises(BadInput, match="visible"):
            extract_palette(pixels[: len(weights)], weights)


def test_shares_are_sorted_and_sum_to_one() -> None:
    palette = extract_palette(*scene([RED, GREEN, BLUE], shares=[0.2, 0.5, 0.3], mixed=0.0))
    assert palette.share.sum() == pytest.approx(1)
    np.testing.assert_allclose(palette.share, [0.5, 0.3, 0.2], atol=0.03)
    assert hue_distance(hsb_array(palette.colours)[0, 0], hsb_array(np.array(GREEN))[0]) < 0.03
    assert palette.colours.min() >= 0
    assert palette.colours.max() <= 1


def test_the_number_of_colours_is_bounded() -> None:
    pixels, alpha = scene([RED, YELLOW, GREEN, BLUE])
    palette = extract_palette(pixels, alpha, PaletteSettings(max_colours=2))
    assert len(palette.colours) == 2
    assert palette.share.sum() == pytest.approx(1)
    anything = np.random.default_rng(0).random((300, 3))
    loose = PaletteSettings(hue_distance=0.0, tolerance=0.0, min_share=0.0, max_colours=3)
    assert len(extract_palette(anything, np.ones(300), loose).colours) == 3


def test_one_seed_one_palette() -> None:
    pixels, alpha = scene([RED, YELLOW, BLUE])
    sampled = PaletteSettings(max_pixels=5000)
    first, second = (extract_palette(pixels, alpha, sampled, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.colours, second.colours)
    assert first.steps == second.steps
    assert_hues(extract_palette(pixels, alpha, sampled, seed=4), [RED, YELLOW, BLUE])
    shuffled = np.random.default_rng(0).permutation(len(alpha))
    np.testing.assert_allclose(
        extract_palette(pixels[shuffled], alpha[shuffled]).colours, extract_palette(pixels, alpha).colours
    )
