"""Volumes of VolVis (``.slc``): 8 bits, as they are or run-length encoded slice by slice.

The usual encoder stops one voxel before the end of a slice, for which VTK's reader returns whatever was in memory.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.bricks.formats.stored import damaged
from svv.dvr.read.grids import from_array
from svv.dvr.read.vtk_readers import check_memory
from svv.errors import BadInput

HEADER = re.compile(rb"\s*11111" + 3 * rb"\s+(\d+)" + rb"\s+(\d+)" + 3 * rb"\s+([-+.\deE]+)" + 3 * rb"\s+[-+]?\d+"
                    + rb"\s+(\d+)\s+(\d+)\s+(\d+)\s*X")  # fmt: skip
"""Number of the format; voxels along x, y, z; bits; spacing; unit, origin and modification, which are not used;
compression; width and height of a picture in red, green and blue, which follows."""

ENCODED = re.compile(rb"\s*(\d+)\s*X")
"""Bytes of an encoded slice, which follow."""


def read_slc(file: Path) -> vtkImageData:
    """Read a volume of VolVis, if a slice lacks its last voxel with the one before it; or raise BadInput."""
    content = file.read_bytes()
    head = HEADER.match(content)
    if head is None:
        raise damaged(file)
    x, y, z, bits, compression, width, height = map(int, head.group(1, 2, 3, 4, 8, 9, 10))
    if bits != 8 or compression > 1:
        raise BadInput(
            f"{file} has {bits} bits per voxel and compression {compression}, but .slc volumes are read with 8 bits "
            "and compression 0 or 1 only: convert it to .nrrd or .vti with the program that it comes from."
        )
    if 0 in (x, y, z):
        raise damaged(file)
    check_memory((x, y, z), 1, file)
    at, count = head.end() + 3 * width * height, x * y
    if not compression:
        if len(content) < at + count * z:
            raise damaged(file)
        values = np.frombuffer(content, np.uint8, count * z, at).copy()
    else:
        values = np.empty(count * z, np.uint8)
        for start in range(0, len(values), count):
            size = ENCODED.match(content, at)
            if size is None or size.end() + int(size[1]) > len(content):
                raise damaged(file)
            at = size.end() + int(size[1])
            found = _decoded(content[size.end() : at])
            if not 0 <= count - len(found) <= 1 or not found.size:
                raise damaged(file)
            values[start : start + count] = np.pad(found, (0, count - len(found)), mode="edge")
    try:
        spacing = tuple(map(float, head.group(5, 6, 7)))
    except ValueError:
        raise damaged(file) from None
    return from_array(values.reshape(z, y, x), spacing, name="SLCImage")


def _decoded(encoded: bytes) -> NDArray[np.uint8]:
    """Return the values of a slice: parts of up to 127, each after its length, as they are (128 added) or repeated."""
    values, at = bytearray(), 0
    while at < len(encoded) and (count := encoded[at] & 127):
        repeats = encoded[at] < 128
        values += encoded[at + 1 : at + 2] * count if repeats else encoded[at + 1 : at + 1 + count]
        at += 2 if repeats else 1 + count
    return np.frombuffer(bytes(values), np.uint8)
