"""Volumes: every file format preserves values and position in the world; bad files are refused with a sentence."""

from __future__ import annotations

import gzip
import re
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("vtkmodules")
tifffile = pytest.importorskip("tifffile")

from PIL import Image  # noqa: E402
from vtkmodules.util.numpy_support import numpy_to_vtk  # noqa: E402
from vtkmodules.vtkCommonCore import vtkBitArray  # noqa: E402
from vtkmodules.vtkCommonDataModel import vtkImageData  # noqa: E402
from vtkmodules.vtkIOImage import vtkMetaImageWriter, vtkNIFTIImageWriter  # noqa: E402
from vtkmodules.vtkIOLegacy import vtkStructuredPointsWriter  # noqa: E402
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter  # noqa: E402

from svv.dvr.read.grids import as_volume, from_array, index_to_world, to_array  # noqa: E402
from svv.dvr.read.volumes import read_volume  # noqa: E402
from svv.errors import BadInput  # noqa: E402

TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def values(kind: str = "i2", shape: tuple[int, int, int] = (7, 6, 5)) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 100, shape).astype(kind)


def write(writer: object, path: Path, image: vtkImageData) -> Path:
    writer.SetInputData(image)  # type: ignore[attr-defined]
    writer.SetFileName(str(path))  # type: ignore[attr-defined]
    writer.Write()  # type: ignore[attr-defined]
    return path


def nrrd(path: Path, array: np.ndarray, geometry: str, encoding: str = "gzip") -> Path:
    kinds = {"i1": "int8", "u1": "uint8", "i2": "int16", "u2": "uint16", "i4": "int32", "u4": "uint32"}
    kinds |= {"i8": "int64", "u8": "uint64", "f4": "float", "f8": "double"}
    sizes = " ".join(str(n) for n in array.shape[::-1])
    head = f"NRRD0004\ntype: {kinds[array.dtype.str[1:]]}\ndimension: 3\nsizes: {sizes}\n{geometry}endian: little\n"
    data = array.tobytes()
    path.write_bytes(f"{head}encoding: {encoding}\n\n".encode() + (gzip.compress(data) if encoding == "gzip" else data))
    return path


