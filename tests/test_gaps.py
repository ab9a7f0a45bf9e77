"""Voxels without a value: nothing is drawn there, and what is beside them looks as if they were not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_cdt

import svv
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import sphere_cameras
from svv.dvr.draw.given import given_volume
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.histogram import default_transfer_function
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.gaps import LAYERS, without_gaps
from svv.dvr.read.grids import as_volume, assumed_of, from_array, to_array
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.nightly import nightly

SIDE = 24
FLAT = Shading(on=False)


def ball(missing: float = np.nan, outside: float = 1.0) -> NDArray[np.float32]:
    """A ball of values 10 to 20 in ``outside``, in which a quarter has no value. (z, y, x)"""
    z, y, x = np.indices((SIDE,) * 3) - (SIDE - 1) / 2
    radius = np.sqrt(x * x + y * y + z * z)
    values = np.where(radius < 9, 20 - radius, outside).astype(np.float32)
    values[(x > 0) & (y > 0)] = missing
    return values


def function(rim: float = 0.9) -> TransferFunction:
    """Blue where values are 10 to 20, and red at 3 to 8, which no voxel has."""
    colours = ((0.0, 1.0, 0.0, 0.0), (8.9, 1.0, 0.0, 0.0), (9.0, 0.0, 0.0, 1.0), (20.0, 0.0, 0.0, 1.0))
    opacities = ((2.0, 0.0), (3.0, rim), (8.0, rim), (9.0, 0.0), (10.5, 0.0), (12.0, 0.1), (20.0, 0.3))
    return TransferFunction(colours, tuple((value, level, 0.5, 0.0) for value, level in opacities), 1.0)


def seen(values: NDArray[np.float32], blank: NDArray[np.bool_] | None = None, shading: Shading = FLAT) -> np.ndarray:
    image = as_volume(from_array(values)) if blank is None else from_array(values)
    if blank is not None:
        put(image, Appearance(blank))
    cameras = sphere_cameras(5, (SIDE / 2,) * 3, 60.0, 0.5, 64)
    return render_views(image, function(), cameras, "bricks", shading).astype(float)


@pytest.mark.parametrize(
    ("missing", "shading"),
    nightly([(np.nan, FLAT), (np.nan, Shading()), (-np.inf, FLAT)], (np.nan, Shading()), (-np.inf, FLAT)),
)
def test_the_picture_is_that_of_the_whole_volume_without_these_voxels(missing: float, shading: Shading) -> None:
    values = ball(missing, 10.0)
    z, y, x = np.indices((SIDE,) * 3) - (SIDE - 1) / 2
    whole = np.where(np.sqrt(x * x + y * y + z * z) < 9, 20 - np.sqrt(x * x + y * y + z * z), 10.0).astype(np.float32)
    gaps = ~np.isfinite(values)
    found, truth = seen(values, shading=shading), seen(whole, gaps, shading)
    zeros = seen(np.where(gaps, np.float32(0), values), shading=shading)
    assert truth[..., 3].max() > 100
    drawn = found[..., 3] > 2
    assert not (found[..., 0] > found[..., 2])[drawn].any()  # no red rim of values that no voxel has
    assert (zeros[..., 0] > zeros[..., 2])[zeros[..., 3] > 2].mean() > 0.05  # zeros make one
    assert np.abs(found - truth)[..., 3].mean() < 1.0
    assert np.abs(found - truth)[..., 2].mean() < (1.0 if not shading.on else 4.0)


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 0.97), st.sampled_from([np.float32, np.float64]))
@settings(max_examples=60, deadline=None)
def test_what_is_filled_in_is_a_value_nearby(seed: int, share: float, kind: type) -> None:
    rng = np.random.default_rng(seed)
    values: NDArray[np.floating] = rng.permutation(7 * 6 * 9).reshape(7, 6, 9).astype(kind)
    gaps = rng.random(values.shape) < share
    gaps[tuple(rng.integers(0, values.shape))] = False
    values[gaps] = rng.choice([np.nan, np.inf, -np.inf], int(gaps.sum()))
    given_values = values.copy()
    filled, found, said = without_gaps(values, "a.npy")
    np.testing.assert_array_equal(values, given_values)
    if not gaps.any():
        assert found is None and said is None
        return
    assert said is not None and f"at {gaps.sum()} voxels" in said
    np.testing.assert_array_equal(found, gaps)
    np.testing.assert_array_equal(filled[~gaps], values[~gaps])
    assert filled.dtype == kind and set(filled[gaps]) <= set(values[~gaps])
    place = {value: index for index, value in np.ndenumerate(values) if np.isfinite(value)}
    away = distance_transform_cdt(gaps, "chessboard")
    for index in np.argwhere(gaps & (away <= LAYERS)):
        assert np.abs(np.array(place[filled[tuple(index)]]) - index).max() <= 2 * away[tuple(index)]


def test_ranges_and_default_functions_are_those_of_the_values() -> None:
    values = ball(np.nan, 1.0)
    image = as_volume(from_array(values), name="ball.npy")
    assert image.GetScalarRange() == (float(np.nanmin(values)), float(np.nanmax(values)))
    blank = Appearance.of(image).blank
    assert blank is not None and blank.sum() == np.isnan(values).sum() == SIDE**3 // 4
    assert assumed_of(image) == (
        "ball.npy has no value (NaN, infinite or missing) at 3456 voxels (25 %): nothing is drawn there."
    )
    whole = ball(1.0, 1.0)[:, : SIDE // 2]  # as much ball as air, of the half that has its values
    known = default_transfer_function(from_array(np.ascontiguousarray(whole)))
    found = default_transfer_function(image)
    np.testing.assert_allclose([p[0] for p in found.opacities], [p[0] for p in known.opacities], atol=1.0)
    with pytest.raises(BadInput, match="no voxel with a value"):
        as_volume(from_array(np.full((4, 4, 4), np.nan)))


def test_views_tell_and_classify_nothing_there(tmp_path: Path) -> None:
    np.save(tmp_path / "ball.npy", ball())
    train, _ = make_views(tmp_path / "ball.npy", function(0.0), svv.ViewOptions(n=12, test=0, size=24), rescale=False)
    assert "at 3456 voxels (25 %)" in str(train.meta.assumed)
    full, _ = make_views(ball(15.0), function(0.0), svv.ViewOptions(n=12, test=0, size=24), rescale=False)
    assert train.images[..., 3].mean() < 0.9 * full.images[..., 3].mean()


def test_masked_arrays_have_no_value_where_they_are_masked() -> None:
    for kind in (np.uint8, np.int32, np.float32):
        array = np.ma.masked_equal(ball(9.0).astype(kind), kind(9))
        image = given_volume(array)
        assert "at 3456 voxels" in str(assumed_of(image)) and "taken for [z, y, x]" in str(assumed_of(image))
        np.testing.assert_array_equal(Appearance.of(image).blank, array.mask)  # type: ignore[arg-type]
        np.testing.assert_array_equal(to_array(image)[~array.mask], array.compressed())  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["h5", "integers", "fits"])
def test_values_that_a_file_marks_as_missing_are_not_drawn(tmp_path: Path, kind: str) -> None:
    values = ball(-9.0, 2.0)
    path = tmp_path / ("a.fits" if kind == "fits" else "a.h5")
    stored = values.astype("i2") if kind != "h5" else values
    if kind == "fits":
        fits = pytest.importorskip("astropy.io.fits")
        made = fits.PrimaryHDU(stored)
        made.header["BLANK"] = -9
        made.writeto(path)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["a"] = stored
            file["a"].attrs["_FillValue"] = stored.dtype.type(-9)
    image = read_here(path)
    blank = Appearance.of(image).blank
    np.testing.assert_array_equal(blank, values == -9.0)
    np.testing.assert_array_equal(to_array(image)[values != -9.0], stored[values != -9.0])
    assert "25 %" in str(assumed_of(image))
    if kind == "integers":
        opened = svv.make_views(path, function(0.0), svv.ViewOptions(n=3, test=0, size=16), rescale=False)[0]
        assert "has no value" in str(opened.meta.assumed)
        with pytest.raises(BadInput, match=r"--mapper auto"):
            svv.make_views(path, function(0.0), svv.ViewOptions(n=12, test=0, size=16, mapper="bricks"))
