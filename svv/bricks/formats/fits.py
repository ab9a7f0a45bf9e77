"""FITS cubes of astronomy, by astropy: scaled values, also compressed or with unsigned integers.

The volume shows pixels in the order in which viewers of FITS files show them: the first at the left. Right ascension,
which rises to the left, is therefore not turned. Voxels have the header's sizes if all three axes have one unit, such
as in simulations; degrees and hertz make no place: each step counts as 1 then.

Source: https://fits.gsfc.nasa.gov/fits_standard.html.
"""

from __future__ import annotations

import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.axes import Choice, picked, unit_of
from svv.bricks.formats.chunked import ChunkedSource, package
from svv.bricks.formats.mapped import too_short
from svv.bricks.formats.places import no_size
from svv.bricks.formats.source import level_of
from svv.bricks.formats.stored import too_large
from svv.errors import BadInput
from svv.io.files.memory import memory_there

TYPES = {8: "|u1", 16: ">i2", 32: ">i4", 64: ">i8", -32: ">f4", -64: ">f8"}
"""Types of the values as stored, by BITPIX."""


def open_fits(
    file: Path,
    choice: Choice = Choice(),  # noqa: B008 - frozen
    array: str | None = None,
    whole: bool = False,
) -> ChunkedSource | None:
    """Open a cube of a FITS file; by default the only one with three axes.

    Args:
        file: The file, which may be compressed.
        choice: The polarization (Stokes parameter) that is shown, as a channel.
        array: Name or number of an extension (HDU).
        whole: Decode it if it is compressed.

    Returns:
        The volume; None if it is compressed and ``whole`` is not set.

    Raises:
        BadInput: It is damaged, has no or several cubes, one with blank voxels, or astropy is not installed.
    """
    fits = package("astropy.io.fits", file)
    try:
        with warnings.catch_warnings():  # headers of telescopes seldom follow the standard in all
            warnings.simplefilter("ignore")
            with fits.open(file, memmap=True, do_not_scale_image_data=True) as opened:
                found = {
                    (one.name or str(k), str(k)): one for k, one in enumerate(opened)
                    if one.is_image and sum(int(side) > 1 for side in one.shape) >= 3
                }  # fmt: skip
                shown = [one for names, one in found.items() if array is None or array in names]
                if len(shown) != 1:
                    asked = f"no cube '{array}'" if array else "several cubes" if shown else "no image with three axes"
                    listed = ", ".join(name for name, _ in found) or "none"
                    raise BadInput(f"{file} has {asked}; images with three axes: {listed}. Choose one with --array.")
                values = _values(file, shown[0], isinstance(shown[0], fits.CompImageHDU), whole)
                return None if values is None else _cube(file, shown[0].header, values, choice)
    except BadInput:
        raise
    except Exception as error:  # a damaged file makes astropy raise all kinds of errors
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or not a FITS file.") from error


def _values(file: Path, hdu: Any, is_packed: bool, whole: bool) -> NDArray[np.generic] | None:
    """Return the values as stored, mapped into memory if they can be; None if they cannot and need not be read."""
    shape, kind = tuple(int(side) for side in hdu.shape), np.dtype(TYPES[int(hdu.header["BITPIX"])])
    needed = int(np.prod(shape, dtype=object)) * kind.itemsize
    with file.open("rb") as begun:
        is_plain = not is_packed and begun.read(6) == b"SIMPLE"
    if is_plain:
        start, there = int(hdu.fileinfo()["datLoc"]), file.stat().st_size
        if there < start + needed:
            raise too_short(file, there, start + needed, shape[::-1], kind)
        return np.memmap(file, kind, "r", start, shape)
    if not whole:
        return None
    if needed > memory_there():
        raise too_large(file, shape[::-1])
    return np.asarray(hdu.data)


def _cube(file: Path, head: Any, values: NDArray[np.generic], choice: Choice) -> ChunkedSource:
    shape, wide = values.shape, iter("xyz")  # the first three axes of the file with several pixels
    names = [
        "c" if str(head.get(f"CTYPE{k}", "")).upper().startswith("STOKES") else next(wide, "t") if side > 1 else "?"
        for k, side in enumerate(shape[::-1], 1)
    ]  # fmt: skip
    steps = {name: float(head.get(f"CDELT{k}", head.get(f"CD{k}_{k}", 1.0))) for k, name in enumerate(names, 1)}
    units = {unit_of(str(head.get(f"CUNIT{k}", ""))) for k, name in enumerate(names, 1) if name in "xyz"}
    pick = picked(names[::-1], shape, choice, file.name)
    sizes = np.array([abs(steps.get(name, 1.0)) for name in "xyz"])
    is_told = any(f"{key}{k}" in head for k in (1, 2, 3) for key in ("CDELT", f"CD{k}_"))
    is_sized = len(units) == 1 and (sizes > 0).all() and is_told
    level = level_of(pick.sides(shape), np.diag(sizes if is_sized else np.ones(3)), np.zeros(3), file.name)
    said = f"{file.name} has axes whose units cannot be compared: each step counts as 1."
    said = said if is_told else no_size(file.name)
    told: dict[str, float] = {
        "scale_factor": float(head.get("BSCALE", 1.0)),
        "add_offset": float(head.get("BZERO", 0.0)),
    }
    if values.dtype.kind in "iu" and "BLANK" in head:
        told["missing_value"] = int(head["BLANK"])
    return ChunkedSource(
        file.name, [partial(pick.box, values)], values.dtype, [level], told, assumed=None if is_sized else said
    )
