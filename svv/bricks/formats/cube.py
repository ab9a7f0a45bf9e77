"""Gaussian cube files: densities and orbitals of quantum chemistry.

World units are those of the file: bohr, or ångström if the numbers of voxels are negative. VTK's reader gives the
atoms, and the voxels as a second output without their sizes and places.

Source: https://gaussian.com/cubegen.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np

from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput

MOST_ATOMS = 1_000_000
"""Largest number of atoms, and of orbitals, that is believed."""


def cube_header(file: Path) -> Stored:
    """Read the header of a Gaussian cube file; raises BadInput if it is damaged."""
    try:
        with file.open("rb") as opened:
            lines = (opened.readline(4096).decode("latin-1") for _ in iter(int, 1))
            first = [line.split() for line in islice(lines, 2, 6)]
            atoms, each = int(first[0][0]), int(first[0][4]) if len(first[0]) > 4 else 1
            origin = np.array([float(x) for x in first[0][1:4]])
            sides = [int(line[0]) for line in first[1:]]
            axes = np.array([[float(x) for x in line[1:4]] for line in first[1:]]).T
            if origin.shape != (3,) or axes.shape != (3, 3) or abs(atoms) > MOST_ATOMS or not 0 < each <= MOST_ATOMS:
                raise ValueError("it needs an origin and three axes")
            count, channels = 6 + abs(atoms), tuple[str, ...]()
            for _ in islice(lines, abs(atoms)):
                pass
            if atoms < 0:  # what the values of a voxel are: a number and as many orbitals, in lines of ten
                words: list[str] = []
                while not words or len(words) <= int(words[0]) <= MOST_ATOMS:
                    line = next(lines)
                    if not line:
                        raise ValueError("it ends before its values")
                    words, count = [*words, *line.split()], count + 1
                each, channels = int(words[0]), tuple(f"orbital {word}" for word in words[1:])
    except (ValueError, IndexError) as error:
        raise bad_header(file, error) from error
    if 0 in sides or not 0 < each <= MOST_ATOMS:
        raise BadInput(f"Cannot read {file}: its header gives no voxels.")
    shape = tuple(abs(side) for side in sides)
    return Stored(
        file, (file,), np.dtype(np.float64), (*shape, each) if each > 1 else shape, "xyzc" if each > 1 else "xyz", axes,
        origin, "cube", "fortran", lines=count, channels=channels if each > 1 else (),
    )  # fmt: skip
