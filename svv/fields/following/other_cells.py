"""A scene of learned features with another extinction, on the cells that this one fills.

A vertex without any features has those of the nearest one that has some: matter and its light change slowly from a
place to the next, while a network can make anything of features that it never saw. Letters: V vertices.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import nn

from svv.errors import BadInput
from svv.fields.following.carried_paint import at_rest
from svv.fields.following.followed_scene import check_paint_follows, owners
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.edits import without_undone_splits
from svv.fields.scene.model import S


@torch.no_grad()
def on_cells(scene: S, occupancy: Occupancy, density: SparseLattice) -> S:
    """Return a scene with another extinction, and its palette, edits and paint.

    The scene has the encoding ``lattice``, a palette network, and neither parts that were split off nor paint that
    cannot be laid on other cells: otherwise, raises BadInput. ``density``: logarithms of that extinction on the cells,
    in the scene's box, that it fills, on any device.
    """
    scene = without_undone_splits(scene)
    palette = scene.palette_network
    if palette is None or scene.base.density is None:
        raise BadInput(
            "The scene has no palette, or its extinction is in a hash grid: train it again with --encoding lattice."
        )
    check_paint_follows(scene)
    base = BaseField(scene.settings, occupancy, density.resolutions)
    base.colour_mlp.load_state_dict(scene.base.colour_mlp.state_dict())
    base.density = density
    normals = None if palette.phong is None else palette.phong.normals.resolutions
    moved = PaletteField(scene.settings, occupancy, base.geometry_width, palette.colours.detach().cpu(), normals)
    learned = {name: value for name, value in palette.state_dict().items() if not name.endswith("table")}
    moved.load_state_dict(learned, strict=False)
    cells = scene.occupancy, occupancy
    _fill(base.encoding, scene.base.encoding, cells)
    _fill(moved.encoding, palette.encoding, cells)
    if moved.phong is not None and palette.phong is not None:
        _fill(moved.phong.normals, palette.phong.normals, cells)
    device = scene.device
    result = replace(
        scene, occupancy=occupancy, base=base.requires_grad_(False).to(device), parts=None,
        palette_network=moved.requires_grad_(False).to(device), expected=None,  # those of another extinction
    )  # fmt: skip
    paint = partial(at_rest, scene=scene, occupancy=occupancy, owners=partial(owners, result))
    return replace(
        result,
        styled=None if scene.styled is None else paint(scene.styled).to(device),
        others=tuple(replace(other, network=paint(other.network).to(device)) for other in scene.others),
    )


def _fill(new: nn.Module, old: nn.Module, cells: tuple[Occupancy, Occupancy]) -> None:
    """Fill a lattice on the CPU with the features of another of the same levels, or with those of the nearest vertex.

    ``cells``: those of the old lattice, and those of the new one.
    """
    assert isinstance(new, SparseLattice) and isinstance(old, SparseLattice)
    table, (before, after) = old.table.detach().cpu(), cells
    for level in range(old.levels):
        known = old.vertices_of_level(level, before.occupied, before.cells)
        wanted = new.vertices_of_level(level, after.occupied, after.cells)
        rows = np.full(tuple(old.shapes[level].tolist()), -1, np.int64)
        rows[tuple(known.T)] = np.arange(len(known))
        row = rows[tuple(wanted.T)]
        unknown = row < 0
        row[unknown] = cKDTree(known).query(wanted[unknown], workers=-1)[1]
        new.table[new.rows_of_level(level)] = table[old.rows_of_level(level)][torch.from_numpy(row)]
