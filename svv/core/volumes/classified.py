"""A classified volume: the extinction and range that the transfer function gives each point, before any training.

A view shows overlapping structures only as a sum, so a field learned from views alone finds noise where they say
little. If the volume is available, its scalar value determines the extinction of a point and its range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.box import Box
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION, OPAQUE_LOG_EXTINCTION
from svv.errors import BadInput

LARGEST = 65472
"""Code of the value 1, less 1; see :class:`ValueGrid`."""

COARSE = 64
"""Distance of the codes that volumes are classified to: 1024 values, as many as files keep; more make no difference."""

MOST_RANGES = 8
"""Maximum number of ranges into which a transfer function is divided."""

COLOUR_SPREAD = 0.2
"""Largest root mean square RGB distance of the colours in one range to their mean; the palette's offsets can express
that much."""

Edges = tuple[tuple[float, float, float], ...]
"""The three edges of a voxel of the volume, as steps on a grid over it. (3, 3)"""

ALIKE: Edges = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Those of a volume whose voxels are the grid's cells."""


def grid_shape(box: Box, cells: int) -> NDArray[np.int64]:
    """Return the number of cells along each side of a grid over a box with ``cells`` per box unit. (3,)"""
    return np.maximum(1, np.ceil(np.asarray(box.extent) * cells - 1e-6).astype(np.int64))


@dataclass(frozen=True)
class ValueRange:
    """Scalar values that the transfer function shows alike: a region of the scene. BadInput if something is invalid."""

    low: float
    """Smallest scalar value of the range."""
    high: float
    """Largest scalar value of the range."""
    colour: tuple[float, float, float]
    """Mean colour of the range, weighted by extinction, RGB in [0, 1]."""

    def __post_init__(self) -> None:
        if not (np.isfinite([self.low, self.high]).all() and self.low <= self.high):
            raise BadInput("A range of a transfer function must run from a finite value to one that is not smaller.")
        if len(self.colour) != 3 or not all(0.0 <= c <= 1.0 for c in self.colour):
            raise BadInput("The colour of a range must be red, green and blue in [0, 1].")


