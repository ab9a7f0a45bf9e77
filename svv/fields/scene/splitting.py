"""Splitting a region into connected parts: the piece at a point becomes a region of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.geometry.components import large, least_opacity, nearest_piece, pieces
from svv.errors import BadInput, Progress, silent
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.model import Model, of_colour
from svv.fields.scene.parts import FINEST, Parts, no_parts
from svv.kernels.dispatch import kernels_of
from svv.options.editing import SPLIT_LEVEL

MOST_CELLS = 256
"""Largest number of cells along a box unit in which pieces are told apart, unless the occupancy has more."""

REACH = 4.0
"""Distance in cells from a point to the nearest piece of its region up to which the point belongs to the piece."""

KEPT = 8
"""Maximum number of splits of a scene that are kept: a panel repeats its splits with every edit."""


@dataclass
class Cells:
    """What a scene's fields hold at the centres of occupied cells. (N,)"""

    cells: int
    """Cells per box unit."""
    opacity: NDArray[np.float32]
    """Opacity of a cell, in [0, 1]."""
    colour: NDArray[np.int16]
    """Palette colour of the largest weight."""
    found: dict[object, tuple[int, Parts, float]] = field(default_factory=dict)
    """The last results of :func:`piece_at`."""


_known: WeakKeyDictionary[torch.nn.Module, Cells] = WeakKeyDictionary()


def piece_at(
    scene: Model, point: Sequence[float], level: float = SPLIT_LEVEL, progress: Progress = silent
) -> tuple[int, Parts, float]:
    """Return the region at a world point, the parts with its piece there as the last one, and the piece's share of it.

    Two cells of the region are connected if they touch and are both opaque enough: at least ``level``, in (0, 1], times
    the region's mean opacity. Cells between two pieces belong to the nearer one. The share, in (0, 1), is of the
    region's opacity. BadInput if nothing is at the point, the region is in one piece, or there are too many parts.
    """
    if scene.palette_network is None:
        raise BadInput("The scene has no regions because it holds no palette network; train it again.")
    if not 0.0 < level <= 1.0:
        raise BadInput(f"The level of a split must be above 0 and at most 1, not {level:g}.")
    place = scene.occupancy.box.to_box(np.asarray(point, np.float64))
    if not np.isfinite(place).all() or not _occupied(scene.occupancy, place):
        raise _nothing(point)
    known = _cells_of(scene, progress)
    key = (None if scene.parts is None else (scene.parts.digest, scene.parts.active), tuple(point), level)
    if key not in known.found:
        while len(known.found) >= KEPT:
            known.found.pop(next(iter(known.found)))
        known.found[key] = _piece_at(scene, known, point, level)
    progress(1.0, "splitting")
    return known.found[key]


