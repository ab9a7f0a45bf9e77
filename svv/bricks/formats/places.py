"""Where the voxels of a stored array lie: by the names of its axes, and the numbers and units along them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.bricks.formats.axes import METRES, roles, unit_of
from svv.errors import BadInput

Array = NDArray[np.float64]

UNEVEN = 0.01
"""Part of a step by which steps between voxels may differ: scales are often stored in single precision."""

ELEMENT_SIZE = ("element_size_um", "spacing", "voxel_size", "resolution")
"""Attributes of an array that may hold the size of a voxel along z, y and x, as they are stored; ``offset`` goes with
them."""

DOWN = ("pa", "hpa", "kpa", "bar", "mbar", "millibar", "dbar", "decibar", "atm")
"""Units of pressure, which falls upwards (climate and forecast metadata conventions, section 4.3.1)."""

STANDARD = {"X": "x", "Y": "y", "Z": "z", "T": "t", "longitude": "x", "latitude": "y", "time": "t",
            "projection_x_coordinate": "x", "projection_y_coordinate": "y", "grid_longitude": "x",
            "grid_latitude": "y", "height": "z", "altitude": "z", "depth": "z", "air_pressure": "z"}  # fmt: skip
"""Axes by the attributes ``axis`` and ``standard_name`` of coordinates (ibid., section 4)."""


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a stored array, as its file tells it."""

    name: str = ""
    step: float | None = None
    """Distance between voxels; None if ``places`` tell it, or nothing does."""
    first: float = 0.0
    """Place of the first voxel, if there is a step."""
    unit: str = ""
    places: NDArray[Any] | None = None
    """Place of each voxel."""
    role: str = ""
    """``x``, ``y``, ``z``, ``c`` or ``t`` where more than the name says so."""


@dataclass(frozen=True, eq=False)
class Placed:
    """The place of an array."""

    names: list[str]
    """Of the stored axes, see :func:`svv.bricks.formats.axes.picked`."""
    axes: Array
    """Steps between voxels along x, y, z, one column each. (3, 3)"""
    origin: Array
    """Position of the first voxel. (3,)"""
    planes: tuple[Array, Array, Array] | None
    """Places of the voxels along x, y and z, if some are not evenly spaced."""
    assumed: str | None
    """What was assumed, in a sentence."""


def axis_of(name: str, values: NDArray[Any] | None, told: Mapping[str, Any], count: int) -> Axis:
    """Return the axis of ``count`` voxels that a coordinate describes (climate and forecast metadata conventions).

    Args:
        name: Name of the dimension.
        values: The coordinate: a place for each voxel, for their edges, or the first two of them; None without one.
        told: Attributes of the coordinate.
        count: Number of voxels along the axis.
    """
    unit, standard = text_of(told.get("units")), text_of(told.get("standard_name"))
    role = STANDARD.get(text_of(told.get("axis")).upper()) or STANDARD.get(standard, "")
    upwards = text_of(told.get("positive")).lower()
    down = upwards == "down" or (not upwards and unit.lower().rstrip("s") in DOWN)
    if not role and (towards := re.fullmatch(r"deg(?:ree)?s?_?(north|east|n|e)", unit.lower())):
        role = {"n": "y", "e": "x"}[towards[1][0]]
    if not role and " since " in unit:
        role = "t"
    if not role and (down or upwards):
        role = "z"
    if values is None or values.ndim != 1 or values.dtype.kind not in "iuf" or values.size < 2:
        return Axis(name, role=role)
    if {"scale_factor", "add_offset"} & set(told):
        values = values * np.ravel(told.get("scale_factor", 1.0))[0] + np.ravel(told.get("add_offset", 0.0))[0]
    if values.size == count + 1:
        values = 0.5 * (values[:-1].astype(np.float64) + values[1:])
    elif values.size == 2 < count:
        values = values[0] + (values[1].astype(np.float64) - values[0]) * np.arange(count)
    if values.size != count:
        return Axis(name, role=role)
    if unit_of(unit) == "degree" and role == "x":  # over the meridian at which they begin again
        values = np.unwrap(values.astype(np.float64), period=360.0).astype(values.dtype)
    values = values if values.dtype.kind == "f" else values.astype(np.float64)
    return Axis(name, unit=unit, places=-values if down else values, role=role)


