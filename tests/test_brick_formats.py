"""Bricked access to files: every format gives the same boxes, and bad files are one sentence."""

from __future__ import annotations

import base64
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from svv.bricks.formats.source import Source
from svv.bricks.opened import open_bricks
from svv.errors import BadInput


def _hdf5(path: Path, values: NDArray[Any]) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path / "v.h5", "w") as file:
        file.create_dataset("small", data=values[:2, :2, :2])
        data = file.create_dataset("group/volume", data=values, chunks=(4, 4, 4), compression="gzip")
        data.attrs["element_size_um"] = (3.0, 2.0, 1.0)
    return path / "v.h5"


def _zarr(version: int) -> Callable[[Path, NDArray[Any]], Path]:
    def write(path: Path, values: NDArray[Any]) -> Path:
        zarr = pytest.importorskip("zarr", minversion="3")
        array = zarr.create_array(path / "v.zarr", data=values, chunks=(4, 4, 4), zarr_format=version)
        assert array.shape == values.shape
        return path / "v.zarr"

    return write


def _tiff(path: Path, values: NDArray[Any]) -> Path:
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(path / "v.tif", values, photometric="minisblack")
    return path / "v.tif"


def _slices(path: Path, values: NDArray[Any]) -> Path:
    tifffile = pytest.importorskip("tifffile")
    (path / "slices").mkdir()
    for k, page in enumerate(values):
        tifffile.imwrite(path / "slices" / f"s{k}.tif", page)
    return path / "slices"


def _raw(path: Path, values: NDArray[Any]) -> Path:
    file = path / f"v_{'x'.join(map(str, values.shape[::-1]))}_{values.dtype.name}.raw"
    values.tofile(file)
    return file


def _npy(path: Path, values: NDArray[Any]) -> Path:
    np.save(path / "v.npy", values)
    return path / "v.npy"


def _mhd(path: Path, values: NDArray[Any]) -> Path:
    size = " ".join(map(str, values.shape[::-1]))
    kind = {"uint8": "MET_UCHAR", "int16": "MET_SHORT", "float32": "MET_FLOAT"}[values.dtype.name]
    values.astype(values.dtype.newbyteorder(">")).tofile(path / "v.bin")
    (path / "v.mhd").write_text(
        f"ObjectType = Image\nNDims = 3\nBinaryDataByteOrderMSB = True\nTransformMatrix = 0 1 0 -1 0 0 0 0 1\n"
        f"Offset = 1 2 3\nElementSpacing = 1 2 3\nDimSize = {size}\nElementType = {kind}\nElementDataFile = v.bin\n"
    )
    return path / "v.mhd"


WRITERS = {
    "raw": _raw, "npy": _npy, "mhd": _mhd, "hdf5": _hdf5, "zarr 2": _zarr(2), "zarr 3": _zarr(3), "tiff": _tiff,
    "slices": _slices,
}  # fmt: skip


@pytest.mark.parametrize("kind", ["u1", "i2", "f4"])
@pytest.mark.parametrize("form", WRITERS)
def test_every_format_gives_its_boxes(form: str, kind: str, tmp_path: Path) -> None:
    values = np.random.default_rng(1).integers(0, 100, (11, 9, 13)).astype(kind)
    source = open_bricks(WRITERS[form](tmp_path, values))
    assert source is not None
    assert source.dtype == values.dtype
    assert source.levels[0].shape == values.shape
    for start, stop in (((0, 0, 0), (11, 9, 13)), ((3, 2, 5), (10, 9, 6)), ((10, 8, 12), (11, 9, 13))):
        box = tuple(slice(a, b) for a, b in zip(start, stop))
        assert np.array_equal(source.read(0, start, stop), values[box])
    if form == "hdf5":
        assert source.levels[0].spacing.tolist() == [1.0, 2.0, 3.0]
    if form == "mhd":
        assert np.allclose(source.levels[0].axes, [[0, -2, 0], [1, 0, 0], [0, 0, 3]])  # its rows are the axes
        assert source.levels[0].origin.tolist() == [1.0, 2.0, 3.0]


