"""MatCaps of regions (:mod:`svv.core.colour.matcaps`): where their pictures and normals come from.

A region's MatCap is the name of one that ships, or a small picture as text, which files hold like any other edit.
Normals are those of the explicit light, or the gradient of the extinction. Letters: S samples, R rays.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.core.colour.light import NORMAL_SCALE, normals_of
from svv.core.colour.matcaps import MATCAPS, matcap_colours, matcap_picture
from svv.errors import BadInput
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.phong import Beams, gradient_of
from svv.fields.scene.model import Model
from svv.fields.scene.occlusion import occlude
from svv.io.pictures.picture_data import as_data, picture_in
from svv.io.pictures.style_picture import read_style

STORED = 160
"""Side in pixels of MatCaps from files: they are smooth, and every step of a history holds them."""

NOT_SQUARE = 0.02
"""Largest difference of a MatCap's sides, as a fraction of its width."""

FINEST = 256
"""Most cells per box unit at which the gradient of the extinction is computed, which takes a whole grid."""

SMOOTHING = 2.0
"""Standard deviation of the Gaussian whose derivatives give the gradient, in cells: with 1, learned extinctions show
grain in reflections."""

NONE = "none"

_known: WeakKeyDictionary[SparseLattice, tuple[int, SparseLattice]] = WeakKeyDictionary()


def validate_matcap(text: str) -> str | None:
    """Return a MatCap as a region holds it, from a name, a file, or what a region holds; None for none.

    Raises BadInput if it is neither a name nor a file, or the picture is broken or not square.
    """
    text = str(text).strip()
    if text.lower() in (NONE, ""):
        return None
    name = text.lower().replace("_", "-").replace(" ", "-")
    if name in MATCAPS:
        return name
    if text.startswith("data:"):
        _check_square(picture_in(text, "The picture of a MatCap").shape, "The picture of a MatCap")
        return text
    if not Path(text).is_file():
        raise BadInput(
            f"There is no MatCap '{text}': choose one of {', '.join(MATCAPS)}, {NONE}, or the file of a square "
            "picture of a sphere."
        )
    picture = read_style(text)
    _check_square(picture.shape, text)
    return as_data(picture, STORED, sharp=True)


def describe_matcap(text: str | None) -> str:
    """Return a few words about a region's MatCap, or its name; a picture is not spelled out."""
    return (text and ("of a picture" if text.startswith("data:") else text)) or "none"


def _check_square(shape: tuple[int, ...], name: str) -> None:
    height, width = shape[:2]
    if abs(width - height) > NOT_SQUARE * max(width, height):
        raise BadInput(
            f"{name} has {width} x {height} pixels, but a MatCap is square, filled by a sphere: cut it to the sphere."
        )


@lru_cache(maxsize=32)
def picture_of(matcap: str) -> Tensor:
    """Return the picture of a region's MatCap, sRGB in [0, 1]; raises BadInput if there is none. (H, W, 3)"""
    if matcap.startswith("data:"):
        return torch.from_numpy(picture_in(matcap, "The picture of a MatCap").copy())
    if matcap not in MATCAPS:
        raise BadInput(f"This version of svv has no MatCap '{matcap}': choose one of {', '.join(MATCAPS)}.")
    return torch.from_numpy(matcap_picture(matcap).copy())


def check_has_normals(scene: Model) -> None:
    """Raise BadInput if the scene has no normals to look MatCaps up by."""
    if scene.palette_network is None or (scene.palette_network.phong is None and scene.base.density is None):
        raise BadInput(
            "This scene has no normals for a MatCap, because its extinction is in a hash grid: train it again with "
            "--encoding lattice."
        )


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