@dataclass(frozen=True, eq=False)
class ValueGrid:
    """Scalar values on the vertices of a grid over the visible box, and the extinction that belongs to each value.

    Values count from 0 to 1 over an interval that contains all visible ones. BadInput if something is invalid.
    """

    cells: int
    """Cells of the grid per box unit, a power of two."""
    codes: NDArray[np.uint16]
    """0 outside the volume; elsewhere the value is (code - 1) / :data:`LARGEST`. (X + 1, Y + 1, Z + 1)"""
    interval: tuple[float, float]
    """What the values 0 and 1 are in the volume."""
    visible: tuple[float, float]
    """Smallest and largest visible value."""
    integral: NDArray[np.float64] | None = None
    """Integral of the extinction (1 / box unit) over the values, from 0 to evenly spaced values up to 1. (K,)

    None where a learned function of the values replaces it.
    """
    edges: Edges = ALIKE
    """Edges of the volume's voxels, in cells of the grid: gradients are differences from voxel to voxel."""

    colours: NDArray[np.float32] | None = None
    """Colours of the transfer function at evenly spaced values from 0 to 1, RGB in [0, 1]; None if not known. (K, 3)"""

    nearest: bool = False
    """Whether a point has the value of the nearest voxel, as labels are shown; otherwise there are values between."""

    def __post_init__(self) -> None:
        check_edges(self.edges)
        shown = self.colours
        if shown is not None and not (
            shown.ndim == 2 and shown.shape[1] == 3 <= len(shown) and np.isfinite(shown).all()
        ):
            raise BadInput("The colours of values must be three or more, RGB.")
        if self.cells < 1 or self.cells & (self.cells - 1):
            raise BadInput(f"The cells of a grid of values must be a power of two, not {self.cells}.")
        if self.codes.dtype != np.uint16 or self.codes.ndim != 3 or min(self.codes.shape) < 2:
            raise BadInput("The codes of values must be uint16 on the vertices of a grid.")
        if not (np.isfinite(self.interval).all() and self.interval[0] < self.interval[1]):
            raise BadInput("The values of a grid must count over a finite interval.")
        if not 0.0 <= self.visible[0] <= self.visible[1] <= 1.0:
            raise BadInput("The visible values must be an interval within 0 and 1.")
        integral = np.zeros(2) if self.integral is None else self.integral
        if integral.ndim != 1 or len(integral) < 2 or not np.isfinite(integral).all() or (np.diff(integral) < 0).any():
            raise BadInput("The integral of an extinction must be finite and must not decrease.")

    def over(self, interval: tuple[float, float], visible: tuple[float, float]) -> ValueGrid:
        """Return the same values counted over another interval, of which the part ``visible`` counts as visible."""
        (low, high), (start, stop) = self.interval, interval
        factor, shift = (high - low) / (stop - start), (low - start) / (stop - start)
        value = np.clip(self.values() * np.float32(factor) + np.float32(shift), 0.0, 1.0)
        codes = np.where(self.codes > 0, 1 + np.rint(LARGEST * value), 0).astype(np.uint16)
        integral = None
        if self.integral is not None:
            known = np.linspace(0.0, 1.0, len(self.integral))
            integral = np.interp((known - shift) / factor, known, self.integral) / factor
        colours = None
        if self.colours is not None:
            at, known = (np.linspace(*ends, len(self.colours)) for ends in (interval, self.interval))
            colours = np.stack([np.interp(at, known, one) for one in self.colours.T], axis=1).astype(np.float32)
        return ValueGrid(self.cells, codes, interval, visible, integral, self.edges, colours, self.nearest)

    def check_between(self) -> None:
        """Raise BadInput if there are no values between those of neighbours, which a function of values has."""
        if self.nearest:
            raise BadInput(
                "The encoding 'values' interpolates between the values of voxels, and this volume is shown without "
                "interpolation: choose the encoding 'lattice', or linear interpolation."
            )

    def values(self) -> NDArray[np.float32]:
        """Return the values, 0 outside of the volume. (X + 1, Y + 1, Z + 1)"""
        return np.maximum(self.codes.astype(np.float32) - 1.0, 0.0) / np.float32(LARGEST)


def check_edges(edges: Edges) -> None:
    """Raise BadInput if the edges of a voxel are not finite, or not those of a body."""
    found = np.asarray(edges, np.float64)
    if found.shape != (3, 3) or not np.isfinite(found).all() or not abs(np.linalg.det(found)) > 0.0:
        raise BadInput("The edges of a volume's voxels must be three finite directions that are not in one plane.")


