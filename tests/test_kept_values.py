"""Values that a scene keeps of its volume: read off as the volume's own interpolation has them, within what is told."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from svv.core.geometry.box import Box
from svv.core.volumes.classified import LARGEST, ClassifiedVolume, ValueGrid, cells_with, grid_shape
from svv.dvr.draw.classify import classified
from svv.dvr.draw.frame import set_stage
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.grids import from_array
from svv.fields.radiance.kept_values import KeptValues, read_at, vertices_at
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.time_steps import TimeSteps
from tests.test_ranges import BLUE, RED, ball, bumps

SPACING, ORIGIN = (0.5, 0.25, 0.75), (10.0, -3.0, 2.0)


def stored(values: np.ndarray, tf: TransferFunction, nearest: bool = False) -> ClassifiedVolume:
    """A volume (Z, Y, X), as views of it come with it."""
    image = from_array(values, SPACING, ORIGIN)
    put(image, Appearance(nearest=nearest))
    return classified(set_stage(image, tf))


def shown(volume: ClassifiedVolume, cells: int = 32, least: float = -2.0) -> Occupancy:
    """The cells in which such a volume shows something."""
    shape = grid_shape(volume.box, cells)
    return Occupancy(volume.box, cells, cells_with(volume.exponent > least, volume.cells, shape, cells))


def kept_of(volume: ClassifiedVolume, whole: bool = False) -> KeptValues:
    assert volume.values is not None
    return KeptValues.of(volume.values, volume.box, shown(volume), whole)


def own_values(values: np.ndarray, points: np.ndarray, order: int = 1) -> np.ndarray:
    """The volume's own values at points in the world (N, 3)."""
    index = (points - ORIGIN) / SPACING
    return np.asarray(map_coordinates(values.astype(np.float64), index[:, ::-1].T, order=order, mode="nearest"))


def seen_points(volume: ClassifiedVolume, count: int = 4000) -> np.ndarray:
    """Points in the world in occupied cells. (N, 3)"""
    there = shown(volume)
    chance = np.random.default_rng(0)
    cells = np.argwhere(there.occupied)
    place = (cells[chance.integers(len(cells), size=count)] + chance.random((count, 3))) / there.cells
    low, high = volume.box.bounds
    points = volume.box.to_world(place)
    return np.asarray(points[((points > low) & (points < high)).all(axis=1)])


def test_a_linear_volume_is_read_off_to_half_a_step() -> None:
    z, y, x = np.indices((20, 31, 24))
    values = 3.0 * x - 2.0 * y + 1.5 * z + 100.0
    volume = stored(values, bumps((110.0, 80.0, 0.3, RED)))
    kept, points = kept_of(volume), seen_points(volume)
    found = read_at(kept, points)
    off, sure = np.abs(found.value - own_values(values, points)), found.uncertainty < 2.0 * kept.step
    assert sure.mean() > 0.8 and off[sure].max() <= 0.5 * kept.step * 1.001
    assert (off <= found.uncertainty).mean() > 0.99 and (found.beyond == 0).all()


@pytest.mark.parametrize("rough", [0.0, 0.05])
def test_values_are_those_of_the_volume_within_the_uncertainty_that_is_told(rough: float) -> None:
    values = ball(40) + rough * np.random.default_rng(1).random((40, 40, 40))
    volume = stored(values, bumps((0.3, 0.2, 0.1, BLUE), (0.8, 0.3, 0.8, RED)))
    points = seen_points(volume)
    found = read_at(kept_of(volume), points)
    off = np.abs(found.value - own_values(values, points))
    told = found.beyond == 0
    assert np.isfinite(found.value).all() and told.mean() > 0.8
    assert (off <= found.uncertainty)[told].mean() >= 0.95
    assert np.median(found.uncertainty) < 0.02 + 3.0 * rough  # and it is not told generously
    # Those beyond what is kept are on the side that is told.
    low = found.beyond < 0
    assert (own_values(values, points)[low] <= found.value[low] + found.uncertainty[low]).mean() > 0.95


