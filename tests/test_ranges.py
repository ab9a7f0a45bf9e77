"""Regions of a classified volume: the ranges of its transfer function, separated by value and by colour."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.volumes.classified import MOST_RANGES, ClassifiedVolume, ValueRange
from svv.dvr.draw.classify import classified
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from svv.fields.radiance.rendering import march
from svv.io.views.viewset import ViewSet
from svv.train.palette.doubts import joined_ranges
from svv.train.palette.ranges import Owners, region_overlaps, shares_of
from svv.train.pipeline import train_scene
from svv.train.run.batches import RayPool
from svv.train.run.config import PRESETS, Preset, ReconstructSettings
from svv_bench.stability.scenes import SCENES

BLUE, RED = (0.1, 0.3, 1.0), (1.0, 0.2, 0.1)
SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=150, rays=1024, cells=32),
    recolour=replace(PRESETS["draft"].recolour, iterations=150, rays=1024),
)  # fmt: skip


def ball(voxels: int = 25, scale: float = 1.0, offset: float = 0.0, dtype: type = np.float64) -> np.ndarray:
    """Values that fall from ``offset + scale`` in the middle to ``offset`` at a radius of one."""
    axis = np.linspace(-1, 1, voxels)
    radius = np.sqrt(sum(np.square(a) for a in np.meshgrid(axis, axis, axis, indexing="ij")))
    return (offset + scale * np.clip(1 - radius, 0, 1)).astype(dtype)


def volume_of(tf: TransferFunction, values: np.ndarray | None = None) -> ClassifiedVolume:
    values = ball() if values is None else values
    return classified(set_stage(from_array(values, (2 / (len(values) - 1),) * 3, (-1.0,) * 3), tf))


def bumps(*parts: tuple[float, float, float, tuple[float, float, float]]) -> TransferFunction:
    """(centre, width, opacity, colour) each."""
    names = ("centre", "width", "opacity", "colour")
    return TransferFunction.from_bumps([dict(zip(names, part, strict=True)) for part in parts], unit_distance=0.1)


def test_ranges_of_one_colour_are_two() -> None:
    """What the views alone can never tell."""
    found = volume_of(bumps((0.3, 0.2, 0.1, RED), (0.8, 0.3, 0.8, RED))).ranges
    assert [(r.low, r.high) for r in found] == [pytest.approx((0.2, 0.4)), pytest.approx((0.65, 0.95), abs=1e-3)]
    for r in found:
        assert r.colour == pytest.approx(RED)


@pytest.mark.parametrize(
    ("scale", "offset", "dtype"), [(1000.0, -200.0, np.int16), (1e-12, 0.0, np.float64), (3e9, 1e9, np.float32)]
)
def test_ranges_are_in_the_values_of_the_volume(scale: float, offset: float, dtype: type) -> None:
    """Whatever the type that the mappers take."""
    tf = bumps((0.3, 0.2, 0.1, BLUE), (0.8, 0.3, 0.8, RED)).mapped(scale, offset)
    found = volume_of(tf, ball(25, scale, offset, dtype)).ranges
    expected = [(0.2, 0.4), (0.65, 0.95)]
    for r, (low, high) in zip(found, expected, strict=True):
        assert (r.low - offset) / scale == pytest.approx(low, abs=3e-3)
        assert (r.high - offset) / scale == pytest.approx(high, abs=3e-3)


def test_one_range_of_many_colours_is_cut() -> None:
    """A cool-to-warm map over a ramp of opacity has a blue end and a red one."""
    tf = TransferFunction(
        ((0.0, 0.23, 0.3, 0.75), (0.5, 0.86, 0.86, 0.86), (1.0, 0.7, 0.02, 0.15)),
        ((0, 0, 0.5, 0), (1, 0.8, 0.5, 0)), 0.1,
    )  # fmt: skip
    found = volume_of(tf).ranges
    assert 2 <= len(found) <= 4
    assert found[0].colour[2] > found[0].colour[0] and found[-1].colour[0] > found[-1].colour[2]
    for before, after in pairwise(found):
        assert before.high <= after.low


def test_hardly_different_colours_stay_together() -> None:
    tf = TransferFunction(((0.0, 0.9, 0.2, 0.15), (1.0, 1.0, 0.3, 0.2)), ((0, 0, 0.5, 0), (1, 0.8, 0.5, 0)), 0.1)
    assert len(volume_of(tf).ranges) == 1


def test_too_many_ranges_are_joined_where_they_are_alike() -> None:
    """Ten bumps, of which three neighbours have one colour."""
    hues = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (0.5, 0.5, 0.5)]
    colours = [*hues[:4], (1, 0, 1), (1, 0, 1), (1, 0, 1), *hues[4:], (1, 1, 1)]
    found = volume_of(bumps(*((0.08 + 0.09 * i, 0.06, 0.5, c) for i, c in enumerate(colours)))).ranges
    assert len(found) == MOST_RANGES
    magenta = [r for r in found if r.colour == pytest.approx((1, 0, 1))]
    assert [(r.low, r.high) for r in magenta] == [pytest.approx((0.41, 0.65), abs=5e-3)]


def test_ranges_of_other_colours_that_had_to_be_joined_are_told() -> None:
    """Of ten colours, two and two became one region, and nobody was told."""
    hues = [
        (1, 0, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 1, 0),
        (1, 0, 1),
        (0, 1, 1),
        (1, 1, 1),
        (0, 0, 0),
        (1, 0, 0),
        (0, 1, 0),
    ]
    parts = [(0.08 + 0.09 * i, 0.06, 0.5, c) for i, c in enumerate(hues)]
    assert volume_of(bumps(*parts[:8])).mixed_ranges() == []
    volume = volume_of(bumps(*parts))
    mixed = volume.mixed_ranges()
    assert mixed and all(one.high - one.low > 0.1 for one in mixed) and len(mixed) <= 2
    said = joined_ranges(mixed, [[(one.low, one.high)] for one in volume.ranges])
    assert len(said) == len(mixed) and said[0].startswith(f"Region {volume.ranges.index(mixed[0])} shows the values")


@given(st.lists(st.floats(0.05, 0.95), min_size=1, max_size=12), st.integers(0, 2**31))
def test_every_function_has_ranges_in_order(centres: list[float], seed: int) -> None:
    draw = np.random.default_rng(seed)
    centres = [*centres, 0.5]  # something is visible
    parts = [(c, draw.uniform(0.01, 0.3), draw.uniform(0.01, 1.0), tuple(draw.random(3))) for c in centres]
    volume = volume_of(bumps(*parts), ball(8))
    assert 1 <= len(volume.ranges) <= MOST_RANGES
    assert volume.owner.max() < len(volume.ranges)
    for before, after in pairwise(volume.ranges):
        assert before.high <= after.low


def test_a_range_that_is_hardly_there_and_never_met_is_one() -> None:
    """Numbers that vanish beside those of the others."""
    colours = ((0.0, *BLUE), (0.2, *RED), (0.5, *RED), (1.0, *RED))
    opacities = ((0.0, 1e-300, 0.5, 0.0), (0.2, 1e-300, 0.5, 0.0), (0.3, 0.0, 0.5, 0.0), (0.6, 0.0, 0.5, 0.0),
                 (1.0, 1.0, 0.5, 0.0))  # fmt: skip
    values = np.where(ball() > 0.5, 1.0, 0.4)
    values[0, 0, 0] = 0.0
    found = volume_of(TransferFunction(colours, opacities, 0.1), values).ranges
    assert found[-1].colour == pytest.approx(RED)
    assert (found[-1].low, found[-1].high) == pytest.approx((0.6, 1.0), abs=1e-3)


def test_vertices_belong_to_the_range_of_their_values() -> None:
    volume = volume_of(bumps((0.3, 0.2, 0.3, BLUE), (0.8, 0.3, 0.8, RED)), ball(48))
    places = np.stack(np.meshgrid(*(np.arange(n) for n in volume.owner.shape), indexing="ij"), -1)
    at = np.asarray(volume.box.low) + places / volume.cells * volume.box.size
    values = 1 - np.linalg.norm(at, axis=-1)
    assert (volume.owner[(values > 0.23) & (values < 0.37)] == 0).all()
    assert (volume.owner[(values > 0.68) & (values < 0.92)] == 1).all()


def accuracy(views: ViewSet, preset: Preset) -> tuple[np.ndarray, list[float]]:
    """Intersection over union, weighted by what is seen, of trained regions with the volume's; and as it is told."""
    volume = views.classified
    assert volume is not None
    scene, _ = train_scene(views, preset)
    assert scene.palette_network is not None
    batch = RayPool(views, scene.occupancy.box, 3, scene.device).batch(1, 8192)
    samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
    order = [[r.low for r in volume.ranges].index(region.values[0]) for region in scene.regions]  # type: ignore[index]
    true = torch.as_tensor(np.argsort(order))[Owners(volume, np.arange(len(order)), scene.device).of(samples.position)]
    found = scene.palette_network.material(samples.position)[1].argmax(1)
    count, sigma = len(order), scene.base.extinction(samples)
    both = shares_of(samples, sigma, torch.where(true == found, true, count), count + 1)[:count]
    either = shares_of(samples, sigma, true, count) + shares_of(samples, sigma, found, count) - both
    return both / either, region_overlaps(scene, views, volume)


