"""MRtrix's images: ``.mif`` with values behind the header or beside it, ``.mih``, and ``.mif.gz``.

Coordinates are the file's scanner coordinates in mm: x to the right, y to the front and z upwards. No package on PyPI
reads the format, and its headers are a few lines of text.

Source: https://mrtrix.readthedocs.io/en/latest/getting_started/image_data.html.
"""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np

from svv.bricks.formats.mapped import MOST_HEADER
from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput


def mif_header(file: Path) -> Stored:
    """Read the header of an image of MRtrix.

    Raises BadInput if it is damaged, or its values are complex or single bits.
    """
    try:
        fields, packed = _fields(file)
        sizes = [int(size) for size in fields["dim"][0].split(",")]
        voxel = [float(size) for size in fields["vox"][0].split(",")]
        layout = [(word.strip()[0], int(word.strip()[1:])) for word in fields["layout"][0].split(",")]
        if len(voxel) != len(sizes) or sorted(place for _, place in layout) != list(range(len(sizes))):
            raise ValueError("the numbers of dim, vox and layout do not fit each other")
        kind = _kind(fields["datatype"][0], file)
        turn = np.array([[float(x) for x in row.split(",")] for row in fields.get("transform", [])][:3])
        turn = np.eye(3, 4) if turn.size == 0 else turn.reshape(3, 4)
        shift, gain = ([float(x) for x in fields.get("scaling", ["0,1"])[0].split(",")] + [1.0])[:2]
        name, _, start = fields["file"][0].partition(" ")
    except BadInput:
        raise
    except (KeyError, ValueError, IndexError) as error:
        raise bad_header(file, error) from error
    axes, origin = turn[:, :3] * voxel[:3] if len(voxel) > 2 else np.eye(3), turn[:, 3].copy()
    for k, (sign, _) in enumerate(layout[: len(axes)]):
        if sign == "-":  # the last voxel is stored first
            origin, axes[:, k] = origin + axes[:, k] * (sizes[k] - 1), -axes[:, k]
    slowest_first = sorted(range(len(sizes)), key=lambda k: -layout[k][1])
    names = "".join("xyzt"[k] if k < 4 else "?" for k in slowest_first)
    return Stored(
        file, (file if name == "." else file.parent / name,), kind, tuple(sizes[k] for k in slowest_first), names,
        axes, origin, file.name.partition(".")[0], "zlib" if packed else "raw", offset=int(start or 0), gain=gain,
        shift=shift,
    )  # fmt: skip


def _fields(file: Path) -> tuple[dict[str, list[str]], bool]:
    """Return the lines of a header by their keys, and whether the file is compressed."""
    with file.open("rb") as opened:
        packed = opened.read(2) == b"\x1f\x8b"
    with gzip.open(file) if packed else file.open("rb") as opened:
        head = opened.read(MOST_HEADER)
    text = re.match(rb"mrtrix image\r?\n(.*?)(?:\nEND\b|\n?\Z)", head, re.DOTALL)  # a header alone has no END
    if text is None:
        raise ValueError("it does not begin with 'mrtrix image'")
    fields: dict[str, list[str]] = {}
    for line in text[1].decode("utf-8", "replace").splitlines():
        key, _, value = line.partition(":")
        fields.setdefault(key.strip().lower(), []).append(value.strip())
    return fields, packed


def _kind(text: str, file: Path) -> np.dtype[np.generic]:
    """Return the type of the values."""
    found = re.fullmatch(r"(u?int|float)(8|16|32|64)(le|be)?", text.strip().lower())
    if found is None:
        raise BadInput(
            f"{file.name} contains values of the type {text}; a volume needs one real number per voxel, such as those "
            "of mrconvert -datatype float32."
        )
    kind = np.dtype(f"{found[1]}{found[2]}")
    return kind.newbyteorder(">") if found[3] == "be" else kind.newbyteorder("<") if found[3] == "le" else kind
