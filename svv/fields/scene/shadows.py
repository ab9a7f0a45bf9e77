"""Cast shadows: how much of the light of one direction, or of a cone around it, reaches a place.

The transmittance towards the light is computed at the vertices of the scene's cells, from the extinction as it is
edited, and interpolated between them (Behrens & Ratering 1998). For each direction, columns of the grid that are
sheared along it are summed up, so that a vertex costs as much as a step of a ray. It is a factor on the lit colour.
Matter next to a place does not count, or surfaces would shade themselves. Letters: S samples, V vertices, D directions.
"""

from __future__ import annotations

import itertools
from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.strokes.strokes import Floats
from svv.errors import BadInput
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.scene.matter import FINEST, PIECE, Matter, matter_of
from svv.fields.scene.model import Model
from svv.fields.scene.shadow_kernels import add_transmittance, carry_inside, transmittance_in_columns
from svv.fields.scene.stroke_opacity import followed, strokes_of
from svv.fields.scene.view_cache import key_of_paint
from svv.kernels.constants import numbers_on
from svv.kernels.dispatch import kernels_for

NEAR, FAR = 1.0, 2.0
"""Distances along the light, in cells, at which matter begins to count and counts fully."""

CLEAR_DEPTH = 0.4
"""Optical depth of a cell in which a vertex counts 1 / e of one in empty space, where surfaces take their light."""

DEEP = 2
"""Vertices from the outside of matter up to which its surface takes the light that is outside."""

LEAST_CLEAR = 1e-4
"""Least that a vertex counts: deep inside, it has its own light."""

AROUND = 2
"""Empty cells around the box, and around its occupied cells: what ends at its border has an outside as well."""

DIRECTIONS = 16
"""Directions into the cone of a soft light."""

REMEMBERED = 4
"""Lights, or views that a light follows, whose shadows are kept."""


@dataclass(frozen=True)
class _Grid:
    """Optical depths of one cell at the vertices of a grid whose cells have one side."""

    low: NDArray[np.float64]
    """World coordinates of its first vertex. (3,)"""
    spacing: float
    """Side of a cell in world units."""
    depth: Floats
    """(X, Y, Z)"""
    where: NDArray[np.bool_]
    """At which vertices shadows are looked up. (X, Y, Z)"""

    @cached_property
    def clear(self) -> Floats:
        """How much each vertex counts for the light of surfaces around it, 0 where none is looked up. (X, Y, Z)"""
        return self.where * np.maximum(np.exp(self.depth / -np.float32(CLEAR_DEPTH)), np.float32(LEAST_CLEAR))

    def fits(self, other: _Grid) -> bool:
        """Return whether the vertices of both are the same."""
        same = self.spacing == other.spacing and self.depth.shape == other.depth.shape
        return same and bool((self.low == other.low).all())


@dataclass
class _Shadows:
    """What is known of the shadows of a scene, alone or among others, for some edits."""

    key: object = None
    grid: _Grid | None = None
    found: OrderedDict[object, Floats] = field(default_factory=OrderedDict)
    """Transmittance at the grid's vertices, by where the light is. (X, Y, Z)"""
    tables: OrderedDict[object, Tensor] = field(default_factory=OrderedDict)
    """The same at the vertices of the scene's own lattice. (V, 1)"""
    lattice: SparseLattice | None = None
    """The layout of these vertices."""


_known: WeakKeyDictionary[SparseLattice, _Shadows] = WeakKeyDictionary()
_means: WeakKeyDictionary[Matter, Tensor] = WeakKeyDictionary()


def check_shadows_stay(scene: Model, what: str) -> None:
    """Raise BadInput if the scene's shadows follow the camera, which ``what``, such as "A page", cannot show."""
    if scene.lamp.shadows_follow:
        raise BadInput(
            f"{what} holds shadows only from a direction in the world, and those of this scene follow the camera: give "
            "them one with svv edit --shadow-light X,Y,Z, or take them off with --shadow 0."
        )


def shadows_from(scene: Model) -> tuple[float, float, float] | None:
    """Return the world direction, of length 1, of shadows that do not follow the camera; None if there are none."""
    if scene.lamp.shadow == 0.0 or scene.lamp.shadows_follow:
        return None
    x, y, z = scene.lamp.casting.towards(np.eye(3)).tolist()
    return x, y, z


@torch.no_grad()
def cast_shadows(
    scene: Model, colour: Tensor, position: Tensor, network: str, towards: tuple[float, float, float] | None
) -> None:
    """Darken lit colours (S, 3) at box coordinates where the light is kept away, in place.

    ``network``: whose opacities cast the shadows; ``towards``: world direction to the light, of length 1, as
    :attr:`svv.fields.radiance.phong.Beams.shadows_from`; None casts none.
    """
    if towards is None or scene.lamp.shadow == 0.0 or not len(colour):
        return
    shadows, table = _table(scene, network, towards)
    assert shadows.lattice is not None
    arrives = kernels_for(position).lattice_encode(position, shadows.lattice.layout, table)
    colour.mul_(1.0 - scene.lamp.shadow * (1.0 - arrives))