def nifti(path: Path, array: np.ndarray, matrix: np.ndarray, slope: float = 0.0, intercept: float = 0.0) -> Path:
    """A NIfTI-1 file with an sform, written by hand after the standard."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *array.shape[::-1], 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, {"i2": 4, "f4": 16, "u1": 2}[array.dtype.str[1:]], 8 * array.itemsize)
    struct.pack_into("<8f", header, 76, 1.0, *np.linalg.norm(matrix[:3, :3], axis=0), 0, 0, 0, 0)
    struct.pack_into("<fff", header, 108, 352.0, slope, intercept)
    struct.pack_into("<hh", header, 252, 0, 1)  # no qform, an sform
    struct.pack_into("<12f", header, 280, *matrix[:3].ravel())
    header[344:348] = b"n+1\0"
    data = bytes(header) + array.tobytes()
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
    return path


FILES = ("v.vti", "v.vtk", "v.mha", "v.mhd", "v.nrrd", "v.npy", "v_5x6x7_KIND.raw")
# VTK writes no 64-bit integers into MetaImage.
KINDS = [(name, kind) for name in FILES for kind in TYPES if not (name[2] == "m" and kind in ("i8", "u8"))]


@pytest.mark.parametrize(("name", "kind"), KINDS)
def test_every_kind_of_file_keeps_its_values(tmp_path: Path, kind: str, name: str) -> None:
    array = values(kind)
    path = tmp_path / name.replace("KIND", array.dtype.name)
    image = from_array(array, (1.0, 2.0, 3.0), (7.0, 8.0, 9.0))
    spaced = True
    if path.suffix == ".vti":
        write(vtkXMLImageDataWriter(), path, image)
    elif path.suffix == ".vtk":
        write(vtkStructuredPointsWriter(), path, image)
    elif path.suffix in (".mha", ".mhd"):
        write(vtkMetaImageWriter(), path, image)
    elif path.suffix == ".nrrd":
        nrrd(path, array, "spacings: 1 2 3\n")
    else:
        spaced = False
        np.save(path, array) if path.suffix == ".npy" else array.tofile(path)
    read = read_volume(path) if spaced else read_volume(path, spacing=(1, 2, 3), origin=(7, 8, 9))
    np.testing.assert_array_equal(to_array(read), array)
    assert to_array(read).dtype.itemsize == array.dtype.itemsize and to_array(read).dtype.kind == array.dtype.kind
    assert read.GetSpacing() == (1.0, 2.0, 3.0)
    if path.suffix != ".nrrd":  # ours has no origin
        assert read.GetOrigin() == (7.0, 8.0, 9.0)


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"])
def test_tiff_stacks(tmp_path: Path, kind: str) -> None:
    array = values(kind)
    tifffile.imwrite(tmp_path / "v.tif", array, photometric="minisblack")
    (tmp_path / "slices").mkdir()
    for i, page in enumerate(array):  # slice_2 stands before slice_10 only if numbers are read as numbers
        tifffile.imwrite(tmp_path / "slices" / f"slice_{5 * i}.tif", page)
    for path in (tmp_path / "v.tif", tmp_path / "slices"):
        np.testing.assert_array_equal(to_array(read_volume(path)), array)


def test_tiff_with_lzw(tmp_path: Path) -> None:
    array = values("u1")
    pages = [Image.fromarray(page) for page in array]
    pages[0].save(tmp_path / "v.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    np.testing.assert_array_equal(to_array(read_volume(tmp_path / "v.tif")), array)


def encoded(values: bytes) -> bytes:
    """Encode a slice of an .slc volume: three or more equal values become a run, others stay as they are; 0 ends it."""
    parts = re.finditer(rb"(?s)(.)\1{2,126}|(?:(?!(.)\2\2).){1,127}", values)
    found = [bytes([len(p[0]), p[0][0]]) if p[1] else bytes([128 + len(p[0])]) + p[0] for p in parts]
    return b"".join([*found, bytes(1)])


def slc(values: np.ndarray, compression: int = 0, ends: Callable[[bytes], bytes] = encoded, bits: int = 8) -> bytes:
    """Return the content of an .slc file; its icon has one pixel."""
    z, y, x = values.shape
    slices = [page.tobytes() for page in values]
    body = [f"{len(code)} X".encode() + code for code in map(ends, slices)] if compression else slices
    return f"11111 {x} {y} {z} {bits} 1.5 2.0 2.5 1 0 0 {compression}\n1 1 X".encode() + b"rgb" + b"".join(body)


SLICES = np.where(np.random.default_rng(0).random((7, 30, 20)) < 0.5, 9, values("u1", (7, 30, 20)))
"""Runs, and values that differ."""


@pytest.mark.parametrize("compression", [0, 1])
@pytest.mark.parametrize("array", [values("u1"), SLICES, np.sort(SLICES, axis=0), SLICES[:, :2, :2]])
def test_slc(tmp_path: Path, array: np.ndarray, compression: int) -> None:
    (tmp_path / "v.slc").write_bytes(slc(array, compression))
    read = read_volume(tmp_path / "v.slc")
    np.testing.assert_array_equal(to_array(read), array)
    assert read.GetSpacing() == (1.5, 2.0, 2.5)


def test_slices_of_an_slc_file_that_lack_their_last_voxel_are_the_same_whenever_they_are_read(tmp_path: Path) -> None:
    """As the format's usual encoder writes them; VTK's reader would return what was in memory."""
    (tmp_path / "v.slc").write_bytes(slc(SLICES, 1, lambda page: encoded(page[:-1])))
    expected = SLICES.copy()
    expected[:, -1, -1] = expected[:, -1, -2]
    for _ in range(2):
        np.testing.assert_array_equal(to_array(read_volume(tmp_path / "v.slc")), expected)


@pytest.mark.parametrize("name", ["v.vti", "v.mha", "v.nrrd", "v.nii", "v.nii.gz"])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_direction_matrices_place_every_voxel(tmp_path: Path, name: str, mirror: float) -> None:
    """The brightest voxel (2, 3, 4) stands in the world where the format's own rule puts it."""
    array = np.zeros((7, 6, 5), np.int16)
    array[4, 3, 2] = 9
    axes = TURN * (mirror, 1, 1)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes * (1.0, 2.0, 3.0), (7, 8, 9)
    image = from_array(array, (1, 2, 3), (7, 8, 9))
    image.SetDirectionMatrix(*axes.ravel())
    path = tmp_path / name
    if name == "v.vti":
        write(vtkXMLImageDataWriter(), path, image)
    elif name == "v.mha":  # not by VTK, which writes the matrix transposed
        turn = " ".join(str(x) for x in axes.T.ravel())
        head = f"NDims = 3\nDimSize = 5 6 7\nElementSpacing = 1 2 3\nOffset = 7 8 9\nTransformMatrix = {turn}\n"
        path.write_bytes(f"{head}ElementType = MET_SHORT\nElementDataFile = LOCAL\n".encode() + array.tobytes())
    elif name == "v.nrrd":
        columns = " ".join("(" + ",".join(str(x) for x in column) + ")" for column in matrix[:3, :3].T)
        nrrd(path, array, f"space: left-posterior-superior\nspace directions: {columns}\nspace origin: (7,8,9)\n")
    else:
        nifti(path, array, matrix)
    read = read_volume(path)
    index = np.array(np.unravel_index(to_array(read).argmax(), array.shape))[::-1]
    place = index_to_world(read) @ [*index, 1]
    np.testing.assert_allclose(place, matrix @ [2, 3, 4, 1], atol=1e-5)


