"""Regions unmixed along rays: laws of the solver, on rays through known regions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.train.palette.along_rays import Seen, agreement, divided, unmixed

SIDE = 10
"""Vertices along each side of the cube."""

COLOURS = np.array([[0.1, 0.3, 0.9], [0.2, 0.8, 0.3], [0.9, 0.2, 0.15]])


def shells(places: np.ndarray) -> np.ndarray:
    """Return which of three nested cubes vertices are in: the outermost 0."""
    depth = np.minimum(places, SIDE - 1 - places).min(axis=1)
    return np.asarray(np.digitize(depth, [1, 3]), np.int64)


def seen_from_all_sides(seed: int, noise: float = 0.0, rays: int = 1500) -> tuple[Seen, np.ndarray, np.ndarray]:
    """Straight rays through translucent nested cubes: what they see, the vertices' places and their regions."""
    generator = np.random.default_rng(seed)
    places = np.argwhere(np.ones((SIDE,) * 3, bool))
    region = shells(places)
    along = generator.normal(size=(rays, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    through = generator.uniform(0.0, SIDE - 1, (rays, 3))
    steps = np.arange(-2 * SIDE, 2 * SIDE)
    cell = np.rint(through[:, None] + along[:, None] * steps[None, :, None]).astype(np.int64)
    inside = ((cell >= 0) & (cell < SIDE)).all(axis=2)
    vertex = np.where(inside, (cell.clip(0, SIDE - 1) * [SIDE * SIDE, SIDE, 1]).sum(axis=2), 0)
    opacity = np.where(inside, np.array([0.12, 0.15, 0.3])[region[vertex]], 0.0)
    clear = np.cumprod(np.concatenate([np.ones((rays, 1)), 1.0 - opacity[:, :-1]], axis=1), axis=1)
    weight, ray = opacity * clear, np.broadcast_to(np.arange(rays)[:, None], inside.shape)
    pixel = (weight[:, :, None] * COLOURS[region[vertex]]).sum(axis=1)
    pixel += noise * generator.normal(size=(rays, 1)) * pixel  # of brightness, as of a normal that nobody knows
    kept = inside & (weight > 0)
    seen = Seen(len(places), vertex[kept], ray[kept], weight[kept], np.ones(kept.sum()), pixel)
    return seen, places, region


@settings(max_examples=3)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.15]))
def test_rays_from_all_sides_correct_what_a_shell_hides(seed: int, noise: float) -> None:
    """A quarter of the vertices behind the shell are said to be of the shell, as where colours are tinted."""
    seen, places, region = seen_from_all_sides(seed, noise)
    tinted = np.random.default_rng(seed + 1).random(len(region)) < 0.25
    wrong = np.where(tinted, np.maximum(region - 1, 0), region)
    found = unmixed(seen, wrong, 3, places)
    assert found.gain > 0.2
    assert (found.region != region).sum() < 0.3 * (wrong != region).sum()


@settings(max_examples=3)
@given(st.integers(0, 2**31))
def test_regions_that_are_right_stay(seed: int) -> None:
    seen, places, region = seen_from_all_sides(seed)
    found = unmixed(seen, region, 3, places)
    assert (found.region == region).all() and found.gain == 0.0


def test_a_time_limit_ends_the_tries() -> None:
    seen, places, region = seen_from_all_sides(0)
    wrong = np.where(np.random.default_rng(1).random(len(region)) < 0.25, np.maximum(region - 1, 0), region)
    assert unmixed(seen, wrong, 3, places).gain > 0.2
    assert unmixed(seen, wrong, 3, places, until=0.0).gain == 0.0


def test_one_region_and_black_pixels_are_left_alone() -> None:
    seen, places, region = seen_from_all_sides(0)
    assert unmixed(seen, np.zeros_like(region), 1, places).gain == 0.0
    black = Seen(seen.vertices, seen.vertex, seen.ray, seen.weight, seen.cosine, np.zeros_like(seen.pixel))
    found = unmixed(black, region, 3, places)
    assert (found.region == region).all() and found.gain == 0.0


def test_the_numbers_of_regions_do_not_matter() -> None:
    seen, places, region = seen_from_all_sides(1)
    wrong = np.where(np.random.default_rng(2).random(len(region)) < 0.2, np.maximum(region - 1, 0), region)
    order = np.array([2, 0, 1])
    one, other = unmixed(seen, wrong, 3, places), unmixed(seen, order[wrong], 3, places)
    assert (order[one.region] == other.region).mean() > 0.99


def test_agreement_is_intersection_over_union() -> None:
    sure = agreement(np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]]))
    assert sure == pytest.approx([1.5 / 2.0, 1.0 / 1.5])


def light_of(region: np.ndarray, colours: np.ndarray, tint: float) -> np.ndarray:
    """Light of vertices, some more than others, tinted by the first colour as behind a shell."""
    mixed = (1.0 - tint * (region > 0))[:, None] * colours[region] + tint * (region > 0)[:, None] * colours[0]
    return np.asarray(mixed * np.random.default_rng(0).uniform(0.5, 1.5, (len(region), 1)))


@settings(max_examples=3)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.3]))
def test_two_materials_that_were_one_region_are_divided(seed: int, tint: float) -> None:
    seen, _, region = seen_from_all_sides(seed)
    joined = np.minimum(region, 1)  # the second and the third are one
    found, done, left = divided(seen, joined, 2, light_of(region, COLOURS, tint), 8)
    assert [number for number, _ in done] == [1] and done[0][1] > 0.2 and not left
    assert (np.where(found == 0, 0, np.where(found == found[region == 1][0], 1, 2)) == region).mean() > 0.95


@settings(max_examples=3)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 0.3]), st.sampled_from([0.0, 0.15]))
def test_one_material_is_not_divided(seed: int, tint: float, noise: float) -> None:
    seen, _, region = seen_from_all_sides(seed, noise)
    found, done, left = divided(seen, region, 3, light_of(region, COLOURS, tint), 8)
    assert not done and not left
    np.testing.assert_array_equal(found, region)


def test_where_there_are_as_many_regions_as_there_can_be_the_half_is_named() -> None:
    seen, _, region = seen_from_all_sides(0)
    joined = np.minimum(region, 1)
    found, done, ((number, half),) = divided(seen, joined, 2, light_of(region, COLOURS, 0.0), 2)
    np.testing.assert_array_equal(found, joined)
    assert not done and number == 1 and len(set(region[half])) == 1
    assert divided(seen, joined, 2, light_of(region, COLOURS, 0.0), 8, until=0.0)[1] == [], "there is no time left"