def test_an_ome_zarr_brings_its_own_levels(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr", minversion="3")
    group = zarr.open_group(tmp_path / "v.zarr", mode="w", zarr_format=2)
    values = np.random.default_rng(1).integers(0, 255, (1, 1, 16, 16, 16)).astype(np.uint8)
    group.create_array("0", data=values)
    group.create_array("1", data=values[:, :, ::2, ::2, ::2])
    steps = [{"type": "scale", "scale": [1, 1, 3.0, 2.0, 1.0]}]
    coarse = [
        {"type": "scale", "scale": [1, 1, 6.0, 4.0, 2.0]},
        {"type": "translation", "translation": [0, 0, 9, 0, 0]},
    ]
    group.attrs["multiscales"] = [
        {
            "version": "0.4",
            "datasets": [
                {"path": "0", "coordinateTransformations": steps},
                {"path": "1", "coordinateTransformations": coarse},
            ],
        }
    ]
    source = open_bricks(tmp_path / "v.zarr")
    assert source is not None
    assert [level.shape for level in source.levels] == [(16, 16, 16), (8, 8, 8)]
    assert source.levels[1].spacing.tolist() == [2.0, 4.0, 6.0]
    assert source.levels[1].origin.tolist() == [0.0, 0.0, 9.0]
    assert np.array_equal(source.read(1, (0, 0, 0), (8, 8, 8)), values[0, 0, ::2, ::2, ::2])
    moved = open_bricks(tmp_path / "v.zarr", spacing=(10.0, 2.0, 3.0), origin=(5.0, 5.0, 5.0))
    assert moved is not None
    assert moved.levels[1].spacing.tolist() == [20.0, 4.0, 6.0]
    assert moved.levels[1].origin.tolist() == [5.0, 5.0, 14.0]


def test_a_damaged_chunk_is_one_sentence(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr", minversion="3")
    zarr.create_array(tmp_path / "v.zarr", data=np.ones((8, 8, 8), np.float32), chunks=(4, 4, 4), zarr_format=2)
    (tmp_path / "v.zarr" / "1.0.1").write_bytes(b"damaged")
    source = open_bricks(tmp_path / "v.zarr")
    assert source is not None
    assert source.read(0, (0, 0, 0), (4, 8, 8)).all()
    with pytest.raises(BadInput, match=r"Cannot read voxels 0\.\.7 x 0\.\.7 x 4\.\.7 of v\.zarr: ") as caught:
        source.read(0, (4, 0, 0), (8, 8, 8))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["v.mhd", "v.nrrd", "v.nii", "v.tif", "v.vti", "v.what"])
def test_a_file_that_may_not_be_read_is_a_sentence(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / name).write_bytes(b"something")

    def refused(*_: Any, **__: Any) -> Any:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)
    monkeypatch.setattr("builtins.open", refused)
    with pytest.raises(BadInput, match=r"Cannot read .*: (Permission denied|it is damaged)"):
        open_bricks(tmp_path / name)


BAD: dict[str, tuple[str, dict[str, Any], str]] = {
    "missing": ("none.raw", {}, "There is no volume"),
    "empty": ("empty.npy", {}, "is empty"),
    "no size": ("noname.raw", {}, "give its dimensions"),
    "cut off": ("v.mhd", {}, "damaged or cut off"),
    "no data": ("lost.mhd", {}, "does not exist"),
    "no header": ("bad.mhd", {}, "header is damaged"),
    "not HDF5": ("bad.h5", {}, "not an HDF5 file"),
    "not NumPy": ("bad.npy", {}, "not an array of numbers"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_one_sentence(case: str, tmp_path: Path) -> None:
    name, arguments, words = BAD[case]
    for file in ("noname.raw", "bad.h5", "bad.npy"):
        (tmp_path / file).write_bytes(b"not a volume")
    (tmp_path / "empty.npy").write_bytes(b"")
    head = "NDims = 3\nDimSize = 4 4 4\nElementType = {}\nElementDataFile = {}\n"
    (tmp_path / "v.mhd").write_text(head.format("MET_SHORT", "noname.raw"))
    (tmp_path / "lost.mhd").write_text(head.format("MET_SHORT", "lost.raw"))
    (tmp_path / "bad.mhd").write_text(head.format("MET_WHAT", "noname.raw"))
    with pytest.raises(BadInput, match=words) as caught:
        open_bricks(tmp_path / name, **arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("form", ["hdf5", "zarr"])
def test_packed_values_are_unpacked_and_missing_ones_refused(form: str, tmp_path: Path) -> None:
    """Climate and forecast files store value = stored * scale_factor + add_offset, and a number for no value."""
    h5py, zarr = pytest.importorskip("h5py"), pytest.importorskip("zarr", minversion="3")
    stored = np.arange(5 * 6 * 7, dtype=np.int16).reshape(5, 6, 7)

    def written(values: NDArray[Any], **told: Any) -> Source:
        path = tmp_path / f"v{len(list(tmp_path.iterdir()))}.{'h5' if form == 'hdf5' else 'zarr'}"
        if form == "hdf5":
            with h5py.File(path, "w") as file:
                file.create_dataset("t", data=values).attrs.update(told)
        else:
            zarr.create_array(path, data=values, chunks=(4, 4, 4)).attrs.update(told)
        source = open_bricks(path)
        assert source is not None
        return source

    source = written(stored, scale_factor=0.01, add_offset=273.15, _FillValue=-32768)
    assert source.dtype == np.float32
    np.testing.assert_allclose(source.read(0, (1, 0, 0), (5, 6, 7)), stored[1:] * 0.01 + 273.15, rtol=1e-6)
    assert written(stored, scale_factor=1.0, add_offset=0.0).dtype == np.int16
    assert written(stored, scale_factor=0.001, add_offset=1e3).dtype == np.float64  # float32 would not separate values
    with pytest.raises(BadInput, match=r"voxels without a value \(its attribute _FillValue is 3\): replace"):
        written(stored, _FillValue=np.array([3]) if form == "hdf5" else 3).read(0, (0, 0, 0), (5, 6, 7))
    for text in ("two", "twelve chars", "AAAAAAAAAAAA"):  # the last one is base64 of nine bytes
        with pytest.raises(BadInput, match=r"attribute scale_factor = .*, which is no number"):
            written(stored, scale_factor=text)
    positive = written(stored.astype(np.uint8), _FillValue=-1)  # no voxel can have it
    assert positive.read(0, (0, 0, 0), (5, 6, 7)).max() == stored.max()
    as_xarray_does = base64.standard_b64encode(struct.pack("<d", 1e20)).decode()
    values = np.where(stored == 3, 1e20, stored)
    with pytest.raises(BadInput, match=r"_FillValue is 1e\+20"):
        written(values, _FillValue=as_xarray_does).read(0, (0, 0, 0), (5, 6, 7))
