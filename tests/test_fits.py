"""FITS cubes as astropy writes them: values, order, sizes, polarizations, and damage."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.grids import assumed_of
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.damage import assert_cut_files_are_refused, assert_wrong_headers_are_refused
from tests.ell_volume import STEP, assert_shown, ell

fits = pytest.importorskip("astropy.io.fits")

UNIT, ORIGIN = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


def cards(hdu: Any, steps: Any = STEP, units: tuple[str, ...] = ("pc", "pc", "pc"), kinds: tuple[str, ...] = ()) -> Any:
    """Give an image its sizes along the axes of FITS, the fastest first."""
    for k, (step, unit) in enumerate(zip(steps, units), 1):
        hdu.header[f"CDELT{k}"], hdu.header[f"CUNIT{k}"] = step, unit
    for k, kind in enumerate(kinds, 1):
        hdu.header[f"CTYPE{k}"] = kind
    return hdu


@pytest.mark.parametrize("kind", ["u1", "i2", "u2", "i4", "f4", "f8"])
@pytest.mark.parametrize("ending", [".fits", ".fits.gz"])
def test_values_are_in_their_places(tmp_path: Path, kind: str, ending: str) -> None:
    cards(fits.PrimaryHDU(ell(kind))).writeto(tmp_path / f"a{ending}")
    assert_shown(tmp_path / f"a{ending}", first=ORIGIN)


def test_scaled_and_compressed_images(tmp_path: Path) -> None:
    scaled = fits.PrimaryHDU(ell("f4"))
    scaled.scale("int16", bscale=0.5, bzero=3)
    cards(scaled).writeto(tmp_path / "a.fits")
    assert_shown(tmp_path / "a.fits", first=ORIGIN)
    packed = cards(fits.CompImageHDU(ell("i2"), name="SCI"))
    fits.HDUList([fits.PrimaryHDU(), packed]).writeto(tmp_path / "b.fits.fz")
    for array in (None, "SCI", "1"):
        assert_shown(tmp_path / "b.fits.fz", first=ORIGIN, array=array)
    assert open_bricks(tmp_path / "b.fits.fz") is None
    assert open_bricks(tmp_path / "a.fits") is not None


def test_cubes_of_the_sky_keep_the_order_of_their_pixels(tmp_path: Path) -> None:
    degrees = cards(
        fits.PrimaryHDU(np.stack([ell("f4"), 2 * ell("f4")])), (-2e-4, 2e-4, 3e6, 1.0), ("deg", "deg", "Hz", ""),
        ("RA---TAN", "DEC--TAN", "FREQ", "STOKES"),
    )  # fmt: skip
    degrees.writeto(tmp_path / "a.fits")
    with pytest.raises(BadInput, match="--channel"):
        read_here(tmp_path / "a.fits")
    assert_shown(tmp_path / "a.fits", UNIT, ORIGIN, factor=2.0, channel="1", says="units cannot be compared")
    cards(fits.PrimaryHDU(ell()[None]), (-2e-4, 2e-4, 1.0, 3e6), ("deg", "deg", "", "Hz")).writeto(tmp_path / "b.fits")
    assert_shown(tmp_path / "b.fits", UNIT, ORIGIN, says="units cannot be compared")
    between = np.expand_dims(ell(), 1)  # polarization before the frequency
    cards(fits.PrimaryHDU(between), (1, 1, 1, 1), ("pc", "pc", "", "pc"), ("X", "Y", "STOKES", "Z")).writeto(
        tmp_path / "c.fits"
    )
    assert_shown(tmp_path / "c.fits", UNIT, ORIGIN)
    fits.PrimaryHDU(ell()).writeto(tmp_path / "d.fits")
    assert_shown(tmp_path / "d.fits", UNIT, ORIGIN, says="no voxel size")


def test_blank_voxels_and_choices_are_told(tmp_path: Path) -> None:
    blank = fits.PrimaryHDU(ell("i2"))
    blank.header["BLANK"] = 0
    blank.writeto(tmp_path / "a.fits")
    assert f"at {(ell() == 0).sum()} voxels" in str(assumed_of(read_here(tmp_path / "a.fits")))
    fits.HDUList([fits.PrimaryHDU(ell()), fits.ImageHDU(ell(), name="ERR")]).writeto(tmp_path / "b.fits")
    with pytest.raises(BadInput, match="several cubes; images with three axes: PRIMARY, ERR"):
        read_here(tmp_path / "b.fits")
    fits.PrimaryHDU(ell()[0]).writeto(tmp_path / "c.fits")
    with pytest.raises(BadInput, match="no image with three axes"):
        read_here(tmp_path / "c.fits")
    values = ell()
    values[0, 0, 0] = np.nan
    fits.PrimaryHDU(values).writeto(tmp_path / "d.fits")
    assert "at 1 voxels" in str(assumed_of(read_here(tmp_path / "d.fits")))


def test_damaged_files_are_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "a.fits"
    cards(fits.PrimaryHDU(ell())).writeto(file)
    assert_cut_files_are_refused(file, places=9)  # what lies behind the values is padding
    assert_wrong_headers_are_refused(
        file,
        {
            b"NAXIS1  =                   22": b"NAXIS1  =                   99",
            b"NAXIS1  =                   2": b"NAXIS1  =                  -2",
            b"NAXIS2  =                   18": b"NAXIS2  =           9999999999",
            b"SIMPLE  ": b"COMPLEX ",
            b"BITPIX  =                  -32": b"BITPIX  =                  -33",
        },
    )
    packed = tmp_path / "b.fits.gz"
    packed.write_bytes(gzip.compress(file.read_bytes()))
    assert_cut_files_are_refused(packed, places=5)
