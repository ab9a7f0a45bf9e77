"""N5 containers, by tensorstore: a dataset, or a group of levels as n5-viewer, Paintera and COSEM write them.

N5 stores the fastest axis first, so unnamed axes are x, y, z. A block that is not there holds zeros.

Sources: https://github.com/saalfeldlab/n5 and https://github.com/saalfeldlab/n5-viewer.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.axes import Choice, in_one_unit, picked, role_of
from svv.bricks.formats.chunked import ChunkedSource, package
from svv.bricks.formats.places import no_size
from svv.bricks.formats.source import level_of
from svv.core.json_values import parsed
from svv.errors import BadInput

Vector = NDArray[np.float64]


def is_n5(path: Path) -> bool:
    """Return whether a folder is an N5 dataset or group."""
    return (path / "attributes.json").is_file()


def open_n5(folder: Path, choice: Choice = Choice(), array: str | None = None) -> ChunkedSource:  # noqa: B008 - frozen
    """Open a dataset of N5, or a group of datasets ``s0``, ``s1`` ... with all its levels.

    Args:
        folder: The dataset or group.
        choice: The channel and the time point that are shown.
        array: Path of a dataset or group below it.

    Raises:
        BadInput: It is damaged, has no such dataset or no values, has several channels or time points of which none is
            chosen, or tensorstore is not installed.
    """
    place = folder / (array or "").strip("/")
    told = _attributes(place)
    levels = (
        [place] if "dimensions" in told else sorted(place.glob("s[0-9]*"), key=lambda path: int(path.name[1:] or 0))
    )
    levels = [path for path in levels if "dimensions" in _attributes(path)]
    if not levels:
        inside = sorted({str(path.parent.relative_to(folder)) for path in place.rglob("attributes.json")} - {"."})
        raise BadInput(f"{place} is no dataset: name one of {folder} ({', '.join(inside) or 'none'}) with --array.")
    if not any(part.is_file() and part.name != "attributes.json" for part in levels[0].rglob("*")):
        raise BadInput(f"{levels[0]} was written without its blocks of values.")
    tensorstore = package("tensorstore", folder)
    try:
        arrays = [
            tensorstore.open({"driver": "n5", "kvstore": {"driver": "file", "path": str(path)}}, read=True).result()
            for path in levels
        ]
        names, sizes, shifts, is_sized = _places(place, levels, folder.name)
    except BadInput:
        raise
    except Exception as error:  # tensorstore's errors, and attributes of any kind
        said = " ".join(str(error).split())[:200].rstrip(". ")
        raise BadInput(f"Cannot read {folder}: it is damaged or incomplete ({said}).") from error
    picks = [picked(names, one.shape, choice, folder.name) for one in arrays]
    steps = [
        level_of(pick.sides(one.shape), np.diag(size), shift, folder.name)
        for pick, one, size, shift in zip(picks, arrays, sizes, shifts)
    ]
    return ChunkedSource(
        folder.name, [partial(pick.box, one) for pick, one in zip(picks, arrays)], arrays[0].dtype.numpy_dtype, steps,
        assumed=None if is_sized else no_size(folder.name),
    )  # fmt: skip


def _attributes(place: Path) -> dict[str, Any]:
    """Return the attributes of a folder; none if it has none.

    Raises BadInput if they are no JSON object.
    """
    file = place / "attributes.json"
    if not file.is_file():
        return {}
    try:
        told = parsed(file.read_bytes())
    except ValueError as error:
        raise BadInput(f"Cannot read {file}: it is damaged.") from error
    if not isinstance(told, dict):
        raise BadInput(f"Cannot read {file}: it is damaged.")
    return told


def _places(group: Path, levels: list[Path], name: str) -> tuple[list[str], list[Vector], list[Vector], bool]:
    """Return the names of the axes, each level's size of a voxel and first place (x, y, z), and if sizes were told."""
    above, finest = _attributes(group), _attributes(levels[0])
    count = len(finest["dimensions"])
    told = finest.get("axes") or above.get("axes") or "xyzct"[:count]
    names = [role_of(str(axis)) or str(axis) for axis in told]
    if len(names) != count:
        raise ValueError(f"{len(names)} axes of {count} are named")
    factors = above.get("downsamplingFactors") or above.get("scales")
    sizes, shifts, is_sized = [], [], False
    base, units = _resolution(finest, above)
    for k, path in enumerate(levels):
        own = _attributes(path)
        transform = own.get("transform") if isinstance(own.get("transform"), dict) else None
        if transform:  # in the order z, y, x of arrays in Python, which its axes name
            order = [str(axis) for axis in transform.get("axes", "zyx")]
            pick = [order.index(axis) for axis in "xyz"]
            size = np.array(transform["scale"], float)[pick]
            first = np.array(transform.get("translate", [0.0] * len(order)), float)[pick]
            units, is_sized = [transform.get("units", [""] * len(order))[i] for i in pick], True
        else:
            given = own.get("downsamplingFactors") or (factors[k] if factors and k < len(factors) else [1.0] * 3)
            factor = np.array(given, float)[:3]
            size = (np.ones(3) if base is None else base) * factor
            first = 0.5 * (factor - 1.0) * (np.ones(3) if base is None else base)  # means of whole blocks
            is_sized = base is not None
        scale = in_one_unit(np.ones(3), units, name)
        sizes.append(size * scale)
        shifts.append(first * scale)
    return names, sizes, shifts, is_sized


def _resolution(finest: dict[str, Any], above: dict[str, Any]) -> tuple[Vector | None, list[str]]:
    """Return the size of a voxel along x, y, z, if it is told, and its units."""
    for told in (finest, above):
        for key in ("pixelResolution", "resolution"):
            given = told.get(key)
            if isinstance(given, dict):
                return np.array(given["dimensions"], float)[:3], [str(given.get("unit", ""))] * 3
            if given is not None:
                units = told.get("units", [""] * 3)
                return np.array(given, float)[:3], [units] * 3 if isinstance(units, str) else [
                    str(u) for u in units[:3]
                ]
    return None, [""] * 3
