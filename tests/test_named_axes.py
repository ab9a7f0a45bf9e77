"""netCDF and Zarr: axes by names and attributes, places by coordinates, as xarray and netCDF's libraries write."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
h5py = pytest.importorskip("h5py")
zarr = pytest.importorskip("zarr", minversion="3")
from scipy.io import netcdf_file  # noqa: E402

from svv.bricks.formats.axes import roles  # noqa: E402
from svv.bricks.opened import open_bricks  # noqa: E402
from svv.dvr.draw.views import make_views  # noqa: E402
from svv.dvr.read.grids import assumed_of, to_array  # noqa: E402
from svv.dvr.read.volumes import read_here, read_volume  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.ell_volume import STEP, assert_shown, ell, planes  # noqa: E402

Coordinates = Mapping[str, tuple[Any, Mapping[str, Any]]]
"""Places along a dimension, or None, and their attributes."""

METRES: Coordinates = {letter: (planes(letter), {"units": "m"}) for letter in "xyz"}
PLACEHOLDER = "This is a netCDF dimension but not a netCDF variable.{:10d}"
"""Name of the scale of a dimension without coordinates, as netCDF-C writes it."""


def netcdf4(path: Path, values: Any, dims: Sequence[str], known: Coordinates, **told: Any) -> Path:
    """A file as netCDF-4's library writes it."""
    with h5py.File(path, "w") as file:
        file["rho"] = values
        file["rho"].attrs.update(told)
        for k, dim in enumerate(dims):
            places, attributes = known.get(dim, (None, {}))
            file[dim] = np.zeros(values.shape[k], ">f4") if places is None else places
            file[dim].attrs.update(attributes)
            file[dim].make_scale(dim if places is not None else PLACEHOLDER.format(values.shape[k]))
            file["rho"].dims[k].attach_scale(file[dim])
    return path


def netcdf3(path: Path, values: Any, dims: Sequence[str], known: Coordinates, **told: Any) -> Path:
    with netcdf_file(path, "w") as file:
        for count, dim in zip(values.shape, dims):
            file.createDimension(dim, count)
        for dim, (places, attributes) in {**known, "rho": (values, told)}.items():
            if places is not None and (dim == "rho" or dim in dims):
                variable = file.createVariable(dim, np.asarray(places).dtype, dims if dim == "rho" else (dim,))
                variable[:] = places
                for key, value in attributes.items():
                    setattr(variable, key, value)
    return path


def grouped(path: Path, values: Any, dims: Sequence[str], known: Coordinates, version: int, **told: Any) -> Path:
    """A group of Zarr as xarray writes it."""
    group = zarr.open_group(path, mode="w", zarr_format=version)
    for key, (places, attributes) in {**known, "rho": (values, told)}.items():
        if places is None or not (key == "rho" or key in dims):
            continue
        names = list(dims) if key == "rho" else [key]
        places = np.asarray(places)
        array = group.create_array(
            key, shape=places.shape, dtype=places.dtype, chunks=places.shape,
            dimension_names=names if version == 3 else None,
        )  # fmt: skip
        array[...] = places
        array.attrs.update(attributes if version == 3 else {**attributes, "_ARRAY_DIMENSIONS": names})
    return path


def write(form: str, folder: Path, values: Any, dims: Sequence[str], known: Coordinates, **told: Any) -> Any:
    """Write a file of a form; returns it and the options that show its volume."""
    if form.startswith("zarr"):
        return grouped(folder / "v.zarr", values, dims, known, int(form[-1]), **told), {"array": "rho"}
    writer, name = {"netCDF-4": (netcdf4, "v.nc"), "HDF5": (netcdf4, "v.h5"), "netCDF-3": (netcdf3, "v3.cdf")}[form]
    return writer(folder / name, values, dims, known, **told), {}


