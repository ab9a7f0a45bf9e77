"""MRC and CCP4 maps of electron microscopy, by mrcfile's reading of the header; the values are mapped into memory.

World units are ångström. Columns, rows and sections are put on the axes that the header names (MAPC, MAPR, MAPS), which
VTK's and SimpleITK's readers do not do. The first voxel lies at ORIGIN or, if that is 0, at NXSTART voxels, as ChimeraX
places maps; VTK adds the two.

Source: https://www.ccpem.ac.uk/mrc_format/mrc2014.php.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.chunked import package
from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput

LENGTH = 1024
"""Bytes of the header, without its extension."""


def mrc_header(file: Path) -> Stored:
    """Read the header of an MRC or CCP4 file, compressed or not.

    Raises BadInput if it is damaged, its values are complex or of 4 bits, or mrcfile is not installed.
    """
    mrcfile = package("mrcfile", file)
    try:
        with mrcfile.open(str(file), permissive=True, header_only=True) as opened:
            head = opened.header
        if bytes(head.map) != b"MAP ":
            raise ValueError("the letters MAP are not in their place")
        kind, shape = mrcfile.utils.data_dtype_from_header(head), mrcfile.utils.data_shape_from_header(head)
        extended, order = int(head.nsymbt), [int(head.mapc), int(head.mapr), int(head.maps)]
        if sorted(order) != [1, 2, 3] or min(shape, default=0) < 1 or extended < 0:
            raise ValueError("its sizes or axes are no sizes or axes")
        axes, origin, is_sized = _placed(head, order, file.name)
    except BadInput:
        raise
    except Exception as error:  # a damaged file makes mrcfile raise all kinds of errors
        raise bad_header(file, ValueError(str(error).strip(". "))) from error
    if kind.kind not in "iuf":
        raise BadInput(f"{file.name} contains complex values; a volume needs one real number per voxel.")
    names = "".join("xyz"[axis - 1] for axis in reversed(order))
    with file.open("rb") as begun:
        magic = begun.read(3)
    packing = "zlib" if magic[:2] == b"\x1f\x8b" else "bz2" if magic == b"BZh" else "raw"
    return Stored(
        file, (file,), kind, tuple(shape), "t" * (len(shape) - 3) + names[-len(shape) :], axes, origin, file.stem,
        packing, offset=LENGTH + extended, is_sized=is_sized,
    )  # fmt: skip


def _placed(head: Any, order: list[int], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64], bool]:
    """Return the steps between voxels (3, 3), the position of the first (3,), and whether the header has sizes."""
    cell = np.array([head.cella.x, head.cella.y, head.cella.z], np.float64)
    counts = np.array([head.mx, head.my, head.mz], np.float64)
    is_sized = bool((cell > 0).all() and (counts > 0).all())
    sizes = cell / counts if is_sized else np.ones(3)
    angles = {float(head.cellb.alpha), float(head.cellb.beta), float(head.cellb.gamma)}
    if angles != {0.0} and not all(abs(angle - 90.0) < 1e-3 for angle in angles):
        raise BadInput(
            f"{name} has a cell whose axes are not perpendicular (a sheared grid); resample it first, such as by vop "
            "resample in ChimeraX."
        )
    origin = np.array([head.origin.x, head.origin.y, head.origin.z], np.float64)
    if not origin.any():
        starts = np.zeros(3)
        starts[np.array(order) - 1] = head.nxstart, head.nystart, head.nzstart
        origin = sizes * starts
    if not (np.isfinite(sizes).all() and np.isfinite(origin).all()):
        raise ValueError("its cell or origin is no number")
    return np.diag(sizes), origin, is_sized
