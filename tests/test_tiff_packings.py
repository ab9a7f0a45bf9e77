"""Pixels of TIFF files, however packed: the values are the stored ones, or the packing is named."""

from __future__ import annotations

import io
from collections import ChainMap
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
tifffile = pytest.importorskip("tifffile")

from PIL import Image  # noqa: E402

from svv.bricks.opened import open_bricks  # noqa: E402
from svv.dvr.read.grids import to_array  # noqa: E402
from svv.dvr.read.volumes import read_here  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.nightly import nightly  # noqa: E402

WITHOUT_CODECS = pytest.mark.skipif(find_spec("imagecodecs") is not None, reason="imagecodecs reads all of these")

WHITE_IS_ZERO = 0


def letter(dtype: str) -> np.ndarray:
    """An L of four values, off the centre. (14, 18, 22)"""
    values = np.zeros((14, 18, 22))
    values[3, 4, 5:13], values[3, 5:9, 5], values[4:6, 4, 5], values[6:8, 4, 5] = 100, 75, 50, 25
    return (values > 30) if dtype == "?" else values.astype(dtype) + np.dtype(dtype).type(1)


def by_libtiff(how: str) -> Any:
    """An encoder for tifffile: bytes as Pillow's libtiff packs them."""

    def packed(data: Any, **_: object) -> bytes:
        raw = data if isinstance(data, bytes) else np.ascontiguousarray(data).tobytes()
        file = io.BytesIO()
        Image.frombytes("L", (len(raw), 1), raw).save(file, "tiff", compression=how)
        with tifffile.TiffFile(io.BytesIO(file.getvalue())) as opened:
            (at,), (size,) = opened.pages[0].dataoffsets, opened.pages[0].databytecounts
        return file.getvalue()[at : at + size]

    return packed


def differences(data: np.ndarray, axis: int = -2, out: object = None) -> np.ndarray:
    """The predictor of real numbers, byte by byte as Adobe's note describes it."""
    rows = data.reshape(-1, data.shape[-2] * data.shape[-1])
    stored = np.empty((len(rows), rows.shape[1] * data.dtype.itemsize), np.uint8)
    for row, put in zip(rows, stored):
        planes = row.astype(row.dtype.newbyteorder(">")).view(np.uint8).reshape(len(row), -1).T.ravel()
        put[:] = planes
        put[data.shape[-1] :] -= planes[: -data.shape[-1]]
    return stored.view(data.dtype).reshape(data.shape)


@pytest.fixture
def packers(monkeypatch: pytest.MonkeyPatch) -> None:
    ours = {5: by_libtiff("tiff_lzw"), 32773: by_libtiff("packbits"), 50000: by_libtiff("zstd")}
    monkeypatch.setattr(tifffile.TIFF, "COMPRESSORS", ChainMap(ours, tifffile.TIFF.COMPRESSORS))
    monkeypatch.setattr(tifffile.TIFF, "PREDICTORS", ChainMap({3: differences}, tifffile.TIFF.PREDICTORS))


KINDS = ("<u1", "<i1", ">u2", "<i2", "<u4", "<f2", ">f4", "<f8")

CASES = [(packing, kind) for packing in (None, "packbits", "zlib", "lzw", "zstd") for kind in KINDS]