FORMS = ["netCDF-4", "HDF5", "netCDF-3", "zarr 2", "zarr 3"]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("order", ["zyx", "xyz", "yxz", "zxy"])
def test_axes_are_found_by_their_names(form: str, order: str, tmp_path: Path) -> None:
    path, how = write(form, tmp_path, ell().transpose(["zyx".index(letter) for letter in order]), order, METRES)
    assert_shown(path, **how)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("lev lat lon", "zyx"), ("lon lat height", "xyz"), ("time level latitude longitude", "tzyx"),
        ("depth height width", "zyx"), ("height width depth", "yxz"), ("Time bottom_top south_north west_east", "tzyx"),
        ("XDim YDim ZDim", "xyz"), ("nx ny nz", "xyz"), ("number lat lon", "zyx"), ("x y layer_index", "xyz"),
        ("plev rlat rlon", "zyx"), ("x_0 y_0 z_0", "xyz"), ("a b c0", "zyx"), ("channel depth height width", "czyx"),
        ("isobaricInhPa latitude longitude", "zyx"), ("deptht nav_lat nav_lon", "zyx"),
    ],
)  # fmt: skip
def test_names_of_axes(names: str, expected: str) -> None:
    found, said = roles(names.split(), [5] * len(expected))
    assert "".join(found) == expected
    guessed = {"number lat lon": "number are taken for z", "a b c0": "a, b, c0 are taken for z, y, x"}
    assert guessed.get(names, "") in said and bool(said) == (names in guessed)


@pytest.mark.parametrize("form", FORMS)
def test_attributes_of_coordinates_name_axes(form: str, tmp_path: Path) -> None:
    """Climate and forecast metadata conventions, section 4."""
    known = {
        "k": (planes("z"), {"units": "m", "axis": "Z"}),
        "j": (planes("y"), {"units": "m", "standard_name": "projection_y_coordinate"}),
        "i": (planes("x"), {"units": "m", "axis": "X"}),
    }
    path, how = write(form, tmp_path, ell().T.copy(), "ijk", known)
    assert_shown(path, **how)


@pytest.mark.parametrize("form", FORMS)
def test_latitudes_that_fall_turn_the_volume(form: str, tmp_path: Path) -> None:
    known = {
        "height": (500.0 * np.arange(14), {"units": "m"}),
        "lat": (60 - 0.25 * np.arange(18), {"units": "degrees_north"}),
        "lon": (0.25 * np.arange(22), {"units": "degrees_east"}),
    }
    for dims, values in ((("height", "lat", "lon"), ell()), (("lon", "lat", "height"), ell().T.copy())):
        path, how = write(form, tmp_path, values, dims, known)
        said = "(x in degrees_east, y in degrees_north, z in m): each step counts as 1"
        assert_shown(path, (1, -1, 1), (0, 0, 0), says=said, **how)


def test_what_is_positive_downwards_is_turned(tmp_path: Path) -> None:
    depth = {**METRES, "depth": (3.0 * np.arange(14), {"units": "m", "positive": "down"})}
    assert_shown(netcdf4(tmp_path / "d.nc", ell(), ("depth", "y", "x"), depth), (1.5, 2, -3), (10, 20, 0))
    pressure = {"x": (planes("x"), {}), "y": (planes("y"), {}), "plev": (1000 - 10.0 * np.arange(14), {"units": "hPa"})}
    path = netcdf4(tmp_path / "p.nc", ell(), ("plev", "y", "x"), pressure)
    assert_shown(path, (1, 1, 1), (0, 0, 0), says="z in hPa")  # falls upwards: the first level is the lowest


def test_units_of_length_become_that_of_x(tmp_path: Path) -> None:
    known = {**METRES, "z": (planes("z") / 1000.0, {"units": "kilometers"}), "y": (planes("y"), {"units": "meters"})}
    assert_shown(netcdf4(tmp_path / "v.nc", ell(), "zyx", known))


def test_longitudes_that_begin_again(tmp_path: Path) -> None:
    places = (350.0 + np.arange(22)) % 360.0
    known = {"x": (places, {"units": "degrees_east"}), "y": (np.arange(18.0), {"units": "degrees_north"})}
    path = netcdf4(tmp_path / "v.nc", ell(), ("level", "y", "x"), known)
    assert_shown(path, (1, 1, 1), (350, 0, 0), says="no voxel size found along z: 1")


