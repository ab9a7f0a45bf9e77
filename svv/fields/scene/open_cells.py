"""The cells of a scene in which some regions are cut off or hidden, so that an image leaps what it does not show.

Networks tell regions, and they take most of an image's time. Cells that lie wholly in regions that are not shown there
are therefore left out before any sample is looked at. Letters: N cells.
"""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary, ref

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry.cuts import Cut
from svv.fields.radiance.cutting import OpenCells
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.history import MOST_CUTS
from svv.fields.scene.matter import regions_of_vertices
from svv.fields.scene.model import Model

FINEST = 256
"""Most vertices per box unit at which regions are looked at."""


@dataclass
class _Known:
    """What is known of a scene's cells: their regions, and those that are open for some cuts and hidden regions."""

    matter: Hashable
    parts: int
    """Vertices along a cell's side, less one."""
    region: NDArray[np.int8]
    """Region at each vertex of occupied cells, -1 elsewhere."""
    occupied: NDArray[np.int64]
    """Those cells. (N, 3)"""
    shares: dict[tuple[bool, ...], tuple[NDArray[np.bool_], NDArray[np.bool_]]] = field(default_factory=dict)
    """Whether all, and whether some of the vertices of each are of regions, by whether these are each one. (N,) each"""
    key: Hashable = None
    cells: OpenCells | None = None


_known: WeakKeyDictionary[PaletteField, _Known] = WeakKeyDictionary()


def key_of_open_cells(scene: Model) -> Hashable:
    """Return what the open cells of a scene depend on besides its networks; None if it has none."""
    cuts = tuple(cut for cut in scene.cuts if cut.regions)
    hidden = tuple(k for k, region in enumerate(scene.regions) if region.seen_opacity == 0.0)
    if scene.palette_network is None or not (cuts or hidden):
        return None
    return cuts, hidden, None if scene.parts is None else (scene.parts.digest, scene.parts.active)


def open_cells_of(scene: Model) -> OpenCells | None:
    """Return the open cells of a scene, remembered until its cuts or hidden regions change; None if it has none."""
    key, palette = key_of_open_cells(scene), scene.palette_network
    if key is None or palette is None:
        return None
    parts = None if scene.parts is None else (scene.parts.digest, scene.parts.active)
    matter = (
        ref(scene.base),
        id(scene.occupancy),
        palette.encoding.table._version,
        scene.device,
        parts,
        len(scene.regions),
    )
    known = _known.get(palette)
    if known is None or known.matter != matter:
        known = _known[palette] = _Known(matter, *_regions_in_cells(scene, palette))
    if known.key != key or known.cells is None:
        known.key, known.cells = key, _opened(scene, known)
    return known.cells


def _regions_in_cells(scene: Model, palette: PaletteField) -> tuple[int, NDArray[np.int8], NDArray[np.int64]]:
    """Return how finely cells are divided, the region at each vertex of these parts, and the occupied cells."""
    occupancy, encoding = scene.occupancy, palette.encoding
    levels = encoding.resolutions if isinstance(encoding, SparseLattice) else (FINEST,)
    parts = max(1, min(max(levels), FINEST) // occupancy.cells)
    vertices, _, found = regions_of_vertices(scene, parts * occupancy.cells)
    region = np.full([parts * n + 1 for n in occupancy.occupied.shape], -1, np.int8)
    region[tuple(vertices.T)] = found
    return parts, region, np.argwhere(occupancy.occupied)


def _opened(scene: Model, known: _Known) -> OpenCells:
    occupancy, cuts = scene.occupancy, [cut for cut in scene.cuts if cut.regions]
    whole, radius = known.occupied, 0.5 * 3.0**0.5 / occupancy.cells + 1e-4
    depth = _depths([cut.in_box(occupancy.box) for cut in cuts], (whole + 0.5) / occupancy.cells)
    numbers = torch.arange(len(scene.regions))
    taken = [(scene.in_cut(cut, numbers).numpy(), own) for cut, own in zip(cuts, depth, strict=True)]
    hidden = np.array([region.seen_opacity == 0.0 for region in scene.regions])
    if hidden.any():
        taken.append((hidden, np.full(len(whole), np.inf)))
    gone, kept = np.zeros_like(occupancy.occupied), occupancy.occupied.copy()
    for of_regions, deep in taken:
        chosen = tuple(of_regions.tolist())
        if chosen not in known.shares:
            if len(known.shares) > MOST_CUTS:
                known.shares.clear()
            known.shares[chosen] = _shares(of_regions[known.region], whole, known.parts)
        all_of, some_of = known.shares[chosen]
        gone[tuple(whole[all_of & (deep > radius)].T)] = 1
        kept[tuple(whole[some_of & (deep > -radius)].T)] = 0
    there = Occupancy(occupancy.box, occupancy.cells, occupancy.occupied & (1 - gone), occupancy.samples_a_ray)
    return OpenCells(there, torch.from_numpy(kept > 0).to(scene.device))


def _depths(shapes: Sequence[Cut], middles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how deep points (N, 3) lie in each shape. (shapes, N)"""
    at: Tensor = torch.from_numpy(middles)
    return np.array([shape.depth(at).numpy() for shape in shapes]).reshape(len(shapes), len(middles))


def _shares(
    marked: NDArray[np.bool_], cells: NDArray[np.integer], parts: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether all, and whether some of the vertices of cells (N, 3) are marked. (N,) each"""
    x, y, z = parts * cells.T
    every, some = np.ones(len(cells), np.bool_), np.zeros(len(cells), np.bool_)
    for i, j, k in itertools.product(range(parts + 1), repeat=3):
        own = marked[x + i, y + j, z + k]
        every &= own
        some |= own
    return every, some
