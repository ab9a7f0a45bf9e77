"""PNG files of light, by their chunks gAMA, sRGB and iCCP: views and style pictures are sRGB."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from svv.io.pictures.gamma import as_srgb, stored
from svv.io.pictures.style_picture import read_style
from svv.io.views.view_images import decode, decode_as_srgb

SRGB = b"sRGB", b"\0"
PROFILE = b"iCCP", b"own\0\0" + zlib.compress(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
KINDS = {1: 0, 2: 4, 3: 2, 4: 6}
"""Colour types of PNG, by channels."""


def png(file: Path, levels: np.ndarray, *chunks: tuple[bytes, bytes], gamma: int | None = 100000) -> Path:
    """Write levels (h, w, channels) of 8 or 16 bits."""
    height, width, channels = levels.shape
    bits = 8 * levels.dtype.itemsize
    rows = b"".join(b"\0" + row.tobytes() for row in levels.astype(levels.dtype.newbyteorder(">")))
    head = struct.pack(">IIBBBBB", width, height, bits, KINDS[channels], 0, 0, 0)
    given = [] if gamma is None else [(b"gAMA", struct.pack(">I", gamma))]
    parts = [(b"IHDR", head), *given, *chunks, (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    each = (struct.pack(">I", len(d)) + t + d + struct.pack(">I", zlib.crc32(t + d)) for t, d in parts)
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(each))
    return file


def ramp(channels: int, bits: int) -> np.ndarray:
    most = 2**bits - 1
    values = np.linspace(0, most, 32 * 20 * channels).reshape(20, 32, channels)
    return np.rint(values).astype(np.uint8 if bits == 8 else np.uint16)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("channels", [3, 4])
def test_linear_views_become_srgb_and_alpha_stays(channels: int, bits: int, tmp_path: Path) -> None:
    levels = ramp(channels, bits)
    found, exponent = decode_as_srgb(png(tmp_path / "a.png", levels))
    light = levels / (2.0**bits - 1)
    expected = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    expected[..., 3:] = light[..., 3:]
    assert exponent == 1.0
    np.testing.assert_allclose(found, 255.0 * expected, atol=1.0 if bits == 16 else 0.51)
    if channels == 3:
        np.testing.assert_allclose(read_style(tmp_path / "a.png"), expected, atol=0.004)


@pytest.mark.parametrize(
    ("gamma", "chunks"), [(45455, ()), (None, ()), (100000, (SRGB,)), (100000, (PROFILE,)), (45455, (SRGB,))]
)
def test_what_is_srgb_stays(gamma: int | None, chunks: tuple[tuple[bytes, bytes], ...], tmp_path: Path) -> None:
    """A power of 1 / 2.2 is what most writers mean by sRGB; the chunks sRGB and iCCP win over gAMA."""
    file = png(tmp_path / "a.png", ramp(4, 8), *chunks, gamma=gamma)
    found, exponent = decode_as_srgb(file)
    assert exponent is None
    np.testing.assert_array_equal(found, ramp(4, 8))


def test_other_powers_and_greys(tmp_path: Path) -> None:
    found, exponent = decode_as_srgb(png(tmp_path / "a.png", ramp(1, 8), gamma=55556))  # old Macintosh
    light = (ramp(1, 8) / 255.0) ** 1.8
    assert exponent == pytest.approx(0.55556)
    np.testing.assert_allclose(found, np.repeat(255.0 * as_srgb(light, 1.0), 3, 2), atol=0.6)
    deep = read_style(png(tmp_path / "deep.png", ramp(1, 16)))
    np.testing.assert_allclose(deep, np.repeat(as_srgb(ramp(1, 16) / 65535.0, 1.0), 3, 2), atol=0.004)
    np.testing.assert_array_equal(decode(png(tmp_path / "mask.png", ramp(3, 8))), ramp(3, 8))  # masks are no light


def test_stored_levels_are_the_inverse() -> None:
    for exponent in (1.0, 0.55556):
        levels = np.rint(255.0 * as_srgb(np.arange(256) / 255.0, exponent)).astype(int)
        assert np.abs(stored(exponent)[levels].astype(int) - np.arange(256)).max() <= 1
    np.testing.assert_array_equal(stored(None), np.arange(256))


def test_a_turned_linear_photograph_is_upright(tmp_path: Path) -> None:
    image = Image.fromarray(ramp(3, 8))
    exif = Image.Exif()
    exif[274] = 6
    image.save(tmp_path / "plain.png", exif=exif)
    file = png(tmp_path / "linear.png", ramp(3, 8), (b"eXIf", exif.tobytes().removeprefix(b"Exif\0\0")))
    assert read_style(file).shape == read_style(tmp_path / "plain.png").shape == (32, 20, 3)