@pytest.mark.parametrize("form", ["netCDF-4", "netCDF-3", "zarr 3"])
def test_dimensions_without_coordinates_have_the_spacing_1(form: str, tmp_path: Path) -> None:
    path, how = write(form, tmp_path, ell().T.copy(), ("nx", "ny", "nz"), {})
    assert_shown(path, (1, 1, 1), (0, 0, 0), says="no voxel size found: 1 x 1 x 1 ", **how)
    path, how = write(form, tmp_path, ell(), "zyx", {"y": METRES["y"], "x": METRES["x"]})
    assert_shown(path, (1.5, 2, 1), (10, 20, 0), says="no voxel size found along z: 1 (", **how)


@pytest.mark.parametrize("form", FORMS)
def test_time_points(form: str, tmp_path: Path) -> None:
    days = {**METRES, "t0": (np.array([0.0, 1.0, 7.0]), {"units": "days since 2020-01-01"})}
    values = np.stack([ell(), 2 * ell(), 3 * ell()])
    path, how = write(form, tmp_path, values, ("t0", "z", "y", "x"), days)
    for time in (0, 2):
        assert_shown(path, factor=time + 1, time=time, **how)
    with pytest.raises(BadInput, match=r"3 time points \(0 to 2\): choose one with --time"):
        read_here(path, **how)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("turn", [1, -1])
def test_uneven_planes_are_resampled(form: str, turn: int, tmp_path: Path) -> None:
    """As a .vtr file with them is: a linear function of the place stays what it is."""
    levels = np.cumsum(np.arange(1.0, 15.0))[::turn]
    values = (levels[:, None, None] + 10 * planes("y")[:, None] + 100 * planes("x")).astype("f4")
    path, how = write(form, tmp_path, values, "zyx", {**METRES, "z": (levels, {"units": "m"})})
    assert open_bricks(path, array=how.get("array")) is None
    image = read_here(path, resample_to=30, **how)
    nx, ny, nz = image.GetDimensions()
    np.testing.assert_allclose(image.GetBounds(), [10, 41.5, 20, 54, 1, 105], rtol=1e-3)
    first, step = image.GetOrigin(), image.GetSpacing()
    x, y, z = (first[k] + step[k] * np.arange(n) for k, n in enumerate((nx, ny, nz)))
    np.testing.assert_allclose(to_array(image), z[:, None, None] + 10 * y[:, None] + 100 * x, rtol=1e-5)


def test_places_that_neither_rise_nor_fall_are_refused(tmp_path: Path) -> None:
    known = {**METRES, "z": (np.array([*range(13), 3.0]), {"units": "m"})}
    with pytest.raises(BadInput, match="places along 'z' that neither rise nor fall"):
        read_here(netcdf4(tmp_path / "v.nc", ell(), "zyx", known))


def test_single_precision_is_even(tmp_path: Path) -> None:
    """Steps of 0.1 at 500 km, which single precision keeps only to 0.03."""
    known = {**METRES, "x": (np.float32(500_000) + np.float32(0.1) * np.arange(22, dtype="f4"), {"units": "m"})}
    image = read_here(netcdf4(tmp_path / "v.nc", ell(), "zyx", known))
    np.testing.assert_allclose(image.GetSpacing(), (0.1, 2.0, 3.0), rtol=0.05)


def test_packed_values_of_netcdf3(tmp_path: Path) -> None:
    path = netcdf3(tmp_path / "v.nc", ell("i2"), "zyx", METRES, scale_factor=0.5, add_offset=0.0)
    assert_shown(path, factor=0.5)
    signed = ell("u1").view("i1")
    path = netcdf3(tmp_path / "u.nc", signed, "zyx", METRES, _Unsigned="true", _FillValue=np.int8(-1))
    assert_shown(path)
    signed[0, 0, 0] = -1
    path = netcdf3(tmp_path / "u.nc", signed, "zyx", METRES, _Unsigned="true", _FillValue=np.int8(-1))
    assert "at 1 voxels" in str(assumed_of(read_here(path)))
    with pytest.raises(BadInput, match=r"without a value \(its attribute _FillValue is 255\)"):
        open_bricks(path).read(0, (0, 0, 0), (14, 18, 22))  # type: ignore[union-attr]


