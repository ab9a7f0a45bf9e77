"""TIFF files of ImageJ, OME, tifffile and libtiff: their axes, channels, time points and voxel sizes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
tifffile = pytest.importorskip("tifffile")
for package in ("h5py", "nibabel", "nrrd", "pydicom", "SimpleITK", "zarr"):
    pytest.importorskip(package)

from PIL import Image  # noqa: E402

from svv.bricks.formats.axes import Choice  # noqa: E402
from svv.bricks.formats.tiff import open_tiff  # noqa: E402
from svv.bricks.opened import open_bricks  # noqa: E402
from svv.dvr.read.grids import to_array  # noqa: E402
from svv.dvr.read.volumes import read_here, read_volume  # noqa: E402
from svv.errors import BadInput  # noqa: E402

V = (np.arange(40 * 32 * 24) % 200).reshape(40, 32, 24).astype(np.int16)

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


def test_three_or_four_slices_are_colours_unless_the_axes_say_otherwise(tmp_path: Path) -> None:
    with pytest.warns(DeprecationWarning, match="photometric"):  # tifffile takes the slices for colours
        path, told = tiff(tmp_path / "v.tif", U[:4]), tiff(tmp_path / "w.tif", U[:4], metadata={"axes": "ZYX"})
    with pytest.raises(BadInput, match="4 channels of single slices; if they are the slices of a volume, say so"):
        read_here(path)
    np.testing.assert_array_equal(to_array(read_here(told)), U[:4])


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


@pytest.mark.parametrize("named", ["folder", "file"])
def test_an_ome_image_in_several_files(tmp_path: Path, named: str) -> None:
    (tmp_path / "scan").mkdir()
    ids = [f"urn:uuid:00000000-0000-0000-0000-00000000000{k}" for k in range(4)]
    planes = "".join(
        f'<TiffData FirstZ="{3 - k}" IFD="0" PlaneCount="1"><UUID FileName="{k}.ome.tif">{one}</UUID></TiffData>'
        for k, one in enumerate(ids)
    )
    for k, one in enumerate(ids):
        text = (
            f'<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="{one}"><Image ID="Image:0"><Pixels '
            f'ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="24" SizeY="32" SizeZ="4" SizeC="1" SizeT="1" '
            f'PhysicalSizeX="0.5" PhysicalSizeY="0.5" PhysicalSizeZ="2"><Channel ID="Channel:0:0"/>{planes}</Pixels>'
            "</Image></OME>"
        )
        tiff(tmp_path / "scan" / f"{k}.ome.tif", U[3 - k], description=text, metadata=None, **GREY)
    volume = read_here(tmp_path / "scan" if named == "folder" else tmp_path / "scan" / "2.ome.tif")
    np.testing.assert_array_equal(to_array(volume), U[:4])
    assert volume.GetSpacing() == (0.5, 0.5, 2.0)
    (tmp_path / "scan" / "1.ome.tif").unlink()
    with pytest.raises(BadInput, match="lacks 1 of the 4 slices that it announces"):
        read_here(tmp_path / "scan" / "2.ome.tif")


def test_channels_of_imagej_packed_by_libtiff(tmp_path: Path) -> None:
    text = "ImageJ=1.53c\nimages=12\nchannels=2\nslices=6\nhyperstack=true\nunit=micron\nspacing=2.0\n"
    pages = [Image.fromarray(page) for z in range(6) for page in (U[z], U[z] + np.uint16(1000))]
    how = {"compression": "tiff_lzw", "description": text, "x_resolution": 2, "y_resolution": 2, "resolution_unit": 1}
    pages[0].save(tmp_path / "v.tif", save_all=True, append_images=pages[1:], **how)
    volume = read_here(tmp_path / "v.tif", channel="1")
    np.testing.assert_array_equal(to_array(volume), U[:6] + 1000)
    assert volume.GetSpacing() == (0.5, 0.5, 2.0)
    source = open_bricks(tmp_path / "v.tif", choice=Choice("1"))
    assert source is not None
    np.testing.assert_array_equal(source.read(0, (1, 2, 3), (5, 9, 8)), U[1:5, 2:9, 3:8] + 1000)


def test_units_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    sizes = {"PhysicalSizeX": 1.0, "PhysicalSizeY": 1.0, "PhysicalSizeZ": 2.0, "PhysicalSizeZUnit": "pixel"}
    path = tiff(tmp_path / "v.ome.tif", U, ome=True, metadata={"axes": "ZYX", **sizes}, **GREY)
    with pytest.raises(BadInput, match=r"units that cannot be compared \(x in µm, y in µm, z in pixel\)"):
        open_tiff(path)


def slices(folder: Path, names: Callable[[int, int], str]) -> Path:
    folder.mkdir()
    for k in range(2):
        for z in range(12):
            tiff(folder / names(k, z), U[z] + np.uint16(1000 * k))
    return folder


@pytest.mark.parametrize(
    "name",
    [
        "s1_c{k}_z{z:03}.tif",
        "s1_z{z}_ch{k:02}.tif",
        "img_channel{k:03}_position000_time000_z{z:03}.tif",
        "{z}_C={k}.tif",
    ],
)
def test_names_of_slices_tell_channels(tmp_path: Path, name: str) -> None:
    folder = slices(tmp_path / "scan", lambda k, z: name.format(k=k, z=z))
    with pytest.raises(BadInput, match=r"^scan has 2 channels \(0 to 1\): choose one with --channel\.$"):
        read_here(folder)
    np.testing.assert_array_equal(to_array(read_here(folder, channel="1")), U[:12] + 1000)


def test_a_folder_of_stacks_is_no_stack(tmp_path: Path) -> None:
    (tmp_path / "scan").mkdir()
    tiff(tmp_path / "scan" / "v1.tif", U, metadata=None, **GREY)
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "scan")), U)
    tiff(tmp_path / "scan" / "v2.tif", U, metadata=None, **GREY)
    with pytest.raises(BadInput, match=r"v1.tif holds 40 pages, not one slice: name the file that you want"):
        read_here(tmp_path / "scan")


def test_numbers_in_names_that_tell_nothing_are_refused_or_left_alone(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"axes of which it does not say what they are \(run 2, part 12, y"):
        read_here(slices(tmp_path / "a", lambda k, z: f"run{k}_part{z}.tif"))
    dated = slices(tmp_path / "b", lambda k, z: f"scan_{20260000 + 12 * k + z}_{1200 + 12 * k + z}.tif")
    np.testing.assert_array_equal(to_array(read_here(dated)), np.concatenate([U[:12], U[:12] + 1000]))


@pytest.mark.parametrize("size", [(6, 7), (3, 4)])
def test_a_slice_of_another_kind_is_not_dropped(tmp_path: Path, size: tuple[int, int]) -> None:
    """A single page of the slices' size is one of them; of another size, a thumbnail or a label."""
    with tifffile.TiffWriter(tmp_path / "v.tif") as writer:
        for z in range(5):
            other = z == 2
            page = np.full(size if other else (6, 7), z, np.uint16)
            writer.write(page, photometric="miniswhite" if other else "minisblack", metadata=None)
    if size == (6, 7):
        with pytest.raises(BadInput, match="holds 2 images"):
            read_here(tmp_path / "v.tif")
    else:
        assert to_array(read_here(tmp_path / "v.tif"))[:, 0, 0].tolist() == [0, 1, 3, 4]


