"""What files declare is checked before memory is allocated for it."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput
from svv.io.files.memory import memory_there

MOST_NUMBERS = 1 << 16
"""Most numbers of an array that describes others."""

FEW_PIXELS = 1 << 22
"""Pixels of a picture that any number of bytes may have."""

MOST_INFLATED = 1032
"""Largest factor by which deflate can shrink."""


def check_fits(declared: int, what: str) -> None:
    """Raise BadInput if ``what`` declares more bytes than memory can hold."""
    if declared > memory_there():
        raise BadInput(
            f"{what} declares {declared / 1e9:.3g} GB, more than this computer's (or this container's) memory can "
            "hold: it is damaged, or needs more memory."
        )


def check_pixels(path: Path, width: int, height: int) -> None:
    """Raise BadInput if a picture has fewer bytes than any picture of so many pixels that shows something.

    Eight pixels of one bit to a byte, deflated as far as can be, are the densest that formats have in practice; only
    pictures of one colour, and headers that lie, have less. Small pictures may.
    """
    there = path.stat().st_size
    if width * height > max(FEW_PIXELS, 8 * MOST_INFLATED * there):
        raise BadInput(
            f"The picture {path} says that it has {width} x {height} pixels, but it has {there} bytes: it is damaged, "
            "or shows nothing; save it again."
        )


def arrays_of_npz(
    file: BinaryIO, names: Sequence[str], optional: Sequence[str], large: Sequence[str], what: str
) -> dict[str, NDArray[Any]]:
    """Read arrays of an open ``.npz`` file, after their headers were compared with the sizes of the archive's members.

    Only ``large`` ones may have more than :data:`MOST_NUMBERS` numbers; ``what`` is the file's name in messages. Raises
    BadInput if the arrays would not fit into memory, ValueError or KeyError if one is missing or not what its header
    says. NumPy and zipfile raise more kinds.
    """
    with zipfile.ZipFile(file) as archive:
        there = {info.filename: info for info in archive.infolist()}
        members = [f"{name}.npy" for name in (*names, *(name for name in optional if f"{name}.npy" in there))]
        sizes = [there[member].file_size for member in members]
        check_fits(sum(sizes), what)
        packed = file.seek(0, io.SEEK_END)
        if any(size > MOST_INFLATED * packed for size in sizes):
            raise ValueError("an array is larger than its file can hold")
        found = {}
        for member in members:
            with archive.open(there[member]) as opened:
                version = np.lib.format.read_magic(opened)
                reader = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
                shape, _, kind = reader[version](opened)
                count = int(np.prod(shape, dtype=object)) * kind.itemsize
                if kind.hasobject or min(shape, default=0) < 0 or opened.tell() + count != there[member].file_size:
                    raise ValueError(f"{member} is not what its header says")
                if count > MOST_NUMBERS * kind.itemsize and member.removesuffix(".npy") not in large:
                    raise ValueError(f"{member} has too many numbers")
            with archive.open(there[member]) as opened:
                found[member.removesuffix(".npy")] = np.lib.format.read_array(opened, allow_pickle=False)
        return found
