"""MetaImage files (``.mhd``, ``.mha``), as ITK reads them.

VTK and ParaView read many of them otherwise: the ``TransformMatrix`` not at all (ParaView 5.11) or transposed (VTK
9.7), ``MET_LONG`` with eight bytes instead of four, and volumes of several channels or time points as components.

SimpleITK, the reference in the tests, has 264 MB, and its ITK beside ParaView's own would be two in one process.

Source: https://itk.org/Wiki/ITK/MetaIO/Documentation, and the library MetaIO itself.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.mapped import MOST_HEADER
from svv.bricks.formats.stored import Stored, bad_header, damaged, numbered

META_TYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4", "MET_INT": "i4",
    "MET_ULONG_LONG": "u8", "MET_LONG_LONG": "i8", "MET_FLOAT": "f4", "MET_DOUBLE": "f8", "MET_ULONG": "u4",
    "MET_LONG": "i4", "MET_ASCII_CHAR": "i1",
}  # fmt: skip
"""Types of MetaImage files: a long has four bytes, wherever it was written."""


def meta_header(file: Path) -> Stored:
    """Read the header of a MetaImage file; raises BadInput if it is damaged."""
    with file.open("rb") as opened:
        head = opened.read(MOST_HEADER)
    # The last line of the header names the files with the data; in the same file, the data follows.
    end = re.search(rb"^[ \t]*ElementDataFile[ \t]*[=:][ \t]*(.*?)[ \t]*\r?(?:\n|\Z)", head, re.MULTILINE)
    if end is None:
        raise damaged(file)
    lines = head[: end.start()].decode("latin-1").splitlines()
    fields = {found[1]: found[2] for line in lines if (found := re.fullmatch(r"\s*(\w+)\s*[=:]\s*(.*?)\s*", line))}
    try:
        dims = [int(n) for n in fields["DimSize"].split()]
        channels = int(fields.get("ElementNumberOfChannels", "1"))
        if len(dims) not in (3, 4) or len(dims) != int(fields.get("NDims", len(dims))) or min(channels, *dims) < 1:
            raise ValueError("a volume needs three axes, and at most one for the time")
        files = _data_files(file, end[1].decode("latin-1"), head[end.end() :], dims)
        skipped = int(fields.get("HeaderSize", "0")) or (end.end() if files == (file,) else 0)
        steps = _numbers(fields, ("ElementSpacing", "ElementSize"), "1 " * len(dims), len(dims))
        identity = " ".join(str(int(x)) for x in np.eye(len(dims)).ravel())
        turned = _numbers(fields, ("TransformMatrix", "Rotation", "Orientation"), identity, len(dims) ** 2)
        origin = _numbers(fields, ("Origin", "Position", "Offset"), "0 " * len(dims), len(dims))
        order = ">" if _true(fields, ("BinaryDataByteOrderMSB", "ElementByteOrderMSB"), False) else "<"
        packed = "zlib" if _true(fields, ("CompressedData",), False) else "raw"
        encoding = packed if _true(fields, ("BinaryData",), True) else "text"
        kind = np.dtype(order + META_TYPES[fields["ElementType"].removesuffix("_ARRAY")])
    except (KeyError, ValueError, OverflowError) as error:
        raise bad_header(file, error) from error
    with np.errstate(all="ignore"):  # what is not finite is rejected later
        axes = turned.reshape(len(dims), -1)[:3, :3].T * steps[:3]  # rows of the matrix are the axes
    return Stored(
        file, files, kind, (*dims[::-1], *([channels] if channels > 1 else [])),
        ("tzyx" if len(dims) == 4 else "zyx") + ("c" if channels > 1 else ""), axes, origin[:3], "MetaImage",
        encoding, max(skipped, 0), offset=min(skipped, 0) and -1,
        is_sized=bool({"ElementSpacing", "ElementSize"} & set(fields)),
    )  # fmt: skip


def _data_files(file: Path, target: str, after: bytes, dims: Sequence[int]) -> tuple[Path, ...]:
    """Return the files with the values."""
    words = target.split()
    if target.upper() == "LOCAL":
        return (file,)
    if words and words[0] == "LIST":
        own = len(dims) - 1 if len(words) < 2 else int(words[1].rstrip("D"))
        count = int(np.prod(dims[own:], dtype=object))
        names = [line.strip() for line in after.decode("latin-1").splitlines() if line.strip()][:count]
        if len(names) != count:
            raise ValueError("the list of files is too short")
        return tuple(file.parent / name for name in names)
    if "%" in target:
        first, last, step = (int(n) for n in (*words[1:4], *("1", str(dims[-1]), "1")[len(words[1:4]) :]))
        return numbered(words[0], first, min(last, first + (dims[-1] - 1) * step), step, file.parent)
    return (file.parent / target,)


def _true(fields: Mapping[str, str], keys: Sequence[str], default: bool) -> bool:
    """Return a switch, which the first letter of its value decides."""
    text = next((fields[key] for key in keys if key in fields), "")
    return text[:1] in ("T", "t", "1") if text else default


def _numbers(fields: Mapping[str, str], keys: Sequence[str], default: str, count: int) -> NDArray[np.float64]:
    numbers = np.array([float(x) for x in next((fields[key] for key in keys if key in fields), default).split()])
    if len(numbers) != count:
        raise ValueError(f"{keys[0]} needs {count} numbers")
    return numbers
