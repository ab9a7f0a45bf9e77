"""The points of a regular grid in a scene, and what edits do not change about them.

The grid's points are vertices of a lattice as fields have it, so that a grid as fine as the scene's finest lattice
repeats what the lattice holds. Letters: S points in occupied cells, P palette colours, (Z, Y, X) points of the grid.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from torch import Tensor

from svv.core.colour import palette_shading
from svv.core.rays.extinction import MOST_LOG_EXTINCTION
from svv.core.volumes.opacity_code import LEAST_LOG_DEPTH, unit_distance
from svv.errors import BadInput, Progress, part, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, PaletteField, UnrestrictedField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.scene import Scene
from svv.kernels.types import Samples
from svv.options.baking import BakeOptions

CHUNK = 1 << 18
"""Points that networks process at a time."""

FINEST_HASH = 256
"""Cells along the longest side for a scene with a hash grid, whose levels go far beyond what it distinguishes."""

FAINTER = 3.0
"""Logarithm of the factor by which extinction may lie below what can be seen and is kept all the same, for edits that
make it more opaque."""


@dataclass(frozen=True)
class Grid:
    """A regular grid of points around the occupied cells of a scene; x, y, z each."""

    resolution: int
    """Cells per box unit."""
    shape: tuple[int, int, int]
    """Number of points."""
    first: tuple[int, int, int]
    """Index of the first point among the lattice's vertices, which are counted from the box's lowest corner."""
    origin: tuple[float, float, float]
    """Position of the first point, world units."""
    spacing: float
    """Distance between points, world units."""

    @property
    def unit_distance(self) -> float:
        """Length over which the opacities of codes hold, world units."""
        return unit_distance(np.array(self.shape) - 1, np.full(3, self.spacing))

    @property
    def points(self) -> int:
        """Number of points in all."""
        return int(np.prod(self.shape, dtype=np.int64))


def grid_of(scene: Scene, options: BakeOptions, network: str) -> Grid:
    """Return the finest grid that the scene needs and the options allow.

    Its resolution divides the cells of the scene's occupancy or is a multiple of them. Raises BadInput if not even the
    coarsest grid fits into the memory allowed, or the scene holds nothing.
    """
    cells = scene.occupancy.cells
    filled = np.argwhere(scene.occupancy.occupied > 0)
    if not len(filled):
        raise BadInput("The scene is empty: there is nothing to make a volume of.")
    wanted = options.resolution or _finest(scene, network)
    divisors = [cells // k for k in range(1, cells + 1) if cells % k == 0 and cells // k >= 4]
    candidates = sorted({*divisors, *range(cells, wanted + 1, cells)})
    fitting = [r for r in candidates if r <= wanted] or candidates[:1]
    for resolution in reversed(fitting):
        grid = _around(scene.occupancy, filled, resolution)
        if 4 * grid.points <= options.memory * 1e9:
            return grid
    raise BadInput(f"A volume of the scene does not fit into {options.memory:g} GB: allow it more memory.")


def grid_around(grids: Sequence[Grid], memory: float) -> Grid:
    """Return a grid that contains others, as fine as the finest and aligned with it if ``memory`` (GB) allows."""
    finest = min(grids, key=lambda grid: grid.spacing)
    spacing, origin = finest.spacing, np.array(finest.origin)
    low = np.min([grid.origin for grid in grids], axis=0)
    high = np.max([grid.origin + grid.spacing * (np.array(grid.shape) - 1) for grid in grids], axis=0)
    while True:
        first = origin - spacing * np.ceil((origin - low) / spacing - 1e-6)
        x, y, z = (int(n) + 1 for n in np.ceil((high - first) / spacing - 1e-6))
        size = 4.0 * x * y * z / (memory * 1e9)
        if size <= 1.0:
            place = float(first[0]), float(first[1]), float(first[2])
            resolution = max(1, round(finest.resolution * finest.spacing / spacing))
            return Grid(resolution, (x, y, z), (0, 0, 0), place, spacing)
        spacing *= 1.01 * float(np.cbrt(size))


def twice(scene: Scene, grid: Grid, network: str) -> Grid | None:
    """Return the grid of twice a grid's resolution; None if that is finer than the scene needs or does not fit it."""
    resolution, cells = 2 * grid.resolution, scene.occupancy.cells
    if resolution > _finest(scene, network) or (resolution % cells and cells % resolution):
        return None
    return _around(scene.occupancy, np.argwhere(scene.occupancy.occupied > 0), resolution)