def regions_in_cells(scene: Model, progress: Progress = silent) -> tuple[int, NDArray[np.int16], NDArray[np.float32]]:
    """Return cells per box unit, and the region and the opacity of each cell of the box, as edited. (X, Y, Z)

    The region is that at the cell's centre, -1 where nothing was found, 0 in a scene without a palette network; the
    opacity in [0, 1] is that of a ray through the cell.
    """
    known = _cells_of(scene, progress)
    occupied = _refined(scene.occupancy.occupied > 0, known.cells // scene.occupancy.cells)
    region, opacity = np.full(occupied.shape, -1, np.int16), np.zeros(occupied.shape, np.float32)
    own = _regions_of_cells(scene, known, occupied)
    seen = np.array([r.seen_opacity for r in scene.regions] or [1.0])
    region[occupied] = own
    opacity[occupied] = 1.0 - (1.0 - known.opacity) ** seen[own]
    return known.cells, region, opacity


@torch.no_grad()
def _piece_at(scene: Model, known: Cells, point: Sequence[float], level: float) -> tuple[int, Parts, float]:
    """Return what :func:`piece_at` does, from the scene's cells."""
    assert scene.palette_network is not None
    place = scene.occupancy.box.to_box(np.asarray(point, np.float64))
    at = torch.tensor(place[None], dtype=torch.float32, device=scene.device)
    region = int(scene.region_of(at, scene.palette_network.material(at)[1]))
    occupied = _refined(scene.occupancy.occupied > 0, known.cells // scene.occupancy.cells)
    own = _regions_of_cells(scene, known, occupied) == region
    visible = np.zeros(occupied.shape, bool)
    visible[occupied] = own & (known.opacity >= least_opacity(known.opacity[own], level))
    labels, sizes = pieces(visible)
    asked, far = nearest_piece(labels, place * known.cells)
    if far > REACH:
        raise _nothing(point)
    others = large(sizes, asked)
    others[asked] = False
    if not others.any():
        raise BadInput(
            f"Region {region} is in one piece at {format_point(point)}: nothing was split. A higher level, up to 1, "
            f"may separate what faint matter connects; it is {level:g} now."
        )
    territory = _nearer(labels == asked, others[labels]) & occupied
    inside = own & territory[occupied]
    share = float(known.opacity[inside].sum(dtype=np.float64) / known.opacity[own].sum(dtype=np.float64))
    try:
        return region, (scene.parts or no_parts(occupied.shape, known.cells)).with_part(territory), share
    except OverflowError as error:
        raise BadInput("The scene has as many parts as it can have: undo splits that you no longer need.") from error


@torch.no_grad()
def _cells_of(scene: Model, progress: Progress) -> Cells:
    palette, cells = scene.palette_network, _resolution_of(scene)
    key = scene.base if palette is None else palette
    if key in _known and _known[key].cells == cells:
        return _known[key]
    there = np.argwhere(_refined(scene.occupancy.occupied > 0, cells // scene.occupancy.cells))
    opacity, colour = np.empty(len(there), np.float32), np.zeros(len(there), np.int16)
    piece = kernels_of(scene.device.type).SAMPLES
    for first in range(0, len(there), piece):
        progress(first / len(there), "splitting")
        rows = slice(first, first + piece)
        position = torch.from_numpy(((there[rows] + 0.5) / cells).astype(np.float32)).to(scene.device)
        sigma = scene.base.extinction_at(position)
        opacity[rows] = (1.0 - torch.exp(-sigma / cells)).cpu().numpy()
        if palette is not None:
            colour[rows] = palette.material(position)[1].argmax(dim=1).cpu().numpy()
    _known[key] = Cells(cells, opacity, colour)
    return _known[key]


def _resolution_of(scene: Model) -> int:
    """Return the number of cells per box unit: that of existing parts, or as many as the extinction's lattice has."""
    if scene.parts is not None:
        return scene.parts.cells
    coarse, density = scene.occupancy.cells, scene.base.density
    most = min(MOST_CELLS, coarse if density is None else max(density.resolutions))
    return max(finer * coarse for finer in (1, 2, FINEST) if finer == 1 or finer * coarse <= most)


def _regions_of_cells(scene: Model, known: Cells, occupied: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the region at each occupied cell's centre. (N,)"""
    own = torch.from_numpy(known.colour.astype(np.int64))
    if scene.parts is None or not scene.parts.active:
        return own.numpy()
    centres = torch.from_numpy(((np.argwhere(occupied) + 0.5) / known.cells).astype(np.float32)).to(scene.device)
    return of_colour(scene.regions_at(centres), own.to(scene.device)).cpu().numpy()


def _nearer(one: NDArray[np.bool_], others: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cells are nearer to ``one`` than to ``others`` in the chessboard distance. (X, Y, Z)"""
    leaps = kernels_of("cpu").leaps
    far = [leaps(torch.from_numpy(np.ascontiguousarray(which, np.uint8))).amin(dim=0) for which in (one, others)]
    return (far[0] < far[1]).numpy()


def _refined(occupied: NDArray[np.bool_], finer: int) -> NDArray[np.bool_]:
    """Return occupied cells in a grid ``finer`` times as fine. (X, Y, Z) -> (finer X, finer Y, finer Z)"""
    return occupied.repeat(finer, 0).repeat(finer, 1).repeat(finer, 2)


def _occupied(occupancy: Occupancy, place: NDArray[np.float64]) -> bool:
    cell = np.floor(place * occupancy.cells).astype(np.int64)
    inside = (cell >= 0).all() and (cell < occupancy.occupied.shape).all()
    return bool(inside) and bool(occupancy.occupied[tuple(cell)])


def _nothing(point: Sequence[float]) -> BadInput:
    return BadInput(f"There is nothing at {format_point(point)}: click on something visible.")


def format_point(point: Sequence[float]) -> str:
    """Return a point's coordinates for a sentence."""
    return ", ".join(f"{value:.4g}" for value in point)
