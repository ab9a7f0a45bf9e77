"""Plotfiles of AMReX and BoxLib (Nyx, Castro, WarpX, Pele ...): folders, read by VTK after a look at their headers.

VTK's reader believes what headers say, and ends the process on some that are damaged.

Source: https://amrex-codes.github.io/amrex/docs_html/IO.html.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm

from svv.errors import BadInput

MAGIC = b"HyperCLaw"
"""With what the file ``Header`` begins."""

BOX = r"\(\((-?\d+),(-?\d+),(-?\d+)\) \((-?\d+),(-?\d+),(-?\d+)\)"
"""Pattern of a box of cells: its first and its last one."""


def is_plotfile(path: Path) -> bool:
    """Return whether a folder is a plotfile."""
    header = path / "Header"
    if not header.is_file():
        return False
    with header.open("rb") as opened:
        return opened.read(len(MAGIC)) == MAGIC


def plotfile_reader(path: Path) -> vtkAlgorithm:
    """Return VTK's reader of a plotfile, which gives all its levels and arrays.

    Raises BadInput if it is damaged, has a file less than it says, or fewer than three dimensions.
    """
    from vtkmodules.vtkIOAMR import vtkAMReXGridReader

    try:
        names, levels = _checked(path)
    except (ValueError, IndexError, OSError) as error:
        raise BadInput(f"Cannot read {path}: it is damaged or incomplete ({error}).") from error
    reader = vtkAMReXGridReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetMaxLevel(levels)
    for name in names:
        reader.SetCellArrayStatus(name, 1)
    return reader


def _checked(path: Path) -> tuple[list[str], int]:
    """Return the names of the arrays and the number of levels, after a look at all headers and the sizes of all files.

    Raises:
        ValueError, IndexError, OSError: They do not fit each other.
    """
    lines = (path / "Header").read_text("latin-1").splitlines()
    count = int(lines[1])
    names, (dimensions, _, finest) = lines[2 : 2 + count], lines[2 + count : 5 + count]
    groups = [line for line in lines[5 + count :] if re.fullmatch(r"\S+/\S+", line)]
    if int(dimensions) != 3:
        raise ValueError(f"it has {int(dimensions)} dimensions, not 3")
    if count < 1 or len(names) != count or len(groups) != int(finest) + 1:
        raise ValueError("its header breaks off")
    for group in groups:
        about = path / f"{group}_H"
        told = about.read_text("latin-1")
        cells = [np.array(box, np.int64).reshape(2, 3) for box in re.findall(BOX, told)]
        files = re.findall(r"FabOnDisk:\s*(\S+)\s+(\d+)", told)
        if not files or len(files) != len(cells):
            raise ValueError(f"{group}_H breaks off")
        for (name, start), (first, last) in zip(files, cells):
            needed = int(start) + count * int(np.prod(last - first + 1, dtype=object)) * 4  # at least: single precision
            if (last < first).any() or (about.parent / name).stat().st_size < needed:
                raise ValueError(f"{name} is shorter than {group}_H says")
    return names, len(groups)
