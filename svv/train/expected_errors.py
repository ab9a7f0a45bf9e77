"""What the errors of a scene's pictures are expected to be, from those of its training views.

The error of a pixel is shared among its samples by their weights; the mean of what a cell of a coarse grid gets is its
error. Cells that few rays show take the error of the worst ones. Rays that the grid does not know then tell how much of
an error is the cells', and how much goes with the change from pixel to pixel: least squares, none below 0.

Letters: R rays.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.optimize import nnls
from torch import Tensor

from svv.core.volumes.classified import grid_shape
from svv.fields.radiance.rendering import RayCaster
from svv.fields.scene.doubt import change, seen_along_rays
from svv.fields.scene.expected import CELLS, LEVELS, ExpectedErrors
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.run.batches import Batch, RayPool

RAYS = 1 << 16
"""Most rays that are looked at, a quarter of which the grid does not know."""

FEWEST = 1 << 12
"""Fewest rays that are looked at, however short the training."""

PART = 16
"""Rays of training for each ray that is looked at, which takes a few thousandths of the time."""

BATCHES, KEPT = 8, 4
"""Batches in which rays are followed, and the spacing of those that the grid does not know: one of every four."""

FEW = 1.0
"""Sum of weights of a cell's samples for which it counts half, and the error of cells that few rays show half."""

UNSEEN = 0.9
"""Quantile of the cells' errors that a cell is expected to have if no ray shows it."""

AROUND = 5
"""Cells along the side of the cube over which the place with the largest errors is found."""


@torch.no_grad()
def expected_errors(scene: Scene, views: ViewSet, trained: int, seed: int) -> ExpectedErrors:
    """Return the expected errors of a scene's pictures, given its training views and the rays it was trained on."""
    pool = RayPool(views, scene.occupancy.box, seed, scene.device, scene.settings.headlight)
    caster = RayCaster(views.cameras, scene.occupancy.box, scene.device, scene.settings.headlight)
    rays = min(RAYS, max(FEWEST, trained // PART)) // BATCHES
    shape = [int(n) for n in grid_shape(scene.occupancy.box, CELLS)]
    sums = torch.zeros(2, int(np.prod(shape)), device=scene.device)
    kept = []
    for number in range(BATCHES):
        batch = pool.batch(number, rays)
        if number % KEPT == KEPT - 1:
            kept.append(batch)
            continue
        out, alpha, (samples, weight) = seen_along_rays(scene, batch.rays)
        error = _errors(out, alpha, batch)
        at = torch.minimum((samples.position * CELLS).long().clamp(min=0), samples.ray.new_tensor(shape).long() - 1)
        cell = (at[:, 0] * shape[1] + at[:, 1]) * shape[2] + at[:, 2]
        sums[0].index_add_(0, cell, weight)
        sums[1].index_add_(0, cell, weight * error[samples.ray.long()])
    weight, total = (part.view(shape).cpu().numpy().astype(np.float64) for part in sums)
    cells = _cells(weight, total)
    first = _packed(cells, 0.0, weight, scene)
    factor, edge = _calibrated(scene, views, kept, caster, first)
    return _packed(cells * factor, edge, weight, scene)


def _errors(out: Tensor, alpha: Tensor, batch: Batch) -> Tensor:
    """Return the mean absolute difference of RGB on white of rays and their pixels. (R,)"""
    shown = out[:, :3] - alpha[:, None]
    return (shown - batch.premultiplied + batch.alpha[:, None]).abs().mean(dim=1)


def _cells(weight: NDArray[np.float64], total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the errors of cells (X, Y, Z) from sums of weights, and of weights times errors."""
    mean = total / np.maximum(weight, 1e-12)
    seen = mean[weight > FEW]
    unseen = float(np.quantile(seen, UNSEEN)) if seen.size else float(total.sum() / max(weight.sum(), 1e-12))
    return np.asarray((total + FEW * unseen) / (weight + FEW))


def _packed(
    cells: NDArray[np.float64], edge: float, weight: NDArray[np.float64], scene: Scene
) -> ExpectedErrors:  # fmt: skip
    cells = cells.clip(0.0, 1.0)
    most = float(cells.max(initial=0.0))
    level = np.rint(LEVELS * np.sqrt(cells / max(most, 1e-12))).astype(np.uint8)
    near, light = (AROUND**3 * uniform_filter(values, AROUND, mode="constant") for values in (weight * cells, weight))
    shown = light > light.max(initial=0.0) / AROUND**3
    around = np.where(shown, near / np.maximum(light, 1e-12), 0.0)
    place = np.unravel_index(int(around.argmax()), around.shape)
    x, y, z = scene.occupancy.box.to_world((np.asarray(place) + 0.5) / CELLS).tolist()
    mean = float((weight * cells).sum() / max(weight.sum(), 1e-12))
    return ExpectedErrors(level, most, edge, min(mean, 1.0), min(float(around.max()), 1.0), (x, y, z))


def _calibrated(
    scene: Scene, views: ViewSet, batches: list[Batch], caster: RayCaster, known: ExpectedErrors
) -> tuple[float, float]:
    """Return the factors of the cells' errors, and of the change from pixel to pixel, of rays that the grid misses."""
    height, width = views.images.shape[1:3]
    columns, errors = [], []
    for batch in batches:
        pixel = batch.pixels.to(scene.device).long()
        column, row = pixel % width, pixel // width % height
        beside, below = pixel + (column < width - 1), pixel + width * (row < height - 1)
        out, alpha, _ = seen_along_rays(scene, batch.rays, known)
        colour = [out[:, :3] - alpha[:, None]]
        for other in (beside, below):
            theirs, covered, _ = seen_along_rays(scene, caster.rays(other))
            colour.append(theirs - covered[:, None])
        columns.append(torch.stack([out[:, 3], change(colour[0], colour[1], colour[2])], dim=1))
        errors.append(_errors(out, alpha, batch))
    told, true = (torch.cat(values).double().cpu().numpy() for values in (columns, errors))
    factors = nnls(told, true)[0]
    factors *= true.sum() / max(float((told @ factors).sum()), 1e-12)  # least squares are right about large errors
    return float(factors[0]), float(factors[1])