@pytest.mark.parametrize(("resolution", "spacing"), [((300, 150), 2.0), ((72, 72), 1.0), (None, 1.0)])
def test_pixels_of_plain_pages_that_are_not_square_keep_their_shape(
    resolution: tuple[int, int] | None, spacing: float, tmp_path: Path
) -> None:
    path = tiff(tmp_path / "v.tif", U, metadata=None, resolution=resolution, **GREY)
    (tmp_path / "slices").mkdir()
    for number, page in enumerate(U):
        tiff(tmp_path / "slices" / f"{number}.tif", page, metadata=None, resolution=resolution, **GREY)
    for volume in (path, tmp_path / "slices"):
        np.testing.assert_allclose(read_here(volume).GetSpacing(), (1.0, spacing, 1.0))


def calibrated(path: Path, function: int, values: np.ndarray = U, **how: Any) -> Path:
    """A file as ImageJ writes it: ``cf``, ``c0`` and ``c1`` in the description are its calibration of values."""
    told = {"spacing": 2.0, "axes": "ZYX", "cf": function, "c0": -32768.0, "c1": 1.0, "vunit": "Gray Value"}
    told["axes"] = "ZYX"[3 - values.ndim :]
    return tiff(path, values, imagej=True, metadata=told, **how)


@pytest.mark.parametrize("packing", [None, "zlib"])
def test_signed_values_of_imagej_are_signed(packing: str | None, tmp_path: Path) -> None:
    """ImageJ stores a CT's values 32768 larger than they are."""
    stored = U + np.uint16(32768 - 100)
    path = calibrated(tmp_path / "v.tif", 0, stored, compression=packing)
    volume = read_here(path)
    np.testing.assert_array_equal(to_array(volume), V - 100)
    assert volume.GetSpacing()[2] == 2.0
    source = open_bricks(path)
    assert source is not None
    np.testing.assert_array_equal(source.read(0, (1, 2, 3), (5, 9, 8)), V[1:5, 2:9, 3:8] - 100)
    assert (source.assumed or "").endswith("ImageJ's calibration of values is applied: 1 x stored -32768.")
    (tmp_path / "slices").mkdir()
    for number, page in enumerate(stored):
        calibrated(tmp_path / "slices" / f"{number}.tif", 0, page, compression=packing)
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "slices")), V - 100)
    tiff(tmp_path / "slices" / "7.tif", stored[7], imagej=True)
    with pytest.raises(BadInput, match=r"7.tif has values that ImageJ calibrates otherwise than those of 0.tif"):
        read_here(tmp_path / "slices")


def test_other_calibrations_of_imagej(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"calibrates by a curve \(its function 7\), which is not reproduced: convert"):
        read_here(calibrated(tmp_path / "curve.tif", 7))
    np.testing.assert_array_equal(to_array(read_here(calibrated(tmp_path / "none.tif", 20))), U)
    real = calibrated(tmp_path / "real.tif", 0, U.astype(np.float32))
    np.testing.assert_array_equal(to_array(read_here(real)), U)
