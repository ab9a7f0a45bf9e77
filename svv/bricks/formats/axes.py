"""Axes of stored arrays by name: which of them are z, y and x, and which channel and time point are shown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.bricks.formats.source import Box
from svv.errors import BadInput

Number = TypeVar("Number", bound=np.generic)

METRES = {
    **dict.fromkeys(("m", "meter", "metre"), 1.0),
    **dict.fromkeys(("dm", "decimeter", "decimetre"), 1e-1),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), 1e-2),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), 1e-3),
    **dict.fromkeys(("um", "µm", "μm", "\\u00b5m", "micron", "micrometer", "micrometre"), 1e-6),
    **dict.fromkeys(("nm", "nanometer", "nanometre"), 1e-9),
    **dict.fromkeys(("a", "å", "å", "angstrom", "ångström"), 1e-10),
    **dict.fromkeys(("pm", "picometer", "picometre"), 1e-12),
    **dict.fromkeys(("km", "kilometer", "kilometre"), 1e3),
    **dict.fromkeys(("in", "inch"), 0.0254),
    **dict.fromkeys(("ft", "foot"), 0.3048),
}
"""Metres per unit of length, by its names in lower case."""

ROLES = {
    "x": r"lon(gitude)?s?|\w+_lon(gitude)?|rlon|width|easting|west_east\w*|col(umn)?s?",
    "y": r"lat(itude)?s?|\w+_lat(itude)?|rlat|northing|south_north\w*|rows?",
    "z": r"(depth|z?lev|plev|pressure|isobaric|alt|elev|hybrid|sigma|bottom_top|layer|plane|slice|height_)\w*",
    "t": r"\w*time\w*|frames?|dates?",
    "c": r"c|channels?|bands?",
}
"""Patterns of names that programs give to the axes, besides the letters (:data:`LETTER`); lower case."""

LETTER = r"(?:n|dim_?)?([xyzt])(?:_?(?:dim|axis|space|c|coord\w*|cent(?:er|re)s?|\d+))?"
"""Pattern of names that consist of a letter and little else: x, nx, x_dim, XDim, x0, xspace."""


def role_of(name: str) -> str:
    """Return which axis a name means: ``z``, ``y``, ``x``, ``c`` or ``t``; nothing if it is unknown or "height"."""
    lower = name.strip().lower()
    if found := re.fullmatch(LETTER, lower):
        return found[1]
    return next((role for role, pattern in ROLES.items() if re.fullmatch(pattern, lower)), "")


def roles(names: Sequence[str], shape: Sequence[int], told: Sequence[str] = ()) -> tuple[list[str], str]:
    """Return names of axes as :func:`picked` knows them, and what was assumed.

    A height is a row's in pictures, which also have a width, and otherwise the vertical (climate and forecast metadata
    conventions, section 4.3). Names that are unknown are kept, unless they are those of z, y and x, in this order, or
    of the only one that is missing among these.

    Args:
        names: As the file has them; empty where it has none.
        shape: Entries along each axis.
        told: Roles that other attributes of the file tell; empty where they do not.
    """
    lower = [name.strip().lower() for name in names]
    height = "y" if any(re.fullmatch("width", name) for name in lower) else "z"
    found = [
        role or (height if name == "height" else role_of(name))
        for role, name in zip([*told, *[""] * len(lower)], lower)
    ]
    if not any(found):
        found = [name if role.startswith("axis") and name else role for role, name in zip(unnamed(shape), lower)]
        known = [k for k, role in enumerate(found) if role in ("z", "y", "x") and names[k]]
    else:
        missing = [role for role in "zyx" if role not in found]
        known = [k for k, role in enumerate(found) if not role and shape[k] > 1]
        if len(known) != len(missing) or len(missing) == 2:
            known = []
        for k, role in zip(known, missing):
            found[k] = role
        found = [role or name or f"axis {k}" for k, (role, name) in enumerate(zip(found, lower))]
    known = [k for k in known if names[k]]
    said = f"its axes {', '.join(names[k] for k in known)} are taken for {', '.join(found[k] for k in known)}"
    return found, said if known else ""


def unnamed(shape: Sequence[int]) -> list[str]:
    """Return names for axes of which nothing is known: z, y, x if three of them have several entries."""
    wide = [k for k, side in enumerate(shape) if side > 1]
    if len(shape) == 3 or len(wide) != 3:
        return [*(f"axis {k}" for k in range(len(shape) - 3)), *"zyx"[-len(shape) :]]
    return [dict(zip(wide, "zyx")).get(k, f"axis {k}") for k in range(len(shape))]


@dataclass(frozen=True)
class Choice:
    """Which part of a file with several channels or time points is shown."""

    channel: str | None = None
    """Number of a channel, from 0, or its name."""
    time: int | None = None
    """Number of a time point, from 0."""


class Indexed(Protocol):
    """An array that reads what is indexed, such as one of Zarr or HDF5."""

    def __getitem__(self, index: tuple[int | slice, ...], /) -> ArrayLike: ...


@dataclass(frozen=True)
class Pick:
    """Where z, y and x lie among the axes of a stored array, and which entry of every other axis is shown."""

    fixed: tuple[int | None, ...]
    """For each stored axis, the entry that is shown; None for z, y and x."""
    order: Box
    """Numbers of z, y and x among the axes that are left."""

    def of(self, values: NDArray[Number]) -> NDArray[Number]:
        """Return the volume as a view of the stored array. (nz, ny, nx)"""
        return values[tuple(slice(None) if k is None else k for k in self.fixed)].transpose(self.order)

    def sides(self, shape: Sequence[int]) -> Box:
        """Return the number of voxels along z, y, x of an array of this shape."""
        left = [side for side, k in zip(shape, self.fixed) if k is None]
        z, y, x = (int(left[axis]) for axis in self.order)
        return z, y, x

    def box(self, array: Indexed, start: Box, stop: Box) -> NDArray[np.generic]:
        """Read a box of the volume."""
        parts = dict(zip(self.order, (slice(a, b) for a, b in zip(start, stop))))
        left = iter(parts[axis] for axis in range(3))
        index = tuple(next(left) if k is None else k for k in self.fixed)
        return np.asarray(array[index]).transpose(self.order)


def picked(axes: Sequence[str], shape: Sequence[int], choice: Choice, name: str, channels: Sequence[str] = ()) -> Pick:
    """Find z, y and x among the axes of a stored array, and the entry that is shown of every other axis.

    Args:
        axes: A name for each axis: ``z``, ``y``, ``x``, ``c`` (channel), ``t`` (time), or any other.
        shape: Entries along each axis.
        choice: The channel and the time point that are asked for.
        name: Name of the volume in messages.
        channels: Names of the channels, if they are known.

    Raises:
        BadInput: There are several channels or time points and none of them is chosen, or the chosen one is not there;
            z, y or x is missing; or an axis of several entries has another name.
    """
    missing = [axis for axis in "zyx" if list(axes).count(axis) != 1]
    said = ", ".join(f"{axis} {side}" for axis, side in zip(axes, shape))
    strange = [axis for axis, side in zip(axes, shape) if axis not in "ctzyx" and side > 1]
    if strange or any(list(axes).count(axis) > 1 for axis in "ct"):
        raise BadInput(
            f"{name} has axes of which it does not say what they are ({said}): save one volume of it, or name its axes "
            "where it was written."
        )
    if missing:
        raise BadInput(
            f"{name} is no volume: of the axes z, y and x, it lacks {' and '.join(missing)} (it has {said})."
        )
    asked = {"c": _channel(choice, name, channels, _side(axes, shape, "c")), "t": choice.time}
    if choice.time is not None and not 0 <= choice.time < _side(axes, shape, "t"):
        raise BadInput(f"{name} has no time point {choice.time}; it has {_listed(axes, shape, 't', ())}.")
    open_ = [axis for axis in "ct" if asked[axis] is None and _side(axes, shape, axis) > 1]
    if open_:
        there = " and ".join(_listed(axes, shape, axis, channels) for axis in open_)
        options = " and ".join({"c": "--channel", "t": "--time"}[axis] for axis in open_)
        raise BadInput(f"{name} has {there}: choose one with {options}.")
    fixed = tuple(None if axis in "zyx" else asked.get(axis) or 0 for axis in axes)
    left = [axis for axis in axes if axis in "zyx"]
    return Pick(fixed, (left.index("z"), left.index("y"), left.index("x")))


def check_alone(choice: Choice, file: Path) -> None:
    """Raise BadInput if a channel or a time point is asked for of a file that has one volume alone."""
    for option, value in (("--channel", choice.channel), ("--time", choice.time)):
        if value is not None:
            raise BadInput(f"{file.name} has neither channels nor time points: leave out {option}.")


def _side(axes: Sequence[str], shape: Sequence[int], axis: str) -> int:
    return int(shape[list(axes).index(axis)]) if axis in axes else 1


def _channel(choice: Choice, name: str, channels: Sequence[str], count: int) -> int | None:
    """Return the number of the chosen channel, given by number or by name."""
    if choice.channel is None:
        return None
    if choice.channel in channels:
        return list(channels).index(choice.channel)
    if choice.channel.isdecimal() and int(choice.channel) < count:
        return int(choice.channel)
    there = _listed("c", (count,), "c", channels)
    raise BadInput(f"{name} has no channel '{choice.channel}'; it has {there}.")


def _listed(axes: Sequence[str], shape: Sequence[int], axis: str, names: Sequence[str]) -> str:
    """Say how many channels or time points there are, and what they are called."""
    count = _side(axes, shape, axis)
    word = {"c": "channel", "t": "time point"}[axis]
    if count == 1:
        return f"one {word}"
    if len(names) == count and count <= 20:
        listed = ", ".join(f"{k} {text}" for k, text in enumerate(names))
    else:
        listed = f"0 to {count - 1}"
    return f"{count} {word}s ({listed})"


def unit_of(text: str | None) -> str:
    """Return a unit as :data:`METRES` has it: meters as meter, [n_m] as nm, degrees_north as degree."""
    lower = (text or "").strip().lower()
    if re.fullmatch(r"deg(ree)?s?(_?(north|east|n|e))?", lower):
        return "degree"
    lower = lower.strip("[]").replace("_", "") if lower.startswith("[") else lower
    one = lower.removesuffix("s")
    return one if lower not in METRES and one in METRES else lower


def in_one_unit(sizes: ArrayLike, units: Sequence[str | None], name: str) -> NDArray[np.float64]:
    """Return lengths along x, y, z in the unit of the first of them.

    Raises BadInput if they have different units, of which one is not a known unit of length.
    """
    named = [unit_of(unit) for unit in units]
    if len(set(named)) == 1:
        return np.asarray(sizes, float)
    if not all(unit in METRES for unit in named):
        said = ", ".join(f"{axis} in {unit or 'no unit'}" for axis, unit in zip("xyz", units))
        raise BadInput(f"{name} gives the size of a voxel in units that cannot be compared ({said}): write one unit.")
    return np.asarray(sizes, float) * [METRES[unit] / METRES[named[0]] for unit in named]
