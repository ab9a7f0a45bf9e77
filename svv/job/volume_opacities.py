"""Other opacities of a scene of learned features, from the volume on which it was trained.

The functions change the extinction that training found at each vertex, and :mod:`svv.fields.following.other_cells` has
the rest: what the views of the training did not show is approximate, and is told. Letters: V vertices, S samples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.interval_text import interval_text
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.core.volumes.classified import cells_with, grid_shape
from svv.dvr.draw.other_functions import exponents_over
from svv.dvr.draw.time_series import visible_bounds
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
from svv.fields.following.other_cells import on_cells
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import FAINTEST, Occupancy, least_extinction
from svv.fields.radiance.rendering import RayCaster, composite, march
from svv.fields.scene.scene import Scene

VIEWS, SIZE = 30, 64
"""Number and size in pixels of the views in which is counted what is seen."""

RAYS = 1 << 16
"""Rays of these that are followed together."""

KNOWN = 2049
"""Values at which functions are known."""

HIDDEN = 0.1
"""Largest transmittance from any of these views at which a place counts as hidden."""

OTHER = 0.2
"""Difference of hues, whose brightest channel is 1, from which a colour is another."""

TOLD, MOST_OTHER = 0.02, 0.1
"""Shares of what is seen: from the first, the user is told that it is approximate; no picture is shown with a larger
one of other colours than the second."""

ALIKE = 0.9
"""Largest mean difference of the logarithms of a learned extinction and that of its own volume: it is .2 to .5, and
1.3 or more for a volume that has been moved by two voxels."""

APPROXIMATE = "approximate"
"""Key of a scene's record: sentences about what its opacities show only approximately."""


def with_opacities_of(
    scene: Scene, before: TransferFunction, function: TransferFunction, volume: vtkImageData
) -> Scene:
    """Return a scene with the opacities of another function of its volume, with its palette, edits and paint.

    The scene, of the encoding ``lattice``, was trained with the volume (:func:`svv.dvr.read.grids.as_volume`), which it
    shows by the function ``before``; both functions have their unit distances. Raises BadInput if the scene is not one
    of these, the volume is another one, or the function shows too much of which no colours were learned.
    """
    density, occupancy = scene.base.density, scene.occupancy
    if density is None or scene.made.get("learned_from") != "volume and views":
        raise BadInput("The scene was not learned from its volume, with a lattice: train it with this function.")
    cells = density.resolutions[-1]
    values, exponents = exponents_over(volume, (before, function), occupancy.box, cells)
    # The last cells of the lattice may end beyond the box, where training took nothing to be.
    beyond = [(0, n - m) for n, m in zip(density.shapes[-1].tolist(), values.shape, strict=True)]
    values = np.pad(values, beyond, constant_values=np.nan)
    old, new = (np.pad(e, beyond, constant_values=EMPTY_LOG_EXTINCTION) for e in exponents)
    there = tuple(density.vertices_of_level(0, occupancy.occupied, occupancy.cells).T)
    learned = density.table.detach().cpu().numpy()[:, 0]
    if len(density.resolutions) > 1 or np.abs(learned - old[there]).mean() > ALIKE:
        raise BadInput("The scene was not trained on this volume: name the one that it was trained on.")
    _check_within(function, volume, occupancy)
    if np.array_equal(old, new):
        return replace(scene, made={**scene.made, APPROXIMATE: []})
    field = new.astype(np.float32)
    field[there] = adapted(learned, old[there].astype(np.float64), new[there].astype(np.float64))
    least = np.log(least_extinction(FAINTEST, float(np.exp(field.max()))))
    occupied = cells_with(field >= least, cells, grid_shape(occupancy.box, occupancy.cells), occupancy.cells)
    filled = Occupancy(occupancy.box, occupancy.cells, occupied)
    lattice = SparseLattice(occupied, occupancy.cells, (cells,), 1).requires_grad_(False)
    for rows, vertices in lattice.pieces_of_level(0, occupied, occupancy.cells):
        lattice.table[rows, 0] = torch.from_numpy(field[tuple(vertices.T)])
    result = on_cells(scene, filled, lattice)
    said = _approximate(scene, result, (before, function), values)
    return replace(result, made={**result.made, APPROXIMATE: said})


