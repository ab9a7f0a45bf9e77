"""What a scene's lattices hold if it is a function of its volume's values: extinctions, features and normals.

Which log extinction at a vertex gives the views' transmittance depends on the transfer function between this vertex and
the next, so on the value there and on its slope: one small table of both stands for all vertices (learned by
:mod:`svv.train.base.extinction_table`). Colours are functions of the value, and light of the normal. Letters: V
vertices.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.core.colour import palette_shading
from svv.core.colour.light import NORMAL_SCALE
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION, LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.core.volumes.classified import ValueGrid
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.phong import LONGEST_VECTOR
from svv.fields.radiance.value_function import ValueFunction

VALUES, SLOPES = 512, 12
"""Rows and columns of the table."""

SLOPE_RANGE = 2.5e-3, 0.75
"""Slopes of the first and last column, in values per cell; those between are spaced by equal factors."""


class Places:
    """Where the vertices of a lattice lie in the table.

    ``inside`` (V,) marks the I vertices inside the volume; ``row`` and ``weight`` (I, 4) interpolate bilinearly there.
    """

    def __init__(self, grid: ValueGrid, vertices: NDArray[np.int64], cells: int, device: torch.device) -> None:
        """Look up vertices (V, 3) of a lattice with ``cells`` per box unit."""
        at = vertices * (grid.cells / cells)
        field, there = grid.values(), grid.codes > 0
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


def features_of(
    grid: ValueGrid, vertices: NDArray[np.int64], cells: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return value and normal at vertices (V, 3) of a lattice with ``cells`` per box unit: (V,), (V, 3).

    Values count from 0 to 1 over the visible interval; those beyond it are the nearest visible ones, so that the bytes
    of a scene file resolve what is seen. Normals are unit vectors against the gradient, shorter where it nearly
    vanishes. The gradient is that of differences from voxel to voxel, interpolated, as ray casters have it: between two
    voxels, interpolated values have a slope that does not change, and at a voxel a kink.
    """
    whole = grid.cells % cells == 0
    at = vertices * (grid.cells // cells if whole else grid.cells / cells)
    field = grid.values()
    low, high = grid.visible
    value = np.clip((_sampled(field, at) - low) / max(high - low, 1e-6), 0.0, 1.0)
    gradient = np.zeros((len(at), 3), np.float32)
    for edge in np.asarray(grid.edges):
        length = np.linalg.norm(edge)
        step = edge * max(1.0, 1.0 / length)  # within a cell of the grid, there is no more to see
        ahead, behind = (np.clip(at + side * step, 0, np.array(field.shape) - 1) for side in (1.0, -1.0))
        change = _sampled(field, ahead) - _sampled(field, behind)
        across = np.maximum(np.linalg.norm(ahead - behind, axis=1), 1e-6)
        gradient += (change / across)[:, None] * (edge / length).astype(np.float32)
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    return value.astype(np.float32), (-gradient / (length + 1e-3 * max(length.max(), 1e-9))).astype(np.float32)


def _sampled(field: NDArray[np.float32], at: NDArray[np.generic]) -> NDArray[np.float32]:
    """Return a field's values at grid coordinates (V, 3), interpolated trilinearly unless these are whole. (V,)"""
    from scipy.ndimage import map_coordinates

    if np.issubdtype(at.dtype, np.integer):
        return np.asarray(field[tuple(np.minimum(at, np.array(field.shape) - 1).T)], np.float32)
    return np.asarray(map_coordinates(field, at.T, order=1, mode="nearest"), np.float32)


def exponents_at(function: ValueFunction, grid: ValueGrid, lattice: SparseLattice, occupancy: Occupancy) -> Tensor:
    """Return log extinctions in 1 / box unit at the vertices of a lattice of one level, on the CPU. (V,)"""
    vertices = lattice.vertices_of_level(0, occupancy.occupied, occupancy.cells)
    places = Places(grid, vertices, lattice.resolutions[0], torch.device("cpu"))
    exponent = looked_up(function.table.cpu(), places) + float(np.log(occupancy.box.size / function.size))
    return exponent.clamp(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)


def features_at(grid: ValueGrid, lattice: nn.Module, occupancy: Occupancy) -> tuple[Tensor, Tensor]:
    """Return value (V,) and normal (V, 3) at the vertices of a lattice of one level, on its device."""
    assert isinstance(lattice, SparseLattice)
    vertices = lattice.vertices_of_level(0, occupancy.occupied, occupancy.cells)
    device = lattice.table.device
    value, normal = (torch.from_numpy(a).to(device) for a in features_of(grid, vertices, lattice.resolutions[0]))
    return value, normal


@torch.no_grad()
def fill_base(base: BaseField, function: ValueFunction, grid: ValueGrid, occupancy: Occupancy) -> None:
    """Fill the tables of a base field on the CPU."""
    assert base.density is not None
    base.density.table.copy_(exponents_at(function, grid, base.density, occupancy)[:, None])
    fill_features(base, grid, occupancy)


@torch.no_grad()
def fill_features(base: BaseField, grid: ValueGrid, occupancy: Occupancy) -> None:
    """Fill the table of a base field's features."""
    value, normal = features_at(grid, base.encoding, occupancy)
    base.encoding.table.copy_(torch.cat([value[:, None], normal], dim=1))


@torch.no_grad()
def fill_palette(network: PaletteField, base: BaseField) -> None:
    """Fill the tables of a palette network, whose values and normals are the features of its base field.

    Its MLP has no biases, so it takes a value v as (1 - v, v).
    """
    value, normal = base.encoding.table[:, 0], base.encoding.table[:, 1:]
    network.encoding.table.copy_(palette_features(value))
    if network.phong is not None:
        network.phong.normals.table.copy_(LONGEST_VECTOR * normal / NORMAL_SCALE)


def palette_features(value: Tensor) -> Tensor:
    """Return a palette network's features of values, which count from 0 to 1 over the visible ones. (V,) -> (V, 4)"""
    zero = torch.zeros_like(value)
    return torch.stack([1.0 - value, value, zero, zero], dim=1)


def colours_of(network: PaletteField, value: Tensor) -> tuple[Tensor, Tensor]:
    """Return the diffuse colours (V, 3) of values (V,) in full light, and the brightness of that, (V, 1)."""
    intensity, weights, offsets = palette_shading.material(network.palette_mlp(palette_features(value)))
    colour = palette_shading.diffuse(intensity, weights, network.colours + offsets)
    if network.phong is None:
        return colour, torch.ones_like(colour[:, :1])
    ambient_and_diffuse = network.phong.coefficients()[:, :2].sum(dim=1)
    return colour, (weights @ ambient_and_diffuse)[:, None]


TABLES = "base.density.table", "base.encoding.table", "pcn.encoding.table", "pcn.phong.normals.table"
"""Names of the tables that :func:`fill_base` and :func:`fill_palette` fill, in a scene's file."""
