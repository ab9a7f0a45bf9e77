"""Files as people's programs write them: read as those programs mean them, or refused by a sentence that says why."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
tifffile = pytest.importorskip("tifffile")
for package in ("h5py", "nibabel", "nrrd", "pydicom", "SimpleITK", "zarr"):
    pytest.importorskip(package)

from pydicom.uid import RLELossless  # noqa: E402
from vtkmodules.util.numpy_support import numpy_to_vtk  # noqa: E402
from vtkmodules.vtkCommonDataModel import vtkImageData  # noqa: E402
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter  # noqa: E402

from svv.bricks.axes import Choice  # noqa: E402
from svv.bricks.opened import data_files, open_bricks  # noqa: E402
from svv.bricks.tiff import open_tiff  # noqa: E402
from svv.core.json_values import parsed  # noqa: E402
from svv.dvr.grids import to_array  # noqa: E402
from svv.dvr.large import LargeVolume, open_volume  # noqa: E402
from svv.dvr.volumes import read_here, read_volume  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.reference_files import dicom_slice, write_nan_nifti  # noqa: E402

V = (np.arange(40 * 32 * 24) % 200).reshape(40, 32, 24).astype(np.int16)


@pytest.fixture(autouse=True)
def _pyramids_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SVV_PYRAMIDS", str(tmp_path / "pyramids"))


# --- TIFF ------------------------------------------------------------------------------------------------------------

U = V.astype(np.uint16)
GREY = {"photometric": "minisblack"}


def tiff(path: Path, values: np.ndarray, **how: Any) -> Path:
    tifffile.imwrite(path, values, **how)
    return path


def test_a_stack_of_imagej_in_one_directory_is_read_whole(tmp_path: Path) -> None:
    """ImageJ writes stacks of more than 4 GB with the first slice's directory alone."""
    path = tiff(tmp_path / "v.tif", U, imagej=True, resolution=(2, 4), metadata={"spacing": 2.0, "axes": "ZYX"})
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as opened:
        at, order = opened.pages[0].offset, "little" if opened.byteorder == "<" else "big"
    entries = int.from_bytes(content[at : at + 2], order)
    content[at + 2 + 12 * entries : at + 6 + 12 * entries] = bytes(4)
    path.write_bytes(content)
    volume = read_here(path)
    np.testing.assert_array_equal(to_array(volume), U)
    np.testing.assert_allclose(volume.GetSpacing(), (0.5, 0.25, 2.0))


def test_channels_have_numbers_and_names(tmp_path: Path) -> None:
    both = np.stack([U, 65535 - U])
    names = {"axes": "CZYX", "Channel": {"Name": ["DAPI", "GFP"]}}
    path = tiff(tmp_path / "v.ome.tif", both, ome=True, metadata=names, **GREY)
    for channel in ("1", "GFP"):
        np.testing.assert_array_equal(to_array(read_here(path, channel=channel)), both[1])
    with pytest.raises(BadInput, match=r"^v.ome.tif has 2 channels \(0 DAPI, 1 GFP\): choose one with --channel\.$"):
        read_here(path)
    with pytest.raises(BadInput, match=r"no channel 'RFP'; it has 2 channels \(0 DAPI, 1 GFP\)\.$"):
        read_here(path, channel="RFP")
    with pytest.raises(BadInput, match=r"no time point 1; it has one time point\.$"):
        read_here(path, channel="0", time=1)
    np.testing.assert_array_equal(to_array(read_volume(path, channel=1)), both[1])  # in the process apart


def test_channels_and_times_are_asked_for_together(tmp_path: Path) -> None:
    path = tiff(tmp_path / "v.tif", np.stack([np.stack([U] * 3)] * 2), metadata={"axes": "TCZYX"}, **GREY)
    with pytest.raises(BadInput, match=r"has 3 channels \(0 to 2\) and 2 time points \(0 to 1\): choose one with --ch"):
        read_here(path)


@pytest.mark.parametrize(
    "how", [{"imagej": True}, {"ome": True}, GREY, {"metadata": None, **GREY}, {"volumetric": True}]
)
def test_a_volume_written_without_axes_is_one(tmp_path: Path, how: dict[str, Any]) -> None:
    """Tifffile calls its slices channels then, for ImageJ and OME."""
    how = {**GREY, "tile": (16, 16, 16), **how} if "volumetric" in how else how
    path = tiff(tmp_path / "v.tif", U, **how)
    np.testing.assert_array_equal(to_array(read_here(path)), U)


