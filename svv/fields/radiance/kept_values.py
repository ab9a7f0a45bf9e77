"""The volume's values where a scene shows something, kept in its file, to be read off at points in the world.

A scene of the encoding ``values`` holds them anyway (:mod:`svv.fields.radiance.time_steps`). Letters: N points.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.box import Box
from svv.core.json_values import list_in, switch_in, vector_in
from svv.core.volumes.classified import ALIKE, COARSE, LARGEST, Edges, ValueGrid, check_edges, grid_shape
from svv.fields.radiance.kept_kernels import differences, restore
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.time_steps import TimeSteps

MOST_VERTICES = 1 << 27
"""Limit of a grid, beyond which a file is damaged: a volume is classified on at most 257 vertices a side."""

POINTS = 1 << 16
"""Points that are read off together, each from 64 vertices."""

BESIDE, LEAST_WEIGHT = 1e-3, 1e-6
"""Distances in cells, and weights, that make no difference."""

FINEST = 1.5
"""Voxels per cell up to which a grid misses more of a rough volume, the more there are."""

HALF = 0.5
"""Least weight of the vertices of a cell that have a value, for a point in it to have one."""

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """Values of a volume at N points in the world."""

    value: Numbers
    """The values, NaN where none is kept. (N,)"""
    uncertainty: Numbers
    """How far they may be off, at 19 of 20 places: a step of the numbers kept, and what interpolation misses. (N,)"""
    beyond: NDArray[np.int8]
    """-1 or 1 where the volume's value may lie below or above the one told, the first or last that is kept. (N,)"""


