"""Files as people's programs write them: read as those programs mean them, or refused by a sentence that says why."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
tifffile = pytest.importorskip("tifffile")
for package in ("h5py", "nibabel", "nrrd", "pydicom", "SimpleITK", "zarr"):
    pytest.importorskip(package)

from vtkmodules.util.numpy_support import numpy_to_vtk  # noqa: E402
from vtkmodules.vtkCommonDataModel import vtkImageData  # noqa: E402
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter  # noqa: E402

from svv.bricks.opened import data_files, open_bricks  # noqa: E402
from svv.core.json_values import parsed  # noqa: E402
from svv.dvr.draw.large import LargeVolume, open_volume  # noqa: E402
from svv.dvr.functions.transfer_functions import TransferFunction  # noqa: E402
from svv.dvr.read.grids import index_to_world, to_array  # noqa: E402
from svv.dvr.read.volumes import read_here, read_volume  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from svv.io.series_file import read_series  # noqa: E402
from tests.reference_files import write_nan_nifti  # noqa: E402

V = (np.arange(40 * 32 * 24) % 200).reshape(40, 32, 24).astype(np.int16)
U = V.astype(np.uint16)


@pytest.fixture(autouse=True)
def _pyramids_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SVV_PYRAMIDS", str(tmp_path / "pyramids"))


# --- MetaImage, NRRD, NIfTI ------------------------------------------------------------------------------------------


def test_metaimage_as_text(tmp_path: Path) -> None:
    head = "NDims = 3\nBinaryData = False\nBinaryDataByteOrderMSB = True\nDimSize = 24 32 40\nElementType = MET_LONG\n"
    numbers = "\n".join(" ".join(f"{x:g}" for x in row) for row in (10000 * V.astype(int)).reshape(-1, 24))
    (tmp_path / "v.mha").write_text(head + "ElementDataFile = LOCAL\n" + numbers)
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "v.mha")), 10000 * V.astype(np.int32))
    assert open_bricks(tmp_path / "v.mha") is None


def test_the_time_points_of_a_metaimage(tmp_path: Path) -> None:
    two = np.stack([V, -V])
    head = "NDims = 4\nElementSpacing = 1 2 3 1\nOffset = 4 5 6 0\nDimSize = 24 32 40 2\nElementType = MET_SHORT\n"
    (tmp_path / "v.mha").write_bytes(f"{head}ElementDataFile = LOCAL\n".encode() + two.tobytes())
    volume = read_here(tmp_path / "v.mha", time=1)
    np.testing.assert_array_equal(to_array(volume), -V)
    assert volume.GetSpacing() == (1.0, 2.0, 3.0) and volume.GetOrigin() == (4.0, 5.0, 6.0)
    with pytest.raises(BadInput, match=r"2 time points \(0 to 1\): choose one with --time"):
        read_here(tmp_path / "v.mha")


NRRD = "NRRD0005\ntype: short\nsizes: 24 32 40\nendian: little\n"


def nrrd(path: Path, more: str, data: bytes | None = None) -> Path:
    text = NRRD if "\ndimension" in more else NRRD + "dimension: 3\n"
    path.write_bytes(f"{text}{more}\n\n".encode() + (V.tobytes() if data is None else data))
    return path


def test_nrrd_in_hexadecimal_digits(tmp_path: Path) -> None:
    path = nrrd(tmp_path / "v.nrrd", "encoding: hex", V.tobytes().hex(" ", 40).encode())
    np.testing.assert_array_equal(to_array(read_here(path)), V)


@pytest.mark.parametrize("listed", ["v%02d.raw 0 39 1", "LIST\n" + "\n".join(f"v{k:02d}.raw" for k in range(40))])
def test_nrrd_in_many_files(tmp_path: Path, listed: str) -> None:
    for k, page in enumerate(V):
        (tmp_path / f"v{k:02d}.raw").write_bytes(page.tobytes())
    (tmp_path / "v.nhdr").write_text(f"{NRRD}dimension: 3\nencoding: raw\ndata file: {listed}\n")
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "v.nhdr")), V)
    assert len(data_files(tmp_path / "v.nhdr")) == 40


@pytest.mark.parametrize(
    ("more", "spacing", "origin"),
    [
        ('spacings: 1 2 3\nunits: "mm" "mm" "um"', (1, 2, 0.003), (0, 0, 0)),
        ("spacings: 1 2 3\naxis mins: 10 20 30\ncenters: node node node", (1, 2, 3), (10, 20, 30)),
        ("spacings: 1 2 3\naxis mins: 10 20 30\ncenters: cell cell cell", (1, 2, 3), (10.5, 21, 31.5)),
        ("axis mins: 0 0 0\naxis maxs: 24 32 40\ncenters: cell cell cell", (1, 1, 1), (0.5, 0.5, 0.5)),
        ("axis mins: 0 0 0\naxis maxs: 23 62 78\ncenters: node node node", (1, 2, 2), (0, 0, 0)),
        (
            'space dimension: 3\nspace units: "mm" "mm" "um"\nspace directions: (1,0,0) (0,2,0) (0,0,3)\n'
            "space origin: (1,1,1000)", (1, 2, 0.003), (1, 1, 1),
        ),
    ],
)  # fmt: skip
def test_where_nrrd_files_lie(tmp_path: Path, more: str, spacing: tuple, origin: tuple) -> None:
    volume = read_here(nrrd(tmp_path / "v.nrrd", f"{more}\nencoding: raw"))
    np.testing.assert_allclose(volume.GetSpacing(), spacing, rtol=1e-12)
    np.testing.assert_allclose(volume.GetOrigin(), origin, rtol=1e-12, atol=1e-12)


def test_a_negative_spacing_of_nrrd_mirrors(tmp_path: Path) -> None:
    volume = read_here(nrrd(tmp_path / "v.nrrd", "spacings: -1 2 3\nencoding: raw"))
    np.testing.assert_array_equal(index_to_world(volume)[:3, :3], np.diag([-1, 2, 3]))


def test_the_byte_skip_of_packed_nrrd_counts_after_unpacking(tmp_path: Path) -> None:
    import gzip

    path = nrrd(tmp_path / "v.nrrd", "encoding: gzip\nbyte skip: 9", gzip.compress(b"123456789" + V.tobytes()))
    np.testing.assert_array_equal(to_array(read_here(path)), V)


def test_a_slope_that_is_no_number_means_one(tmp_path: Path) -> None:
    path = write_nan_nifti(tmp_path / "v.nii", V)
    np.testing.assert_array_equal(to_array(read_here(path)), V)
    assert to_array(read_here(path)).dtype == np.int16


# --- arrays, ray casters, caches -------------------------------------------------------------------------------------


def two_arrays(path: Path, active: str | None) -> Path:
    image = vtkImageData()
    image.SetDimensions(8, 8, 8)
    for name, values in (("a", np.zeros(512)), ("b", np.ones(512)), ("v", np.zeros((512, 3)))):
        array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        image.GetPointData().AddArray(array)
    if active:
        image.GetPointData().SetActiveScalars(active)
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToNone()
    writer.Write()
    return path


def test_blanked_points_are_not_read_by_bricks(tmp_path: Path) -> None:
    """Bricks know no blanking: VTK reads the file as a whole, with the array that blanks."""
    path = two_arrays(tmp_path / "v.vti", "a")
    assert open_bricks(path) is not None
    path.write_bytes(path.read_bytes().replace(b'Name="v"', b'Name="vtkGhostType"', 1))
    assert open_bricks(path) is None


def overview(volume: Any) -> np.ndarray:
    return to_array(volume.overview if isinstance(volume, LargeVolume) else volume)


@pytest.mark.parametrize("active", [None, "a", "b", "v"])
@pytest.mark.parametrize("array", [None, "a", "b"])
def test_every_ray_caster_shows_the_same_array(tmp_path: Path, active: str | None, array: str | None) -> None:
    path = two_arrays(tmp_path / "v.vti", active)
    shown = [overview(open_volume(path, array=array, mapper=mapper)) for mapper in ("cpu", "bricks")]
    np.testing.assert_array_equal(*shown)
    assert shown[0].max() == float("b" == (array or active))


def test_hdf5_with_any_ray_caster(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["first"], file["second"] = V, V + 1
    for mapper in ("cpu", "gpu", "bricks", "auto"):
        for array, values in (("first", V), ("second", V + 1)):  # of the same shape: not one pyramid for both
            opened = open_volume(tmp_path / "v.h5", array=array, mapper=mapper)
            np.testing.assert_array_equal(overview(opened), values)
            range_ = opened.range if isinstance(opened, LargeVolume) else (values.min(), values.max())
            assert range_ == (values.min(), values.max())


def test_a_pyramid_belongs_to_a_channel(tmp_path: Path) -> None:
    path = tmp_path / "v.tif"
    tifffile.imwrite(path, np.stack([U, U + 500]), metadata={"axes": "CZYX"}, photometric="minisblack")
    ranges = [open_volume(path, mapper="bricks", channel=channel).range for channel in (0, 1)]
    assert ranges == [(0.0, 199.0), (500.0, 699.0)]


def test_a_pyramid_is_made_again_when_the_data_beside_a_header_changes(tmp_path: Path) -> None:
    head = "NDims = 3\nDimSize = 24 32 40\nElementType = MET_SHORT\nElementDataFile = v.raw\n"
    (tmp_path / "v.mhd").write_text(head)
    for more in (0, 7):
        (tmp_path / "v.raw").write_bytes((V + np.int16(more)).tobytes() + b"j" * more)
        opened = open_volume(tmp_path / "v.mhd", mapper="bricks")
        assert isinstance(opened, LargeVolume) and opened.range == (more, 199 + more)


@pytest.mark.parametrize("name", ["v.npy", "v_24x32x40_int16.raw"])
def test_channels_of_files_without_any_are_refused(tmp_path: Path, name: str) -> None:
    np.save(tmp_path / name, V) if name.endswith("npy") else V.tofile(tmp_path / name)
    for choice in ({"channel": "1"}, {"time": 0}):
        with pytest.raises(BadInput, match=r"neither channels nor time points: leave out --(channel|time)\."):
            read_volume(tmp_path / name, **choice)


# --- Zarr ------------------------------------------------------------------------------------------------------------


def ome(path: Path, values: np.ndarray, axes: list[dict[str, str]] | None, steps: list[dict[str, Any]]) -> Path:
    zarr = pytest.importorskip("zarr", minversion="3")
    group = zarr.open_group(path, mode="w", zarr_format=2)
    group.create_array("0", data=values)
    told: dict[str, Any] = {"version": "0.4", "datasets": [{"path": "0", "coordinateTransformations": steps}]}
    group.attrs["multiscales"] = [told | ({"axes": axes} if axes else {})]
    group.attrs["omero"] = {"channels": [{"label": "DAPI"}, {"label": "GFP"}]}
    return path


def test_units_and_channels_of_ome_zarr(tmp_path: Path) -> None:
    units = {"x": "micrometer", "y": "micrometer", "z": "nanometer"}
    axes = [{"name": n, "type": "space", "unit": units[n]} for n in "xyz"] + [{"name": "c", "type": "channel"}]
    steps = [{"type": "scale", "scale": [0.5, 0.5, 2000.0, 1.0]}]
    path = ome(tmp_path / "v.zarr", np.stack([V.T, V.T + 1], -1), axes, steps)
    volume = read_here(path, channel="GFP")
    np.testing.assert_array_equal(to_array(volume), V + 1)
    np.testing.assert_allclose(volume.GetSpacing(), (0.5, 0.5, 2.0))
    with pytest.raises(BadInput, match=r"2 channels \(0 DAPI, 1 GFP\): choose one with --channel"):
        read_here(path)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ([{"type": "scale", "path": "scales"}], "scale without numbers"),
        ([{"type": "rotation", "rotation": [1] * 9}], "rotation"),
        ([{"type": "scale", "scale": [1.0, 2.0]}], "2 numbers for 3 axes"),
    ],
)
def test_transformations_that_cannot_be_read_are_refused(tmp_path: Path, steps: list, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        open_bricks(ome(tmp_path / "v.zarr", V, None, steps))


def test_a_level_of_an_ome_zarr_image_keeps_its_place(tmp_path: Path) -> None:
    axes = [{"name": name, "type": "space"} for name in "xyz"]
    path = ome(tmp_path / "v.zarr", V.T, axes, [{"type": "scale", "scale": [0.5, 0.25, 2.0]}])
    volume = read_here(path, array="0")
    np.testing.assert_array_equal(to_array(volume), V)
    assert volume.GetSpacing() == (0.5, 0.25, 2.0)


def test_further_axes_of_a_plain_zarr_array_are_not_dropped(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr", minversion="3")
    zarr.create_array(tmp_path / "v.zarr", data=np.stack([V, V]))
    with pytest.raises(BadInput, match="does not say what they are"):
        open_bricks(tmp_path / "v.zarr")
    names = ["c", "z", "y", "x"]
    zarr.create_array(tmp_path / "w.zarr", data=np.stack([V, V + 1]), dimension_names=names, zarr_format=3)
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "w.zarr", channel="1")), V + 1)


# --- JSON ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_json_as_windows_writes_it(tmp_path: Path, encoding: str) -> None:
    text = json.dumps({"bumps": [{"centre": 100, "width": 80, "opacity": 0.3}]})
    (tmp_path / "tf.json").write_bytes(text.encode(encoding))
    assert (
        TransferFunction.read(tmp_path / "tf.json").to_dict()
        == TransferFunction.from_dict(parsed(text), "tf.json").to_dict()
    )
    (tmp_path / "steps.vti.series").write_bytes(json.dumps({"files": [{"name": "a.vti", "time": 2}]}).encode(encoding))
    assert read_series(tmp_path / "steps.vti.series") == [(2.0, tmp_path / "a.vti")]


def test_a_byte_order_mark_is_no_part_of_json() -> None:
    text = json.dumps({"a": [1, 2]})
    assert parsed("\ufeff" + text) == parsed(b"\xef\xbb\xbf" + text.encode()) == parsed(text)


def _with_scales(file: Path, *values: object, units: tuple[str, ...] = ("m", "m", "m")) -> None:
    import h5py

    with h5py.File(file, "w") as opened:
        data = opened.create_dataset("data", data=np.arange(5 * 6 * 7.0).reshape(5, 6, 7))
        for axis, (name, scale, unit) in enumerate(zip("zyx", values, units)):
            coordinates = opened.create_dataset(name, data=scale)
            coordinates.attrs["units"] = unit
            coordinates.make_scale(name)
            data.dims[axis].attach_scale(coordinates)


def test_scales_attached_to_the_axes_of_hdf5_are_its_places(tmp_path: Path) -> None:
    """As netCDF-4 writes them."""
    even = np.arange(5) * 2.0 + 3, 10 - np.arange(6) * 0.25, np.arange(7, dtype=np.float32) * 0.1
    _with_scales(tmp_path / "v.h5", *even)
    np.testing.assert_allclose(
        index_to_world(read_here(tmp_path / "v.h5")),
        [[0.1, 0, 0, 0], [0, -0.25, 0, 10], [0, 0, 2, 3], [0, 0, 0, 1]], atol=1e-6,
    )  # fmt: skip
    _with_scales(tmp_path / "globe.h5", *even, units=("m", "degrees_north", "degrees_east"))
    np.testing.assert_allclose(index_to_world(read_here(tmp_path / "globe.h5")), np.diag([1.0, -1.0, 1.0, 1.0]))


def test_two_volumes_of_one_size_in_hdf5_are_listed(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "v.h5", "w") as opened:
        for name in ("labels", "raw", "small"):
            opened.create_dataset(name, data=np.zeros((4, 4, 3 if name == "small" else 4)))
    with pytest.raises(BadInput, match=r"several volumes of one size: name one of them \(labels, raw\)"):
        read_here(tmp_path / "v.h5")
    assert read_here(tmp_path / "v.h5", array="raw").GetNumberOfPoints() == 64
