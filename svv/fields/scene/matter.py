"""The matter of a scene on the vertices of a coarse lattice, from which light that it keeps away is computed.

Letters: S positions, V vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary, ref

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.rays.extinction import MOST_LOG_EXTINCTION
from svv.fields.radiance.encodings import SparseLattice, places_of, vertices_of
from svv.fields.scene.edits import check_has_extinction
from svv.fields.scene.model import Model

FINEST = 128
"""Most cells per box unit: every halving costs a place on a smooth surface a visible unevenness."""

PIECE = 1 << 17
"""Vertices whose regions are found together."""


@dataclass(frozen=True, eq=False)
class Matter:
    """What is known of a scene's matter, whatever its edits."""

    key: object
    """What it depends on, besides the lattice of the extinction."""
    resolution: int
    """Cells per box unit."""
    vertices: NDArray[np.int64]
    """Those of the occupied cells. (V, 3)"""
    places: Tensor
    """Box coordinates at which to look them up, on the CPU. (V, 3)"""
    depth: NDArray[np.float32]
    """Optical depth of one cell at each vertex. (V,)"""
    region: NDArray[np.int64]
    """(V,)"""


_known: WeakKeyDictionary[SparseLattice, Matter] = WeakKeyDictionary()


def matter_of(scene: Model) -> Matter:
    """Return the scene's matter, remembered until its networks or its parts change."""
    check_has_extinction(scene, "light")
    density, palette = scene.base.density, scene.palette_network
    assert density is not None and palette is not None
    parts = None if scene.parts is None else (scene.parts.digest, scene.parts.active)
    key = density.table._version, ref(palette), palette.encoding.table._version, parts
    matter = _known.get(density)
    if matter is None or matter.key != key:
        matter = _known[density] = _looked_up(scene, density, key)
    return matter


def seen_depth(scene: Model, matter: Matter) -> NDArray[np.float32]:
    """Return the optical depth of one cell at each vertex, for the opacities that the scene's regions have. (V,)"""
    return np.asarray(matter.depth * np.array([r.seen_opacity for r in scene.regions], np.float32)[matter.region])


def resolution_of(scene: Model) -> int:
    """Return the number of cells per box unit of the lattice on which a scene's matter is known."""
    cells = scene.occupancy.cells
    return max(r for r in range(1, min(cells, FINEST) + 1) if cells % r == 0)


def regions_of_vertices(scene: Model, resolution: int) -> tuple[NDArray[np.int64], Tensor, NDArray[np.int64]]:
    """Return the vertices of a lattice in occupied cells, and their regions: coordinates, places and numbers.

    ``resolution``: cells of the lattice per box unit. Coordinates are integers (V, 3), places box coordinates at which
    to look them up, on the CPU (V, 3); regions (V,).
    """
    occupancy, palette = scene.occupancy, scene.palette_network
    assert palette is not None
    where = occupancy.occupied, occupancy.cells, resolution
    vertices, end = np.ascontiguousarray(vertices_of(*where)), np.asarray(occupancy.box.extent, np.float32)
    places, regions = torch.from_numpy(np.minimum(places_of(*where, vertices), end)), [np.zeros(0, np.int64)]
    for piece in places.split(PIECE):
        position = piece.to(scene.device)
        with torch.no_grad():
            regions.append(scene.region_of(position, palette.material(position)[1]).cpu().numpy())
    return vertices, places, np.concatenate(regions)


def _looked_up(scene: Model, density: SparseLattice, key: object) -> Matter:
    """Return the optical depth and the region of each vertex of the occupied cells."""
    resolution, logs = resolution_of(scene), [np.zeros(0, np.float32)]
    vertices, places, regions = regions_of_vertices(scene, resolution)
    for piece in places.split(PIECE):
        log = density.look_up(piece.to(density.table.device)).sum(dim=1)
        logs.append(log.clamp(max=MOST_LOG_EXTINCTION).cpu().numpy())
    depth = (np.exp(np.concatenate(logs)) / resolution).astype(np.float32)
    return Matter(key, resolution, vertices, places, depth, regions)