def _table(scene: Model, network: str, towards: tuple[float, float, float]) -> tuple[_Shadows, Tensor]:
    """Return the transmittance at the vertices of the scene's lattice (V, 1), remembered until something changes."""
    matter, density = matter_of(scene), scene.base.density
    assert density is not None
    casters = scene.casters or (scene,)
    first = casters[0].base.density
    assert first is not None
    key = tuple(_key(one, network) for one in casters)
    light = towards, scene.lamp.shadow_softness
    shared, own = (_anew(of, key) for of in (first, density))
    table = own.tables.get(light)
    if table is None or table.device != density.table.device or own.lattice is None:
        if shared.grid is None:
            shared.grid = _together([_grid(one, network) for one in casters])
        found = shared.found.get(light)
        if found is None:
            found = _transmittance(shared.grid, np.array(towards), scene.lamp.shadow_softness)
            _remember(shared.found, light, found)
        if own.lattice is None or own.lattice.table.device != density.table.device:
            occupancy = scene.occupancy
            own.lattice = SparseLattice(occupancy.occupied, occupancy.cells, (matter.resolution,), 1)
            own.lattice = own.lattice.requires_grad_(False).to(density.table.device)
        table = torch.from_numpy(_at(scene, matter, shared.grid, found))[:, None].to(density.table.device)
        _remember(own.tables, light, table)
    return own, table


def _remember(known: OrderedDict[object, Any], key: object, value: object) -> None:
    known[key] = value
    while len(known) > REMEMBERED:
        known.popitem(last=False)


def _anew(density: SparseLattice, key: object) -> _Shadows:
    """Return what is known of a scene's shadows, nothing if it was of something else."""
    known = _known.get(density)
    if known is None or known.key != key:
        known = _known[density] = _Shadows(key)
    return known


def _key(scene: Model, network: str) -> object:
    """Return what the shadows that a scene casts depend on, besides the light."""
    amounts = tuple(0.0 if r.style is None else r.stroke_opacity * r.strength for r in scene.regions)
    paint = (amounts, key_of_paint(scene, "styled")) if network == "styled" and any(amounts) else None
    return matter_of(scene), tuple(r.seen_opacity for r in scene.regions), scene.cuts, paint


def _grid(scene: Model, network: str) -> _Grid:
    """Return the optical depth of what is seen of a scene."""
    from scipy.ndimage import binary_dilation

    matter, box = matter_of(scene), scene.occupancy.box
    opacity = numbers_on([r.seen_opacity for r in scene.regions], torch.device("cpu"))
    region = torch.from_numpy(matter.region)
    depth = _mean_depth(scene, matter) * opacity[region]
    for cut in scene.cuts:
        left = (0.5 - cut.in_box(box).depth(matter.places) * matter.resolution).clamp(0.0, 1.0)
        depth = torch.where(scene.in_cut(cut, region), left * depth, depth)
    if network == "styled" and strokes_of(scene) is not None and scene.paint_shown is not None:
        paint = torch.cat([scene.paint_shown(piece.to(scene.device)) for piece in matter.places.split(PIECE)])
        depth = followed(scene, depth.to(scene.device), region.to(scene.device), paint).cpu()
    shape = np.array(scene.occupancy.occupied.shape) * matter.resolution // scene.occupancy.cells + 1
    dense = np.zeros(tuple(shape + 2 * AROUND), np.float32)
    where = np.zeros(dense.shape, np.bool_)
    at = tuple((matter.vertices + AROUND).T)
    dense[at], where[at] = depth.numpy(), True
    spacing = box.size / matter.resolution
    return _Grid(np.array(box.low) - AROUND * spacing, spacing, dense, binary_dilation(where, iterations=AROUND))


def _mean_depth(scene: Model, matter: Matter) -> Tensor:
    """Return the mean optical depth of one cell around each vertex, on the CPU: surfaces are thinner than a cell. (V,)

    Interpolated between vertices, extinction itself would be more than it is, because a scene interpolates its
    logarithm, and could miss what lies between them.
    """
    known = _means.get(matter)
    if known is None:
        occupancy, base = scene.occupancy, scene.base
        occupied = torch.from_numpy(occupancy.occupied > 0)
        end, last = torch.tensor(occupancy.box.extent), torch.tensor(occupied.shape) - 1
        known = _means[matter] = torch.zeros(len(matter.vertices))
        for offset in itertools.product((-0.25, 0.25), repeat=3):
            places = matter.places + torch.tensor(offset) / matter.resolution
            cell = (places * occupancy.cells).floor().long()
            inside = (cell >= 0).all(1) & (cell <= last).all(1) & (places <= end).all(1)
            inside &= occupied[tuple(torch.minimum(cell.clamp(min=0), last).T)]
            rows = inside.nonzero()[:, 0]
            for piece in rows.split(PIECE):
                found = base.extinction_at(places[piece].to(scene.device)).cpu()
                known[piece] += found / (8.0 * matter.resolution)
    return known