def test_nifti_of_vtk_and_its_rescaling(tmp_path: Path) -> None:
    array = values("i2")
    path = write(vtkNIFTIImageWriter(), tmp_path / "v.nii.gz", from_array(array, (1, 2, 3), (7, 8, 9)))
    read = read_volume(path)
    np.testing.assert_array_equal(to_array(read), array)
    np.testing.assert_allclose(index_to_world(read)[:3, 3], (7, 8, 9), atol=1e-5)
    scaled = read_volume(nifti(tmp_path / "s.nii", array, np.eye(4), slope=0.5, intercept=-10.0))
    np.testing.assert_allclose(to_array(scaled), array * 0.5 - 10)


@settings(max_examples=30, deadline=None)
@given(
    kind=st.sampled_from(["u1", ">u2", "<i2", ">f4", "f2", "b1", ">i8"]),
    size=st.tuples(st.integers(2, 5), st.integers(2, 5), st.integers(2, 5)),
)
def test_arrays_of_any_type_and_byte_order(tmp_path_factory: pytest.TempPathFactory, kind: str, size: tuple) -> None:
    path = tmp_path_factory.mktemp("v") / "v.npy"
    array = values(kind, size)
    np.save(path, array)
    image = read_volume(path)
    np.testing.assert_array_equal(to_array(image), array)
    assert image.GetDimensions() == size[::-1]


def test_raw_with_given_dimensions_and_big_endian(tmp_path: Path) -> None:
    array = values(">u2")
    array.tofile(tmp_path / "data.bin")
    read = read_volume(tmp_path / "data.bin", dims=(5, 6, 7), dtype=">u2", spacing=(1, 1, 2))
    np.testing.assert_array_equal(to_array(read), array)
    assert read.GetSpacing() == (1.0, 1.0, 2.0)


def test_cell_scalars_move_to_the_cells_centres() -> None:
    """A cell's value stands, unchanged, at its centre: half a voxel inwards along the volume's own axes."""
    image = vtkImageData()
    image.SetDimensions(4, 5, 6)
    image.SetSpacing(1, 2, 3)
    image.SetDirectionMatrix(*TURN.ravel())
    cells = np.arange(3 * 4 * 5, dtype=np.float32)
    scalars = numpy_to_vtk(cells, deep=True)
    scalars.SetName("c")
    image.GetCellData().SetScalars(scalars)
    volume = as_volume(image)
    np.testing.assert_array_equal(to_array(volume).ravel(), cells)
    assert volume.GetDimensions() == (3, 4, 5)
    np.testing.assert_allclose(index_to_world(volume)[:3, 3], TURN @ (0.5, 1.0, 1.5))