@dataclass(frozen=True, eq=False)
class ClassifiedVolume:
    """Extinction and range of the transfer function on the vertices of a grid over the visible box.

    Args:
        box: The visible box in world units.
        cells: Cells of the grid per box unit, a power of two.
        exponent: Natural logarithm of the extinction in 1 / box unit, from :data:`EMPTY_LOG_EXTINCTION` to
            :data:`OPAQUE_LOG_EXTINCTION`; vertex (i, j, k) lies at (i, j, k) / ``cells`` of the box.
            (X + 1, Y + 1, Z + 1) float16
        owner: Number of the range that contributes most of a vertex's extinction; at an empty vertex, the nearest
            range in value. (X + 1, Y + 1, Z + 1) uint8
        ranges: The visible ranges of the transfer function, in ascending order of their values.
        values: The values themselves; None for volumes that were classified without keeping them.

    Raises:
        BadInput: The box, the number of cells, the exponents or the owners are invalid or do not fit each other.
    """

    box: Box
    cells: int
    exponent: NDArray[np.float16]
    owner: NDArray[np.uint8]
    ranges: tuple[ValueRange, ...]
    values: ValueGrid | None = None

    def __post_init__(self) -> None:
        if self.cells < 1 or self.cells & (self.cells - 1):
            raise BadInput(f"The cells of a classified volume must be a power of two, not {self.cells}.")
        sides = np.asarray(self.box.extent)
        place = np.isfinite([*self.box.low, self.box.size]).all() and self.box.size > 0
        if not (place and len(self.box.low) == len(sides) == 3 and (sides > 0).all() and sides.max() <= 1.0):
            raise BadInput("The box of a classified volume must be finite, with sides in (0, 1] of its size.")
        expected = tuple(grid_shape(self.box, self.cells) + 1)
        if self.exponent.dtype != np.float16 or self.exponent.shape != expected:
            raise BadInput(f"The exponents of the extinction must be float16 on {expected} vertices.")
        if self.owner.dtype != np.uint8 or self.owner.shape != expected or self.owner.max() >= len(self.ranges):
            raise BadInput(f"The owners must be numbers of the {len(self.ranges)} ranges, on {expected} vertices.")
        if not ((self.exponent >= EMPTY_LOG_EXTINCTION) & (self.exponent <= OPAQUE_LOG_EXTINCTION)).all():
            raise BadInput(
                f"The exponents of an extinction must lie between {EMPTY_LOG_EXTINCTION} and {OPAQUE_LOG_EXTINCTION}."
            )

    def mixed_ranges(self) -> list[ValueRange]:
        """Return the ranges of colours that differ more than ``COLOUR_SPREAD``, because there are ``MOST_RANGES``."""
        grid = self.values
        if len(self.ranges) < MOST_RANGES or grid is None or grid.colours is None or grid.integral is None:
            return []
        parts = np.linspace(*grid.interval, len(grid.integral))
        middles, weight = 0.5 * (parts[1:] + parts[:-1]), np.diff(grid.integral)
        known = np.linspace(*grid.interval, len(grid.colours))
        colour = np.stack([np.interp(middles, known, one) for one in grid.colours.T], axis=1)
        found = []
        for one in self.ranges:
            own = (middles >= one.low) & (middles <= one.high) & (weight > 0)
            if own.any():
                away = np.square(colour[own] - np.average(colour[own], axis=0, weights=weight[own])).sum(axis=1)
                if np.average(away, weights=weight[own]) > COLOUR_SPREAD**2:
                    found.append(one)
        return found

    def at_vertices(self, vertices: NDArray[np.integer], resolution: int) -> NDArray[np.float32]:
        """Return the exponents at ``vertices / resolution``: (V, 3) integers -> (V,).

        ``resolution`` must divide ``cells``. Vertices outside the grid get ``EMPTY_LOG_EXTINCTION``.
        """
        if self.cells % resolution:
            raise ValueError(f"resolution {resolution} does not divide {self.cells}")
        i = np.asarray(vertices) * (self.cells // resolution)
        last = np.array(self.exponent.shape) - 1
        values = self.exponent[tuple(np.clip(i, 0, last).T)].astype(np.float32)
        return np.where(((i >= 0) & (i <= last)).all(axis=1), values, np.float32(EMPTY_LOG_EXTINCTION))

    def occupied(self, cells: int, least: float) -> NDArray[np.uint8]:
        """Mark the cells of a grid with ``cells`` per box unit where the extinction reaches ``least`` (1 / box unit).

        (X, Y, Z) uint8. ``cells`` must be a power of two.
        """
        return cells_with(self.exponent >= np.log(least), self.cells, grid_shape(self.box, cells), cells)


def cells_with(there: NDArray[np.bool_], own: int, shape: NDArray[np.int64], cells: int) -> NDArray[np.uint8]:
    """Mark the cells that have a marked vertex of another grid, which has ``own`` cells per box unit. (X, Y, Z)

    ``shape`` is from :func:`grid_shape` for ``cells`` per box unit. Both numbers per box unit are powers of two.
    """
    parts = max(1, own // cells)  # cells of the other grid per cell of this one, along an axis
    copies = max(1, cells // own)
    seen = np.zeros(-(-shape // copies) * parts + 1, bool)
    kept = tuple(slice(0, min(a, b)) for a, b in zip(seen.shape, there.shape))
    seen[kept] = there[kept]
    for axis in range(3):  # a cell has the vertices 0 to `parts`, inclusive
        seen = np.moveaxis(seen, axis, 0)
        inner = seen[:-1].reshape(-1, parts, *seen.shape[1:]).any(axis=1)
        seen = np.moveaxis(inner | seen[parts::parts], 0, axis)
    for axis in range(3):
        seen = seen.repeat(copies, axis)
    return seen[: shape[0], : shape[1], : shape[2]].astype(np.uint8)
