"""Style pictures of every kind that occurs, and the messages for those that cannot be used."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageCms

from svv.errors import BadInput
from svv.io.pictures.mask_file import picture_size
from svv.io.pictures.style_picture import LARGEST, read_style

RED = (220, 30, 10)


def test_rgb_comes_back_as_it_is(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    style = read_style(tmp_path / "a.png")
    assert style.dtype == np.float32
    np.testing.assert_allclose(style, pixels / 255, atol=1e-6)


def test_greyscale_and_sixteen_bits_become_rgb(tmp_path: Path) -> None:
    ramp = np.linspace(0, 65535, 32 * 40).reshape(32, 40)
    Image.fromarray(ramp.astype(np.uint16)).save(tmp_path / "deep.png")
    Image.fromarray((ramp / 257).astype(np.uint8)).save(tmp_path / "grey.png")
    for name, tolerance in (("deep.png", 1e-4), ("grey.png", 1 / 255)):
        style = read_style(tmp_path / name)
        assert style.shape == (32, 40, 3)
        np.testing.assert_allclose(style, np.repeat((ramp / 65535)[..., None], 3, 2), atol=tolerance)


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P"])
def test_transparency_lies_over_white(tmp_path: Path, mode: str) -> None:
    image = Image.new("RGBA", (20, 20), (0, 0, 0, 0))
    image.paste((0, 0, 0, 255), (0, 0, 10, 20))
    if mode == "P":
        image = image.quantize(4)
    elif mode == "LA":
        image = image.convert("LA")
    image.save(tmp_path / "a.png")
    style = read_style(tmp_path / "a.png")
    np.testing.assert_allclose(style[:, :10], 0, atol=0.01)
    np.testing.assert_allclose(style[:, 10:], 1, atol=0.01)


def test_cmyk_and_profiles_become_srgb(tmp_path: Path) -> None:
    Image.new("RGB", (32, 32), RED).convert("CMYK").save(tmp_path / "cmyk.jpg", quality=95)
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.new("RGB", (32, 32), RED).save(tmp_path / "profile.png", icc_profile=profile)
    Image.new("RGB", (32, 32), RED).save(tmp_path / "damaged.png", icc_profile=b"nonsense")
    for name in ("cmyk.jpg", "profile.png", "damaged.png"):
        np.testing.assert_allclose(read_style(tmp_path / name).mean((0, 1)), np.array(RED) / 255, atol=0.02)


@pytest.mark.parametrize("profiled", [False, True])
def test_a_rotated_camera_is_held_upright(tmp_path: Path, profiled: bool) -> None:
    image = Image.new("RGB", (60, 30), "blue")
    image.paste(RED, (0, 0, 30, 30))
    exif = Image.Exif()
    exif[0x0112] = 6  # the top of the scene is on the right-hand side... of a picture turned by 90 degrees
    extra = {"icc_profile": ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()} if profiled else {}
    image.save(tmp_path / "a.jpg", exif=exif, quality=95, **extra)
    style = read_style(tmp_path / "a.jpg")
    assert style.shape == (60, 30, 3)
    assert style[5, 15, 0] > 0.7 and style[55, 15, 2] > 0.7


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "transparent P"])
def test_profiles_and_rotation_count_in_every_kind_of_png(tmp_path: Path, mode: str) -> None:
    image = Image.new("RGB", (60, 30), (0, 0, 255))
    image.paste((255, 0, 0), (0, 0, 30, 30))
    other = image if mode == "RGB" else image.convert("RGBA") if mode == "RGBA" else image.quantize(4)
    exif = Image.Exif()
    exif[0x0112] = 6
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    swapped = srgb.replace(b"rXYZ", b"here").replace(b"bXYZ", b"rXYZ").replace(b"here", b"bXYZ")  # red is blue
    extra = {"transparency": 3} if mode == "transparent P" else {}  # an index that no pixel has
    other.save(tmp_path / "a.png", exif=exif, icc_profile=swapped, **extra)
    style = read_style(tmp_path / "a.png")
    assert style.shape == (60, 30, 3)
    np.testing.assert_allclose(style[5, 15], (0, 0, 1), atol=0.02)
    np.testing.assert_allclose(style[55, 15], (1, 0, 0), atol=0.02)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L"])
@pytest.mark.parametrize("compression", [None, "tiff_lzw"])
def test_turned_tiff_files_are_upright_and_of_their_size(tmp_path: Path, mode: str, compression: str | None) -> None:
    image = Image.new("RGB", (60, 30), "black")
    image.paste("white", (0, 0, 30, 30))
    exif = Image.Exif()
    exif[0x0112] = 6
    image.convert(mode).save(tmp_path / "a.tif", exif=exif, compression=compression)
    style = read_style(tmp_path / "a.tif")
    assert style.shape == (60, 30, 3) and picture_size(tmp_path / "a.tif") == (30, 60)
    assert style[:30].min() == 1.0 and style[30:].max() == 0.0


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_twenty_thousand_pixels_wide_is_shrunk(tmp_path: Path, suffix: str) -> None:
    Image.new("RGB", (20_000, 200), RED).save(tmp_path / f"wide.{suffix}")
    style = read_style(tmp_path / f"wide.{suffix}")
    assert style.shape[0] == 16 and style.shape[1] == 1600  # the short side is not lost
    np.testing.assert_allclose(style.mean((0, 1)), np.array(RED) / 255, atol=0.02)
    Image.new("L", (3000, 2000), 128).save(tmp_path / "large.jpg")
    assert max(read_style(tmp_path / "large.jpg").shape) == LARGEST


def test_sentences_for_what_cannot_be_used(tmp_path: Path) -> None:
    Image.new("RGB", (1, 1)).save(tmp_path / "tiny.png")
    Image.new("RGBA", (20, 20), (200, 30, 30, 0)).save(tmp_path / "nothing.png")
    (tmp_path / "text.png").write_text("not a picture")
    (tmp_path / "empty.png").touch()
    Image.effect_noise((64, 64), 50).save(tmp_path / "whole.png")
    (tmp_path / "cut.png").write_bytes((tmp_path / "whole.png").read_bytes()[:1500])
    for name, words in {
        "missing.png": "no style picture",
        "tiny.png": "at least 16 x 16",
        "nothing.png": "completely transparent",
        "text.png": "PNG or JPEG",
        "empty.png": "PNG or JPEG",
        "cut.png": "damaged",
        ".": "no style picture",
    }.items():
        with pytest.raises(BadInput, match=words):
            read_style(tmp_path / name)


def test_pillow_s_own_limit_is_left_as_it_was(tmp_path: Path) -> None:
    before = Image.MAX_IMAGE_PIXELS
    with pytest.raises(BadInput):
        read_style(tmp_path / "missing.png")
    (tmp_path / "text.png").write_text("not a picture")
    with pytest.raises(BadInput):
        read_style(tmp_path / "text.png")
    assert before == Image.MAX_IMAGE_PIXELS


GRID = np.mgrid[0:64, 0:80]
LEVELS = np.stack([(3 * GRID[1] + 2 * GRID[0]) % 256, GRID[1] * 3, GRID[0] * 4 % 256], -1).astype(np.uint16)
"""Levels of a picture with 8 bits; other depths hold multiples of them."""

COLOURS: dict[str, tuple[np.ndarray, dict[str, Any]]] = {
    "planes of 16 bits": (257 * LEVELS, {"planarconfig": "separate"}),
    "tiled planes": (257 * LEVELS, {"planarconfig": "separate", "tile": (16, 16)}),
    "packed planes": (257 * LEVELS, {"planarconfig": "separate", "compression": "zlib", "byteorder": ">"}),
    "12 bits in 16": (LEVELS * 16 + LEVELS // 16, {}),
    "planes of 12 bits in 16": (LEVELS * 16 + LEVELS // 16, {"planarconfig": "separate"}),
    "real numbers": ((LEVELS / 255).astype(np.float32), {}),
}


@pytest.mark.parametrize("case", COLOURS)
def test_deep_colours_in_tiff(tmp_path: Path, case: str) -> None:
    tifffile = pytest.importorskip("tifffile")
    values, how = COLOURS[case]
    stored = np.moveaxis(values, -1, 0).copy() if "planarconfig" in how else values
    tifffile.imwrite(tmp_path / "s.tif", stored, photometric="rgb", **how)
    np.testing.assert_allclose(read_style(tmp_path / "s.tif"), LEVELS / 255, atol=0.51 / 255)


GREYS = LEVELS[..., 0].astype(np.uint32)
DEPTHS: dict[str, tuple[np.ndarray, dict[str, Any]]] = {
    "8 bits in 16": (GREYS.astype(np.uint16), {}),
    "10 bits in 16": ((GREYS * 1023 // 255).astype(np.uint16), {}),
    "12 bits in 16": ((GREYS * 4095 // 255).astype(np.uint16), {}),
    "16 bits": ((GREYS * 257).astype(np.uint16), {}),
    "16 bits, white is zero": ((65535 - GREYS * 257).astype(np.uint16), {"photometric": "miniswhite"}),
    "32 bits": (GREYS * 16843009, {}),
    "signed": ((GREYS * 32767 // 255).astype(np.int16), {}),
    "double": (GREYS / 255, {}),
}


@pytest.mark.parametrize("case", DEPTHS)
def test_greys_of_any_depth_in_tiff(tmp_path: Path, case: str) -> None:
    tifffile = pytest.importorskip("tifffile")
    values, how = DEPTHS[case]
    tifffile.imwrite(tmp_path / "s.tif", values, **{"photometric": "minisblack", **how})
    np.testing.assert_allclose(read_style(tmp_path / "s.tif")[..., 0], GREYS / 255, atol=0.6 / 255)


def test_12_bits_in_a_png(tmp_path: Path) -> None:
    Image.fromarray((GREYS * 4095 // 255).astype(np.uint16)).save(tmp_path / "grey.png")
    np.testing.assert_allclose(read_style(tmp_path / "grey.png")[..., 0], GREYS / 255, atol=0.6 / 255)
    (tmp_path / "colour.png").write_bytes(png16(LEVELS * 16))
    with pytest.raises(BadInput, match="almost black, as if its 16 bits held 12: multiply its values by 16"):
        read_style(tmp_path / "colour.png")


def png16(values: np.ndarray) -> bytes:
    """A PNG file of 16 bits per sample, which Pillow does not write in colours."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = values.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    head = chunk(b"IHDR", struct.pack(">2I5B", width, height, 16, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
