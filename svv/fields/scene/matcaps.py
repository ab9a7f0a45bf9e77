"""Drawing regions in their MatCaps (:mod:`svv.fields.scene.matcap_pictures`), and the normals for it.

Normals are those of the explicit light, or the gradient of the extinction. Letters: S samples, R rays.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.core.colour.light import NORMAL_SCALE, normals_of
from svv.core.colour.matcaps import matcap_colours
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.phong import Beams, gradient_of
from svv.fields.scene.edits import check_has_normals
from svv.fields.scene.matcap_pictures import picture_of
from svv.fields.scene.model import Model
from svv.fields.scene.occlusion import occlude

FINEST = 256
"""Most cells per box unit at which the gradient of the extinction is computed, which takes a whole grid."""

SMOOTHING = 2.0
"""Standard deviation of the Gaussian whose derivatives give the gradient, in cells: with 1, learned extinctions show
grain in reflections."""

_known: WeakKeyDictionary[SparseLattice, tuple[int, SparseLattice]] = WeakKeyDictionary()


@torch.no_grad()
def normals_at(scene: Model, position: Tensor) -> Tensor:
    """Return normals of either orientation, at most 1 long, shorter away from surfaces. (S, 3) -> (S, 3)"""
    check_has_normals(scene)
    assert scene.palette_network is not None
    phong = scene.palette_network.phong
    lattice = _gradient(scene) if phong is None else phong.normals
    return normals_of(lattice.look_up(position).unflatten(1, (-1, 3)).sum(dim=1))


def _gradient(scene: Model) -> SparseLattice:
    """Return the lattice of the gradient of the extinction, remembered until the extinction changes."""
    density = scene.base.density
    assert density is not None
    version, lattice = _known.get(density, (-1, None))
    if lattice is None or version != density.table._version or lattice.table.device != density.table.device:
        occupancy = scene.occupancy
        resolution = max((r for r in density.resolutions if r <= FINEST), default=density.resolutions[0])
        lattice = SparseLattice(occupancy.occupied, occupancy.cells, (resolution,), 3).requires_grad_(False)
        lattice.table.copy_(gradient_of(density, occupancy, resolution, SMOOTHING) / NORMAL_SCALE)
        lattice = lattice.to(density.table.device)
        _known[density] = density.table._version, lattice
    return lattice


@torch.no_grad()
def dress(scene: Model, colour: Tensor, position: Tensor, region: Tensor, ray: Tensor, beams: Beams) -> None:
    """Replace the lit colours (S, 3) of samples at box coordinates whose regions (S,) have MatCaps, in place.

    ``beams``: directions towards the viewer of the rays, and the camera's axis up. (R)
    """
    for number, one in enumerate(scene.regions):
        if one.matcap is None or one.seen_opacity == 0.0:
            continue
        rows = (region == number).nonzero()[:, 0]
        if len(rows):
            facing = beams.facing[ray[rows].long()]
            up = facing.new_tensor(beams.up)
            picture = picture_of(one.matcap).to(colour)
            own = matcap_colours(normals_at(scene, position[rows]), facing, up, picture)
            occlude(scene, own, position[rows], region[rows])
            colour[rows] = own