def sized(axes: Sequence[Axis], told: Mapping[str, Any], shape: Sequence[int]) -> list[Axis]:
    """Return axes with the sizes of a voxel that an array's attributes hold (:data:`ELEMENT_SIZE`), if they do."""
    names, _ = roles([axis.name for axis in axes], shape, [axis.role for axis in axes])
    space = [k for k, name in enumerate(names) if name in ("z", "y", "x")]

    def numbers(key: str) -> list[float]:
        values = np.atleast_1d(np.asarray(told.get(key, ()), dtype=object))
        real = all(isinstance(v, (int, float, np.number)) for v in values)
        values = values[space] if values.shape == (len(axes),) else values
        return [float(v) for v in values] if real and values.shape == (3,) == (len(space),) else []

    key = next((key for key in ELEMENT_SIZE if numbers(key)), "")
    steps, first = numbers(key), numbers("offset") or [0.0] * 3
    if not steps or (steps == [1.0] * 3 and any(axis.places is not None or axis.step for axis in axes)):
        return list(axes)
    unit = "um" if key.endswith("_um") else ""
    there = {k: replace(axes[k], places=None, step=a, first=b, unit=unit) for k, a, b in zip(space, steps, first)}
    return [there.get(k, axis) for k, axis in enumerate(axes)]


def text_of(value: object) -> str:
    """Return an attribute that is a text, which some libraries read as bytes or as an array of one."""
    one = next(iter(np.ravel(np.asarray(value, object)).tolist()), None)
    return "" if one is None else (one.decode("utf-8", "replace") if isinstance(one, bytes) else str(one)).strip()


def no_size(name: str, axes: str = "xyz", sizes: ArrayLike = (1.0, 1.0, 1.0)) -> str:
    """Say that a file tells no size of a voxel along some axes, and which are taken."""
    where = "" if axes == "xyz" else f" along {', '.join(axes)}"
    taken = " x ".join(f"{size:g}" for letter, size in zip("xyz", np.ravel(sizes)) if letter in axes)
    return f"{name}: no voxel size found{where}: {taken} (--spacing X,Y,Z gives another)."


def placed(axes: Sequence[Axis], shape: Sequence[int], name: str, turn: Array | None = None) -> Placed:
    """Return where an array lies.

    Lengths in different units become those of x. Degrees and metres make no place: each step counts as 1 then.

    Args:
        axes: Of the stored array.
        shape: Entries along them.
        name: Name of the volume in messages.
        turn: Directions of x, y and z, one column each; the origin is not turned. (3, 3)

    Raises:
        BadInput: Places along an axis neither rise nor fall.
    """
    names, guessed = roles([axis.name for axis in axes], shape, [axis.role for axis in axes])
    said = [f"{name}: {guessed}."] if guessed else []
    steps, origin, planes = np.ones(3), np.zeros(3), [np.zeros(0)] * 3
    found = {names[k]: axis for k, axis in enumerate(axes) if names.count(names[k]) == 1}
    known, uneven = [], False
    for k, letter in enumerate("xyz"):
        axis = found.get(letter, Axis())
        if axis.places is not None:
            planes[k] = axis.places.astype(np.float64)
            steps[k], origin[k] = (planes[k][-1] - planes[k][0]) / (len(planes[k]) - 1), planes[k][0]
            uneven |= not _is_even(axis, planes[k], name)
        elif axis.step is not None:
            steps[k], origin[k] = axis.step, axis.first
        else:
            continue
        known.append(k)
    unit = [unit_of(found["xyz"[k]].unit) for k in known]
    if set(found) >= set("xyz") and len(known) < 3:
        said.append(no_size(name, "".join("xyz"[k] for k in range(3) if k not in known)))
    scale = np.ones(3)
    if len(set(unit)) > 1 and all(one in METRES for one in unit):
        scale[known] = [METRES[one] / METRES[unit[0]] for one in unit]
    elif len(set(unit)) > 1:
        listed = ", ".join(f"{'xyz'[k]} in {found['xyz'[k]].unit or 'no unit'}" for k in known)
        said.append(f"{name} has axes whose units cannot be compared ({listed}): each step counts as 1.")
        scale = 1.0 / np.abs(steps)
        planes = [part - start if len(part) else part for part, start in zip(planes, origin)]
        origin = np.zeros(3)
    steps, origin = steps * scale, origin * scale
    if uneven:
        sides = [int(shape[names.index(letter)]) for letter in "xyz"]
        planes = [
            part * scale[k] if len(part) else origin[k] + steps[k] * np.arange(sides[k])
            for k, part in enumerate(planes)
        ]
    matrix = np.diag(steps) if turn is None else turn * steps
    even = None if not uneven else (planes[0], planes[1], planes[2])
    return Placed(names, matrix, origin, even, " ".join(said) or None)


def _is_even(axis: Axis, places: Array, name: str) -> bool:
    steps = np.diff(places)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise BadInput(f"{name} has places along '{axis.name}' that neither rise nor fall from voxel to voxel.")
    mean, kind = steps.mean(), np.asarray(axis.places).dtype
    precision = 4 * float(np.finfo(kind).eps) * np.abs(places).max() if kind.kind == "f" else 0.0
    return bool(np.abs(steps - mean).max() < max(UNEVEN * abs(mean), precision))
