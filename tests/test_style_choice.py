"""Assignment of styles to regions, by colour or in turn, and the notes about styles left over."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.core.colour.colour import colour_differences
from svv.errors import BadInput
from svv.fields.scene.region import Region
from svv.train.paint.ink import StyleInput
from svv.train.paint.style_choice import leftovers, mean_colour, pairs_by_colour, validate_masks

COLOURS = st.tuples(*[st.floats(0, 1, width=32)] * 3)


def regions(*colours: tuple[float, float, float]) -> list[Region]:
    return [Region(c, 1 / len(colours)) for c in colours]


def flat(*colours: tuple[float, float, float]) -> list[np.ndarray]:
    return [np.full((4, 4, 3), c, np.float32) for c in colours]


@given(st.lists(COLOURS, min_size=3, max_size=3), st.lists(COLOURS, min_size=3, max_size=3))
def test_the_sum_of_differences_is_least(wanted: list, given_: list) -> None:
    pairs = pairs_by_colour(regions(*wanted), flat(*given_))
    cost = colour_differences(np.array(wanted), np.array([mean_colour(s) for s in flat(*given_)]))
    assert sorted(pairs.values()) == [0, 1, 2]
    least = min(sum(cost[i, p[i]] for i in range(3)) for p in permutations(range(3)))
    assert sum(cost[i, k] for i, k in pairs.items()) == pytest.approx(least, abs=1e-6)


RED, GREEN, BLUE = (0.9, 0.1, 0.1), (0.1, 0.7, 0.2), (0.1, 0.2, 0.9)


def test_more_regions_than_styles_share_the_nearest() -> None:
    pairs = pairs_by_colour(regions(RED, BLUE, (0.8, 0.2, 0.0), (0.2, 0.1, 0.8)), flat(BLUE, RED))
    assert pairs == {0: 1, 1: 0, 2: 1, 3: 0}
    notes = leftovers(pairs, ["sea", "fire"])
    assert notes == ["Style 0 (sea) is shared by regions 1, 3.", "Style 1 (fire) is shared by regions 0, 2."]


def test_more_styles_than_regions_are_left_out_and_said() -> None:
    pairs = pairs_by_colour(regions(GREEN), flat(BLUE, GREEN, RED))
    assert pairs == {0: 1}
    said = "Styles 0 (a), 2 (c) have no region and are not used; assign regions with --map."
    assert leftovers(pairs, ["a", "b", "c"]) == [said]
    assert leftovers({0: 0}, ["a"]) == [] and leftovers({0: 0, 1: 0}, ["a"]) == []


def test_kept_regions_are_left_out_and_edits_count() -> None:
    scene = [Region(RED, 0.5, edited_colour=BLUE), Region(BLUE, 0.5, edited_colour=RED)]
    assert pairs_by_colour(scene, flat(RED, BLUE)) == {0: 1, 1: 0}
    assert pairs_by_colour(scene, flat(RED, BLUE), keep=[0]) == {1: 0}
    assert pairs_by_colour(scene, flat(RED, BLUE), keep=[0, 1]) == {}


def test_only_what_a_mask_shows_has_a_colour() -> None:
    picture = np.zeros((4, 8, 3), np.float32)
    picture[:, :4], picture[:, 4:] = RED, BLUE
    left = np.arange(8)[None].repeat(4, 0) < 4
    np.testing.assert_allclose(mean_colour(picture, left), RED, atol=1e-6)
    assert pairs_by_colour(regions(BLUE, RED), [picture, picture], [left, ~left]) == {0: 1, 1: 0}


def test_masks_are_checked() -> None:
    styles = flat(RED, BLUE)
    half = np.tri(4, dtype=bool)

    def masked(*masks: np.ndarray | None) -> list[StyleInput]:
        return [StyleInput(style, mask=mask) for style, mask in zip(styles, masks, strict=True)]

    assert validate_masks(masked(None, None)) == ([None, None], [])
    found, notes = validate_masks(masked(half, np.ones((4, 4), bool)))
    assert found[1] is None and found[0] is not None
    assert notes == ["The mask of style 1 covers the whole picture, so it changes nothing."]
    for masks, words in (
        ([None, np.zeros((4, 4), bool)], "style 1 is empty"),
        ([np.ones((4, 5), bool), None], "5 x 4 pixels, but its picture has 4 x 4"),
    ):
        with pytest.raises(BadInput, match=words):
            validate_masks(masked(*masks))


PICTURE = np.random.default_rng(0).random((24, 32, 3), np.float32)


def test_bytes_of_a_picture_count_from_0_to_1() -> None:
    """As they were, they painted everything white."""
    found = StyleInput((255 * PICTURE).astype(np.uint8)).style
    assert isinstance(found, np.ndarray) and found.dtype == np.float32
    np.testing.assert_allclose(found, PICTURE, atol=1 / 255)
    assert StyleInput(PICTURE).style is PICTURE


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        ("a.png", r"svv\.read_style\('a.png'\)"), (PICTURE[..., 0], r"\(24, 32\)"), (PICTURE[:0], r"\(0, 32, 3\)"),
        (PICTURE.repeat(2, axis=2), "not float32"), (PICTURE > 0.5, "not bool"), (None, "array of numbers"),
        (255 * PICTURE, "scale its values"), (PICTURE - 1, "scale its values"),
        (np.where(PICTURE > 0.9, np.nan, PICTURE), "scale its values"),
        ((255 * PICTURE).astype(int), "scale its values"),
    ],
)  # fmt: skip
def test_what_is_no_picture_is_refused(picture: object, words: str) -> None:
    """Values of NaN gave images of NaN, others ended in an error of torch's or painted everything black or white."""
    with pytest.raises(BadInput, match=words):
        StyleInput(picture)  # type: ignore[arg-type]