@pytest.mark.slow
@pytest.mark.parametrize("hue", [BLUE, RED], ids=["of its own hue", "of the core's hue"])
def test_trained_regions_are_the_ranges(hue: tuple[float, float, float]) -> None:
    """A translucent shell around a red core: each region is nine tenths its range at least."""
    tf = bumps((0.3, 0.4, 0.1, hue), (0.8, 0.5, 0.8, RED))
    views, _ = make_views(from_array(ball(32), (1.0,) * 3, (0.0,) * 3), tf, n=20, size=96, mapper="cpu")
    overlap, told = accuracy(views, SHORT)
    assert len(overlap) == 2
    assert overlap.min() > 0.9
    np.testing.assert_allclose(told, overlap, atol=0.02)  # of other rays


def test_a_short_training_tells_a_white_in_the_shade_from_a_grey() -> None:
    """They look alike, so colours pull a white region's weights towards the grey: the volume has the last word."""
    known = SCENES["greys"]
    views, _ = make_views(known.volume(32), known.transfer_function(), n=16, size=96, mapper="cpu", rescale=False)
    short = replace(SHORT, reconstruct=replace(SHORT.reconstruct, iterations=100, samples=4096))
    short = replace(short, recolour=replace(SHORT.recolour, iterations=60, samples=4096))
    assert accuracy(views, short)[0].min() > 0.85


@pytest.mark.slow
def test_a_range_that_is_not_seen_is_no_region() -> None:
    """A core inside of an opaque shell."""
    tf = bumps((0.4, 0.3, 1.0, BLUE), (0.85, 0.2, 0.8, RED))
    image = from_array(ball(32), (1.0,) * 3, (0.0,) * 3)
    views, _ = make_views(image, replace(tf, unit_distance=0.5), n=12, size=64, mapper="cpu")
    assert views.classified is not None and len(views.classified.ranges) == 2
    scene, report = train_scene(views, SHORT)
    assert len(scene.regions) == 1
    assert any("less than" in note for note in report["notes"])


@pytest.mark.parametrize(
    "numbers", [(1.0, 0.0, (0, 0, 0)), (0.0, np.nan, (0, 0, 0)), (0.0, 1.0, (0, 0, 2)), (0.0, 1.0, (0, 0))]
)
def test_a_range_that_cannot_be_is_refused(numbers: tuple[float, float, tuple[float, float, float]]) -> None:
    with pytest.raises(BadInput):
        ValueRange(*numbers)
