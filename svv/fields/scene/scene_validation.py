"""What a scene's file says is checked before any network is built: types, ranges, and sizes that its arrays bear out.

All functions raise BadInput, KeyError, TypeError or ValueError if the content does not fit; the caller names the file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.box import Box
from svv.core.json_values import (
    each_in,
    list_in,
    number_in,
    object_in,
    pair_in,
    switch_in,
    text_in,
    vector_in,
    whole_in,
)
from svv.core.volumes.classified import grid_shape
from svv.fields.radiance.widths import DIRECTION_WIDTH, FACING_WIDTH
from svv.io.files.declared_sizes import check_fits

if TYPE_CHECKING:
    from svv.fields.radiance.networks import FieldSettings

MOST_CELLS = 1 << 14
"""Largest number of cells of a grid per box unit."""

MOST_LEVELS, MOST_FEATURES, MOST_LOG_ENTRIES = 64, 64, 30
"""Largest numbers of levels, of features of a level, and of rows of a level of the hash grid, as a power of two."""

MOST_PLANES = 32
"""Largest number of planes of a cut."""

BYTES_A_VERTEX = 6
"""Bytes that laying out a lattice takes for each vertex of its box: marks of cells and vertices, and a number."""

Arrays = Mapping[str, NDArray[np.generic]]


def _planes_in(value: object, name: str) -> tuple[tuple[float, ...], ...]:
    planes = each_in(value, lambda plane, name: list_in(plane, 4, name), name)
    if len(planes) > MOST_PLANES:
        raise ValueError(f"{name} has more than {MOST_PLANES} planes")
    return tuple(tuple(float(number_in(v, name)) for v in plane) for plane in planes)


_KINDS: Mapping[str, Callable[[object, str], object]] = {
    "float": number_in,
    "int": whole_in,
    "bool": switch_in,
    "str": text_in,
    "tuple[float, float]": pair_in,
    "tuple[float, ...]": lambda value, name: tuple(float(v) for v in each_in(value, number_in, name)),
    "tuple[float, float, float]": vector_in,
    "tuple[tuple[float, float], ...]": lambda value, name: each_in(value, pair_in, name),
    "tuple[tuple[float, float, float], ...]": lambda value, name: each_in(value, vector_in, name),
    "tuple[tuple[float, float, float, float], ...]": _planes_in,
    "tuple[int, ...]": lambda value, name: each_in(value, whole_in, name),
}
"""Annotation of a field -> what turns the value in a file into one of that type."""


def values_of(kind: type, told: object) -> dict[str, Any]:
    """Return values for the fields of a dataclass, as :data:`_KINDS` reads them from JSON."""
    found: dict[str, Any] = {}
    for name, value in object_in(told, kind.__name__).items():
        if name not in kind.__annotations__:
            raise ValueError(f"a {kind.__name__} has no {name}")
        plain, _, none = str(kind.__annotations__[name]).partition(" | ")
        found[name] = None if value is None and none == "None" else _KINDS[plain](value, f"{kind.__name__}.{name}")
    return found


def box_of(told: Mapping[str, Any]) -> Box:
    """Return a box of the file's header."""
    low, extent = vector_in(told["low"], "the corner of the box"), vector_in(told["extent"], "the sides of the box")
    size = number_in(told["size"], "the size of the box")
    if not (size > 0.0 and all(0.0 < side <= 1.0 for side in extent) and math.isfinite(max(low) + size)):
        raise ValueError(f"a box of the size {size:g} with the sides {extent} is not valid")
    return Box(low, float(size), extent)


def check_finite(tensors: Arrays) -> None:
    """Find numbers that are NaN or infinite where they are stored, not in the picture."""
    for name, array in tensors.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            bad = int(array.size - np.count_nonzero(np.isfinite(array)))
            raise ValueError(f"{bad} of the {array.size} numbers in {name} are not finite")


def occupied_of(header: Mapping[str, Any], tensors: Arrays, box: Box) -> NDArray[np.uint8]:
    """Return the occupied cells. (X, Y, Z)"""
    cells = whole_in(header["cells"], "cells")
    if not 1 <= cells <= MOST_CELLS:
        raise ValueError(f"{cells} cells are not valid")
    x, y, z = (whole_in(side, "shape") for side in list_in(header["shape"], 3, "shape"))
    bits = tensors["occupied"]
    if (x, y, z) != tuple(grid_shape(box, cells)) or bits.dtype != np.uint8 or not 0 <= 8 * bits.size - x * y * z < 8:
        raise ValueError(f"the occupied cells are not {x} x {y} x {z} of {cells}")
    return np.ascontiguousarray(np.unpackbits(bits.astype(np.uint8, copy=False), count=x * y * z).reshape(x, y, z))


