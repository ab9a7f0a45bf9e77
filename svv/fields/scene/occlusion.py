"""Ambient occlusion: how much of the light that comes from everywhere reaches a place, from the scene's extinction.

The mean transmittance over directions is interpolated between the vertices of the scene's cells (Zhukov et al. 1998;
for volumes, Hernell et al. 2010). It is a factor on the diffuse colour before it is lit, so highlights stay. Hidden
regions cast no shade, and fainter ones less. Letters: S samples, V vertices, D directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.fields.radiance.encodings import SparseLattice
from svv.fields.scene.matter import Matter, matter_of, seen_depth
from svv.fields.scene.model import Model
from svv.fields.scene.occlusion_kernels import mean_transmittance
from svv.kernels.constants import numbers_on

DIRECTIONS = 32
"""Number of directions, spread evenly."""

REACH = 0.15
"""Distance from which matter no longer shades a place, as a fraction of the box's longest side."""

START = 0.02
"""The same of the distance from which matter shades it: a surface must not shade itself."""

STEPS = 12
"""Least number of samples in each direction; on fine grids, there is one a cell."""

STOP = 6.0
"""Optical depth at which a direction is dark."""

SMOOTHING = 1.0 / 64.0
"""Standard deviation, as a fraction of the side, of the Gaussian that smooths the light; places that it reaches count
more, by its square, so surfaces do not take on the dark of their inside, which would show as stripes."""

POWER = 1.5
"""Power of the openness that is shown: deep places darken more than shallow ones."""


@dataclass
class _Shade:
    """The openness of a scene's matter, whatever its edits, for some opacities."""

    matter: Matter
    key: object = None
    openness: SparseLattice | None = None


_known: WeakKeyDictionary[SparseLattice, _Shade] = WeakKeyDictionary()


def is_occluded(scene: Model) -> bool:
    """Return whether a region that shows has ambient occlusion."""
    return any(region.occlusion > 0.0 and region.seen_opacity > 0.0 for region in scene.regions)


@torch.no_grad()
def occlude(scene: Model, colour: Tensor, position: Tensor, region: Tensor) -> None:
    """Darken diffuse colours (S, 3), or those of MatCaps, by the ambient occlusion of their regions (S,), in place."""
    if is_occluded(scene) and len(colour):
        amount = numbers_on([r.occlusion for r in scene.regions], colour.device)[region.long()]
        open_to_light = _openness(scene).look_up(position)[:, 0]
        colour.mul_((1.0 - amount * (1.0 - open_to_light))[:, None])


def _openness(scene: Model) -> SparseLattice:
    """Return the lattice of the openness in [0, 1], remembered until extinction or opacities change."""
    matter, density = matter_of(scene), scene.base.density
    assert density is not None
    shade = _known.get(density)
    if shade is None or shade.matter is not matter:
        shade = _known[density] = _Shade(matter)
    key = tuple(r.seen_opacity for r in scene.regions), density.table.device
    if shade.key != key or shade.openness is None:
        shade.openness = _lattice(scene, matter).to(density.table.device)
        shade.key = key
    return shade.openness


def _lattice(scene: Model, matter: Matter) -> SparseLattice:
    """Return the openness of the vertices for the opacities that the regions have."""
    occupancy, resolution = scene.occupancy, matter.resolution
    lattice = SparseLattice(occupancy.occupied, occupancy.cells, (resolution,), 1).requires_grad_(False)
    depth = seen_depth(scene, matter)
    at, field = tuple(matter.vertices.T), np.zeros(tuple(lattice.shapes[0].tolist()), np.float32)
    field[at] = depth
    light = np.zeros(len(depth), np.float32)
    reach, start = REACH * resolution, START * resolution
    step = min(1.0, (reach - start) / STEPS)
    mean_transmittance(field, matter.vertices, _directions(), start, reach, step, STOP, light)
    light = _smoothed(light, at, field, SMOOTHING * resolution)
    most = _median(light, light * -np.expm1(-depth))
    lattice.table.copy_(torch.from_numpy(np.minimum(light / max(most, 1e-3), 1.0) ** POWER)[:, None])
    return lattice


def _smoothed(
    light: NDArray[np.float32], at: tuple[NDArray[np.integer], ...], field: NDArray[np.float32], width: float
) -> NDArray[np.float32]:
    """Return the light (V,) at vertices ``at`` these places of arrays like ``field``, smoothed; ``width`` in cells."""
    from scipy.ndimage import gaussian_filter

    weight, weighted = np.zeros_like(field), np.zeros_like(field)
    weight[at], weighted[at] = light**2, light**3
    return np.asarray(gaussian_filter(weighted, width)[at] / (gaussian_filter(weight, width)[at] + 1e-9))


def _median(values: NDArray[np.float32], weights: NDArray[np.float32]) -> float:
    """Return the median of what is visible, which counts as open: half of a surface's own directions are dark."""
    if not weights.any():
        return 1.0
    order = np.argsort(values)
    before = np.cumsum(weights[order], dtype=np.float64)
    return float(values[order[np.searchsorted(before, 0.5 * before[-1])]])


def _directions() -> NDArray[np.float64]:
    """Return unit vectors on a spiral, which are spread evenly. (D, 3)"""
    z = 1.0 - 2.0 * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    angle, across = np.pi * (1.0 + 5.0**0.5) * np.arange(DIRECTIONS), np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z])