def test_three_or_four_slices_are_no_colours(tmp_path: Path) -> None:
    with pytest.warns(DeprecationWarning, match="photometric"):  # tifffile takes the slices for colours
        path = tiff(tmp_path / "v.tif", U[:4])
    np.testing.assert_array_equal(to_array(read_here(path)), U[:4])


def test_channels_in_packed_pages(tmp_path: Path) -> None:
    both = np.stack([U, 65535 - U], 1)
    path = tiff(tmp_path / "v.tif", both, compression="zlib", metadata={"axes": "ZCYX"}, **GREY)
    np.testing.assert_array_equal(to_array(read_here(path, channel="1")), both[:, 1])
    source = open_bricks(path, choice=Choice("1"))
    assert source is not None
    np.testing.assert_array_equal(source.read(0, (3, 2, 1), (30, 9, 8)), both[3:30, 1, 2:9, 1:8])


@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_colours_are_channels(tmp_path: Path, planar: str) -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (10, 12, 14, 3)).astype(np.uint8)
    stored = rgb if planar == "contig" else rgb.transpose(0, 3, 1, 2)
    path = tiff(tmp_path / "v.tif", stored, photometric="rgb", planarconfig=planar)
    with pytest.raises(BadInput, match="has 3 channels"):
        read_here(path)
    np.testing.assert_array_equal(to_array(read_here(path, channel="2")), rgb[..., 2])


BAD_TIFF: dict[str, tuple[np.ndarray, dict[str, Any], str]] = {
    "unknown axes": (np.stack([U, U]), GREY, "axes of which it does not say what they are"),
    "times of slices": (U, {"imagej": True, "metadata": {"axes": "TYX"}}, "40 time points of single slices; if they"),
    "few channels": (U[:3], {"imagej": True, "metadata": {"axes": "CYX"}}, "3 channels of single slices; if they are"),
    "a picture": (U[0], GREY, "no volume|at least 2"),
}


@pytest.mark.parametrize("case", BAD_TIFF)
def test_what_is_no_volume_is_refused(tmp_path: Path, case: str) -> None:
    values, how, words = BAD_TIFF[case]
    with pytest.raises(BadInput, match=words):
        read_here(tiff(tmp_path / "v.tif", values, **how))


def test_several_images_are_listed(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "v.tif") as writer:
        writer.write(U, metadata={"axes": "ZYX"}, **GREY)
        writer.write(U[:9, :8, :7], metadata={"axes": "ZYX"}, **GREY)
    with pytest.raises(
        BadInput, match=r"2 images \(0 \(40 x 32 x 24\), 1 \(9 x 8 x 7\)\): choose one of them with --arr"
    ):
        read_here(tmp_path / "v.tif")
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "v.tif", array="1")), U[:9, :8, :7])


def test_units_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    sizes = {"PhysicalSizeX": 1.0, "PhysicalSizeY": 1.0, "PhysicalSizeZ": 2.0, "PhysicalSizeZUnit": "pixel"}
    path = tiff(tmp_path / "v.ome.tif", U, ome=True, metadata={"axes": "ZYX", **sizes}, **GREY)
    with pytest.raises(BadInput, match=r"units that cannot be compared \(x in µm, y in µm, z in pixel\)"):
        open_tiff(path)


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
    path = tiff(tmp_path / "v.tif", np.stack([U, U + 500]), metadata={"axes": "CZYX"}, **GREY)
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


def test_further_axes_of_a_plain_zarr_array_are_not_dropped(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr", minversion="3")
    zarr.create_array(tmp_path / "v.zarr", data=np.stack([V, V]))
    with pytest.raises(BadInput, match="does not say what they are"):
        open_bricks(tmp_path / "v.zarr")
    names = ["c", "z", "y", "x"]
    zarr.create_array(tmp_path / "w.zarr", data=np.stack([V, V + 1]), dimension_names=names, zarr_format=3)
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "w.zarr", channel="1")), V + 1)


# --- DICOM -----------------------------------------------------------------------------------------------------------

SMALL = V[:4, :5, :6]


def scan(folder: Path, places: list[Any], change: Callable[[int, Any], None] = lambda k, data: None) -> Path:
    folder.mkdir(exist_ok=True)
    for k, place in enumerate(places):
        data = dicom_slice(SMALL[k % 4], place)
        data.InstanceNumber = k
        change(k, data)
        data.save_as(folder / f"IM{k}", enforce_file_format=True)
    return folder


