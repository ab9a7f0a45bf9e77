"""NIfTI files, versions 1 and 2, compressed or not, in one file (``.nii``) or two (``.hdr`` and ``.img``).

Coordinates are the file's: x to the right, y to the front and z upwards, by its sform, otherwise its qform.

nibabel, the reference in the tests, is not in ParaView's Python; it raises errors of several kinds for damaged files,
allocates what a header declares, and places images at NaN without a word.

Source: https://nifti.nimh.nih.gov/nifti-1, https://nifti.nimh.nih.gov/nifti-2.
"""

from __future__ import annotations

import gzip
import sys
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.stored import Stored, damaged
from svv.errors import BadInput

TYPES = {2: "u1", 4: "i2", 8: "i4", 16: "f4", 64: "f8", 256: "i1", 512: "u2", 768: "u4", 1024: "i8", 1280: "u8"}
"""NumPy types of the codes for real numbers."""

OTHERS = {1: "bits", 32: "complex", 128: "RGB", 1536: "128-bit", 1792: "complex", 2048: "complex", 2304: "RGBA"}
"""Codes of other types of values."""

FIRST = np.dtype(
    {
        "names": ["dim", "kind", "pixdim", "offset", "slope", "shift", "qform", "sform", "quatern", "moved", "rows"],
        "formats": ["8i2", "i2", "8f4", "f4", "f4", "f4", "i2", "i2", "3f4", "3f4", "(3,4)f4"],
        "offsets": [40, 70, 76, 108, 112, 116, 252, 254, 256, 268, 280],
        "itemsize": 348,
    }
)
"""Fields of the header of version 1."""

SECOND = np.dtype(
    {
        "names": ["dim", "kind", "pixdim", "offset", "slope", "shift", "qform", "sform", "quatern", "moved", "rows"],
        "formats": ["8i8", "i2", "8f8", "i8", "f8", "f8", "i4", "i4", "3f8", "3f8", "(3,4)f8"],
        "offsets": [16, 12, 104, 168, 176, 184, 344, 348, 352, 376, 400],
        "itemsize": 540,
    }
)
"""Fields of the header of version 2."""


def nifti_header(file: Path) -> Stored:
    """Read the header of a NIfTI file; raises BadInput if it is damaged, or its values are no real numbers."""
    head_file, data_file = _files(file)
    with head_file.open("rb") as opened:
        packed = opened.read(2) == b"\x1f\x8b"
    try:
        with gzip.open(head_file) if packed else head_file.open("rb") as opened:
            head = opened.read(540)
    except (OSError, EOFError, zlib.error) as error:
        raise damaged(file) from error
    order = next((o for o in "<>" if np.frombuffer(head[:4], o + "i4", 1)[:1].tolist() in ([348], [540])), None) if (
        len(head) >= 348
    ) else None  # fmt: skip
    if order is None and head.startswith(b"ENVI"):
        raise BadInput(
            f"{file} is a header of ENVI: name the file with the values, with --dims, --dtype and --spacing."
        )
    if order is None:
        raise damaged(file)
    layout = FIRST if np.frombuffer(head[:4], order + "i4")[0] == 348 else SECOND
    magic = head[344:347] if layout is FIRST else head[4:7]
    if layout is FIRST and magic == bytes(3) and head_file != data_file:
        raise BadInput(
            f"{file} is an Analyze 7.5 file, which does not say which of its sides is left: convert it to NIfTI first, "
            "such as with nibabel or SPM."
        )
    if len(head) < layout.itemsize or magic not in (b"n+1", b"ni1", b"n+2", b"ni2"):
        raise damaged(file)
    turned = layout if order == ("<" if sys.byteorder == "little" else ">") else layout.newbyteorder("S")
    read = np.frombuffer(head[: layout.itemsize], turned)[0]
    return _described(file, data_file if magic[1:2] == b"i" else head_file, read, order, packed)


def _files(file: Path) -> tuple[Path, Path]:
    """Return the file with the header and the file with the values, which may be the same."""
    name = file.name
    for pair in ((".hdr", ".img"), (".HDR", ".IMG")):
        for ending in pair:
            base = name.removesuffix(".gz")
            if base.endswith(ending):
                packed = name[len(base) :]
                stem = base.removesuffix(ending)
                return tuple(file.with_name(stem + one + packed) for one in pair)  # type: ignore[return-value]
    return file, file


def _described(file: Path, data: Path, read: np.void, order: str, packed: bool) -> Stored:
    dims = [int(n) for n in read["dim"]]
    code = int(read["kind"])
    if code in OTHERS:
        raise BadInput(f"{file.name} contains {OTHERS[code]} values; a volume needs one real number per voxel.")
    shape = dims[1 : dims[0] + 1]
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    if not 1 <= dims[0] <= 7 or code not in TYPES or min(shape) < 1:
        raise damaged(file)
    names = "xyzt?"[: len(shape)] if len(shape) < 5 else "xyztc" + "abdefg"[: len(shape) - 5]
    slope, shift = float(read["slope"]), float(read["shift"])
    if not np.isfinite(slope) or slope == 0.0:
        slope, shift = 1.0, 0.0
    if not np.isfinite(shift):
        raise BadInput(f"{file.name} has a slope of {slope:g}, but its intercept is no number: it is damaged.")
    start = float(read["offset"])
    if not 0 <= start < 2**62:
        raise damaged(file)
    axes, origin = _placed(read)
    return Stored(
        file, (data,), np.dtype(order + TYPES[code]), tuple(shape[::-1]), names[::-1], axes, origin, "NIFTI",
        "zlib" if packed else "raw", 0, 0, int(start), slope, shift,
        is_sized=bool(read["sform"] > 0 or read["pixdim"][1:4].any()),
    )  # fmt: skip


def _placed(read: np.void) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the steps between voxels (3, 3) and the position of the first (3,)."""
    pixels = read["pixdim"].astype(np.float64)
    if read["sform"] > 0:
        rows = read["rows"].astype(np.float64)
        return rows[:, :3], rows[:, 3]
    sizes = np.where(pixels[1:4] == 0, 1.0, np.abs(pixels[1:4]))
    if read["qform"] > 0:
        b, c, d = (float(x) for x in read["quatern"])
        a = np.sqrt(max(0.0, 1.0 - b * b - c * c - d * d))
        turned = np.array(
            [
                [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
                [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
                [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
            ]
        )
        flip = -1.0 if pixels[0] < 0 else 1.0
        return turned * (sizes * [1.0, 1.0, flip]), read["moved"].astype(np.float64)
    return np.diag(sizes), np.zeros(3)
