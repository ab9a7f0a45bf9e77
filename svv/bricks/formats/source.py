"""Bricked access to volumes: one interface for files of many formats, whatever their size.

Arrays are indexed [z, y, x]; so are boxes, as ``start`` (included) and ``stop`` (excluded). Points, axes and sizes in
the world are (x, y, z): world coordinates are origin + axes * (x, y, z) index.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from svv.errors import BadInput

Box = tuple[int, int, int]
Array = NDArray[np.float64]

ORTHOGONAL_TOLERANCE = 1e-3
"""Largest cosine of the angle between two axes that still count as perpendicular."""


@dataclass(frozen=True, eq=False)
class Level:
    """A resolution of a volume, and its place in the world."""

    shape: Box
    """Number of voxels along z, y, x."""
    axes: Array
    """Steps between voxels along x, y, z in world units, one column each. (3, 3)"""
    origin: Array
    """Position of the first voxel, world units. (3,)"""

    @property
    def spacing(self) -> Array:
        """Distances between voxels along x, y, z, world units. (3,)"""
        return np.linalg.norm(self.axes, axis=0)

    @property
    def voxel(self) -> float:
        """Size of a voxel in world units: the cube root of its volume, but at most twice the smallest spacing."""
        return float(min(np.cbrt(self.spacing.prod()), 2.0 * self.spacing.min()))

    @property
    def voxels(self) -> int:
        """Number of voxels."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    def halved(self) -> Level:
        """Return the level whose voxels are the means of 2 x 2 x 2 voxels; at the end of an odd side, of fewer."""
        shape = tuple(-(-size // 2) for size in self.shape)
        return Level((shape[0], shape[1], shape[2]), 2.0 * self.axes, self.origin + 0.5 * self.axes.sum(axis=1))


class Source(Protocol):
    """A volume in a file, of which boxes are read."""

    @property
    def name(self) -> str:
        """Name in messages."""
        ...

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Type of the values: a native integer or floating-point type."""
        ...

    levels: Sequence[Level]
    """Resolutions that the file contains, the finest first."""

    assumed: str | None
    """What was assumed because the file does not tell it, such as the size of a voxel, in sentences."""

    @property
    def planes(self) -> tuple[Array, Array, Array] | None:
        """Places of the voxels along x, y and z, if some are not evenly spaced: the levels have their mean steps."""
        ...

    def read(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box of a level. (stop - start)

        Raises BadInput if the data there cannot be read.
        """
        ...


def level_of(shape: Sequence[int], axes: Array, origin: Array, name: str) -> Level:
    """Return the level of a grid after a check.

    Raises BadInput if a side has fewer than two voxels, the spacing is not positive, or axes are not perpendicular.
    """
    if len(shape) != 3 or min(shape) < 2:
        size = " x ".join(str(side) for side in reversed(shape))
        raise BadInput(f"{name} has {size} voxels; a volume needs at least 2 along each of three axes.")
    with np.errstate(all="ignore"):  # what is not finite is rejected
        spacing = np.linalg.norm(axes, axis=0)
    if not (np.isfinite(axes).all() and np.isfinite(origin).all() and 0 < spacing.min() <= spacing.max() < np.inf):
        raise BadInput(f"{name} has the spacing {tuple(spacing.tolist())}; it must be positive along each axis.")
    cosines = (axes / spacing).T @ (axes / spacing)
    if np.abs(cosines - np.eye(3)).max() > ORTHOGONAL_TOLERANCE:
        raise BadInput(f"{name} has axes that are not perpendicular (a sheared grid); resample it first.")
    return Level((int(shape[0]), int(shape[1]), int(shape[2])), np.asarray(axes, float), np.asarray(origin, float))


def native(dtype: DTypeLike, name: str) -> np.dtype[np.generic]:
    """Return the type in which values are read: native byte order, no half precision, no booleans.

    Raises BadInput if it is not a numeric type.
    """
    kind = np.dtype(dtype)
    if kind.kind not in "buif":
        raise BadInput(f"{name} contains values of type {kind}; a volume needs integers or real numbers.")
    return np.dtype({"b1": "u1", "f2": "f4", "f16": "f8"}.get(kind.str[1:], kind.str[1:]))


REPLACE_THEM = (
    "replace them with numbers first: numpy.nan_to_num(values, nan=0, posinf=0, neginf=0), in ParaView as the "
    "expression of a Python Calculator with the array's name."
)
"""What to do about values that are no numbers."""


class WithoutValues(BadInput):
    """A volume has voxels without a value, which only :mod:`svv.dvr.read.gaps` knows how to draw."""


def check_finite(values: NDArray[np.number], name: str) -> None:
    """Raise WithoutValues if a value is NaN or infinite."""
    if not (np.isfinite(values.min()) and np.isfinite(values.max())):  # both are NaN if any value is
        raise WithoutValues(f"{name} contains values that are NaN or infinite; {REPLACE_THEM}")


def scaled_type(stored: np.dtype[np.generic], gain: float, shift: float) -> np.dtype[np.generic]:
    """Return the type of gain * stored + shift: float32 if it separates all stored values, otherwise float64."""
    narrow = stored.itemsize <= 2 or stored == np.float32
    return np.dtype(np.float32 if narrow and abs(shift) <= 65536.0 * abs(gain) else np.float64)


class ArraySource:
    """A volume that is in memory or mapped into it.

    Args:
        values: Array (nz, ny, nx), such as a ``numpy.memmap``.
        axes: Steps between voxels, see :class:`Level`; by default 1 along each axis. (3, 3)
        origin: World position of the first voxel; by default 0. (3,)
        name: Name in messages.

    Raises:
        BadInput: See :func:`level_of` and :func:`native`.
    """

    planes = None

    def __init__(
        self,
        values: NDArray[np.generic],
        axes: Array | None = None,
        origin: Array | None = None,
        name: str = "The volume",
    ) -> None:
        self.name, self.dtype, self._values = name, native(values.dtype, name), values
        self.assumed: str | None = None
        axes, origin = np.eye(3) if axes is None else axes, np.zeros(3) if origin is None else origin
        self.levels: Sequence[Level] = (level_of(values.shape, axes, origin, name),)

    def read(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box; see :meth:`Source.read`."""
        box = self._values[start[0] : stop[0], start[1] : stop[1], start[2] : stop[2]]
        return np.ascontiguousarray(box, dtype=self.dtype)
