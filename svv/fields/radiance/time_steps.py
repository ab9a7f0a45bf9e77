"""The values of a volume at one or several time steps, as a scene that is a function of them keeps them.

A step is a grid of values, compressed to a few bits each, and where its matter came from. Everything else about the
step follows from these (:mod:`svv.fields.following.followed_scene`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.box import Box
from svv.core.volumes.classified import ALIKE, COARSE, Edges, ValueGrid, check_edges, grid_shape
from svv.core.volumes.packing import packed, unpacked
from svv.errors import BadInput

MOVE_CELLS = 16
"""Cells along the longest side of the grid on which displacements of matter are kept."""

MOVE_STEP = 1.0 / 512.0
"""Precision of displacements, in box units."""

MOST_CELLS, MOST_VERTICES = 1 << 14, 1 << 31
"""Limits of a grid, beyond which a file is damaged."""


@dataclass(frozen=True, eq=False)
class TimeSteps:
    """Time steps of a volume, over one box; BadInput if times do not increase, or the parts do not fit each other."""

    box: Box
    """Box of the grids, in world units."""
    cells: int
    """Cells of the grids per box unit, a power of two."""
    interval: tuple[float, float]
    """What the values 0 and 1 are in the volume."""
    times: tuple[float, ...]
    """Times of the steps, ascending."""
    codes: tuple[NDArray[np.uint8], ...]
    """Codes of each step's values, without their last six bits, compressed
    (:func:`svv.core.volumes.packing.packed`)."""
    moves: tuple[NDArray[np.uint8] | None, ...]
    """Where the matter of each step was in the own step, compressed; None where it is the same place."""
    own: int = 0
    """Number of the step that the scene itself shows, and in which it was painted."""
    edges: Edges = ALIKE
    """Edges of the volume's voxels, in cells of the grids."""

    def __post_init__(self) -> None:
        check_edges(self.edges)
        count = len(self.times)
        if count < 1 or not np.isfinite(self.times).all() or (np.diff(self.times) <= 0).any():
            raise BadInput("The times of steps must increase from one to the next.")
        if len(self.codes) != count or len(self.moves) != count or not 0 <= self.own < count:
            raise BadInput("The time steps of a scene do not fit each other.")
        sides, place = np.asarray(self.box.extent), np.isfinite([*self.box.low, self.box.size, *self.interval]).all()
        small = 1 <= self.cells <= MOST_CELLS and not self.cells & (self.cells - 1)
        whole = (
            place and len(self.box.low) == len(sides) == 3 and self.box.size > 0 and self.interval[0] < self.interval[1]
        )
        if not (small and whole and ((sides > 0) & (sides <= 1)).all() and np.prod(self.shape) <= MOST_VERTICES):
            raise BadInput("The grid of a scene's time steps is not valid.")

    def __len__(self) -> int:
        return len(self.times)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of vertices of the grids along x, y, z."""
        x, y, z = (int(n) + 1 for n in grid_shape(self.box, self.cells))
        return x, y, z

    @classmethod
    def of(cls, grid: ValueGrid, box: Box, time: float = 0.0) -> TimeSteps:
        """Return a single step."""
        return cls(box, grid.cells, grid.interval, (time,), (packed_codes(grid.codes),), (None,), 0, grid.edges)

    def only(self, step: int) -> TimeSteps:
        """Return one of the steps alone, as the own one."""
        codes, time = self.codes[step], self.times[step]
        return TimeSteps(self.box, self.cells, self.interval, (time,), (codes,), (None,), 0, self.edges)

    def grid(self, step: int, visible: tuple[float, float]) -> ValueGrid:
        """Return the values of a step, of which the part ``visible`` is visible; ValueError if they are damaged."""
        codes = unpacked(self.codes[step], self.shape)
        codes = np.where(codes > 0, 1 + COARSE * (np.minimum(codes, 1024) - 1), 0).astype(np.uint16)
        return ValueGrid(self.cells, codes, self.interval, visible, edges=self.edges)

    def place(self, step: int) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
        """Return a function from positions in the box to where their matter was in the own step, (S, 3) -> (S, 3).

        Raises BadInput if the displacements are damaged.
        """
        content = self.moves[step]
        if content is None:
            return lambda position: position
        from scipy.ndimage import map_coordinates

        shape = move_shape(self.shape)
        try:
            moves = MOVE_STEP * unpacked(content, (3, *shape)).view(np.int16).astype(np.float64)
        except ValueError as error:
            raise BadInput(f"Time step {step} of the scene cannot be read: {error}.") from error
        extent = np.array([(n - 1) / self.cells for n in self.shape])

        def found(position: NDArray[np.float64]) -> NDArray[np.float64]:
            place = (position / extent * (np.array(shape) - 1)).T
            moved = np.stack([map_coordinates(axis, place, order=1, mode="nearest") for axis in moves], axis=1)
            return np.asarray(position + moved)

        return found

    def to_json(self) -> dict[str, object]:
        """Return what the header of a scene's file tells about the steps."""
        return {
            "box": {"low": self.box.low, "size": self.box.size, "extent": self.box.extent}, "cells": self.cells,
            "interval": self.interval, "times": self.times, "own": self.own, "edges": self.edges,
        }  # fmt: skip

    def to_arrays(self) -> dict[str, NDArray[np.uint8]]:
        """Return the arrays of a scene's file."""
        found = {f"step{k}.codes": codes for k, codes in enumerate(self.codes)}
        return found | {f"step{k}.moves": moves for k, moves in enumerate(self.moves) if moves is not None}

    @classmethod
    def from_file(cls, header: dict[str, Any], arrays: Mapping[str, NDArray[np.generic]]) -> TimeSteps:
        """Restore the steps of a scene's file; raises KeyError, TypeError or ValueError if the content does not fit."""
        b, (low, high) = header["box"], header["interval"]
        box = Box(tuple(b["low"]), float(b["size"]), tuple(b["extent"]))
        times = tuple(float(time) for time in header["times"])
        given = [(arrays[f"step{k}.codes"], arrays.get(f"step{k}.moves")) for k in range(len(times))]
        if any(a is not None and (a.dtype != np.uint8 or a.ndim != 1) for pair in given for a in pair):
            raise ValueError("the time steps are damaged")
        codes = tuple(np.asarray(own, np.uint8) for own, _ in given)
        moves = tuple(None if move is None else np.asarray(move, np.uint8) for _, move in given)
        try:
            edges = tuple((float(x), float(y), float(z)) for x, y, z in header.get("edges", ALIKE))
            own = int(header["own"])
            return cls(box, int(header["cells"]), (float(low), float(high)), times, codes, moves, own, edges)
        except BadInput as error:
            raise ValueError(str(error)) from error


def packed_codes(codes: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return a :class:`svv.core.volumes.classified.ValueGrid`'s codes, 1024 values, compressed. (N,)"""
    rounded = (codes.astype(np.int32) - 1 + COARSE // 2) // COARSE
    return packed(np.where(codes > 0, 1 + rounded, 0).astype(np.uint16))


def move_shape(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the number of vertices of the displacements that belong to a grid of values of this shape."""
    factor = min(1.0, MOVE_CELLS / (max(shape) - 1))
    x, y, z = (max(2, round((n - 1) * factor) + 1) for n in shape)
    return x, y, z


def packed_moves(moves: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return displacements in box units (3, X, Y, Z), compressed, see :func:`move_shape`. (N,)"""
    return packed(np.clip(np.rint(moves / MOVE_STEP), -32768, 32767).astype(np.int16))