def test_what_netcdf_did_not_write_has_no_value(tmp_path: Path) -> None:
    values = ell()
    values[-1] = 9.969209968386869e36
    image = read_here(netcdf4(tmp_path / "v.nc", values, "zyx", METRES))
    assert "at 396 voxels (7.1 %)" in str(assumed_of(image)) and to_array(image).max() == 200.0


def test_other_formats_with_the_ending_of_netcdf(tmp_path: Path) -> None:
    for content, words in ((b"CDF\x05" + bytes(40), "CDF-5: convert it to netCDF-4"), (b"something", "no netCDF file")):
        (tmp_path / "v.nc").write_bytes(content)
        with pytest.raises(BadInput, match=words):
            open_bricks(tmp_path / "v.nc")
    whole = netcdf3(tmp_path / "w.nc", ell(), "zyx", METRES).read_bytes()
    for length in (4, 30, 200, len(whole) - 500):
        (tmp_path / "w.nc").write_bytes(whole[:length])
        with pytest.raises(BadInput, match=r"damaged|lacks|no variable"):
            read_here(tmp_path / "w.nc")


def test_an_option_for_time_of_an_unknown_format_is_not_blamed(tmp_path: Path) -> None:
    (tmp_path / "v.what").write_text("1 2 3")
    with pytest.raises(BadInput, match="does not have a supported format"):
        read_volume(tmp_path / "v.what", time=1)


# --- Zarr ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [2, 3])
def test_an_array_is_placed_by_the_groups_in_which_it_lies(version: int, tmp_path: Path) -> None:
    path = grouped(tmp_path / "v.zarr", ell().T.copy(), "xyz", METRES, version)
    assert_shown(path / "rho", says=None)
    group = zarr.open_group(path, mode="a", zarr_format=version).create_group("inner")
    names = {"dimension_names": ["z", "y", "x"]} if version == 3 else {}
    group.create_array("rho", data=ell(), **names).attrs["_ARRAY_DIMENSIONS"] = ["z", "y", "x"]
    assert_shown(path, array="inner/rho")


def test_sizes_in_attributes_of_zarr(tmp_path: Path) -> None:
    array = zarr.create_array(tmp_path / "v.zarr", data=ell())
    array.attrs.update(resolution=STEP[::-1].tolist(), offset=[30.0, 20.0, 10.0])
    assert_shown(tmp_path / "v.zarr")


@pytest.mark.parametrize("version", [2, 3])
def test_chunks_under_other_names_are_said(version: int, tmp_path: Path) -> None:
    path = tmp_path / "v.zarr"
    zarr.create_array(
        path, data=ell(), chunks=(8, 8, 8), zarr_format=version, fill_value=0,
        chunk_key_encoding={"name": "v2", "separator": "/"},
    )  # fmt: skip
    about = path / {2: ".zarray", 3: "zarr.json"}[version]
    told = json.loads(about.read_text())
    if version == 2:
        told["dimension_separator"] = "."
    else:
        told["chunk_key_encoding"]["configuration"]["separator"] = "."
    about.write_text(json.dumps(told))
    with pytest.raises(BadInput, match=rf"none is called as {about.name} says \(0\.0\.0, \.\.\.\), but one \d/\d/\d\."):
        open_bricks(path)
    zarr.create_array(path, shape=ell().shape, dtype="f4", chunks=(8, 8, 8), overwrite=True)
    with pytest.raises(BadInput, match=r"without its chunks of values, or these were renamed: it has none"):
        open_bricks(path)