def test_extents_that_do_not_start_at_zero() -> None:
    image = vtkImageData()
    image.SetExtent(10, 13, -2, 2, 5, 9)
    image.SetSpacing(0.5, 1, 2)
    image.SetOrigin(1, 1, 1)
    image.GetPointData().SetScalars(numpy_to_vtk(np.arange(100.0), deep=True))
    np.testing.assert_allclose(index_to_world(as_volume(image))[:3, 3], (6, -1, 11))


def test_arrays_are_picked_by_name() -> None:
    image = from_array(values(), name="a")
    for name, components in (("v", 3), ("b", 1)):
        extra = numpy_to_vtk(np.ones((210, components)).squeeze(), deep=True)
        extra.SetName(name)
        image.GetPointData().AddArray(extra)
    assert to_array(as_volume(image)).max() > 1  # the active scalars
    assert to_array(as_volume(image, "b")).max() == 1
    with pytest.raises(BadInput, match="3 components"):
        as_volume(image, "v")
    with pytest.raises(BadInput, match="no array 'c'; it has a, v, b"):
        as_volume(image, "c")


def test_bits_are_numbers_too() -> None:
    image, bits = from_array(values()), vtkBitArray()
    for i in range(210):
        bits.InsertNextValue(i % 2)
    image.GetPointData().SetScalars(bits)
    np.testing.assert_array_equal(to_array(as_volume(image)).ravel(), np.arange(210) % 2)


MHD = "ObjectType = Image\nNDims = 3\nDimSize = {}\nElementType = MET_SHORT\nElementDataFile = gone.raw\n"
VTI = (
    '<VTKFile type="ImageData"><ImageData WholeExtent="0 {n} 0 {n} 0 {n}"><Piece Extent="0 {n} 0 {n} 0 {n}">'
    '<PointData><DataArray type="Int16" Name="a" format="ascii">1</DataArray></PointData></Piece></ImageData></VTKFile>'
)


def save(name: str, content: bytes | str | np.ndarray) -> object:
    def make(folder: Path) -> Path:
        path = folder / name
        if isinstance(content, np.ndarray):
            np.save(path, content)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


def truncated(writer: object, name: str) -> object:
    def make(folder: Path) -> Path:
        path = write(writer, folder / name, from_array(values("f8")))
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
        return path

    return make


def truncated_tiff(folder: Path) -> Path:
    pages = [Image.fromarray(page) for page in values("u1", (7, 60, 50))]
    pages[0].save(folder / "v.tif", save_all=True, append_images=pages[1:])
    (folder / "v.tif").write_bytes((folder / "v.tif").read_bytes()[:12000])
    return folder / "v.tif"


def truncated_nrrd(folder: Path) -> Path:
    path = nrrd(folder / "v.nrrd", values(), "spacings: 1 2 3\n", "raw")
    path.write_bytes(path.read_bytes()[:-50])
    return path