@pytest.mark.parametrize(
    ("packing", "dtype"),
    nightly(
        [*CASES, (None, "?"), ("packbits", "?"), ("zlib", "?")],
        *((None, kind) for kind in KINDS), ("packbits", "?"), ("packbits", "<i2"), ("lzw", ">u2"), ("lzw", "<f8"),
        *(("zlib", kind) for kind in KINDS), ("zstd", "<u1"), ("zstd", ">f4"),
    ),
)  # fmt: skip
def test_values_are_the_stored_ones(packing: str | None, dtype: str, tmp_path: Path, packers: None) -> None:
    """Whether white is 0 or black, in strips or tiles, with a predictor or without, in either order of bytes."""
    values = letter(dtype)
    for number, how in enumerate(
        {"photometric": light, "predictor": summed, **parts}
        for light in ("minisblack", "miniswhite")
        for summed in (False, True)
        for parts in ({"rowsperstrip": 5}, {"tile": (16, 16), "bigtiff": True})
        if not summed or (packing not in (None, "packbits") and dtype != "?")
    ):
        path = tmp_path / f"{number}.tif"
        order = ">" if dtype[0] == ">" else "<"
        tifffile.imwrite(path, values, compression=packing, byteorder=order, metadata={"axes": "ZYX"}, **how)
        volume = read_here(path)
        np.testing.assert_array_equal(to_array(volume), values, err_msg=str(how))
        source = open_bricks(path)
        assert source is not None
        np.testing.assert_array_equal(source.read(0, (2, 3, 4), (9, 9, 19)), values[2:9, 3:9, 4:19])


@pytest.mark.parametrize("white", [False, True])
@pytest.mark.parametrize(
    ("kind", "packing"),
    [("u1", None), ("u1", "tiff_lzw"), ("u1", "tiff_adobe_deflate"), ("u1", "packbits"), ("u1", "zstd"),
     ("u2", None), ("u2", "tiff_lzw"), ("?", None), ("?", "group3"), ("?", "group4"), ("?", "tiff_lzw"),
     ("u1", "jpeg")],
)  # fmt: skip
@pytest.mark.parametrize("turned", [1, 4])
def test_what_pillow_writes_is_not_turned_round(
    kind: str, packing: str | None, white: bool, turned: int, tmp_path: Path
) -> None:
    """Pillow inverts white-is-zero pages of up to 8 bits, writing and reading, and turns pages upright."""
    values = letter(kind)
    pages = [Image.fromarray(page) for page in values]
    tags = {262: WHITE_IS_ZERO if white else 1, 274: turned}
    pages[0].save(tmp_path / "v.tif", save_all=True, append_images=pages[1:], compression=packing, tiffinfo=tags)
    (tmp_path / "slices").mkdir()
    for number, page in enumerate(pages):
        page.save(tmp_path / "slices" / f"{number}.tif", compression=packing, tiffinfo=tags)
    with tifffile.TiffFile(tmp_path / "v.tif") as opened:
        assert opened.pages[0].photometric == tags[262]
    values = ~values if white and kind != "u2" else values
    tolerance = 40 if packing == "jpeg" else 0
    for path in (tmp_path / "v.tif", tmp_path / "slices"):
        np.testing.assert_allclose(to_array(read_here(path)), values, atol=tolerance)


@WITHOUT_CODECS
@pytest.mark.parametrize(
    ("tag", "value", "words"),
    [(259, 34712, "is packed by JPEG2000, which"), (259, 50002, "is packed by JPEGXL, which"),
     (259, 34887, "is packed by LERC, which"), (259, 34933, "is packed by PNG, which"),
     (259, 50001, "is packed by WEBP, which"), (259, 7, "is packed by JPEG, which"),
     (258, 12, "is stored in 12 bits per value, which")],
)  # fmt: skip
def test_packings_that_need_a_package_are_named(tag: int, value: int, words: str, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "v.tif", letter("u2"), metadata=None, photometric="minisblack", rowsperstrip=5)
    (tmp_path / "slices").mkdir()
    for number, page in enumerate(letter("u2")):
        tifffile.imwrite(tmp_path / "slices" / f"{number}.tif", page, metadata=None, photometric="minisblack")
    for path in (tmp_path / "v.tif", *(tmp_path / "slices").iterdir()):
        with tifffile.TiffFile(path, mode="r+b") as opened:
            for page in list(opened.pages):
                page.tags[tag].overwrite(value)
    for path in (tmp_path / "v.tif", tmp_path / "slices"):
        with pytest.raises(BadInput, match=rf"{words}.*with the package imagecodecs: pip install imagecodecs, or save"):
            read_here(path)
        with pytest.raises(BadInput, match=words):
            open_bricks(path)