def settings_of(told: Mapping[str, Any]) -> FieldSettings:
    """Return the architecture of the networks."""
    from svv.fields.radiance.networks import ENCODINGS, FieldSettings

    s = dict(told)
    if "lit" in s:  # files from before the explicit light
        s["lighting"] = "network" if s.pop("lit") else "none"
    settings = FieldSettings(**values_of(FieldSettings, s))
    known = settings.lighting in ("network", "phong", "none") and settings.encoding in ENCODINGS
    small = 1 <= settings.features <= MOST_FEATURES and 1 <= settings.levels <= MOST_LEVELS
    if not (known and small and 0 <= settings.log2_entries <= MOST_LOG_ENTRIES and settings.width >= 1):
        raise ValueError("the architecture of its networks is not valid")
    _levels(settings.resolutions)
    _levels(settings.finer, least=0)
    if settings.encoding == "hash" and len(settings.resolutions) != 2:
        raise ValueError("a hash grid has a coarsest and a finest level")
    return settings


def _levels(told: object, least: int = 1) -> tuple[int, ...]:
    found = each_in(told, whole_in, "resolutions")
    if not least <= len(found) <= MOST_LEVELS or not all(1 <= n <= MOST_CELLS for n in found):
        raise ValueError(f"the resolutions {found} of a lattice are not valid")
    return found


def check_sizes(
    header: Mapping[str, Any], tensors: Arrays, settings: FieldSettings, occupied: NDArray[np.uint8]
) -> None:
    """Check that networks of the sizes that the header declares are in the file."""
    hidden, features = tensors["base.colour_mlp.0.weight"].shape
    geometry = len(settings.resolutions) * settings.features if settings.encoding == "lattice" else 15
    if hidden != settings.width or features != geometry + DIRECTION_WIDTH + FACING_WIDTH * settings.facing:
        raise ValueError(f"networks of the width {settings.width} are not in the file")
    every = _levels(settings.resolutions + settings.finer)
    known = {
        "base.encoding": settings.resolutions,
        "base.density": header["density_resolutions"],
        "pcn.encoding": settings.resolutions,
        "pcn.phong.normals": header.get("normal_resolutions") or every,
        "styled.encoding": _painted(header.get("paint_resolutions") or every, header.get("paint_direct")),
    }
    variants = header.get("variants", [])
    # Laid paint is a lattice in scenes of any encoding, like the normals of an explicit light.
    lattices = {"pcn.phong.normals", *(f"variant{k}.encoding" for k, v in enumerate(variants) if v.get("direct"))}
    lattices |= {"styled.encoding"} if header.get("paint_direct") else set()
    known |= {
        f"variant{k}.encoding": _painted(v.get("resolutions") or every, v.get("direct")) for k, v in enumerate(variants)
    }
    strokes = {name for name, told in header.get("brushed", {}).items() if told["complete"]}
    if any(f"variant{k}.encoding.table" not in tensors and f"variant{k}" not in strokes for k in range(len(variants))):
        raise ValueError("a painted variant is not in the file")
    for name, resolutions in known.items():
        needed = name.split(".")[0] in ("base", *header["networks"]) or name.startswith("variant")
        is_lattice = settings.encoding == "lattice" or name in lattices
        if not needed or (name == "base.density" and settings.encoding != "lattice"):
            continue
        table = tensors.get(f"{name}.table")
        if settings.encoding == "hash" and not is_lattice:
            _check_hash(settings, table)
        elif is_lattice and (name != "pcn.phong.normals" or settings.lighting == "phong"):
            _check_lattice(_levels(resolutions or every), header["cells"], occupied, table)


def _painted(resolutions: Sequence[int], direct: object) -> Sequence[int]:
    """Return the levels of a painting's lattice; one that holds the colours themselves has only the finest."""
    return resolutions[-1:] if direct else resolutions


def _check_hash(settings: FieldSettings, table: NDArray[np.generic] | None) -> None:
    coarsest, finest = settings.resolutions
    most = max(coarsest, finest) + 1
    if table is None or table.ndim != 2 or table.size < settings.levels * settings.features:
        raise ValueError("a table is missing")
    rows = min((min(coarsest, finest) + 1) ** 3, 2**settings.log2_entries)
    if settings.levels * rows > len(table) or len(table) > settings.levels * min(most**3, 2**settings.log2_entries):
        raise ValueError(f"a table of {table.shape} does not fit a hash grid of {settings.levels} levels")


def _check_lattice(
    resolutions: Sequence[int], cells: int, occupied: NDArray[np.uint8], table: NDArray[np.generic] | None
) -> None:
    factors = [max(1.0, resolution / cells) ** 3 for resolution in resolutions]
    check_fits(int(BYTES_A_VERTEX * occupied.size * sum(factors)), "A lattice of the scene")
    fine = [resolution // cells for resolution in resolutions if resolution >= cells]
    if table is not None and len(table) < int((occupied > 0).sum()) * sum(factor**3 for factor in fine):
        raise ValueError(f"a table of {table.shape} is too small for the resolutions {tuple(resolutions)}")
