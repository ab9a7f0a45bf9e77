"""The hand of a picture: strokes of known width, length and angle are recovered, and bad pictures are survived."""

from __future__ import annotations

from collections import OrderedDict
from functools import lru_cache

import numpy as np
import pytest

from svv.core.colour.colour import lab_to_rgb
from svv.core.images.structure_tensor import structure_tensor
from svv.errors import BadInput
from svv.styles.gallery import gallery_picture
from svv.styles.hand import INKS, PROFILE, TONES, Hand, measure_hand
from svv.train.paint import plan
from svv.train.paint.manner import manner_of
from tests.nightly import nightly


@lru_cache
def strokes(width: float, length: float, angle: float, size: int = 300, seed: int = 0) -> np.ndarray:
    """Overlapping rectangles of random grey in one direction: painted strokes whose measures are known. (H, W, 3)"""
    generator = np.random.default_rng(seed)
    out = np.full((size, size, 3), 0.5, np.float32)
    rows, columns = np.mgrid[:size, :size]
    reach = int(0.5 * length + width) + 2
    for _ in range(int(4 * size * size / (width * length))):
        x, y = generator.uniform(0, size, 2)
        turned = angle + generator.normal(0.0, 0.05)
        there = (slice(max(int(y) - reach, 0), int(y) + reach), slice(max(int(x) - reach, 0), int(x) + reach))
        right, up = columns[there] - x, y - rows[there]
        along, across = (
            right * np.cos(turned) + up * np.sin(turned),
            up * np.cos(turned) - right * np.sin(turned),
        )
        out[there][(np.abs(along) < 0.5 * length) & (np.abs(across) < 0.5 * width)] = generator.uniform(0.1, 0.9)
    return out


def direction(hand: Hand) -> float:
    """The mean angle of the strokes, which are lines of either sign."""
    return float(0.5 * np.angle((hand.coherences * np.exp(2j * hand.angles)).mean()) % np.pi)


@pytest.mark.parametrize(("width", "ratio"), nightly([(5, 4), (8, 2), (8, 5), (8, 10), (14, 4)], (8, 2), (14, 4)))
def test_strokes_of_known_width_and_length_are_recovered(width: int, ratio: int) -> None:
    """Overlapped strokes look a little narrower than they are: the width is found within -30 and +15 percent."""
    hand = measure_hand(strokes(width, ratio * width, 0.4))
    assert 0.7 <= hand.width / width <= 1.15
    assert 0.7 <= hand.elongation / ratio <= 1.3
    assert not hand.plain


