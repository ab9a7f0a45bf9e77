"""NRRD files (``.nrrd``, ``.nhdr``) of every encoding, with one or several data files.

Coordinates are those of the file: a right-anterior-superior space stays one, as in ParaView (ITK turns it).

pynrrd, the reference in the tests, is not in ParaView's Python, and maps nothing: it reads all values into memory.

Source: https://teem.sourceforge.net/nrrd/format.html.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.axes import in_one_unit
from svv.bricks.formats.mapped import MOST_HEADER
from svv.bricks.formats.stored import Stored, bad_header, damaged, numbered
from svv.errors import BadInput

TYPES = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **dict.fromkeys(("short", "short int", "signed short", "signed short int", "int16", "int16_t"), "i2"),
    **dict.fromkeys(("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"), "u2"),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t"), "i4"),
    **dict.fromkeys(("uint", "unsigned int", "uint32", "uint32_t"), "u4"),
    **dict.fromkeys(("longlong", "long long", "long long int", "signed long long", "signed long long int"), "i8"),
    **dict.fromkeys(("int64", "int64_t"), "i8"),
    **dict.fromkeys(("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"), "u8"),
    "float": "f4",
    "double": "f8",
}
"""Types of NRRD files."""

ENCODINGS = {
    "raw": "raw", "txt": "text", "text": "text", "ascii": "text", "hex": "hex", "gz": "zlib", "gzip": "zlib",
    "bz2": "bz2", "bzip2": "bz2",
}  # fmt: skip
"""Our names of the encodings."""

COLOURS = ("color", "vector", "matrix", "complex", "quaternion", "gradient", "normal")
"""Words in the kinds of axes along which one sample has several numbers."""


def nrrd_header(file: Path) -> Stored:
    """Read the header of an NRRD file; raises BadInput if it is damaged, or describes no volume."""
    fields, files_listed, end = _fields(file)
    try:
        sizes = [int(size) for size in fields["sizes"].split()]
        if len(sizes) != int(fields["dimension"]) or min(sizes) < 1:
            raise ValueError("the number of sizes is not the dimension")
        kind, encoding = np.dtype(TYPES[fields["type"].lower()]), ENCODINGS[fields["encoding"].lower()]
        if encoding not in ("text",) and kind.itemsize > 1:
            kind = np.dtype({"little": "<", "big": ">"}[fields.get("endian", "little").lower()] + kind.str[1:])
        names = _names(fields, sizes)
        space = [axis for axis, name in enumerate(names) if name in "xyz"]
        axes, origin = _geometry(fields, space, sizes, file)
        files = _data_files(file, fields.get("data file"), files_listed, sizes)
        lines, skip = int(fields.get("line skip", "0")), int(fields.get("byte skip", "0"))
        if lines < 0 or (skip < 0 and encoding != "raw"):
            raise ValueError("only raw data can be skipped from the end")
    except BadInput:
        raise
    except (KeyError, ValueError, IndexError, OverflowError) as error:
        raise bad_header(file, error) from error
    return Stored(
        file, files, kind, tuple(sizes[::-1]), "".join(names[::-1]), axes, origin, "NRRD", encoding,
        end if files == (file,) else 0, lines, skip,
        is_sized=any(fields.get(key) for key in ("space directions", "spacings", "axis maxs")),
    )  # fmt: skip


def _fields(file: Path) -> tuple[dict[str, str], list[str], int]:
    """Return the fields of a header, the lines after ``data file: LIST``, and the position at which the header ends.

    Raises BadInput if it is not the text of a header.
    """
    with file.open("rb") as opened:
        head = opened.read(MOST_HEADER)
    blank = re.search(rb"\r?\n\r?\n", head)
    text = head[: blank.start() if blank else len(head)]
    if not head.startswith(b"NRRD") or re.search(rb"[\0-\x08\x0b\x0c\x0e-\x1f]", text):
        raise damaged(file)
    fields: dict[str, str] = {}
    lines = text.decode("latin-1").splitlines()
    for number, line in enumerate(lines):
        found = re.fullmatch(r"([^:#]+?): *(.*?)\s*", line)
        if found is None or line.partition(":")[2].startswith("="):
            continue  # a comment, a key with a value, or the magic number
        key = {"datafile": "data file", "lineskip": "line skip", "byteskip": "byte skip", "centerings": "centers"}
        name = key.get(found[1].lower().strip(), found[1].lower().strip().replace("axismins", "axis mins"))
        fields[name] = found[2]
        if name == "data file" and found[2].split()[:1] == ["LIST"]:
            return fields, [line.strip() for line in lines[number + 1 :] if line.strip()], 0
    return fields, [], blank.end() if blank else len(head)


def _names(fields: dict[str, str], sizes: Sequence[int]) -> list[str]:
    """Return a name for each axis, the fastest first: x, y, z, c (channels), t (time), or ? (unknown)."""
    count = len(sizes)
    kinds = fields.get("kinds", "").lower().split()
    kinds = kinds if len(kinds) == count else ["???"] * count
    directions = _directions(fields)
    if directions and len(directions) != count:
        raise ValueError("there are not as many directions as axes")
    names = ["?"] * count
    for axis, kind in enumerate(kinds):
        vector = directions[axis] if directions else ()
        if vector is None or any(word in kind for word in COLOURS) or (kind == "list" and count > 3):
            names[axis] = "t" if kind == "time" else "c"
        elif (kind == "time" and count > 3) or (len(vector) == 4 and not any(vector[:3])):
            names[axis] = "t"
        elif directions or kind in ("domain", "space") or count == 3:
            names[axis] = "space"
    left = iter("xyz")
    return [next(left, "?") if name == "space" else name for name in names]


def _directions(fields: dict[str, str]) -> list[list[float] | None]:
    """Return the direction of each axis, None for one that is not in space; nothing if the file has no directions."""
    found = re.findall(r"\(([^)]*)\)|(none)", fields.get("space directions", ""))
    return [[float(x) for x in vector.split(",")] if not none else None for vector, none in found]


def _geometry(
    fields: dict[str, str], space: Sequence[int], sizes: Sequence[int], file: Path
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the steps between voxels, one column for each of x, y, z (3, 3), and the position of the first (3,)."""
    if len(space) != 3:
        return np.eye(3), np.zeros(3)  # refused later, with the names of the axes
    directions = _directions(fields)
    if directions:
        steps = np.array([directions[axis] for axis in space], np.float64).T[:3]
        place = np.array(_vector(fields["space origin"])[:3] if "space origin" in fields else [0.0] * 3)
        if steps.shape != (3, 3) or place.shape != (3,):
            raise ValueError("space directions need three numbers")
        units = re.findall(r'"([^"]*)"', fields.get("space units", "")) or ["", "", ""]
        scale = in_one_unit(np.ones(3), (units + [""] * 3)[:3], file.name)
        return steps * scale[:, None], place * scale
    per_axis = {key: _numbers(fields, key, len(sizes)) for key in ("spacings", "axis mins", "axis maxs")}
    cells = [text != "node" for text in (fields.get("centers", "").lower().split() or ["???"] * len(sizes))]
    spacing, place = np.ones(3), np.zeros(3)
    for k, axis in enumerate(space):
        low, high, step = (per_axis[key][axis] for key in ("axis mins", "axis maxs", "spacings"))
        if np.isnan(step) and np.isfinite(high - low):
            step = (high - low) / (sizes[axis] - (not cells[axis]))
        spacing[k] = 1.0 if np.isnan(step) else step
        place[k] = 0.0 if np.isnan(low) else low + 0.5 * spacing[k] * cells[axis]
    units = re.findall(r'"([^"]*)"', fields.get("units", ""))
    scale = in_one_unit(np.ones(3), [units[axis] if len(units) == len(sizes) else "" for axis in space], file.name)
    return np.diag(spacing * scale), place * scale


