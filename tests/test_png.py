"""Pictures that are decoded without Pillow are those that Pillow decodes, and all others are left to it."""

from __future__ import annotations

import io
import struct
import zlib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from svv.errors import BadInput
from svv.io.views.png import SIGNATURE, read_png
from svv.io.views.view_images import decode


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(lines: NDArray[np.uint8], width: int, kind: int, parts: int = 1) -> bytes:
    """A file of filtered lines, each with its filter first, in some parts. (H, 1 + B)"""
    packed = zlib.compress(lines.tobytes())
    cuts = np.linspace(0, len(packed), parts + 1).astype(int)
    data = b"".join(chunk(b"IDAT", packed[a:b]) for a, b in pairwise(cuts.tolist()))
    header = struct.pack(">IIBBBBB", width, len(lines), 8, kind, 0, 0, 0)
    return SIGNATURE + chunk(b"IHDR", header) + chunk(b"tEXt", b"Software\0none") + data + chunk(b"IEND", b"")


def of_pillow(data: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(data)))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(1, 20), st.integers(1, 20), st.sampled_from([2, 6]), st.integers(1, 3), st.integers(0, 1 << 30))
def test_all_filters_are_undone(tmp_path: Path, height: int, width: int, kind: int, parts: int, seed: int) -> None:
    """Any bytes are lines of some picture, whatever their filters are."""
    rng = np.random.default_rng(seed)
    lines = rng.integers(0, 256, (height, 1 + width * (3 if kind == 2 else 4)), np.uint8)
    lines[:, 0] = rng.integers(0, 5, height)
    file = tmp_path / "any.png"
    file.write_bytes(png(lines, width, kind, parts))
    pixels = read_png(file)
    assert pixels is not None and np.array_equal(pixels, of_pillow(file.read_bytes()))


def test_pictures_of_other_kinds_are_left_to_pillow(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    grey = Image.fromarray(rng.integers(0, 256, (9, 7), np.uint8))
    coloured = Image.fromarray(rng.integers(0, 256, (9, 7, 3), np.uint8))
    file = tmp_path / "one.png"
    for image, options in (
        (grey, {}), (grey.convert("LA"), {}), (coloured.quantize(8), {}), (coloured, {"transparency": (1, 2, 3)}),
        (grey.convert("1"), {}), (coloured, {"save_all": True, "append_images": [coloured.rotate(90)]}),
    ):  # fmt: skip
        image.save(file, format="PNG", **options)
        assert read_png(file) is None
        assert np.array_equal(decode(file), image.convert("RGBA" if "A" in decode_mode(file) else "RGB"))
    coloured.save(file, format="BMP")
    assert read_png(file) is None and np.array_equal(decode(file), coloured)
    coloured.save(file, format="PNG")
    assert np.array_equal(decode(file), coloured) and read_png(file) is not None


def decode_mode(file: Path) -> str:
    """RGBA if Pillow finds alpha in a file, or a transparent colour."""
    with Image.open(file) as image:
        return "RGBA" if "A" in image.getbands() or "transparency" in image.info else "RGB"


def test_damaged_files_are_not_read(tmp_path: Path) -> None:
    """Whichever byte is another one, or missing, the pixels are those of the whole file, or Pillow is asked."""
    lines = np.random.default_rng(1).integers(0, 256, (4, 1 + 3 * 4), np.uint8)
    lines[:, 0] = 4
    data, file = png(lines, 3, 6), tmp_path / "damaged.png"
    file.write_bytes(data)
    whole = read_png(file)
    for place in range(len(data)):
        file.write_bytes(data[:place] + bytes([data[place] ^ 0x10]) + data[place + 1 :])
        assert read_png(file) is None
        file.write_bytes(data[:place])
        assert read_png(file) is None
    file.write_bytes(data + b"something behind the end")
    assert np.array_equal(read_png(file), whole)
    for wrong in (lines[:3], np.repeat(lines, 2, axis=0)):  # of fewer lines than there should be, and of more
        body = zlib.compress(wrong.tobytes())
        parts = data.partition(chunk(b"IDAT", zlib.compress(lines.tobytes())))
        file.write_bytes(parts[0] + chunk(b"IDAT", body) + parts[2])
        assert read_png(file) is None
    lines[2, 0] = 5
    file.write_bytes(png(lines, 3, 6))
    assert read_png(file) is None
    with pytest.raises(BadInput, match="truncated or not an image"):
        decode(file)


def test_a_picture_that_declares_too_many_pixels_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bomb.png"
    file.write_bytes(SIGNATURE + chunk(b"IHDR", struct.pack(">IIBBBBB", 60000, 60000, 8, 6, 0, 0, 0))
                     + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b""))  # fmt: skip
    with pytest.raises(BadInput, match="pixels"):
        decode(file)