def adapted(learned: NDArray[np.floating], old: NDArray[np.float64], new: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return logarithms of an extinction for another function, from what training has found for the old one.

    It keeps its ratio to the classified extinction, of which ``old`` and ``new`` are the logarithms. Where nothing was
    visible, training had nothing to adapt. All have the same shape.

    >>> adapted(np.array([2.5, -4.0]), np.array([2.0, -3.0]), np.array([1.0, 1.0]))
    array([1.5, 1. ], dtype=float32)
    """
    shown, now = old > EMPTY_LOG_EXTINCTION, new > EMPTY_LOG_EXTINCTION
    kept = np.where(shown, np.minimum(learned, EMPTY_LOG_EXTINCTION), learned)
    found = np.where(now, np.where(shown, learned + new - old, np.maximum(learned, new)), kept)
    return np.minimum(found, MOST_LOG_EXTINCTION).astype(np.float32)


def _check_within(function: TransferFunction, volume: vtkImageData, occupancy: Occupancy) -> None:
    """Raise BadInput if a function shows nothing, or something beyond the box of a scene, but for a cell."""
    bounds, box = visible_bounds(volume, function), occupancy.box
    if bounds is None:
        raise BadInput(f"'{function.name}' shows nothing of this volume, or all of it.")
    beyond = np.maximum(box.bounds[0] - bounds[0], bounds[1] - box.bounds[1]).max()
    if beyond > box.size / occupancy.cells:
        raise BadInput("The function shows more than the space that the scene fills: train a scene with this function.")


class _Seen:
    """What views of a scene show: the samples of their rays, in pieces, and their weights."""

    def __init__(self, scene: Scene, function: TransferFunction, values: NDArray[np.float32]) -> None:
        """Look at a scene of a function of a volume with ``values`` on the vertices of its extinction."""
        assert scene.base.density is not None and scene.palette_network is not None
        cells, cameras = scene.base.density.resolutions[-1], scene.rig.sphere(VIEWS, SIZE)
        caster, box = RayCaster(cameras, scene.occupancy.box, scene.device), scene.occupancy.box
        known = function.resolved(float(np.nanmin(values)), float(np.nanmax(values)), KNOWN)
        opacity, hue = function.opacity_at(known), _hue(function.colour_at(known))
        places, weights, clear, other, found = [], [], [], [], []
        for pixels in torch.arange(VIEWS * SIZE * SIZE).split(RAYS):
            samples = march(caster.rays(pixels), scene.occupancy, scene.base.density, scene.marching)
            _, _, weight = composite(samples, samples.sigma, samples.sigma.new_zeros(len(samples), 1))
            alpha = -torch.expm1(-samples.sigma * samples.step)
            place, w = samples.position.cpu().numpy(), weight.cpu().numpy()
            vertex = np.rint(place * cells).astype(np.int64)
            value = np.nan_to_num(values[tuple(vertex.T)], nan=np.inf)
            shown = np.interp(value, known, opacity, right=0.0) > 0.0
            _, mixed, offsets = scene.palette_network.material(samples.position)
            colour = (mixed[:, :, None] * (scene.palette_network.colours + offsets)).sum(1).cpu().numpy()
            told = np.stack([np.interp(value, known, channel) for channel in hue.T], axis=1)
            places.append(place)
            weights.append(np.where(shown, w, 0.0))
            found.append(value)
            clear.append((weight / alpha.clamp(min=1e-6)).cpu().numpy())
            other.append(np.abs(_hue(colour) - _hue(told)).max(axis=1) > OTHER)
        self.place, self.clear, self.other, self.value = map(np.concatenate, (places, clear, other, found))
        weight = np.concatenate(weights)
        self.weight = weight / max(weight.sum(), 1e-9)
        self.cells, self.shape = scene.settings.resolutions[-1], grid_shape(box, scene.settings.resolutions[-1])

    @property
    def cell(self) -> NDArray[np.int64]:
        """The cell of the finest features in which each sample lies. (S,)"""
        at = np.minimum((self.place * self.cells).astype(np.int64), self.shape - 1)
        return np.ravel_multi_index(tuple(at.T), tuple(self.shape))


def _hue(colour: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return colours (S, 3) as bright as they can be."""
    return colour / np.maximum(colour.max(axis=1, keepdims=True), 1e-3)


@torch.no_grad()
def _approximate(
    scene: Scene, result: Scene, functions: tuple[TransferFunction, TransferFunction], values: NDArray[np.float32]
) -> list[str]:
    """Return what a result for the second function shows only approximately; raises BadInput if that is too much."""
    before, now = (_Seen(s, f, values) for s, f in zip((scene, result), functions, strict=True))
    clear = np.zeros(int(before.shape.prod()), np.float32)
    np.maximum.at(clear, before.cell, before.clear)
    hidden = float(now.weight[clear[now.cell] <= HIDDEN].sum())
    other = float(now.weight[now.other].sum() - before.weight[before.other].sum())
    said = []
    if other > TOLD:
        known = functions[0].resolved(float(np.nanmin(values)), float(np.nanmax(values)), KNOWN)
        new = np.interp(now.value, known, functions[0].opacity_at(known)) <= 0.0
        wrong = now.other & (now.weight > 0.0)
        low, high = np.quantile(now.value[wrong & new if (wrong & new).any() else wrong], (0.05, 0.95))
        where = f"{other:.0%} of what the function shows, at values of {interval_text(low, high)}, "
        if other > MOST_OTHER:
            raise BadInput(f"The scene has no colours for {where[:-2]}: train a scene with this function.")
        said.append(f"{where}has colours of what lies beside it, as the views of the training showed no such values.")
    if hidden > TOLD:
        said.append(
            f"{hidden:.0%} of what the function shows was hidden when the scene was trained, so its light is guessed."
        )
    return said