def test_missing_chunks_without_a_fill_value_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "v.zarr"
    zarr.create_array(path, data=1 + ell(), chunks=(8, 8, 8), zarr_format=2)
    told = json.loads((path / ".zarray").read_text())
    (path / ".zarray").write_text(json.dumps({**told, "fill_value": None}))
    source = open_bricks(path)
    assert source is not None
    np.testing.assert_array_equal(source.read(0, (0, 0, 0), source.levels[0].shape), 1 + ell())
    (path / "1.0.0").unlink()
    assert source.read(0, (0, 8, 0), (14, 18, 22)).all()
    with pytest.raises(BadInput, match=r"the chunk .*1\.0\.0 is missing, and no fill value says what it holds"):
        source.read(0, (0, 0, 0), source.levels[0].shape)


# --- no size of a voxel ----------------------------------------------------------------------------------------------


def unsized(folder: Path) -> dict[str, Path]:
    tifffile = pytest.importorskip("tifffile")
    nibabel = pytest.importorskip("nibabel")
    values, names = ell("i2"), {}
    for name in ("v.npy", "v_22x18x14_int16.raw", "v.h5", "v.zarr", "v.tif", "v.mhd", "v.nrrd", "v.nii", "slices"):
        names[name] = folder / name
    np.save(names["v.npy"], values)
    values.tofile(names["v_22x18x14_int16.raw"])
    with h5py.File(names["v.h5"], "w") as file:
        file["rho"] = values
    zarr.create_array(names["v.zarr"], data=values)
    tifffile.imwrite(names["v.tif"], values, photometric="minisblack")
    raw = "v_22x18x14_int16.raw"
    names["v.mhd"].write_text(f"NDims = 3\nDimSize = 22 18 14\nElementType = MET_SHORT\nElementDataFile = {raw}\n")
    head = b"NRRD0004\ntype: short\ndimension: 3\nsizes: 22 18 14\nendian: little\nencoding: raw\n\n"
    names["v.nrrd"].write_bytes(head + values.tobytes())
    header = nibabel.Nifti1Header()
    header.set_data_shape(values.T.shape)
    header.set_data_dtype(np.int16)
    header["pixdim"][1:4], header["vox_offset"], header["magic"] = 0, 352, b"n+1"
    names["v.nii"].write_bytes(header.binaryblock + bytes(4) + values.tobytes())
    names["slices"].mkdir()
    for k, page in enumerate(values):
        tifffile.imwrite(names["slices"] / f"s{k:02d}.tif", page)
    return names


def test_that_no_voxel_size_was_found_is_said_by_every_format(tmp_path: Path) -> None:
    for path in unsized(tmp_path).values():
        says = f"{path.name}: no voxel size found: 1 x 1 x 1 (--spacing X,Y,Z gives another)."
        assert_shown(path, (1, 1, 1), (0, 0, 0), says=says)
    views, _ = make_views(tmp_path / "v.npy", n=3, test=0, size=16)
    assert (views.meta.assumed or "").startswith(
        "v.npy: no voxel size found: 1 x 1 x 1 (--spacing X,Y,Z gives another)."
    )
    given, _ = make_views(read_volume(tmp_path / "v.nii", spacing=(1, 1, 1)), n=3, test=0, size=16)
    assert "no voxel size" not in (given.meta.assumed or "")
    source = open_bricks(tmp_path / "v.npy", spacing=(1, 1, 1))
    assert source is not None and source.assumed is None
    image = read_volume(tmp_path / "v.tif")  # by a process of its own
    views, _ = make_views(image, n=3, test=0, size=16)
    assert str(views.meta.assumed).startswith("v.tif: no voxel size found: 1 x 1 x 1")


def test_the_command_says_what_it_assumes(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", ell())
    command = [sys.executable, "-m", "svv", "views", str(tmp_path / "v.npy"), "--out", str(tmp_path / "views")]
    size = ["--n", "3", "--test", "0", "--size", "16"]
    ran = subprocess.run([*command, *size], capture_output=True, text=True, timeout=300, check=True)
    assert "v.npy: no voxel size found: 1 x 1 x 1 (--spacing X,Y,Z gives another)." in ran.stderr
    told = json.loads((tmp_path / "views" / "transforms_train.json").read_text())["svv"]["assumed"]
    assert told.startswith("v.npy: no voxel size found")