def _numbers(fields: dict[str, str], key: str, count: int) -> list[float]:
    """Return a number for each axis, NaN where the file has none."""
    numbers = [float(x) for x in fields.get(key, "nan " * count).split()]
    if len(numbers) != count:
        raise ValueError(f"{key} needs a number for each axis")
    return numbers


def _vector(text: str) -> list[float]:
    """Parse numbers as written in NRRD headers, ``(1,2,3)``."""
    return [float(x) for x in text.strip("() ").split(",")]


def _data_files(file: Path, target: str | None, listed: Sequence[str], sizes: Sequence[int]) -> tuple[Path, ...]:
    """Return the files with the values."""
    if target is None:
        if file.suffix.lower() == ".nhdr":
            raise BadInput(f"{file} names no data file: it is damaged or incomplete.")
        return (file,)
    words = target.split()
    if words[:1] == ["LIST"]:
        files = tuple(file.parent / name for name in listed)
    elif "%" in target and len(words) in (4, 5):
        files = numbered(words[0], int(words[1]), int(words[2]), int(words[3]), file.parent)
    else:
        return (file.parent / target,)
    own = int(words[-1]) if len(words) == {"LIST": 2}.get(words[0], 5) else len(sizes) - 1
    if not files or int(np.prod(sizes[own:], dtype=object)) != len(files):
        raise ValueError("the number of data files does not fit the sizes")
    return files
