"""Regions unmixed along rays: laws of the solver, on rays through known regions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import get_num_threads, set_num_threads

from svv.kernels.numba import along_rays as loops
from svv.kernels.reference_regions import to_memberships
from svv.train.palette import along_rays
from svv.train.palette.along_rays import Seen, Solver, agreement, divided, joined, unmixed

SIDE = 10
"""Vertices along each side of the cube."""

COLOURS = np.array([[0.1, 0.3, 0.9], [0.2, 0.8, 0.3], [0.9, 0.2, 0.15]])


def shells(places: np.ndarray) -> np.ndarray:
    """Return which of three nested cubes vertices are in: the outermost 0."""
    depth = np.minimum(places, SIDE - 1 - places).min(axis=1)
    return np.asarray(np.digitize(depth, [1, 3]), np.int64)


def seen_from_all_sides(seed: int, noise: float = 0.0, rays: int = 1500) -> tuple[Seen, torch.Tensor, np.ndarray]:
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
    own, which, light = (torch.from_numpy(values[kept]) for values in (vertex, ray, weight))
    seen = Seen(len(places), own, which, light.float(), torch.ones(len(own)), torch.from_numpy(pixel).float())
    return seen, torch.from_numpy(places), region


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
    black = replace(seen, pixel=torch.zeros_like(seen.pixel))
    found = unmixed(black, region, 3, places)
    assert (found.region == region).all() and found.gain == 0.0
    assert divided(black, region, 3, light_of(region, COLOURS, 0.0), 8)[1] == []


def test_the_numbers_of_regions_do_not_matter() -> None:
    seen, places, region = seen_from_all_sides(1)
    wrong = np.where(np.random.default_rng(2).random(len(region)) < 0.2, np.maximum(region - 1, 0), region)
    order = np.array([2, 0, 1])
    one, other = unmixed(seen, wrong, 3, places), unmixed(seen, order[wrong], 3, places)
    assert (order[one.region] == other.region).mean() > 0.99


def test_agreement_is_intersection_over_union() -> None:
    light = np.array([[6.0, 2.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 4.0]])
    for alike in (np.eye(3, dtype=bool), np.zeros((3, 3), bool)):
        assert agreement(light, alike) == pytest.approx([6.0 / 9.0, 3.0 / 6.0, 1.0])


def test_what_cannot_be_told_apart_does_not_disagree() -> None:
    alike = np.array([[True, True, False], [True, True, False], [False, False, True]])
    assert agreement(np.array([[6.0, 2.0, 2.0], [1.0, 3.0, 0.0], [0.0, 0.0, 4.0]]), alike) == pytest.approx(
        [8.0 / 10.0, 1.0, 4.0 / 6.0]
    )


@settings(max_examples=5)
@given(st.integers(0, 2**31), st.integers(0, 60))
def test_samples_of_one_vertex_are_joined(seed: int, samples: int) -> None:
    """Nothing is lost of the light of any ray at any vertex, and neighbours in the list differ."""
    generator = np.random.default_rng(seed)
    ray, vertex = np.sort(generator.integers(0, 5, samples)), generator.integers(0, 3, samples)
    weight, colour = (generator.uniform(0.1, 1.0, n).astype(np.float32) for n in (samples, (samples, 3)))

    def light(ray: np.ndarray, vertex: np.ndarray, weight: np.ndarray, colour: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(3 * ray + vertex, weight * c, 15) for c in (*colour.T, 1.0)])

    joint = tuple(found.numpy() for found in joined(*(torch.from_numpy(own) for own in (ray, vertex, weight, colour))))
    np.testing.assert_allclose(light(*joint), light(ray, vertex, weight, colour), rtol=1e-5)
    assert len(joint[0]) <= samples and not ((np.diff(joint[0]) == 0) & (np.diff(joint[1]) == 0)).any()


# --- the solver --------------------------------------------------------------------------------------------------


def simplex_by_sorting(values: np.ndarray) -> np.ndarray:
    """The nearest memberships, >= 0 with sum 1, as Duchi et al. (2008) find them. (V, P) -> (V, P)"""
    over = -np.cumsum(np.sort(-values, axis=1), axis=1) - 1.0
    shift = (over / np.arange(1, values.shape[1] + 1)).max(axis=1, keepdims=True)
    return np.maximum(values - shift, 0.0)


class Plain:
    """The solver's problem in dense matrices and double precision."""

    def __init__(self, seen: Seen, places: torch.Tensor, smoothness: float) -> None:
        """Write down what rays see of vertices, and how much their neighbours must agree."""
        self.seen, self.smoothness, shape = seen, smoothness, (len(seen.pixel), seen.vertices)
        self.plain, self.lit = np.zeros(shape), np.zeros(shape)
        at, weight = (seen.ray.numpy(), seen.vertex.numpy()), seen.weight.numpy()
        np.add.at(self.plain, at, weight)
        np.add.at(self.lit, at, weight * seen.cosine.numpy())
        light = self.plain.sum(axis=0)
        near = ((places[:, None] - places[None]).abs().sum(dim=2) == 1).numpy()
        self.near = near * (np.sqrt(np.outer(light, light)) + 1e-3 * light.mean())
        self.pixel = seen.pixel.double().numpy()
        length = np.linalg.norm(self.pixel, axis=1, keepdims=True)
        self.along = self.pixel / np.maximum(length, 1e-6)

    def errors(self, member: np.ndarray, light: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """What is shown less the pixels, in full, and with a tenth of it along the pixels' colours."""
        error = self.plain @ member @ light[0] + self.lit @ member @ light[1] - self.pixel
        inside = (error * self.along).sum(axis=1, keepdims=True)
        return error, error - (1.0 - along_rays.ALONG) * inside * self.along

    def objective(self, member: np.ndarray) -> float:
        """Half the squared error, by the metric whose slope is what the solver descends, and of neighbours."""
        error, less = self.errors(member, self.light(member))
        apart = np.square(member[:, None] - member[None]).sum(axis=2)
        return float(0.5 * (error * less).sum() + 0.25 * self.smoothness * (self.near * apart).sum())

    def light(self, member: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What regions reflect if each vertex is of the region in which it is most."""
        return self.seen.light(torch.from_numpy(member.argmax(axis=1)), member.shape[1])

    def solve(self, member: np.ndarray) -> np.ndarray:
        """Accelerated projected gradients, as the solver's kernels take them."""
        bound, degree = self.plain.T @ self.plain.sum(axis=1), self.near.sum(axis=1)
        for _ in range(along_rays.TURNS):
            light = self.light(member)
            full = light[0] + light[1]
            curvature = np.linalg.eigvalsh(full @ full.T).max() * bound
            step = 1.0 / (curvature + 2.0 * self.smoothness * degree + 1e-9)
            ahead, pace = member, 1.0
            for _ in range(along_rays.STEPS):
                error = self.errors(ahead, light)[1]
                slope = self.plain.T @ error @ light[0].T + self.lit.T @ error @ light[1].T
                slope += self.smoothness * (degree[:, None] * ahead - self.near @ ahead)
                found = simplex_by_sorting(ahead - step[:, None] * slope)
                following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pace * pace))
                ahead, member = found + (pace - 1.0) / following * (found - member), found
                pace = following
        return member


