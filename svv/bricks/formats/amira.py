"""AmiraMesh files (``.am``) of Amira and Avizo: uniform lattices, stored as they are, in zlib, run lengths or text.

The bounding box runs from the first voxel's centre to the last one's; the matrix moves it, as in Amira.
ahds, the only reader on PyPI, does not import with NumPy 2.

Source: Amira's user guide, "AmiraMesh format".
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from svv.bricks.formats.mapped import MOST_HEADER
from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput

TYPES = {
    "byte": "u1", "sbyte": "i1", "ushort": "u2", "short": "i2", "int": "i4", "int32": "i4", "float": "f4",
    "double": "f8",
}  # fmt: skip
"""Types of lattices."""

PACKINGS = {"": "raw", "HxZip": "zlib", "HxByteRLE": "runs"}
"""Our names of the ways in which values are packed."""

LATTICE = r"(?m)^\s*Lattice\s*\{\s*(\w+)(?:\[(\d+)\])?\s+(\w+)\s*\}\s*=?\s*@(\d+)(?:\((\w+),\s*\d+\))?"
"""Pattern of the line that tells type, components, name and place of the values, and how they are packed."""


def am_header(file: Path) -> Stored:
    """Read the header of an AmiraMesh file.

    Raises BadInput if it is damaged, holds no lattice, or one whose points are not evenly spaced.
    """
    with file.open("rb") as opened:
        head = opened.read(MOST_HEADER)
    text = head.decode("latin-1")
    magic = re.match(r"#\s*(?:AmiraMesh|Avizo)(?:\s+3D)?\s+(BINARY(?:-LITTLE-ENDIAN)?|ASCII)", text)
    lattice = re.search(r"(?m)^\s*define\s+Lattice\s+(\d+)\s+(\d+)\s+(\d+)", text)
    values = re.search(LATTICE, text)
    if magic is None or lattice is None or values is None:
        raise BadInput(f"{file} holds no lattice of values of Amira or Avizo.")
    if (grid := re.search(r'CoordType\s+"(\w+)"', text)) and grid[1] != "uniform":
        raise BadInput(f"{file} has {grid[1]} coordinates: resample it to uniform ones in Amira first.")
    begin = re.search(rf"(?m)^@{values[4]}[ \t]*\r?\n".encode(), head[values.end() :])
    try:
        if begin is None:
            raise ValueError("its values are missing")
        kind = np.dtype(TYPES[values[1].lower()])
        kind = kind.newbyteorder("<" if magic[1].endswith("LITTLE-ENDIAN") else ">")
        packing = "text" if magic[1] == "ASCII" else PACKINGS[values[5] or ""]
        if packing == "runs" and kind.itemsize > 1:
            raise BadInput(f"{file} packs {values[1]} values by runs of bytes: save it uncompressed.")
        sides, each = [int(side) for side in lattice.groups()], int(values[2] or 1)
        box = re.search(r"BoundingBox\s+([-+\d.eE \t]+)", text)
        ends = np.array([float(x) for x in box[1].split()] if box else [0.0] * 6).reshape(3, 2)
        told = re.search(r"TransformationMatrix\s+([-+\d.eE \t]+)", text)
        turn = np.array([float(x) for x in told[1].split()] if told else np.eye(4)).reshape(4, 4).T
    except (KeyError, ValueError) as error:
        raise bad_header(file, error) from error
    step = (ends[:, 1] - ends[:, 0]) / np.maximum(np.array(sides) - 1, 1) if box else np.ones(3)
    begins = values.end() + begin.end()
    return Stored(
        file, (file,), kind, (*sides[::-1], *([each] if each > 1 else [])), "zyxc" if each > 1 else "zyx",
        turn[:3, :3] * step, turn[:3, :3] @ ends[:, 0] + turn[:3, 3], values[3], packing,
        begins, is_sized=box is not None,
    )  # fmt: skip