def _together(grids: list[_Grid]) -> _Grid:
    """Return the sum of optical depths on one grid around all."""
    from scipy.ndimage import map_coordinates

    first = grids[0]
    if all(grid.fits(first) for grid in grids):
        depth = np.sum([grid.depth for grid in grids], axis=0)
        return _Grid(first.low, first.spacing, depth, np.any([grid.where for grid in grids], axis=0))
    ends = [grid.low + grid.spacing * (np.array(grid.depth.shape) - 1) for grid in grids]
    low = np.min([grid.low for grid in grids], axis=0)
    sides = np.max(ends, axis=0) - low
    spacing = max(min(grid.spacing for grid in grids), float(sides.max()) / FINEST)
    count = np.ceil(sides / spacing - 1e-6).astype(int) + 1
    depth = np.zeros(tuple(count), np.float32)
    for grid in grids:
        axes = [(low[k] + spacing * np.arange(count[k]) - grid.low[k]) / grid.spacing for k in range(3)]
        own = map_coordinates(grid.depth, np.meshgrid(*axes, indexing="ij"), order=1, mode="constant")
        depth += np.float32(spacing / grid.spacing) * own
    return _Grid(low, spacing, depth, np.ones(depth.shape, np.bool_))


def _at(scene: Model, matter: Matter, grid: _Grid, found: Floats) -> Floats:
    """Return the values of a grid at the vertices of the scene's own lattice. (V,)"""
    from scipy.ndimage import map_coordinates

    low, spacing = np.array(scene.occupancy.box.low), scene.occupancy.box.size / matter.resolution
    if spacing == grid.spacing and (low - AROUND * spacing == grid.low).all():
        return np.ascontiguousarray(found[tuple((matter.vertices + AROUND).T)])
    places = (low + spacing * matter.vertices - grid.low) / grid.spacing
    return np.asarray(map_coordinates(found, places.T, order=1, mode="nearest"), np.float32)


def _transmittance(grid: _Grid, towards: NDArray[np.float64], softness: float) -> Floats:
    """Return the mean transmittance to a light, as wide as ``softness`` degrees, where the grid says. (X, Y, Z)"""
    light = np.zeros(grid.depth.shape, np.float32)
    every = cone(towards, softness)
    for axis, of_axis in itertools.groupby(sorted(every.tolist(), key=_axis), key=_axis):
        here = _first(grid.depth, axis)
        part = np.zeros(here.shape, np.float32)
        for direction in of_axis:
            _add(here, direction, axis, np.float32(1.0 / len(every)), part)
        sign, number = axis
        part = part[::-1] if sign > 0 else part
        light += np.moveaxis(part, 0, number)
    clear = grid.clear
    for _ in range(DEEP):
        before = light, clear
        light, clear = np.zeros_like(light), np.zeros_like(light)
        carry_inside(*before, light, clear)
    return light


def _axis(direction: list[float]) -> tuple[int, int]:
    """Return the sign and the number of a direction's longest component."""
    number = int(np.abs(direction).argmax())
    return (1 if direction[number] > 0.0 else -1), number


def _first(array: NDArray[Any], axis: tuple[int, int]) -> NDArray[Any]:
    """Return an array with an axis first, beginning on the side of its sign."""
    sign, number = axis
    array = np.moveaxis(array, number, 0)
    return np.ascontiguousarray(array[::-1] if sign > 0 else array)


def _add(depth: Floats, direction: list[float], axis: tuple[int, int], share: np.float32, found: Floats) -> None:
    """Add a share of the transmittance in one direction to ``found``; arrays are as :func:`_first` returns them."""
    along = abs(direction[axis[1]])
    p, q = (component / along for k, component in enumerate(direction) if k != axis[1])
    count, *sides = depth.shape
    shifts = [(count - 1) * slope for slope in (p, q)]
    first = np.array([int(np.floor(min(0.0, shift))) for shift in shifts])
    size = [int(np.floor(n - 1 + max(0.0, s))) - f + 2 for n, s, f in zip(sides, shifts, first.tolist(), strict=True)]
    step = 1.0 / along
    near = np.arange(int(np.ceil(FAR / step))) * step
    nearer = np.clip((near - NEAR) / (FAR - NEAR), 0.0, 1.0).astype(np.float32)
    columns = np.empty((size[0], count, size[1]), np.float32)
    transmittance_in_columns(depth * np.float32(step), p, q, first, nearer, columns)
    add_transmittance(columns, p, q, first, share, found)


def cone(towards: NDArray[np.float64], softness: float) -> NDArray[np.float64]:
    """Return unit vectors on a spiral, spread evenly over a cone of an opening angle in degrees around one. (D, 3)"""
    if softness == 0.0:
        return towards[None] / np.linalg.norm(towards)
    sides = np.linalg.svd(towards[None])[2][1:]  # of length 1, at right angles to it
    number = np.arange(DIRECTIONS) + 0.5
    away = np.tan(np.radians(0.5 * softness)) * np.sqrt(number / DIRECTIONS)
    angle = np.pi * (1.0 + 5.0**0.5) * number
    every = towards / np.linalg.norm(towards) + np.stack([away * np.cos(angle), away * np.sin(angle)], axis=1) @ sides
    return np.asarray(every / np.linalg.norm(every, axis=1, keepdims=True))