def _around(occupancy: Occupancy, filled: NDArray[np.int64], resolution: int) -> Grid:
    """Return the grid of a resolution around the occupied cells (N, 3)."""
    first = filled.min(axis=0) * resolution // occupancy.cells
    last = -(-(filled.max(axis=0) + 1) * resolution // occupancy.cells)
    x, y, z = (int(n) for n in last - first + 1)
    a, b, c = (int(n) for n in first)
    low = occupancy.box.to_world(first / resolution)
    return Grid(
        resolution, (x, y, z), (a, b, c), (float(low[0]), float(low[1]), float(low[2])),
        occupancy.box.size / resolution,
    )  # fmt: skip


def _finest(scene: Scene, network: str) -> int:
    """Return the cells per box unit of the finest lattice that images of this network depend on."""
    assert scene.palette_network is not None
    tables = [scene.base.density or scene.base.encoding, scene.palette_network.encoding]
    if network == "styled" and scene.styled is not None:
        tables.append(scene.styled.encoding)
    levels = [int(t.resolutions[-1]) for t in tables if isinstance(t, SparseLattice)]
    return max(levels) if levels else FINEST_HASH


@dataclass(frozen=True)
class Matter:
    """What a scene holds at the points of a grid, whatever its edits."""

    grid: Grid
    position: Tensor
    """Box coordinates. (S, 3)"""
    place: NDArray[np.int64]
    """Flat index into an array of the grid (Z, Y, X), ascending. (S,)"""
    near: NDArray[np.int64]
    """The same of all points that are, or lie beside, one of these. (N,)"""
    log_extinction: Tensor
    """Logarithm of the extinction, 1 / box unit. (S,)"""
    region: Tensor
    """Palette colour of the largest weight of each point, which is its region unless parts were split off. (S,)"""
    diffuse: Tensor
    """Diffuse colour without edits and paint, half precision. (S, 3)"""
    shares: Tensor
    """Intensity times palette weights, half precision. (S, P)"""
    offsets: Tensor
    """Offsets of the palette colours, half precision. (S, P, 3)"""

    def __len__(self) -> int:
        return len(self.place)

    def pieces(self) -> Iterator[slice]:
        """Yield slices of points that are processed together."""
        return (slice(first, first + CHUNK) for first in range(0, len(self), CHUNK))


@torch.no_grad()
def matter_of(scene: Scene, grid: Grid, progress: Progress = silent) -> Matter:
    """Look up extinction and material of a scene with a palette network, without its edits, at the points of a grid."""
    assert scene.palette_network is not None
    progress(0.0, "finding points")
    position, place = _points(scene.occupancy, grid)
    least = LEAST_LOG_DEPTH - FAINTER - float(np.log(grid.unit_distance / scene.occupancy.box.size))
    device, palette = scene.device, scene.palette_network
    found: list[tuple[Tensor, ...]] = [_material(palette, torch.zeros(0, 3, device=device))]
    kept, logs = [torch.zeros(0, dtype=torch.int64)], [torch.zeros(0, device=device)]
    for first in range(0, len(place), CHUNK):
        part(progress, 0.1, 1.0)(first / len(place), "looking up the scene")
        at = position[first : first + CHUNK].to(device)
        log = log_extinction(scene.base, at)
        rows = (log > least).nonzero()[:, 0]
        kept.append(rows.cpu() + first)
        logs.append(log[rows])
        found.append(_material(palette, at[rows].contiguous()))
    chosen = torch.cat(kept)
    place = place[chosen.numpy()]
    rest = (torch.cat(parts) for parts in zip(*found, strict=True))
    there = np.zeros(grid.shape[::-1], bool)
    there.ravel()[place] = True
    near = np.flatnonzero(maximum_filter(there, 3))
    return Matter(grid, position[chosen].to(device), place, near, torch.cat(logs), *rest)


def _material(palette: PaletteField, position: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return region, diffuse colour, shares and offsets of points, as :class:`Matter` holds them."""
    intensity, weights, offsets = palette.material(position)
    colour = palette_shading.diffuse(intensity, weights, palette.colours + offsets)
    return weights.argmax(dim=1), colour.half(), (intensity[:, None] * weights).half(), offsets.half()


def log_extinction(base: BaseField, position: Tensor) -> Tensor:
    """Return the logarithm of the extinction at box coordinates (S, 3), bounded above as in images. (S,)"""
    if base.density is not None:
        return base.density(position).sum(dim=1).clamp(max=MOST_LOG_EXTINCTION)
    return base.geometry(as_samples(position))[0].log()


def as_samples(position: Tensor) -> Samples:
    """Return points as samples of one ray each that know only where they are."""
    number = torch.arange(len(position), device=position.device)
    none, one = position.new_zeros(len(position)), torch.ones_like(number)
    return Samples(position, none, none, number.int(), number, one, none, 0.0)


def _points(occupancy: Occupancy, grid: Grid) -> tuple[Tensor, NDArray[np.int64]]:
    """Return box coordinates (S, 3) and flat indices (S,), ascending, of the points of occupied cells."""
    where = occupancy.occupied, occupancy.cells
    # A point of a coarser grid may lie in an empty cell, where nothing is stored: the finer vertices tell.
    finer = max(grid.resolution, occupancy.cells)
    lattice = SparseLattice(*where, (finer,), 1)
    vertices, every = lattice.vertices_of_level(0, *where), finer // grid.resolution
    rows = (vertices % every == 0).all(axis=1)
    x, y, z = (vertices[rows] // every - grid.first).T
    width, height, _ = grid.shape
    place = (z * height + y) * width + x
    order = np.argsort(place)
    places = lattice.places_of_level(0, *where)[rows][order]
    end = np.asarray(occupancy.box.extent, np.float32)
    return torch.from_numpy(np.minimum(places, end)), place[order]


def paint_at(network: UnrestrictedField, matter: Matter) -> Tensor:
    """Return the colours of a painting at the points, half precision. (S, 3)"""
    pieces = [network(matter.position[piece]).half() for piece in matter.pieces()]
    return torch.cat(pieces) if pieces else torch.zeros(0, 3).half()