def lit_and_wrong(seed: int, count: int) -> tuple[Seen, torch.Tensor, torch.Tensor]:
    """What rays see of nested cubes under a headlight, the vertices' places, and regions that are partly wrong."""
    seen, places, region = seen_from_all_sides(seed, 0.1, rays=300)
    generator = np.random.default_rng(seed)
    seen = replace(seen, cosine=torch.from_numpy(generator.uniform(0.0, 1.0, len(seen.cosine))).float())
    wrong = np.where(generator.random(len(region)) < 0.3, generator.integers(0, count, len(region)), region)
    return seen, places, torch.from_numpy(wrong)


@settings(max_examples=4)
@given(st.integers(0, 2**31), st.integers(3, 8), st.sampled_from(along_rays.SMOOTHNESS))
def test_memberships_are_those_of_a_plain_solver(seed: int, count: int, smoothness: float) -> None:
    seen, places, region = lit_and_wrong(seed, count)
    found, plain = Solver(seen, places).solve(region, count, smoothness).numpy(), Plain(seen, places, smoothness)
    begun = np.eye(count)[region.numpy()]
    np.testing.assert_allclose(found, plain.solve(begun), atol=2e-3)
    assert (found >= 0.0).all() and found.shape == begun.shape
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-5)
    assert plain.objective(found.astype(np.float64)) < 0.5 * plain.objective(begun)


def test_memberships_do_not_depend_on_the_number_of_threads() -> None:
    seen, places, region = lit_and_wrong(0, 3)
    before = get_num_threads()
    results = []
    for threads in (1, before, 1):
        set_num_threads(threads)
        light = seen.light(region, 3)
        results.append((Solver(seen, places).solve(region, 3, 0.02), *light, seen.error_across(region, light)))
    set_num_threads(before)
    for other in results[1:]:
        for one, same in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(one, same)


@given(st.integers(0, 2**31), st.integers(1, 9), st.sampled_from([1e-6, 0.3, 1.0, 100.0]))
def test_nearest_memberships_are_those_found_by_sorting(seed: int, count: int, spread: float) -> None:
    values = (spread * np.random.default_rng(seed).normal(size=(20, count))).astype(np.float32)
    shift = [loops.excess(values, np.uint32(i), np.uint32(count)) for i in range(len(values))]
    expected = simplex_by_sorting(values.astype(np.float64))
    for found in (np.maximum(values - np.array(shift)[:, None], 0.0), to_memberships(torch.from_numpy(values))):
        np.testing.assert_allclose(found, expected, atol=1e-6 * (1.0 + 10.0 * spread))


def test_light_of_regions_is_that_of_least_squares() -> None:
    """Of a dense design without noise, the solution of the normal equations is what made the pixels."""
    seen, _, region = lit_and_wrong(1, 3)
    ambient, diffuse = COLOURS, COLOURS[::-1] * 0.5
    own = region[seen.vertex].numpy()
    colour = ambient[own] + diffuse[own] * seen.cosine.numpy()[:, None]
    ray, weight = seen.ray.numpy(), seen.weight.numpy()
    pixel = np.stack([np.bincount(ray, weight * c, len(seen.pixel)) for c in colour.T], axis=1)
    made = replace(seen, pixel=torch.from_numpy(pixel).float())
    found = made.light(region, 3)
    np.testing.assert_allclose(found, (ambient, diffuse), atol=1e-3)
    assert made.error_across(region, found) < 1e-4
    np.testing.assert_allclose(made.errors(region, (0.0 * ambient, 0.0 * diffuse), 1.0), -pixel, atol=1e-6)


# --- regions of two hues -----------------------------------------------------------------------------------------


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