@dataclass(frozen=True, eq=False)
class KeptValues:
    """Values on those vertices of a grid over a box that lie at cells in which a scene shows something."""

    box: Box
    """Box of the grid, in world units."""
    cells: int
    """Cells of the grid per box unit."""
    interval: tuple[float, float]
    """What the smallest and the largest code are in the volume."""
    there: NDArray[np.uint8]
    """Which vertices have a value, a bit each, compressed. (A,)"""
    codes: NDArray[np.uint8]
    """Their codes (:class:`svv.core.volumes.classified.ValueGrid`), as compressed differences from neighbours. (B,)"""
    edges: Edges = ALIKE
    """Edges of the volume's voxels, in cells of the grid."""
    coarse: bool = True
    """Whether there are 1024 values, as of volumes that are interpolated, or 64 times as many, for labels."""
    nearest: bool = False
    """Whether a point has the value of the nearest voxel, and none between."""
    whole: bool = False
    """Whether the volume's values are whole numbers, which those of nearest voxels are then as well."""

    def __post_init__(self) -> None:
        check_edges(self.edges)
        small = self.cells >= 1 and np.prod(grid_shape(self.box, self.cells) + 1.0) <= MOST_VERTICES
        if not (np.isfinite([*self.box.low, self.box.size, *self.interval]).all() and self.box.size > 0 and small):
            raise ValueError("the grid of the values is not valid")
        if not self.interval[0] < self.interval[1]:
            raise ValueError("the interval of the values is not valid")

    @classmethod
    def of(cls, grid: ValueGrid, box: Box, shown: Occupancy, whole: bool = False) -> KeptValues:
        """Return the values of a grid over a box at the occupied cells of a scene."""
        seen = vertices_at(shown, box, grid.cells, grid.codes.shape) & (grid.codes > 0)
        coarse = not ((grid.codes[seen] - 1) % COARSE).any()
        own = (np.maximum(grid.codes, 1) - 1).astype(np.int32) // (COARSE if coarse else 1)
        found = np.empty(int(seen.sum()), np.uint16)
        differences(own, seen, found)
        rest = found.view(np.int16)
        folded = ((rest << 1) ^ (rest >> 15)).view(np.uint16)  # 0, -1, 1, -2 ... become 0, 1, 2, 3 ...
        halves = (folded & 255).astype(np.uint8), (folded >> 8).astype(np.uint8)
        stream = zlib.compressobj(memLevel=9, strategy=zlib.Z_RLE)
        codes = b"".join(stream.compress(half.tobytes()) for half in halves) + stream.flush()
        there = zlib.compress(np.packbits(seen).tobytes(), 6)
        kept = np.frombuffer(there, np.uint8), np.frombuffer(codes, np.uint8)
        return cls(box, grid.cells, grid.interval, *kept, grid.edges, coarse, grid.nearest, whole)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of vertices of the grid along x, y, z."""
        x, y, z = (int(n) + 1 for n in grid_shape(self.box, self.cells))
        return x, y, z

    @property
    def step(self) -> float:
        """Distance of the values that can be told apart."""
        return (self.interval[1] - self.interval[0]) / (LARGEST // COARSE if self.coarse else LARGEST)

    @property
    def bytes(self) -> int:
        """Bytes that the values take in a scene's file."""
        return len(self.there) + len(self.codes)

    @property
    def count(self) -> int:
        """Number of vertices with a value."""
        return int(self._seen().sum())

    def lattice(self) -> NDArray[np.uint16]:
        """Return the codes on all vertices, 0 where there is none; raises ValueError if they are damaged. (X, Y, Z)"""
        seen = self._seen()
        count = int(seen.sum())
        both = _inflated(self.codes, 2 * count)
        folded = both[:count].astype(np.uint16) | (both[count:].astype(np.uint16) << 8)
        own = np.zeros(self.shape, np.int32)
        restore((folded >> 1) ^ (0 - (folded & 1)).astype(np.uint16), seen, own)
        own = np.where(seen, 1 + own * (COARSE if self.coarse else 1), 0)
        if own.max(initial=0) > LARGEST + 1:
            raise ValueError("the values are beyond their interval")
        return own.astype(np.uint16)

    def _seen(self) -> NDArray[np.bool_]:
        count = int(np.prod(self.shape))
        return np.unpackbits(_inflated(self.there, -(-count // 8)), count=count).view(bool).reshape(self.shape)

    def to_json(self) -> dict[str, object]:
        """Return what the header of a scene's file tells about them."""
        return {
            "box": {"low": self.box.low, "size": self.box.size, "extent": self.box.extent}, "cells": self.cells,
            "interval": self.interval, "edges": self.edges, "coarse": self.coarse, "nearest": self.nearest,
            "whole": self.whole,
        }  # fmt: skip

    def to_arrays(self) -> dict[str, NDArray[np.uint8]]:
        """Return the arrays of a scene's file."""
        return {"kept.there": self.there, "kept.codes": self.codes}

    @classmethod
    def from_file(cls, told: dict[str, Any], arrays: Mapping[str, NDArray[np.generic]], box: Box) -> KeptValues:
        """Restore what a scene's file holds; raises KeyError, TypeError or ValueError if the content does not fit."""
        there, codes = (arrays[f"kept.{name}"] for name in ("there", "codes"))
        if any(array.dtype != np.uint8 or array.ndim != 1 for array in (there, codes)):
            raise ValueError("the values are damaged")
        low, high = (float(end) for end in told["interval"])
        kept = np.asarray(there, np.uint8), np.asarray(codes, np.uint8)
        x, y, z = (vector_in(edge, "the edge of a voxel") for edge in list_in(told["edges"], 3, "the edges of voxels"))
        coarse, nearest, whole = (switch_in(told[name], name) for name in ("coarse", "nearest", "whole"))
        return cls(box, int(told["cells"]), (low, high), *kept, (x, y, z), coarse, nearest, whole)


def read_at(kept: KeptValues | TimeSteps, points: Numbers, within: tuple[float, float] | None = None) -> Reading:
    """Return the values at points in the world (N, 3), of the step that a scene shows if it has time steps.

    Between voxels, values are interpolated trilinearly. Labels have none between: of those at the corners of a point's
    cell, the nearest counts, of the values ``within`` an interval if one has such a value. Raises ValueError if they
    are damaged.
    """
    lattice = _lattice_of(kept)
    place = kept.box.to_box(points).reshape(-1, 3) * kept.cells
    pieces = [_read(kept, lattice, place[k : k + POINTS], within) for k in range(0, len(place), POINTS)]
    empty = np.zeros(0)
    value, uncertainty, beyond = (np.concatenate(each) for each in zip((empty, empty, empty), *pieces, strict=True))
    return Reading(value, uncertainty, beyond.astype(np.int8))


@lru_cache(maxsize=2)
def _lattice_of(kept: KeptValues | TimeSteps) -> NDArray[np.uint16]:
    """Return the codes on all vertices; those of the last scenes stay in memory, as clicks come one after another."""
    return kept.lattice() if isinstance(kept, KeptValues) else kept.grid(kept.own, (0.0, 1.0)).codes


CORNERS = np.stack(np.meshgrid(*[[0, 1]] * 3, indexing="ij"), axis=-1).reshape(8, 3)
AROUND = np.stack(np.meshgrid(*[[-1, 0, 1, 2]] * 3, indexing="ij"), axis=-1).reshape(64, 3)


def _read(
    kept: KeptValues | TimeSteps, lattice: NDArray[np.uint16], place: Numbers, within: tuple[float, float] | None
) -> tuple[Numbers, Numbers, Numbers]:
    """Return value, uncertainty and where it may lie beyond (N,) at positions in cells of the grid (N, 3)."""
    last, (low, high), step = np.array(lattice.shape) - 1, kept.interval, _step_of(kept)
    inside = np.asarray(((place >= -BESIDE) & (place <= last + BESIDE)).all(axis=1))
    first = np.clip(np.floor(np.where(inside[:, None], place, 0.0)).astype(np.int64), 0, last - 1)
    part = np.clip(place - first, 0.0, 1.0)
    at = first[:, None] + AROUND
    around = lattice[tuple(np.moveaxis(np.clip(at, 0, last), -1, 0))].astype(np.float64)
    around = np.where(((at >= 0) & (at <= last)).all(axis=-1), around, 0.0).reshape(-1, 4, 4, 4)
    code = around[:, 1:3, 1:3, 1:3].reshape(-1, 8)
    weight = np.where(CORNERS, part[:, None], 1.0 - part[:, None]).prod(axis=-1) * (code > 0)
    known = np.asarray(inside & (weight.sum(axis=1) >= HALF))
    width = (high - low) / LARGEST
    values = low + width * (code - 1.0)
    spread = (np.where(code > 0, values, -np.inf).max(axis=1) - np.where(code > 0, values, np.inf).min(axis=1))[known]
    found, off, beyond = np.full(len(place), np.nan), np.full(len(place), np.nan), np.zeros(len(place))
    if isinstance(kept, KeptValues) and kept.nearest:
        found[known] = _nearest(values[known], weight[known], within)
        exact = kept.whole and step < 1.0
        found = np.rint(found) if exact else found
        off[known] = spread + (0.0 if exact else 0.5 * step)
    else:
        found[known] = (weight * values)[known].sum(axis=1) / weight[known].sum(axis=1)
        orders = (0, 1, 2), (1, 0, 2), (2, 0, 1)
        finer = finer_than_cells(kept.edges)
        bends = [_bends(np.moveaxis(around, 1 + k[0], 1), part[:, k], step / width, finer[k[0]]) for k in orders]
        missed = width * np.linalg.norm(bends, axis=0)  # those along the axes are independent
        off[known] = step + missed[known] + np.where((code[known] > 0).all(axis=1), 0.0, spread)
    counts = (weight > LEAST_WEIGHT) & np.reshape(known, (-1, 1))
    beyond -= (counts & (code == 1)).any(axis=1)
    beyond += (counts & (code == LARGEST + 1)).any(axis=1)
    return found, off, beyond


def finer_than_cells(edges: Edges) -> Numbers:
    """Return how many voxels there are per cell along each axis, at least 1, from their edges in cells. (3,)"""
    return np.asarray(1.0 / np.clip(np.abs(edges).max(axis=0), 1e-3, 1.0))


def _step_of(kept: KeptValues | TimeSteps) -> float:
    """Return the distance of the values that can be told apart."""
    low, high = kept.interval
    return kept.step if isinstance(kept, KeptValues) else (high - low) * COARSE / LARGEST


def _nearest(values: Numbers, weight: Numbers, within: tuple[float, float] | None) -> Numbers:
    """Return the values of the corners (N, 8) with the largest weight, of those within an interval if there are any."""
    if within is not None:
        fits = (values >= within[0] - LEAST_WEIGHT) & (values <= within[1] + LEAST_WEIGHT) & (weight > 0)
        weight = np.where(fits, 1.0 + weight, weight)
    return np.take_along_axis(values, weight.argmax(axis=1)[:, None], axis=1)[:, 0]


def _bends(code: Numbers, part: Numbers, rounding: float, finer: float) -> Numbers:
    """Return what linear interpolation along the first axis misses at points in cells, from the codes around. (N,)

    Where a voxel lies within a cell, values have a kink there. At a part s of the way along an edge of the cell, they
    miss at most 2 s (1 - s) of the larger second difference at its ends, or all of it if only one is known; with
    ``finer`` voxels than cells, they are farther off, and sooner. ``part``: position in the cell, first along that axis
    (N, 3). ``rounding`` alone makes such differences, and hides others.
    """
    inner = code[:, :, 1:3, 1:3]
    there = (inner[:, :-2] > 0) & (inner[:, 1:-1] > 0) & (inner[:, 2:] > 0)
    bend = np.where(there, np.abs(inner[:, :-2] - 2.0 * inner[:, 1:-1] + inner[:, 2:]) - rounding, 0.0)
    along, second, third = part.T
    reach = np.minimum(2.0 * finer * along * (1.0 - along), 0.5 * min(finer, FINEST))
    edges = np.where(there.all(axis=1), reach[:, None, None], 1.0) * np.maximum(bend.max(axis=1), 0.0)
    edges = edges[:, 0] * (1.0 - second)[:, None] + edges[:, 1] * second[:, None]
    return np.asarray(edges[:, 0] * (1.0 - third) + edges[:, 1] * third)


def vertices_at(shown: Occupancy, box: Box, cells: int, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mark the vertices of a grid over a box whose cells touch an occupied cell, wherever that has its own box.

    The grid has ``cells`` per box unit and ``shape`` vertices. (X, Y, Z)
    """
    found = shown.occupied > 0
    for axis, (count, low) in enumerate(zip(shape, box.low, strict=True)):
        vertex = np.arange(count)[:, None] + (-1.0, 1.0)
        at = (low + vertex * (box.size / cells) - shown.box.low[axis]) / shown.box.size * shown.cells
        first, end = np.floor(at[:, 0] + BESIDE), np.ceil(at[:, 1] - BESIDE)
        limits = np.clip(np.stack([first, end]), 0, found.shape[axis]).astype(np.int64)
        there = np.moveaxis(found, axis, 0)
        counts = np.concatenate([np.zeros((1, *there.shape[1:]), np.int32), np.cumsum(there, axis=0, dtype=np.int32)])
        found = np.moveaxis(counts[limits[1]] > counts[limits[0]], 0, axis)
    return found


def _inflated(content: NDArray[np.uint8], count: int) -> NDArray[np.uint8]:
    """Return so many bytes, decompressed; raises ValueError if there are more or fewer."""
    stream = zlib.decompressobj()
    try:
        found = np.frombuffer(stream.decompress(content.tobytes(), max(count, 1)), np.uint8)
    except zlib.error as error:
        raise ValueError(f"the values are damaged: {error}") from error
    if len(found) != count or stream.unconsumed_tail or not stream.eof:
        raise ValueError("the values are more or fewer than they say")
    return found