JUNK = np.random.default_rng(0).integers(0, 256, 3000, dtype=np.uint8).tobytes()
POLYDATA = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n0 0 0\n"
BAD = {
    "missing": (lambda folder: folder / "no.vti", "There is no volume"),
    "empty": (save("v.vti", b""), "is empty"),
    "unknown": (save("v.xyz", b"abc"), "not have a supported format"),
    **{f"junk{s}": (save(f"v{s}", JUNK), "damaged") for s in (".vti", ".vtk", ".mha", ".mhd", ".nrrd", ".slc", ".npy")},
    **{f"junk{s}": (save(f"v{s}", JUNK), "damaged") for s in (".nii", ".nii.gz", ".tif")},
    "junk in gzip": (save("v.nii.gz", gzip.compress(JUNK)), "damaged"),
    "truncated vti": (truncated(vtkXMLImageDataWriter(), "v.vti"), "damaged"),
    "truncated vtk": (truncated(vtkStructuredPointsWriter(), "v.vtk"), "damaged"),
    "truncated mha": (truncated(vtkMetaImageWriter(), "v.mha"), "damaged"),
    "truncated nifti": (truncated(vtkNIFTIImageWriter(), "v.nii"), "damaged"),
    "truncated nrrd": (truncated_nrrd, "damaged"),
    "truncated tiff": (truncated_tiff, "damaged"),
    "truncated slc": (save("v.slc", slc(SLICES)[:-1]), "damaged"),
    "truncated slc in a slice": (save("v.slc", slc(SLICES, 1)[:-9]), "damaged"),
    "truncated slc after a slice": (save("v.slc", slc(SLICES[:-1], 1).replace(b" 6 8 ", b" 7 8 ")), "damaged"),
    "slc slice too short": (save("v.slc", slc(SLICES, 1, lambda page: encoded(page[:-2]))), "damaged"),
    "slc slice too long": (save("v.slc", slc(SLICES, 1, lambda page: encoded(page + page[:1]))), "damaged"),
    "slc without slices": (save("v.slc", slc(SLICES[:0])), "damaged"),
    "slc of 16 bits": (save("v.slc", slc(SLICES, bits=16)), "16 bits per voxel"),
    "slc too large": (save("v.slc", slc(SLICES).replace(b"20 30 7", b"90000 90000 90000")), "memory"),
    "data gone": (save("v.mhd", MHD.format("5 6 7")), "gone.raw, which does not exist"),
    "too large": (save("v.mhd", MHD.format("90000 90000 90000")), "memory"),
    "too large vti": (save("v.vti", VTI.format(n=99999)), "memory"),
    "negative size": (save("v.mhd", MHD.format("-5 6 7")), "damaged"),
    "not a grid": (save("v.vtk", POLYDATA), "vtkPolyData"),
    "empty folder": (lambda folder: folder, "contains no .tif"),
    "single voxel": (save("v.npy", np.ones((1, 1, 1))), "1 x 1 x 1 voxels"),
    "slice": (save("v.npy", np.ones((1, 4, 4))), "4 x 4 x 1 voxels"),
    "two axes": (save("v.npy", np.ones((4, 4))), "three axes"),
    "several components": (save("v.npy", np.ones((4, 4, 4, 3))), "three axes"),
    "nan": (save("v.npy", np.full((3, 3, 3), np.nan)), "no voxel with a value"),
    "infinite": (save("v.npy", np.full((3, 3, 3), np.inf)), "no voxel with a value"),
    "complex": (save("v.npy", np.ones((3, 3, 3), complex)), "integers or real"),
    "text": (save("v.npy", np.array([["a"]])), "axes|real"),
    "raw without size": (save("v.raw", b"12345678"), "dimensions"),
    "raw without type": (save("v_2x2x2.raw", b"12345678"), "type"),
    "raw of another size": (save("v_2x2x3_uint8.raw", b"12345678"), "8 bytes, but 2 x 2 x 3"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_volumes_are_refused_with_one_sentence(tmp_path: Path, case: str, capfd: pytest.CaptureFixture) -> None:
    make, words = BAD[case]
    path = make(tmp_path)  # type: ignore[operator]
    with pytest.raises(BadInput, match=words) as caught:
        read_volume(path)
    assert "\n" not in str(caught.value) and str(caught.value).endswith(".")
    assert capfd.readouterr() == ("", "")  # nothing of VTK's own on the terminal


def test_a_sheared_grid_and_an_impossible_spacing_are_refused() -> None:
    image = from_array(values())
    image.SetDirectionMatrix(1, 0.5, 0, 0, 1, 0, 0, 0, 1)
    with pytest.raises(BadInput, match="perpendicular"):
        as_volume(image)
    with pytest.raises(BadInput, match="the spacing 1 x 0 x 1;"):
        as_volume(from_array(values(), (1, 0, 1)))
