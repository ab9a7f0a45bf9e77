"""Regions of views alone: from points of one hue or brightness, and their colours in full light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from svv.cli.pointing import parse_pointed
from svv.core.colour.shading import Shading
from svv.core.geometry.box import Box
from svv.core.geometry.surfaces import blurred, surface_normals
from svv.core.two_groups import gap_of, weighted_quantile
from svv.dvr.draw.views import make_views
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.palette import regions_from_views
from svv.train.palette.along_rays import Seen
from svv.train.palette.confidence import Evidence, errors_where_alone, light_in_front, likely_overlap
from svv.train.palette.doubts import Question, doubts, hues_within
from svv.train.palette.ranges import KnownRegions, Owners
from svv.train.palette.recolour import palette_of
from svv.train.palette.regions_from_views import Labels, _Points, owners_of, regions_in
from svv.train.pipeline import train_scene
from svv.train.run.batches import Batch, RayPool
from svv.train.run.config import PRESETS, Preset, ReconstructSettings
from svv_bench.stability.measures import palette_error
from svv_bench.stability.scenes import SCENES
from tests.nightly import nightly

SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=200, rays=2048),
    recolour=replace(PRESETS["draft"].recolour, iterations=1, rays=64),
)  # fmt: skip


# --- normals -----------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**31))
def test_the_normal_of_a_thin_shell_is_across_it(seed: int) -> None:
    """In the middle of the shell the gradient vanishes."""
    direction = np.random.default_rng(seed).normal(size=3)
    direction /= np.linalg.norm(direction)
    place = np.stack(np.meshgrid(*[np.arange(-7.0, 8.0)] * 3, indexing="ij"), axis=-1)
    shell = np.exp(-0.5 * (place @ direction) ** 2)
    (normal,) = surface_normals(shell, np.array([[7, 7, 7]]), 1.0, 1.0)
    assert abs(normal @ direction) > 0.995


def test_where_nothing_changes_there_is_no_normal() -> None:
    np.testing.assert_array_equal(surface_normals(np.ones((5, 5, 5)), np.array([[2, 2, 2]]), 1.0, 1.0), 0.0)


@settings(max_examples=8)
@given(
    st.integers(0, 2**31), st.tuples(*[st.integers(1, 14)] * 3), st.floats(0.4, 1.5), st.booleans(),
    st.sampled_from([None, 0, 1, 2]),
)  # fmt: skip
def test_blurred_grids_are_those_of_scipy(
    seed: int, shape: tuple[int, int, int], deviation: float, beyond: bool, along: int | None
) -> None:
    values = np.random.default_rng(seed).random(shape).astype(np.float32)
    order = [int(axis == along) for axis in range(3)]
    expected = gaussian_filter(values.astype(np.float64), deviation, order, mode="nearest" if beyond else "constant")
    found = blurred(values, deviation, along, beyond)
    np.testing.assert_allclose(found, expected, atol=2e-6)


# --- groups of values --------------------------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.sampled_from([-3.0, 0.0, 1e-9, 0.5, 7.0]), st.floats(0.0, 2.0)), min_size=1, max_size=40),
    st.floats(0.0, 1.0), st.integers(0, 2**31),
)  # fmt: skip
def test_a_weighted_quantile_is_that_of_sorted_values(pairs: list[tuple[float, float]], part: float, seed: int) -> None:
    """Nearly so many weights lie up to it, and no fewer values would do."""
    values, weights = (np.array(column) for column in zip(*pairs, strict=True))
    values = values + np.random.default_rng(seed).choice([0.0, 1e-3], len(values))
    found, goal = weighted_quantile(values, weights, part), part * weights.sum()
    assert found in values
    assert weights[values <= found].sum() >= goal - 1e-9
    assert weights[values < found].sum() <= goal + 1e-9


@example(4678, 0.15625, 2.0, 0.0, 1.0)
@given(st.integers(0, 2**31), st.floats(0.1, 0.9), st.floats(2.0, 4.0), st.floats(-100.0, 100.0), st.floats(0.01, 10.0))
def test_two_groups_far_apart_have_a_gap_between_them(
    seed: int, share: float, apart: float, shift: float, least: float
) -> None:
    generator = np.random.default_rng(seed)
    upper = generator.random(4000) < share
    values = shift + least * (apart * upper + 0.15 * generator.normal(size=4000))
    gap = gap_of(values, np.ones(4000), least)
    assert gap is not None
    assert ((values > gap) == upper).mean() > 0.99


@given(st.integers(0, 2**31), st.floats(0.05, 3.0), st.sampled_from(["normal", "even", "one value"]))
def test_one_group_has_none(seed: int, width: float, kind: str) -> None:
    generator = np.random.default_rng(seed)
    values = {"normal": generator.normal(size=8000), "even": generator.random(8000), "one value": np.zeros(8000)}[kind]
    assert gap_of(width * values, np.ones(8000), 1.0) is None


def test_a_few_strays_are_no_group() -> None:
    generator = np.random.default_rng(0)
    values = np.concatenate([0.1 * generator.normal(size=1000), 3.0 + 0.1 * generator.normal(size=1000)])
    weights = np.repeat([1.0, 0.01], 1000)
    assert gap_of(values, weights, 1.0) is None
    assert gap_of(values, np.ones(2000), 1.0) is not None
    assert gap_of(np.empty(0), np.empty(0), 1.0) is None


# --- labels ------------------------------------------------------------------------------------------------------


def test_a_point_has_the_region_of_the_nearest_vertex() -> None:
    lattice = SparseLattice(np.ones((4, 3, 2), np.uint8), 4, (4,), 1).requires_grad_(False)
    vertices = lattice.vertices_of_level(0, np.ones((4, 3, 2), np.uint8), 4)
    region = (vertices[:, 0] + 2 * vertices[:, 1] + vertices[:, 2]) % 3
    labels = Labels(lattice, region, torch.device("cpu"))
    generator = np.random.default_rng(0)
    vertex = vertices[generator.integers(0, len(vertices), 200)]
    near = (vertex + generator.uniform(-0.49, 0.49, vertex.shape)).clip(0, (4, 3, 2)) / 4
    expected = (vertex[:, 0] + 2 * vertex[:, 1] + vertex[:, 2]) % 3
    position = torch.from_numpy(near.astype(np.float32))
    np.testing.assert_array_equal(labels.of(position).numpy(), expected)
    weights = torch.softmax(torch.from_numpy(generator.normal(size=(200, 3)).astype(np.float32)), dim=1)
    owner, own = labels.assign(weights, position)
    np.testing.assert_array_equal(owner.numpy(), expected)
    torch.testing.assert_close(own, weights[torch.arange(200), torch.from_numpy(expected)])


# --- confidence --------------------------------------------------------------------------------------------------


def test_a_region_of_low_confidence_is_named_with_what_to_do() -> None:
    colours = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    (said,) = doubts(colours, (0.9, 0.31))
    assert said.startswith("Region 1 (#0000ff) may be wrong") and "31%" in said and "svv palette" in said
    assert doubts(colours, (0.7, 1.0)) == [] and doubts(colours, ()) == []


def test_what_would_settle_a_doubtful_region_is_asked_for() -> None:
    colours = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0]])
    asked = (Question(1, 2, (0.25, -1.0, 3.0)),)
    (said,) = doubts(colours, (0.9, 0.31, 0.8), asked)
    assert "confused with region 2 (#ffff00)" in said and "svv palette --point 0.25,-1,3=1, or =2" in said
    assert parse_pointed("0.25,-1,3=2") == ((0.25, -1.0, 3.0), 2)


def told(colours: np.ndarray, hues: np.ndarray, region: np.ndarray) -> tuple[np.ndarray, list[Question]]:
    """How far rays agree with regions (V,) of vertices in a row, each of which one shows in one of the colours."""
    points = object.__new__(_Points)
    places = np.stack([np.arange(len(region)), np.zeros_like(region), np.zeros_like(region)], axis=1)
    points.vertex, points.weight = torch.arange(len(region)), torch.ones(len(region))
    points.colour = torch.from_numpy(colours[hues].astype(np.float32))
    points._device, points._places, points._cells = torch.device("cpu"), places, 8
    points._box = Box((-1.0, 0.0, 0.0), 2.0, (1.0, 1.0, 1.0))
    points._blurred = lambda values: values  # type: ignore[method-assign]
    found = points.agreed(region.astype(np.int64), colours)
    return found.agreement, points.questions(region.astype(np.int64), found, found.agreement)


def test_regions_of_near_hues_are_as_certain_as_rays_tell_them() -> None:
    """Hues 0.2 rad apart: noise confuses them, so what is told the other way counts."""
    colours = np.array([[1.0, 0.0, 0.0], [np.cos(0.2), np.sin(0.2), 0.0], [0.0, 0.0, 1.0]])
    region = np.array([0] * 6 + [1] * 6 + [2] * 4)
    hues = region.copy()
    hues[3:6] = 1
    sure, (first, second) = told(colours, hues, region)
    np.testing.assert_allclose(sure, [3 / 6, 6 / 9, 1.0])
    assert (first.region, first.other, second.region, second.other) == (0, 1, 1, 0)
    assert first.place == second.place and 3 <= (first.place[0] + 1.0) / 2.0 * 8 < 6


def test_regions_that_only_brightness_tells_apart_are_not_doubted_for_their_hue() -> None:
    colours = np.array([[0.9, 0.9, 0.9], [0.4, 0.4, 0.4]])
    sure, asked = told(colours, np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1]))
    np.testing.assert_allclose(sure, 1.0)
    assert asked == []


def fake_points(colour: np.ndarray, region: np.ndarray) -> _Points:
    """Vertices in a row, each of which one ray shows, opaque, in a colour (V, 3)."""
    points, count = object.__new__(_Points), len(region)
    points.vertex = points.ray = torch.arange(count)
    points.weight = points.cosine = torch.ones(count)
    points.colour = points.pixel = torch.from_numpy(colour.astype(np.float32))
    points._places = np.stack([np.arange(count), np.zeros(count, int), np.zeros(count, int)], axis=1)
    points._device, points._cells, points._box = torch.device("cpu"), 8, Box((0.0,) * 3, 1.0, (1.0,) * 3)
    points._blurred = lambda values: values  # type: ignore[method-assign]
    points._seen = Seen(count, points.vertex, points.ray, points.weight, points.cosine, points.pixel)
    return points


def test_a_region_that_is_tinted_all_over_is_known_by_what_it_looks_like() -> None:
    """Its points, behind a red shell, look orange, which is nearer to red than to its own yellow."""
    colours = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    region = np.repeat([0, 1], 8)
    sure, asked = fake_points(np.array([[1.0, 0.0, 0.0], [1.0, 0.35, 0.0]])[region], region).confidence(region, colours)
    assert sure.min() > 0.9 and asked == []


def test_regions_of_one_hue_whose_brightness_differs_little_are_doubted() -> None:
    region, noise = np.repeat([0, 1], 200), np.random.default_rng(0).normal(1.0, 0.2, 400)
    for dark, least, most in ((0.9, 0.0, 0.6), (0.3, 0.9, 1.0)):
        bright = np.array([1.0, dark])
        looks = (bright[region] * noise)[:, None] * np.ones(3)
        sure, _ = fake_points(looks, region).confidence(region, bright[:, None] * np.ones(3))
        assert least <= sure.min() <= sure.max() <= most


@given(
    st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4), st.floats(0.0, 1.0), st.integers(0, 3)
)  # fmt: skip
def test_confidence_is_monotone_in_what_is_known(one: list[float], more: float, which: int) -> None:
    other = [value + more * (k == which) for k, value in enumerate(one)]
    before, after = likely_overlap(Evidence(*np.array([one, other]).T))
    assert 0.0 < before < 1.0 and 0.0 < after < 1.0
    assert after >= before if which in (0, 2) else after <= before


def test_light_in_front_and_errors_are_those_of_each_ray() -> None:
    rng, rays, each, count = np.random.default_rng(3), 40, 5, 3
    ray, vertex = np.repeat(np.arange(rays), each), rng.integers(0, 12, rays * each)
    weight, cosine = rng.uniform(0.02, 0.2, rays * each), rng.random(rays * each)
    pixel, region = rng.random((rays, 3)), np.arange(12) % count
    whole = (torch.from_numpy(v) for v in (vertex, ray))
    parts = (torch.from_numpy(v.astype(np.float32)) for v in (weight, cosine, pixel))
    seen, own = Seen(12, *whole, *parts), region[vertex]
    light, total, error, bright = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    there = torch.from_numpy(region)
    wrong = seen.errors(there, seen.light(there, count), 0.0).norm(dim=1).numpy()
    for number in range(rays):
        mine = np.flatnonzero(ray == number)
        for place, sample in enumerate(mine):
            ahead = mine[:place]
            light[own[sample]] += weight[sample] * weight[ahead][own[ahead] != own[sample]].sum()
            total[own[sample]] += weight[sample]
        part = np.bincount(own[mine], weight[mine], count)
        error += wrong[number] * part**2 / part.sum()
        bright += np.linalg.norm(pixel[number]) * part
    np.testing.assert_allclose(light_in_front(seen, torch.from_numpy(own), count), light / total, rtol=1e-5)
    np.testing.assert_allclose(errors_where_alone(seen, there, count), error / bright, rtol=1e-5)


def test_a_region_of_two_hues_is_named_with_the_command_that_splits_it() -> None:
    (said,) = hues_within([(2, np.array([3.0, 1.5, 0.0]))])
    assert said.startswith("Region 2 holds more than one hue") and "svv palette --add '#ff8000'" in said


# --- scenes ------------------------------------------------------------------------------------------------------


def drawn(name: str, shading: Shading | None = None, size: int = 128, chosen: Preset = SHORT) -> tuple[Scene, ViewSet]:
    known = SCENES[name]
    volume = known.volume(48)
    train, _ = make_views(
        volume, known.transfer_function(), n=32, size=size, mapper="cpu", rescale=False, shading=shading
    )
    scene, _ = train_scene(replace(train, classified=None), chosen)
    return scene, train


def overlap(scene: Scene, views: ViewSet, found: KnownRegions | Labels) -> np.ndarray:
    """Intersection over union of each true range with the region that matches it best, over visible samples."""
    labels = found.owners if isinstance(found, KnownRegions) else found
    assert views.classified is not None
    pool = RayPool(views, scene.occupancy.box, 1, scene.device)
    samples = march(pool.batch(0, 4096).rays, scene.occupancy, scene.base.density, scene.marching)
    ours, theirs = scene.occupancy.box, views.classified.box
    shift = torch.tensor((np.asarray(ours.low) - np.asarray(theirs.low)) / theirs.size, dtype=torch.float32)
    owners = Owners(views.classified, np.arange(len(views.classified.ranges)), scene.device)
    truth = owners.of(samples.position * (ours.size / theirs.size) + shift).numpy()
    region = labels.of(samples.position).numpy()
    both = np.zeros((truth.max() + 1, region.max() + 1))
    np.add.at(both, (truth, region), composite(samples, samples.sigma, torch.zeros(len(samples), 1))[2].numpy())
    return np.asarray((both / (both.sum(0) + both.sum(1, keepdims=True) - both)).max(axis=1))


@pytest.mark.parametrize(
    "name", ["greys", *(pytest.param(n, marks=pytest.mark.slow) for n in ("nested", "regions-similar"))]
)
def test_ranges_that_pixels_confuse_are_regions_with_their_colours(name: str) -> None:
    """Shells in each other, grey beside white, and hues that are too close for a palette of pixels."""
    # With half of the steps, seeds differ by more than 1 in the colour of the grey.
    scene, train = drawn(name, chosen=replace(SHORT, reconstruct=replace(SHORT.reconstruct, iterations=400)))
    palette = palette_of(train, scene.occupancy, 0)
    found = regions_in(scene, train, palette, 0)
    truth = np.array([r.colour for r in SCENES[name].ranges])
    assert len(found.palette.colours) == len(truth)
    assert overlap(scene, train, found).min() > 0.7
    assert palette_error(found.palette.colours, truth) < 5.0
    assert palette_error(palette.colours, truth) > palette_error(found.palette.colours, truth)
    assert found.palette.share.sum() == pytest.approx(1.0)
    assert (np.diff(found.palette.share) <= 0).all()
    assert len(found.confidence) == len(truth) and 0.5 < min(found.confidence) <= max(found.confidence) <= 1.0


AMBIENT = Shading(ambient=0.3, diffuse=0.6)


@pytest.mark.parametrize(
    ("name", "shading", "most"),
    nightly(
        [("noise", None, 4.0), ("wires", None, 4.0), ("noise", AMBIENT, 4.0), ("wires", AMBIENT, 6.0)],
        ("wires", AMBIENT, 6.0),
    ),
)
def test_colours_are_right_where_normals_are_not(name: str, shading: Shading | None, most: float) -> None:
    """Noise turns gradients anywhere, and a wire is thinner than its normals, so hardly a point is seen in full light.

    Wires come out a little too bright, because more of a wire faces the camera than of normals at random. Views that do
    not say how they were shaded give colours that are at most darker.
    """
    scene, train = drawn(name, shading)
    palette = palette_of(train, scene.occupancy, 0)
    truth = np.array([r.colour for r in SCENES[name].ranges])
    light = 1.0 if shading is None else shading.ambient + shading.diffuse
    found = regions_in(scene, train, palette, 0).palette.colours
    assert palette_error(found, truth * light) < most
    other = regions_in(scene, replace(train, meta=replace(train.meta, shading=None)), palette, 0).palette.colours
    assert other.max() <= found.max() + 0.01


@pytest.mark.parametrize(
    "shading",
    [
        pytest.param(Shading(on=False), marks=pytest.mark.slow),
        Shading(ambient=0.3, diffuse=0.6, specular=0.3, specular_power=20.0),
    ],
    ids=["unlit", "shiny"],
)  # fmt: skip
def test_one_material_is_one_region_however_it_is_lit(shading: Shading) -> None:
    scene, train = drawn("easy", shading)
    found = regions_in(scene, train, palette_of(train, scene.occupancy, 0), 0)
    assert len(found.palette.colours) == 2
    assert overlap(scene, train, found).min() > 0.9


@pytest.mark.slow
def test_a_black_scene_is_one_black_region() -> None:
    _, train = drawn("one-region", size=64)
    images = train.images.copy()
    images[..., :3] = 0
    black = replace(train, images=images)
    scene, _ = train_scene(replace(black, classified=None), SHORT)
    found = regions_in(scene, black, palette_of(black, scene.occupancy, 0), 0)
    np.testing.assert_allclose(found.palette.colours, np.zeros((1, 3)), atol=0.02)


@pytest.mark.slow
def test_a_palette_given_by_hand_tells_brightnesses_of_one_hue_apart() -> None:
    scene, train = drawn("greys")
    truth = np.array([r.colour for r in SCENES["greys"].ranges])
    assert overlap(scene, train, owners_of(scene, train, truth, 0)).min() > 0.9


@pytest.mark.slow
def test_the_same_seed_finds_the_same_regions() -> None:
    scene, train = drawn("easy", size=64)
    palette = palette_of(train, scene.occupancy, 0)
    one, other = (regions_in(scene, train, palette, 3) for _ in range(2))
    np.testing.assert_array_equal(one.palette.colours, other.palette.colours)
    generator = np.random.default_rng(0)
    cells = np.argwhere(scene.occupancy.occupied)[generator.integers(0, scene.occupancy.occupied.sum(), 200)]
    points = torch.from_numpy(((cells + generator.random(cells.shape)) / scene.occupancy.cells).astype(np.float32))
    points = torch.minimum(points, torch.tensor(scene.occupancy.box.extent, dtype=torch.float32))
    torch.testing.assert_close(one.owners.of(points), other.owners.of(points))


@pytest.mark.slow
def test_a_time_limit_ends_the_search_for_regions(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, train = drawn("easy", size=64)
    palette, batches, real = palette_of(train, scene.occupancy, 0), [], RayPool.batch

    def counted(pool: RayPool, *given: int) -> Batch:
        batches.append(given)
        return real(pool, *given)

    monkeypatch.setattr(RayPool, "batch", counted)
    found = regions_in(scene, train, palette, 0, seconds=0.0)
    assert len(batches) == 1 and len(found.palette.colours) == len(SCENES["easy"].ranges)
    regions_in(scene, train, palette, 0)
    assert len(batches) == 1 + regions_from_views.RAYS // regions_from_views.AT_A_TIME