def test_slices_are_in_the_order_of_their_places(tmp_path: Path) -> None:
    folder = scan(tmp_path / "scan", [(0, 0, 3 * k) for k in (0, 1, 2, 3)][::-1])
    (folder / "DICOMDIR").write_bytes(b"an index")
    volume = read_here(folder)
    np.testing.assert_array_equal(to_array(volume), SMALL[::-1])
    assert volume.GetSpacing() == (1.0, 1.0, 3.0)
    assert open_bricks(folder) is None


def test_slices_packed_by_run_lengths(tmp_path: Path) -> None:
    folder = scan(tmp_path / "scan", [(0, 0, k) for k in range(4)], lambda k, data: data.compress(RLELossless))
    np.testing.assert_array_equal(to_array(read_here(folder)), SMALL)


def test_the_frames_of_one_file_are_a_volume(tmp_path: Path) -> None:
    data = dicom_slice(SMALL, (1, 2, 3))
    data.NumberOfFrames, data.SpacingBetweenSlices = 4, "2.5"
    data.save_as(tmp_path / "frames", enforce_file_format=True)
    volume = read_here(tmp_path / "frames")
    np.testing.assert_array_equal(to_array(volume), SMALL)
    assert volume.GetSpacing() == (1.0, 1.0, 2.5) and volume.GetOrigin() == (1.0, 2.0, 3.0)


def test_slices_at_the_same_places_are_time_points(tmp_path: Path) -> None:
    folder = scan(tmp_path / "scan", [(0, 0, k % 2) for k in range(4)])
    with pytest.raises(BadInput, match=r"^scan has 2 time points \(0 to 1\): choose one with --time\.$"):
        read_here(folder)
    np.testing.assert_array_equal(to_array(read_here(folder, time=1)), SMALL[2:])


def test_two_series_in_a_folder_are_listed(tmp_path: Path) -> None:
    def series(k: int, data: Any) -> None:
        data.SeriesInstanceUID, data.SeriesDescription = f"1.2.{k // 2}", ("thorax", "scout")[k // 2]

    folder = scan(tmp_path / "scan", [(0, 0, k % 2) for k in range(4)], series)
    with pytest.raises(
        BadInput, match=r"2 series \(0 thorax \(2 files\), 1 scout \(2 files\)\): choose one with --array"
    ):
        read_here(folder)
    for name in ("1", "scout", "1.2.1"):
        np.testing.assert_array_equal(to_array(read_here(folder, array=name)), SMALL[2:])


def wide(k: int, data: Any) -> None:
    if k == 2:
        data.PixelSpacing = ["2", "2"]


BAD_SCANS: dict[str, tuple[list[Any], Callable[[int, Any], None], str]] = {
    "a slice is missing": ([(0, 0, z) for z in (0, 1, 3, 4)], lambda k, data: None, "uneven distances .1 to 2 mm."),
    "a tilted gantry": ([(0, k, k) for k in range(4)], lambda k, data: None, "not perpendicular"),
    "one slice": ([(0, 0, 0)], lambda k, data: None, "is a single slice: name the folder"),
    "other pixels": ([(0, 0, k) for k in range(4)], wide, "differs in size or direction"),
    "one place": ([(0, 0, 0)] * 4, lambda k, data: None, "at the same place"),
    "a place twice": ([(0, 0, z) for z in (0, 1, 2, 2)], lambda k, data: None, "places with several slices"),
    "colours": ([(0, 0, k) for k in range(4)], lambda k, data: setattr(data, "SamplesPerPixel", 3), "in colours"),
}


@pytest.mark.parametrize("case", BAD_SCANS)
def test_scans_that_are_no_volume_are_refused(tmp_path: Path, case: str) -> None:
    places, change, words = BAD_SCANS[case]
    with pytest.raises(BadInput, match=words):
        read_here(scan(tmp_path / "scan", places, change))


# --- JSON ------------------------------------------------------------------------------------------------------------


def test_a_byte_order_mark_is_no_part_of_json() -> None:
    text = json.dumps({"a": [1, 2]})
    assert parsed("\ufeff" + text) == parsed(b"\xef\xbb\xbf" + text.encode()) == parsed(text)