@pytest.mark.parametrize("angle", nightly([0.0, 0.4, 1.2, 2.5], 1.2))
def test_strokes_of_known_angle_are_recovered(angle: float) -> None:
    away = (direction(measure_hand(strokes(8, 40, angle))) - angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    assert abs(away) < 0.05


def test_measures_do_not_change_when_the_picture_is_turned_or_mirrored() -> None:
    picture = strokes(8, 40, 0.4)
    hand = measure_hand(picture)
    for other, expected in ((np.rot90(picture), 0.4 + 0.5 * np.pi), (picture[:, ::-1], np.pi - 0.4)):
        found = measure_hand(np.ascontiguousarray(other))
        assert found.width == pytest.approx(hand.width, rel=0.05)
        assert found.elongation == pytest.approx(hand.elongation, rel=0.08)
        assert found.contrast == pytest.approx(hand.contrast, rel=0.05)
        assert direction(found) == pytest.approx(expected, abs=0.03)


def test_an_enlarged_picture_has_larger_strokes_and_otherwise_the_same_hand() -> None:
    picture = gallery_picture("woodcut", 400)
    hand, double = measure_hand(picture), measure_hand(picture.repeat(2, 0).repeat(2, 1))
    assert double.width == pytest.approx(2.0 * hand.width, rel=0.15)
    assert double.elongation == pytest.approx(hand.elongation, rel=0.2)
    assert double.scatter == pytest.approx(hand.scatter, abs=0.03)


def test_the_profile_of_a_stroke_is_high_in_its_middle_and_falls_to_both_sides() -> None:
    profile = measure_hand(strokes(12, 60, 0.7)).profile
    middle = PROFILE // 2
    assert profile[middle] == pytest.approx(1.0)
    assert (np.diff(profile[: middle + 1]) > 0).all() and (np.diff(profile[middle:]) < 0).all()
    assert profile == pytest.approx(profile[::-1], abs=0.15)


def test_dots_are_short_and_have_no_direction_and_lines_are_long() -> None:
    dots, lines = (measure_hand(gallery_picture(name, 400)) for name in ("pointillism", "cross-hatching"))
    assert dots.elongation < 1.5 < lines.elongation
    assert dots.coherence < 0.4 < lines.coherence


def test_more_turning_strokes_are_more_curved() -> None:
    straight = measure_hand(strokes(8, 60, 0.4))
    rows, columns = np.mgrid[:300, :300] - 149.5
    rings = np.repeat(np.sin(np.hypot(rows, columns) / 2.5)[..., None], 3, 2) * 0.4 + 0.5
    assert measure_hand(rings).curvature > straight.curvature


def test_the_palette_goes_from_dark_to_light() -> None:
    hand = measure_hand(gallery_picture("impasto", 300))
    assert hand.palette.shape == (TONES, 3)
    assert (np.diff(hand.palette[:, 0]) >= 0).all()
    assert hand.darkest[0] <= hand.palette[0, 0]


def test_inks_are_the_commonest_colours_that_differ_the_commonest_first() -> None:
    picture = np.full((90, 120, 3), (0.9, 0.85, 0.7), np.float32)
    picture[:, 60:100] = 0.1, 0.2, 0.45
    picture[:, 100:] = 0.8, 0.25, 0.15
    picture[:2, :3] = 0.0, 1.0, 0.0  # less than LEAST_INK
    inks = lab_to_rgb(measure_hand(picture).inks)
    assert inks == pytest.approx(np.array([(0.9, 0.85, 0.7), (0.1, 0.2, 0.45), (0.8, 0.25, 0.15)]), abs=0.02)


def test_soft_edges_between_flat_colours_are_no_inks() -> None:
    picture = np.full((200, 200, 3), (0.95, 0.9, 0.75), np.float32)
    picture[:, 100:] = 0.05, 0.05, 0.1
    for k in range(3):
        picture[:, 98 + k] = picture[0, 0] + (k + 1) / 4 * (picture[0, -1] - picture[0, 0])
    assert len(measure_hand(picture).inks) == 2


def test_even_a_picture_of_many_colours_has_an_ink() -> None:
    noise = np.random.default_rng(0).random((300, 300, 3)).astype(np.float32)
    assert 1 <= len(measure_hand(noise).inks) <= INKS


def test_a_mask_measures_only_its_part() -> None:
    picture = np.concatenate([strokes(6, 40, 0.0), strokes(6, 40, 0.5 * np.pi)], axis=1)
    mask = np.zeros(picture.shape[:2], bool)
    mask[:, :300] = True
    for inside, expected in ((mask, 0.0), (~mask, 0.5 * np.pi)):
        hand = measure_hand(picture, inside)
        assert abs((direction(hand) - expected + 0.5 * np.pi) % np.pi - 0.5 * np.pi) < 0.06
        assert ((hand.places[:, 0] * 600 < 299.5) == (expected == 0.0)).all()


def test_the_same_seed_gives_the_same_hand() -> None:
    picture = gallery_picture("oil", 200)
    one, two = (measure_hand(picture, seed=3) for _ in range(2))
    assert all(np.array_equal(getattr(one, name), getattr(two, name)) for name in vars(one))


def gradient() -> np.ndarray:
    return np.repeat(np.linspace(0.0, 1.0, 256)[None, :, None], 3, 2).repeat(128, 0)


PICTURES = {
    "flat": np.full((120, 90, 3), 0.4),
    "gradient": gradient(),
    "tiny": np.random.default_rng(0).random((16, 16, 3)),
    "panorama": np.random.default_rng(0).random((60, 480, 3)),
    "black and white": (np.random.default_rng(0).random((90, 120, 1)) > 0.5).repeat(3, 2).astype(float),
    "black": np.zeros((50, 50, 3)),
    "noise": np.random.default_rng(1).random((200, 200, 3)),
}


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_without_strokes_are_measured_all_the_same(name: str) -> None:
    hand = measure_hand(PICTURES[name])
    height, width = PICTURES[name].shape[:2]
    assert 1.0 <= hand.width <= 0.5 * min(height, width)
    assert 0.0 <= hand.coherence <= 1.0 and 0.0 <= hand.scatter <= 1.0 and hand.elongation >= 1.0
    numbers = [value for name, value in vars(hand).items() if name != "technique"]
    assert all(np.isfinite(np.asarray(value)).all() for value in numbers)
    assert hand.plain == (name in ("flat", "gradient", "black"))


def test_three_red_pixels_on_white_leave_a_usable_hand() -> None:
    picture = np.ones((64, 64, 3))
    picture[30:33, 30] = 1.0, 0.0, 0.0
    hand = measure_hand(picture)
    assert np.isfinite(hand.colours).all() and hand.palette[-1, 0] > 95.0


@pytest.mark.parametrize(
    ("picture", "mask", "told"),
    [
        (np.zeros((7, 40, 3)), None, "at least 8 x 8"),
        (np.zeros((40, 40)), None, "three channels"),
        (np.full((40, 40, 3), np.nan), None, "not finite"),
        (np.zeros((40, 40, 3)), np.zeros((40, 40), bool), "empty"),
        (np.zeros((40, 40, 3)), np.ones((40, 41), bool), "differ in size"),
    ],
)
def test_unusable_pictures_and_masks_are_refused(picture: np.ndarray, mask: np.ndarray | None, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        measure_hand(picture, mask)


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.0, 2.0, 3.0])
def test_the_structure_tensor_follows_stripes(angle: float) -> None:
    rows, columns = np.mgrid[:80, :80]
    stripes = np.sin((-np.sin(angle) * columns - np.cos(angle) * rows) * 0.8)
    tensor = structure_tensor(stripes, 1.0, 5.0)
    away = (tensor.angle[20:60, 20:60] - angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    assert np.abs(away).max() < 0.03
    assert tensor.coherence[20:60, 20:60].min() > 0.95


@pytest.mark.parametrize(
    ("name", "expected"),
    nightly(
        [
            *dict.fromkeys(("impasto", "watercolour", "oil", "pastel", "charcoal", "woodcut"), "strokes").items(),
            *dict.fromkeys(("mosaic", "screen-print", "cross-hatching", "stipple"), "pieces").items(),
        ],
        ("watercolour", "strokes"), ("woodcut", "strokes"), ("mosaic", "pieces"), ("cross-hatching", "pieces"),
    ),
)  # fmt: skip
def test_paintings_and_block_prints_are_painted_by_strokes_and_mosaics_by_pieces(name: str, expected: str) -> None:
    assert manner_of(measure_hand(gallery_picture(name)))[0] == expected


@pytest.mark.parametrize("name", nightly(["flat", "gradient", "black", "noise"], "gradient", "noise"))
def test_pictures_without_a_hand_are_painted_by_pieces(name: str) -> None:
    manner, reason = manner_of(measure_hand(PICTURES[name]))
    assert manner == "pieces" and reason


def test_a_picture_is_measured_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def measured(*picture: np.ndarray) -> Hand:
        seen.append(1)
        return measure_hand(*picture)

    monkeypatch.setattr(plan, "measure_hand", measured)
    monkeypatch.setattr(plan, "_hands", OrderedDict())
    monkeypatch.setattr(plan, "HANDS", 3)
    picture = np.random.default_rng(3).random((64, 48, 3), np.float32)
    mask = np.arange(64 * 48).reshape(64, 48) % 3 > 0
    first, again, other = (plan.hand_of(p, m) for p, m in ((picture, None), (picture.copy(), None), (picture, mask)))
    assert again is first and other is not first and len(seen) == 2
    for _ in range(plan.HANDS):
        picture = picture + np.float32(1e-3)
        plan.hand_of(picture.clip(0.0, 1.0), None)
    assert len(plan._hands) == plan.HANDS
