"""Volumes whose values are large for their range: pressures of 101325 Pa, temperatures near 300 K, ids of 2^60."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from svv.bricks.numbers import Numbers
from svv.core.differences import above
from svv.core.interval_text import interval_text
from svv.core.volumes.classified import ClassifiedVolume
from svv.dvr.draw.classify import classified
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.time_series import values_over
from svv.dvr.draw.views import make_views
from svv.dvr.functions.histogram import default_transfer_function
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from svv.fields.scene.region import Region
from svv.train.palette.ranges import membership
from tests.nightly import nightly


def field(voxels: int = 14) -> np.ndarray:
    """Values from exactly 0 to 1: a ball, with noise."""
    axis = np.linspace(-1, 1, voxels)
    radius = np.sqrt(sum(np.square(a) for a in np.meshgrid(axis, axis, axis, indexing="ij")))
    values = np.clip(1 - radius, 0, 1) + 0.05 * np.random.default_rng(0).random(radius.shape)
    return (values - values.min()) / np.ptp(values)


def integers(start: int, width: int, dtype: str) -> np.ndarray:
    return np.asarray(np.rint(width * field()).astype(dtype) + np.asarray(start, dtype))


DECADES = {f"1 + 1e-{n}, float64": 1.0 + 10.0**-n * field() for n in range(13)}
DECADES |= {f"1 + 1e-{n}, float32": (1.0 + 10.0**-n * field()).astype(np.float32) for n in range(6)}
FIELDS = {
    "pressure, float32": (101325 + field()).astype(np.float32),
    "pressure, float64": 101325 + field(),
    "temperature, float32": (300 + 0.004 * field()).astype(np.float32),
    "temperature, float64": 300 + 0.004 * field(),
    "1e16": 1e16 + 100 * field(),
    "1e9, float64": 1e9 + field(),
    "1e9, float32": (1e9 + 1e4 * field()).astype(np.float32),
    "2^60, int64": integers(2**60, 10**6, "i8"),
    "-2^60, int64": integers(-(2**60), 10**6, "i8"),
    "2^63, uint64": integers(2**63, 10**7, "u8"),
    "2e9, int32": integers(2_000_000_000, 1000, "i4"),
    **DECADES,
}


def views_of(values: np.ndarray, mapper: str) -> tuple[np.ndarray, list[tuple[float, float]]]:
    views, _ = make_views(from_array(values), n=3, size=24, mapper=mapper, step=0.5)
    assert views.classified is not None
    return views.images.astype(float), [(r.low, r.high) for r in views.classified.ranges]


@pytest.mark.parametrize(
    ("name", "mapper"),
    nightly(
        itertools.product(FIELDS, ["cpu", "bricks"]),
        *((name, "bricks") for name in FIELDS if name not in DECADES or name == list(DECADES)[-1]),
        *((name, "cpu") for name in ("pressure, float32", "1e16", "2^63, uint64")),
    ),
)
def test_views_are_those_of_the_same_field_from_0_to_1(name: str, mapper: str) -> None:
    values = FIELDS[name]
    low, width = float(values.min()), float(values.max()) - float(values.min())
    drawn, ranges = views_of(values, mapper)
    plain, expected = views_of(above(values, low) / width, mapper)
    grain = float(np.spacing(max(abs(low), abs(low + width)))) / width  # of double precision, in which ranges are
    assert np.abs(drawn - plain).mean() < 0.05 + 30 * grain
    found = [[(end - low) / width for end in one] for one in ranges]
    np.testing.assert_allclose(found, expected, atol=1e-8 + 1.01 * grain)


def test_values_of_ranges_have_as_many_digits_as_their_range_needs() -> None:
    """Nine digits of 101325.4 are a thousandth of a range of 1; a billionth of the range is kept instead."""
    values = 101325 + 0.01 * field()
    tf = TransferFunction.from_bumps([{"centre": 101325.0051234, "width": 0.002, "opacity": 0.5}])
    volume = classified(set_stage(from_array(values), tf))
    (only,) = volume.ranges
    assert (only.low, only.high) == pytest.approx((101325.0041234, 101325.0061234), abs=1e-6 * 0.01)
    assert len(repr(only.low)) <= len("101325.00412340000")
    regions = [
        Region((0.0, 0.0, 0.0), 0.5, values=(only.low, only.high)),
        Region((0.0, 0.0, 0.0), 0.5, values=(0.0, 1.0)),
    ]
    assert membership(regions, volume).tolist() == [[True, False]]


def test_steps_of_a_series_are_resolved() -> None:
    image = from_array(1e9 + field())
    volume = classified(set_stage(image, default_transfer_function(image)))
    assert volume.values is not None
    there = values_over(image, volume.box, volume.values.cells, volume.values.interval)
    both = (there.codes > 0) & (volume.values.codes > 0)
    assert np.abs(there.codes.astype(int) - volume.values.codes)[both].max() <= 64


@pytest.mark.parametrize(("start", "width"), [(2**60, 100), (2**60, 1000), (-(2**62), 5000)])
def test_integers_that_double_precision_cannot_tell_apart_are_refused(start: int, width: int) -> None:
    values = integers(start, width, "i8")
    with pytest.raises(BadInput, match=f"run from {start} to {start + width}.*subtract {start} "):
        default_transfer_function(from_array(values))
    tf = TransferFunction(((0.0, 1, 1, 1), (3e18, 1, 1, 1)), ((-5e18, 0.0, 0.5, 0.0), (5e18, 0.5, 0.5, 0.0)))
    with pytest.raises(BadInput, match="cannot tell most of them apart"):
        set_stage(from_array(values), tf)
    small = from_array(integers(5, 3, "i8"))
    set_stage(small, default_transfer_function(small))


def test_differences_are_exact() -> None:
    values = np.array([2**60, 2**60 + 1, 2**60 - 3])
    assert above(values, float(2**60)).tolist() == [0.0, 1.0, -3.0]
    assert above(np.array([2**64 - 1, 2**63], np.uint64), float(2**63)).tolist() == [2.0**63, 0.0]
    assert above(np.array([7, 9], np.uint8), 8.0).tolist() == [-1.0, 1.0]
    assert above(np.array([1.5], np.float32), 1.0).tolist() == [0.5]


@pytest.mark.parametrize("origin", [0.7, -1.3, 2.0, 1e18])
@pytest.mark.parametrize("kind", ["i8", "u8", "i4", "f8"])
def test_differences_from_any_number_are_those_of_whole_numbers(kind: str, origin: float) -> None:
    """Where a function begins between two labels, all of them were taken for others."""
    np.testing.assert_allclose(above(np.arange(5).astype(kind), origin), np.arange(5) - origin)


def test_differences_may_be_larger_than_half_of_all_whole_numbers() -> None:
    np.testing.assert_allclose(above(np.array([0, 5, 2**64 - 1], np.uint64), 1.0), [-1.0, 4.0, 2.0**64], rtol=1e-15)
    np.testing.assert_allclose(above(np.array([-(2**63), 2**63 - 1]), -(2.0**63)), [0.0, 2.0**64], rtol=1e-15)


def test_labels_of_64_bits_are_drawn_as_those_of_8() -> None:
    labels = np.random.default_rng(0).integers(0, 3, (12, 12, 12))
    tf = TransferFunction(
        [(0, 1, 0, 0), (1, 0, 1, 0), (2, 0, 0, 1)], [(0.7, 0, 0.5, 0), (1, 0.3, 0.5, 0), (1.9, 0, 0.5, 0)]
    )
    drawn = [
        make_views(from_array(labels.astype(kind)), tf, n=3, size=24, mapper="bricks", rescale=False)[0].images.astype(
            int
        )
        for kind in ("u1", "i8", "u8")
    ]
    assert drawn[0].any() and np.abs(drawn[1:] - drawn[0]).mean() < 0.5


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    ("value", "kind"),
    nightly(
        [(0, "u1"), (-7, "i2"), (101325.0, "f4"), (2**40, "i8"), (1e12, "f8")],
        (-7, "i2"),
        (101325.0, "f4"),
        (2**40, "i8"),
    ),
)
def test_a_volume_of_one_value_is_drawn(value: float, kind: str) -> None:
    """Large ones were refused with a sentence about grids, others drawn with a warning of an overflow."""
    solid = from_array(np.full((8, 9, 10), value, kind))
    tf = TransferFunction([(value, 0.2, 0.4, 0.6)], [(value, 0.3, 0.5, 0.0)], 1.0)
    drawn, vtks = (
        make_views(solid, tf, n=3, size=24, mapper=mapper, rescale=False)[0].images[:, 10:14, 10:14].astype(float)
        for mapper in ("bricks", "cpu")
    )
    assert drawn[..., 3].min() > 200.0 and np.abs(drawn - vtks).mean() < 2.0


def test_bricks_keep_floats_that_differ_little_as_differences() -> None:
    kept = Numbers.of(np.dtype(np.float32), 101325.0, 101326.0)
    assert kept.converted(np.array([101325.5], np.float32)).tolist() == [0.5] and kept.mapped(101326.0) == 1.0
    assert Numbers.of(np.dtype(np.float32), -1.0, 1.0).gain == 1.0
    signed = Numbers.of(np.dtype(np.int16), 0.0, 1.0)
    assert signed.converted(np.array([-32768, 7], np.int16)).tolist() == [0, 32775] and signed.mapped(7) == 32775


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.25, 1.0, "0.25 to 1"),
        (-1000.0, 1000.0, "-1000 to 1000"),
        (101325.21834, 101325.70114, "101325.218 to 101325.701"),
        (300.0, 300.004, "300 to 300.004"),
        (1e16, 1e16 + 100, "10000000000000000 to 10000000000000100"),
        (7.0, 7.0, "7 to 7"),
        (0.0, 1e-30, "0 to 1e-30"),
    ],
)
def test_intervals_are_told_with_the_digits_that_they_need(low: float, high: float, text: str) -> None:
    assert interval_text(low, high) == text


FILLS = {"-999": -999.0, "-99999": -99999.0, "1e20": 1e20, "-1e20": -1e20, "netCDF's": 9.96921e36, "lowest": -3.4e38}


def with_fill(fill: float, opacities: tuple[tuple[float, float], ...]) -> ClassifiedVolume:
    """A ball whose volume has a block of a fill value where it shows nothing, and what opacities make of it."""
    values = field(24).astype(np.float32)
    values[0, 0, 0] = values[-1, -1, -1] = 1.0  # the box is that of the whole volume
    values[2:6, 2:6, 2:6] = 0.0
    values[3:5, 3:5, 3:5] = fill
    points = [(value, opacity, 0.5, 0.0) for value, opacity in opacities]
    function = TransferFunction([(0.0, 0, 0, 1), (0.5, 0, 1, 0), (1.0, 1, 0, 0)], points, 1.0)
    return classified(set_stage(from_array(values), function))


@pytest.mark.parametrize("fill", [pytest.param(value, id=name) for name, value in FILLS.items()])
@pytest.mark.parametrize(
    "opacities", [((0.3, 0.0), (0.4, 0.3), (0.5, 0.0), (0.7, 0.0), (0.8, 0.8)), ((0.5, 0.0), (0.5000001, 0.7))],
    ids=["ramps", "step"],
)  # fmt: skip
def test_a_fill_value_far_away_changes_no_extinction_elsewhere(
    fill: float, opacities: tuple[tuple[float, float], ...]
) -> None:
    """It is one that lies just beyond the function, only farther away."""
    if fill > 0:
        opacities = (*opacities, (1.9, opacities[-1][1]), (2.0, 0.0))  # it is not to be seen
    plain, found = (with_fill(value, opacities) for value in (3.0 if fill > 0 else -2.0, fill))
    away = np.exp(found.exponent.astype(float)) - np.exp(plain.exponent.astype(float))
    scale = np.exp(plain.exponent.astype(float)).max()
    assert np.abs(away).mean() < 2e-3 * scale
    beyond = np.abs(away).copy()
    beyond[4:20, 4:20, 4:20] = 0.0  # the block and the cells around it
    assert beyond.max() < 0.02 * scale
    assert plain.values is not None and found.values is not None
    assert found.values.interval == pytest.approx(plain.values.interval, abs=0.1 * np.ptp(plain.values.interval))
