"""Headers that are text beside a file of raw values: BOV of VisIt, ``.dat`` of Inviwo and Voreen, ``.vgi`` of VGStudio.

Sources: https://visit-sphinx-github-user-manual.readthedocs.io/en/develop/data_into_visit/BOVFormat.html, and how the
readers of Inviwo (https://github.com/inviwo/inviwo), Voreen and others understand the files.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from svv.bricks.formats.mapped import MOST_HEADER, RAW_TYPES, first_text
from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput

BOV_TYPES = {"byte": "u1", "short": "i2", "int": "i4", "float": "f4", "double": "f8"}
"""Types of BOV headers, which may also stand in the plural."""


def bov_header(file: Path) -> Stored:
    """Read a BOV header ("brick of values"); raises BadInput if it is damaged, or its values lie in several files."""
    try:
        told = {key.replace(" ", "_"): value for key, value in _fields(file).items()}
        sides, each = _whole(told["data_size"]), told.get("data_components", "1").lower()
        count = 2 if each == "complex" else int(each)
        name = told["data_file"].strip('"')
        if "%" in name or "*" in name:
            raise BadInput(f"{file} describes values in several files ({name}): join them into one first.")
        kind = np.dtype(BOV_TYPES[told["data_format"].lower().removesuffix("s")])
        kind = kind.newbyteorder(">" if told.get("data_endian", "").lower() == "big" else "<")
        on_cells = told.get("centering", "nodal").strip('"').lower() == "zonal"
        first = np.array([float(x) for x in told.get("brick_origin", "0 0 0").split()])
        whole = np.array([float(x) for x in told["brick_size"].split()]) if "brick_size" in told else None
        if len(sides) != 3 or first.shape != (3,) or (whole is not None and whole.shape != (3,)) or min(sides) < 1:
            raise ValueError("sizes and places need three numbers")
        offset = int(told.get("byte_offset", "0"))
    except (KeyError, ValueError) as error:
        raise bad_header(file, error) from error
    step = np.ones(3) if whole is None else whole / np.maximum(sides if on_cells else np.array(sides) - 1, 1)
    values = file.parent / name
    return Stored(
        file, (values,), kind, (*sides[::-1], *([count] if count > 1 else [])), "zyxc" if count > 1 else "zyx",
        np.diag(step), first + 0.5 * step * on_cells, told.get("variable", "").strip('"') or file.stem,
        "zlib" if values.suffix == ".gz" else "raw", offset=offset, is_sized=whole is not None,
    )  # fmt: skip


def is_dat_header(file: Path) -> bool:
    """Return whether a ``.dat`` file is a header of Inviwo or Voreen, and not raw values."""
    head = first_text(file)
    return head is not None and re.search(rb"(?im)^[ \t]*(?:objectfilename|rawfile|datfile)[ \t]*:", head) is not None


def dat_header(file: Path) -> Stored:
    """Read a ``.dat`` header of Inviwo or Voreen.

    Inviwo's basis vectors span the whole volume, and without an offset its centre is the origin. Voreen's offset is the
    first voxel's place. Raises BadInput if it is damaged, or a list of other headers.
    """
    try:
        told = _fields(file)
        if "datfile" in told:
            raise BadInput(f"{file} is a list of other .dat files: name one of them, such as {told['datfile']}.")
        sides = _whole(told.get("resolution") or told["dimensions"])
        text, vector = re.sub(r"_12$", "", told["format"].split()[0].lower()), 1
        if found := re.fullmatch(r"vec([234])(\w+)", text):
            text, vector = found[2], int(found[1])
        vector = {"la": 2, "rgb": 3, "rgba": 4}.get(told.get("objectmodel", "i").lower(), vector)
        kind = np.dtype(RAW_TYPES.get(text, text))
        kind = kind.newbyteorder(">" if told.get("byteorder", "").lower() == "bigendian" else "<")
        spacing = _numbers(told.get("spacing") or told.get("slicethickness") or "", 3)
        basis = np.array([_numbers(told.get(f"basisvector{k}", ""), 3) for k in (1, 2, 3)])
        world = np.array([_numbers(told.get(f"worldvector{k}", ""), 4) for k in (1, 2, 3)])
        offset, count = _numbers(told.get("offset", ""), 3), int(told.get("sequences", "1"))
        if len(sides) != 3 or min(sides) < 1 or count < 1:
            raise ValueError("the resolution needs three numbers")
    except (KeyError, ValueError, TypeError) as error:
        raise bad_header(file, error) from error
    is_inviwo = bool(basis.any()) or "rawfile" in told or "spacing" in told
    axes = basis / sides if basis.any() else np.diag(spacing if spacing.any() else np.ones(3))
    origin = offset
    if is_inviwo:  # its places are those of the volume's corner
        corner = offset if "offset" in told else -0.5 * axes @ np.array(sides)
        origin = corner + 0.5 * axes.sum(axis=1)
    if world.any():
        axes, origin = world[:, :3] @ axes, world[:, :3] @ origin + world[:, 3]
    values = file.parent / (told.get("rawfile") or told.get("objectfilename", ""))
    shape = (*([count] if count > 1 else []), *sides[::-1], *([vector] if vector > 1 else []))
    return Stored(
        file, (values,), kind, shape, ("t" if count > 1 else "") + "zyx" + ("c" if vector > 1 else ""), axes, origin,
        file.stem, offset=int(told.get("byteoffset") or 0), is_sized=bool(basis.any() or spacing.any()),
    )  # fmt: skip


def vgi_header(file: Path) -> Stored:
    """Read a header of VGStudio (``.vgi``), whose values lie in a ``.vol`` file.

    Raises BadInput if it is damaged, describes several volumes, or a mirrored one.
    """
    try:
        told: dict[str, str] = {}
        with file.open("rb") as opened:
            text = opened.read(MOST_HEADER).decode("latin-1")
        if len(set(re.findall(r"(?m)^\s*\{(volume\d+)\}", text))) > 1:
            raise BadInput(f"{file} describes several volumes: save one of them.")
        section = ""
        for line in text.splitlines():
            if found := re.fullmatch(r"\s*\[(\w+)\]\s*", line):
                section = found[1].lower()
            elif "=" in line and re.fullmatch(r"representation|file\d+|geometry", section):
                key, _, value = line.partition("=")
                told[key.strip().lower()] = value.strip()
        if any(float(word) for word in told.get("mirror", "0").split()):
            raise BadInput(f"{file} describes a mirrored volume: save it as it is shown.")
        sides, bits = _whole(told["size"]), int(told["bitsperelement"])
        letter = {"f": "f", "u": "u", "s": "i", "i": "i"}[told["datatype"].lower()[0]]
        kind = np.dtype(f"<{letter}{bits // 8}")
        spacing = _numbers(told.get("resolution", ""), 3)
        if len(sides) != 3 or min(sides) < 1 or bits % 8:
            raise ValueError("the size needs three numbers")
        name, skipped = told["name"].strip('"'), int(told.get("skipheader", "0"))
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise bad_header(file, error) from error
    beside = file.parent / re.split(r"[\\/]", name)[-1]  # a path of the computer that wrote it
    return Stored(
        file, (beside,), kind, tuple(sides[::-1]), "zyx", np.diag(spacing if spacing.any() else np.ones(3)),
        np.zeros(3), file.stem, offset=skipped, is_sized=bool(spacing.any()),
    )  # fmt: skip


def _fields(file: Path) -> dict[str, str]:
    """Return the lines ``key: value`` of a header, with keys in lower case; what follows a # is a comment."""
    with file.open("rb") as opened:
        text = opened.read(MOST_HEADER).decode("latin-1")
    lines = (line.partition("#")[0].partition(":") for line in text.splitlines())
    return {key.strip().lower(): value.strip() for key, mark, value in lines if mark}


def _whole(text: str) -> list[int]:
    """Parse whole numbers between spaces."""
    return [int(word) for word in text.split()]


def _numbers(text: str, count: int) -> np.ndarray:
    """Parse real numbers between spaces; zeros without any."""
    numbers = [float(word) for word in text.split()] or [0.0] * count
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(f"'{text}' are not {count} numbers")
    return np.array(numbers)
