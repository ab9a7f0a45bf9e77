"""The extinction of a scene as a learned function of its volume's values.

A scene's extinction lives on the vertices of a lattice, with trilinear logarithms between them. Which logarithm at a
vertex gives the views' transmittance along rays depends on the transfer function between this vertex and the next, so
on the value there and on its slope: where the field is locally linear, on nothing else. One small table of both thus
stands for all vertices. It starts as the mean extinction over the values within half a cell (pre-integrated
classification, Engel et al. 2001) and is learned from the views.

Letters: V vertices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from torch import Tensor

from svv.core.classified import ValueGrid
from svv.core.extinction import EMPTY_LOG_EXTINCTION, MOST_LOG_EXTINCTION

VALUES, SLOPES = 512, 12
"""Rows and columns of the table."""

SLOPE_RANGE = 1e-3, 0.3
"""Slopes of the first and last column, in values per cell; those between are spaced by equal factors."""

BETAS = 0.9, 0.99
"""Decay rates of Adam's moments."""


class ExtinctionTable:
    """Logarithm of the extinction for each value and slope, and its optimiser (Adam)."""

    def __init__(self, grid: ValueGrid, device: torch.device) -> None:
        """Start from the grid's extinction."""
        value = np.linspace(0.0, 1.0, VALUES)[:, None]
        half = 0.5 * np.geomspace(*SLOPE_RANGE, SLOPES)[None]
        low, high = np.clip(value - half, 0.0, 1.0), np.clip(value + half, 0.0, 1.0)
        known = np.linspace(0.0, 1.0, len(grid.integral))
        mean = (np.interp(high, known, grid.integral) - np.interp(low, known, grid.integral)) / (high - low)
        least, most = np.exp([EMPTY_LOG_EXTINCTION, MOST_LOG_EXTINCTION])
        start = np.log(np.clip(mean, least, most)).ravel()
        self.table = torch.tensor(start, dtype=torch.float32, device=device)
        self.moments = torch.zeros(2, len(self.table), device=device)
        self.age = 0

    def step(self, gradient: Tensor, places: Places, rate: float) -> None:
        """Take one step against the gradient of the logarithms at V vertices. (V,)"""
        each = gradient[places.inside, None] * places.weight
        total = torch.zeros_like(self.table).index_add_(0, places.row.reshape(-1), each.reshape(-1))
        self.age += 1
        first, second = self.moments
        first.mul_(BETAS[0]).add_(total, alpha=1.0 - BETAS[0])
        second.mul_(BETAS[1]).addcmul_(total, total, value=1.0 - BETAS[1])
        mean, square = first / (1.0 - BETAS[0] ** self.age), second / (1.0 - BETAS[1] ** self.age)
        self.table -= rate * mean / (square.sqrt() + 1e-12)

    def at(self, places: Places) -> Tensor:
        """Return the logarithms at V vertices. (V,)"""
        return looked_up(self.table, places)


class Places:
    """Where the vertices of a lattice lie in the table.

    ``inside`` (V,) marks the I vertices inside the volume; ``row`` and ``weight`` (I, 4) interpolate bilinearly there.
    """

    def __init__(self, grid: ValueGrid, vertices: NDArray[np.int64], cells: int, device: torch.device) -> None:
        """Look up vertices (V, 3) of a lattice with ``cells`` per box unit."""
        at = vertices * (grid.cells / cells)
        field, there = values_of(grid)
        inside = _sampled(there.astype(np.float32), at) > 0.999
        at, half = at[inside], 0.5 * grid.cells / cells * np.eye(3)
        value = _sampled(field, at)
        change = np.stack([_sampled(field, at + axis) - _sampled(field, at - axis) for axis in half])
        slope = np.linalg.norm(change, axis=0)
        first, last = np.log(SLOPE_RANGE)
        row = np.clip(value, 0.0, 1.0) * (VALUES - 1)
        column = np.clip((np.log(slope + 1e-9) - first) / (last - first), 0.0, 1.0) * (SLOPES - 1)
        i, j = np.minimum(row.astype(np.int64), VALUES - 2), np.minimum(column.astype(np.int64), SLOPES - 2)
        a, b = row - i, column - j
        corner = i * SLOPES + j
        rows = np.stack([corner, corner + 1, corner + SLOPES, corner + SLOPES + 1], axis=1)
        weights = np.stack([(1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b], axis=1)
        self.inside = torch.from_numpy(inside).to(device)
        self.row = torch.from_numpy(rows).to(device)
        self.weight = torch.from_numpy(weights.astype(np.float32)).to(device)


def looked_up(table: Tensor, places: Places) -> Tensor:
    """Return the logarithms that a table gives V vertices; outside the volume, nothing is visible. (V,)"""
    found = table.new_full((len(places.inside),), EMPTY_LOG_EXTINCTION)
    found[places.inside] = (table[places.row] * places.weight).sum(dim=1)
    return found


def values_of(grid: ValueGrid) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the values of a grid, 0 outside of the volume, and which vertices are inside. (X + 1, Y + 1, Z + 1)"""
    there = grid.codes > 0
    return np.where(there, (grid.codes.astype(np.float32) - 1.0) / 65534.0, 0.0).astype(np.float32), there


def features_of(
    grid: ValueGrid, vertices: NDArray[np.int64], cells: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return value and normal at vertices (V, 3) of a lattice with ``cells`` per box unit: (V,), (V, 3).

    Values count from 0 to 1 over the visible interval; those beyond it are the nearest visible ones, so that the bytes
    of a scene file resolve what is seen. Normals are unit vectors against the gradient, shorter where it nearly
    vanishes.
    """
    at = vertices * (grid.cells / cells)
    field, _ = values_of(grid)
    low, high = grid.visible
    value = np.clip((_sampled(field, at) - low) / max(high - low, 1e-6), 0.0, 1.0)
    gradient = np.stack([_sampled(slope, at) for slope in np.gradient(field)], axis=1)
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    return value.astype(np.float32), (-gradient / (length + 1e-3 * max(length.max(), 1e-9))).astype(np.float32)


def _sampled(field: NDArray[np.float32], at: NDArray[Any]) -> NDArray[np.float32]:
    """Return a field's values at grid coordinates (V, 3), interpolated trilinearly. (V,)"""
    return np.asarray(map_coordinates(field, at.T, order=1, mode="nearest"), np.float32)
