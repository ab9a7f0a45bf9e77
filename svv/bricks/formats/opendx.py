"""OpenDX files (``.dx``) of electrostatics and molecular dynamics, as APBS, VMD and GridDataFormats write them: text.

Source: https://apbs.readthedocs.io/en/latest/formats/opendx.html.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from svv.bricks.formats.mapped import MOST_HEADER
from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput

NUMBER = rb"([-+\d.eE]+)"

VALUES = rb"class\s+array\s+type\s+\"?\w+\"?\s+rank\s+0\s+items\s+(\d+)\s+data\s+follows[^\n]*\n"
"""Pattern of the line before the values, with their number."""


def dx_header(file: Path) -> Stored:
    """Read the header of an OpenDX file; z varies fastest, and world units are the program's, usually ångström.

    Raises BadInput if it is damaged, or holds no regular grid of numbers as text.
    """
    with file.open("rb") as opened:
        head = opened.read(MOST_HEADER)
    follows = re.search(VALUES, head)
    counts = re.search(rb"class\s+gridpositions\s+counts\s+(\d+)\s+(\d+)\s+(\d+)", head)
    if follows is None or counts is None:
        raise BadInput(f"{file} holds no regular grid of numbers in OpenDX's text format.")
    try:
        sides = tuple(int(side) for side in counts.groups())
        place = re.search(rb"(?m)^\s*origin\s+" + rb"\s+".join([NUMBER] * 3), head)
        steps = re.findall(rb"(?m)^\s*delta\s+" + rb"\s+".join([NUMBER] * 3), head)[:3]
        if place is None or len(steps) != 3 or int(follows[1]) != np.prod(sides, dtype=object):
            raise ValueError("its counts, origin and deltas do not fit each other")
        axes = np.array([[float(x) for x in step] for step in steps]).T
        origin = np.array([float(x) for x in place.groups()])
    except ValueError as error:
        raise bad_header(file, error) from error
    return Stored(
        file, (file,), np.dtype(np.float64), sides, "xyz", axes, origin, file.stem, "text", start=follows.end()
    )
