"""Finer features where a volume's normals turn within the cells that views alone would be given."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.rays.extinction import MOST_LOG_EXTINCTION
from svv.core.volumes.classified import ValueGrid
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.of_values import features_of
from svv.fields.radiance.rendering import Marching, composite, march
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU
from svv.train.base.first_colours import LEAST_LENGTH
from svv.train.base.first_extinction import Beginning
from svv.train.base.resolutions import pixel_in
from svv.train.run.batches import RayPool
from svv.train.run.config import ReconstructSettings

RAYS = 1024
"""Pixels of the views in which light is compared."""

LEAST_WEIGHT = 0.01
"""Weight in its pixel from which a sample is compared."""

GOOD_ENOUGH = 34.0
"""PSNR in dB of the diffuse light of interpolated normals from which no finer cells are needed: 5 of 255 levels. Of
smooth volumes, it is 37 to 50 with the cells that pixels allow, of CT scans and an embryo 21 to 25."""

MOST_CELLS = 128
"""Maximum number of cells along the longest side that this chooses. From 64 to 128, head, stent and embryo gain .8 to
1.6 dB with ``fast`` in 1.1 to 1.25 of the time; from 128 to 256, at most .2 dB in 1.4 of it, and a head loses .8."""

PLACES = 16
"""Places along an edge of a voxel to which samples are rounded."""


def finer_for_normals(
    field: FieldSettings, views: ViewSet, beginning: Beginning, settings: ReconstructSettings, seed: int = 0
) -> tuple[FieldSettings, str | None]:
    """Return the field with a level more, and why, if its cells are too wide for the normals that pixels see lit.

    Only a volume tells normals (:mod:`svv.train.base.first_colours`): views alone have too few rays to learn finer
    cells in a short training. The added cells cover a pixel or more, and are no finer than the volume's.
    """
    volume, shading, finer = views.classified, views.meta.shading, 2 * field.resolutions[-1]
    if volume is None or volume.values is None or shading is None or not shading.seen:
        return field, None
    most = min(MOST_CELLS, settings.most_cells, volume.cells, 1.0 / pixel_in(views.cameras, volume.box))
    if beginning.density is None or beginning.measured or finer > most:
        return field, None
    error = shading.diffuse * interpolation_error(field.resolutions[-1], views, beginning, volume.values, seed)
    psnr = -20.0 * np.log10(max(error, 1e-6))
    if psnr >= GOOD_ENOUGH:
        return field, None
    reason = f"the volume's normals turn within these cells, which would show light to {psnr:.0f} dB: {finer} cells"
    return replace(field, resolutions=(*field.resolutions, finer)), reason


@torch.no_grad()
def interpolation_error(cells: int, views: ViewSet, beginning: Beginning, values: ValueGrid, seed: int = 0) -> float:
    """Return the root mean square over pixels by which the cosine between normals and headlight differs, in [0, 1].

    Normals at samples are compared with those that are interpolated between vertices of ``cells`` per box unit.
    """
    density, occupancy = beginning.density, beginning.occupancy
    assert density is not None
    rays = RayPool(views, occupancy.box, seed, CPU).batch(0, RAYS).rays
    samples = march(rays, occupancy, density, Marching(1.0 / density.resolutions[-1]))
    sigma = density(samples.position)[:, 0].clamp(max=MOST_LOG_EXTINCTION).exp()
    weight = composite(samples, sigma, torch.ones(len(sigma), 1))[2]
    seen = (weight >= LEAST_WEIGHT).nonzero()[:, 0]
    if not len(seen):
        return 0.0
    ray, position = samples.ray[seen].long().numpy(), samples.position[seen].numpy().astype(np.float64)
    along, fine = rays.lit_along.numpy()[ray], PLACES * values.cells
    there = features_of(values, np.rint(position * fine).astype(np.int64), fine)[1]
    low = np.floor(position * cells).astype(np.int64)
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    around = features_of(values, (low + corners[:, None]).reshape(-1, 3), cells)[1].reshape(8, -1, 3)
    part = position * cells - low
    shares = np.where(corners[:, None] == 1, part, 1.0 - part).prod(axis=2)
    between = (shares[..., None] * around).sum(axis=0)
    away = weight[seen].numpy() * (_cosine(between, along) - _cosine(there, along))
    return float(np.sqrt(np.square(np.bincount(ray, away))[np.unique(ray)].mean()))


def _cosine(normal: NDArray[np.floating], direction: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the cosine between normals of either orientation and directions, as colours start with it. (S,)"""
    length = np.maximum(np.linalg.norm(normal, axis=1), LEAST_LENGTH)
    found: NDArray[np.floating] = np.abs((normal * direction).sum(axis=1)) / length
    return found