def test_labels_are_whole_numbers_however_large() -> None:
    _, y, x = np.indices((12, 12, 12))
    values = np.where(x < 6, 2035, np.where(y < 6, 14175, 7)).astype(np.int32)
    every = {"centre": 7000.0, "width": 20000.0, "opacity": 0.5, "colour": RED}
    volume = stored(values, TransferFunction.from_bumps([every], unit_distance=0.1), nearest=True)
    kept, points = kept_of(volume, whole=True), seen_points(volume)
    assert not kept.coarse
    found = read_at(kept, points)
    assert set(np.unique(found.value)) <= {7.0, 2035.0, 14175.0}
    sure = found.uncertainty == 0.0
    assert sure.mean() > 0.5
    assert (found.value == own_values(values, points, order=0))[sure].all()
    # Beside a border, the label of the region that is seen counts.
    seven = read_at(kept, points, within=(7.0, 7.0))
    border = ~sure & (np.abs(seven.uncertainty) > 0) & (seven.value == 7.0)
    assert border.sum() >= (found.value == 7.0)[~sure].sum()


def test_what_is_not_shown_has_no_value() -> None:
    volume = stored(ball(24), bumps((0.8, 0.3, 0.8, RED)))
    kept = kept_of(volume)
    low, high = volume.box.bounds
    found = read_at(kept, np.stack([low - 1.0, high + 1.0, 0.999 * low + 0.001 * high]))
    assert np.isnan(found.value).all() and np.isnan(found.uncertainty).all()
    assert read_at(kept, np.zeros((0, 3))).value.shape == (0,)


def test_they_take_less_than_a_byte_a_vertex_and_come_back() -> None:
    volume = stored(ball(48) + 0.004 * np.random.default_rng(1).random((48, 48, 48)), bumps((0.6, 0.5, 0.8, RED)))
    kept = kept_of(volume)
    assert kept.bytes < kept.count
    lattice = kept.lattice()
    assert volume.values is not None
    assert np.array_equal(lattice[lattice > 0], volume.values.codes[lattice > 0])
    again = KeptValues.from_file(kept.to_json(), kept.to_arrays(), volume.box)
    assert np.array_equal(again.lattice(), lattice)
    for name, array in kept.to_arrays().items():
        with pytest.raises(ValueError, match=r"damaged|more or fewer"):
            KeptValues.from_file(kept.to_json(), {**kept.to_arrays(), name: array[:-9]}, volume.box).lattice()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([4, 8, 16]), st.sampled_from([4, 8, 32]), st.booleans())
def test_every_corner_of_an_occupied_cell_is_kept(seed: int, cells: int, own: int, aside: bool) -> None:
    chance = np.random.default_rng(seed)
    box = Box((0.0, 1.0, 2.0), 2.0, (1.0, 0.5, 0.75))
    other = Box((0.1, 1.05, 1.9), 2.2, (1.0, 0.5, 0.75)) if aside else box
    occupied = (chance.random(tuple(grid_shape(other, own))) < 0.02).astype(np.uint8)
    shape = tuple(grid_shape(box, cells) + 1)
    marked = vertices_at(Occupancy(other, own, occupied), box, cells, shape)
    points = other.to_world((np.argwhere(occupied) + chance.random((int(occupied.sum()), 3)) * 0.98 + 0.01) / own)
    first = np.floor(box.to_box(points) * cells).astype(int)
    for corner in np.ndindex(2, 2, 2):
        at = first + corner
        inside = ((at >= 0) & (at < shape)).all(axis=1)
        assert marked[tuple(at[inside].T)].all()
    assert not marked.all() or len(points) > 3


def test_values_of_a_scene_that_is_a_function_of_them_are_read_off_alike() -> None:
    codes = (1 + 64 * np.arange(5 * 4 * 3).reshape(5, 4, 3)).astype(np.uint16)
    box = Box((0.0, 0.0, 0.0), 1.0, (1.0, 0.75, 0.5))
    grid = ValueGrid(4, codes, (-50.0, 200.0), (0.0, 1.0))
    everywhere = Occupancy(box, 4, np.ones((4, 3, 2), np.uint8))
    points = np.random.default_rng(0).random((50, 3)) * box.extent
    one = read_at(KeptValues.of(grid, box, everywhere), points)
    two = read_at(TimeSteps.of(grid, box), points)
    assert np.allclose(one.value, two.value) and np.allclose(one.uncertainty, two.uncertainty)
    index = points * 4
    expected = -50.0 + 250.0 * (map_coordinates(codes.astype(float), index.T, order=1) - 1.0) / LARGEST
    assert np.allclose(one.value, expected)
