"""Classification of a volume by its transfer function, as a starting point for training.

The optical model is that of Max (1995): absorption and emission along a ray, opacity by Beer's law. Letters: K known
values, V voxels; sigma is extinction in 1 / box unit.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_FLOAT
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkCommonMath import vtkMatrix4x4
from vtkmodules.vtkImagingCore import vtkImageReslice

from svv.core.geometry.box import Box
from svv.core.volumes import classified as limits
from svv.core.volumes.classified import COARSE, LARGEST, ClassifiedVolume, Edges, ValueGrid, ValueRange, grid_shape
from svv.dvr.draw.averaging import averaged, integral_of, varying
from svv.dvr.draw.frame import STEP, Stage, set_stage
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import to_array

Array = NDArray[np.float64]

MOST_CELLS = 256
"""Maximum number of cells along the longest side."""

CELLS_A_VOXEL = 2
"""Minimum number of cells per voxel, within ``MOST_CELLS``: transfer functions can vary much between two voxels."""

THICKNESS = 0.25
"""Thickness in box units of matter whose alpha weighs its colour when ranges are split a second time. By extinction,
opaque matter outweighs haze that fills most of a picture and would get its colour; by alpha, haze outweighs bones."""

BESIDE = 0.1
"""Width of the known values on both sides of the visible ones, as a fraction of the width of these."""

BEYOND = 100.0
"""Distance from what a function tells apart, in its width, from which values are kept as if they were that near."""

VALUES = 4097
"""Number of values at which the integral of the extinction is known."""

COLOURS = 513
"""Number of values at which the colour is known."""

COUNTED_VOXELS = 4_000_000
"""Maximum number of voxels whose values are counted."""


def classified(stage: Stage) -> ClassifiedVolume:
    """Classify a volume on its stage by its transfer function: extinction and ranges over the visible box in the world.

    A ray that passes the opacity unit distance u through a value of opacity a keeps 1 - a of its light, so the
    extinction is -ln(1 - a) / u, regardless of the sample distance of the ray caster. Values are first interpolated
    trilinearly and then classified, as ray casters do.
    """
    box, cells = grid_over(stage)
    image = to_array(stage.image)
    known, sigma = extinction(stage, box, float(image.min()), float(image.max()))
    values = resampled(stage, box, cells)
    blank = stage.appearance.blank
    counts = frequencies(image if blank is None else image[~blank], known)
    return classified_grid(stage, box, cells, values, (known, sigma), counts)


def _hide(stage: Stage, box: Box, cells: int, values: NDArray[np.float32]) -> None:
    """Set the values at vertices (Z, Y, X) that are blanked or cropped away to NaN, as those outside of the image."""
    shown = stage.appearance
    if shown.blank is None and shown.crop is None:
        return
    spacing, origin = np.array(stage.image.GetSpacing()), np.array(stage.image.GetOrigin())
    turn = _to_indices(stage)
    steps = turn * (box.size / cells)
    y, x = np.indices(values.shape[1:])
    for z, layer in enumerate(values):
        vertices = np.stack([x, y, np.full_like(x, z)], axis=-1)
        index = vertices @ steps.T + (turn @ (np.asarray(box.low) - stage.centre) - origin / spacing)
        layer[shown.hidden_at(index)] = np.nan


def _to_indices(stage: Stage) -> Array:
    """Return the matrix from directions in the world to steps of indices of the stage's image. (3, 3)"""
    return np.asarray(stage.scale * stage.rotation.T / np.array(stage.image.GetSpacing())[:, None])


def voxel_edges(stage: Stage, box: Box, cells: int) -> Edges:
    """Return the edges of the stage's voxels on a grid over a box with ``cells`` per box unit."""
    x, y, z = (tuple(edge) for edge in np.linalg.inv(_to_indices(stage) * (box.size / cells)).T.tolist())
    return x, y, z


def grid_over(stage: Stage) -> tuple[Box, int]:
    """Return the visible box in world space, and the number of cells of the grid over it per box unit."""
    box = Box.of_bounds(*stage.bounds)
    voxels, cells = _voxels(stage), MOST_CELLS
    while cells > 16 and cells // 2 >= CELLS_A_VOXEL * voxels:
        cells //= 2
    return box, cells


def _voxels(stage: Stage) -> float:
    """Return the largest number of voxels along a side of the visible box."""
    return float((stage.visible_size / np.array(stage.image.GetSpacing()) * stage.scale).max())


def resampled(stage: Stage, box: Box, cells: int) -> NDArray[np.float32]:
    """Return the stage's values at the vertices of a grid over a box, NaN where nothing is shown. (Z, Y, X)"""
    values = resampled_part(stage, box, cells, np.zeros(3, np.int64), grid_shape(box, cells) + 1)
    _hide(stage, box, cells, values)
    return values


def resampled_part(
    stage: Stage, box: Box, cells: int, first: NDArray[np.int64], shape: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Return the stage's values at vertices of a grid over a box, NaN outside of its image. (Z, Y, X)

    ``first`` is the index of the first vertex, ``shape`` the number of vertices, both along x, y, z.
    """
    turn = stage.scale * stage.rotation.T
    to_stage = vtkMatrix4x4()  # from the indices of a vertex to the stage
    for i in range(3):
        for j in range(3):
            to_stage.SetElement(i, j, turn[i, j] * box.size / cells)
        to_stage.SetElement(i, 3, float(turn[i] @ (np.asarray(box.low) - stage.centre)))
    reslice = vtkImageReslice()
    reslice.SetInputData(stage.image)
    reslice.SetResliceAxes(to_stage)
    reslice.SetOutputSpacing(1.0, 1.0, 1.0)
    reslice.SetOutputOrigin(0.0, 0.0, 0.0)
    last = first + shape - 1
    reslice.SetOutputExtent([int(i) for pair in zip(first, last) for i in pair])
    if stage.appearance.nearest:
        reslice.SetInterpolationModeToNearestNeighbor()
    else:
        reslice.SetInterpolationModeToLinear()
    reslice.SetOutputScalarType(VTK_FLOAT)
    reslice.SetBackgroundLevel(float("nan"))
    reslice.Update()
    values: NDArray[np.float32] = vtk_to_numpy(reslice.GetOutput().GetPointData().GetScalars()).reshape(shape[::-1])
    return values


def classified_grid(
    stage: Stage, box: Box, cells: int, values: NDArray[np.float32], function: tuple[Array, Array], counts: Array
) -> ClassifiedVolume:
    """Classify a grid of values (Z, Y, X) over a box; those of the stage itself are not used.

    ``function`` has the known values and their extinction (:func:`extinction`), ``counts`` :func:`frequencies`. (K,)
    each
    """
    known, sigma = function
    colour = stage.tf.colour_at(known)
    # Interpolation produces all values between those of voxels, so no visible one has a weight of 0.
    counts = (counts + 1e-6) * (sigma > 0)
    weight = counts * np.maximum(sigma, 1e-9 * sigma.max())
    starts = _ranges(known, sigma, colour, (weight, counts * np.maximum(-np.expm1(-THICKNESS * sigma), 1e-9)))
    ranges = []
    decimals = _decimals(known / stage.gain)
    for a, b in pairwise([*starts, len(known)]):
        inside = a + np.flatnonzero(sigma[a:b] > 0)
        low, high = (round(float(stage.of_volume(known[i])), decimals) for i in (inside[0], inside[-1]))
        mean = np.average(colour[inside], axis=0, weights=weight[inside])
        ranges.append(ValueRange(low, high, tuple(np.clip(mean, 0.0, 1.0).tolist())))
    exponent, owner = averaged(values, known, sigma, starts, as_voxels_are(stage, box, known))
    spare = CELLS_A_VOXEL if CELLS_A_VOXEL * _voxels(stage) <= cells else 1
    nearest = stage.appearance.nearest
    kept = _value_grid(values, cells, spare, (known, sigma, colour), 1 if nearest else COARSE)
    low, high = stage.of_volume(kept.interval).tolist()
    high = max(high, float(np.nextafter(low, np.inf)))  # of a volume of one large value
    shown = stage.tf.colour_at(np.linspace(*kept.interval, COLOURS)).astype(np.float32)
    edges = voxel_edges(stage, box, kept.cells)
    kept = replace(kept, interval=(low, high), edges=edges, colours=shown, nearest=nearest)
    return ClassifiedVolume(box, cells, exponent, owner, tuple(ranges), kept)


def _decimals(values: Array) -> int:
    """Return the number of decimals (of digits before the point if negative) that resolve a billionth of a range."""
    width = float(values[-1] - values[0])
    return 9 - math.floor(math.log10(width)) if width > 0 else 300


def _value_grid(
    values: NDArray[np.float32], cells: int, spare: int, function: tuple[Array, Array, Array], apart: int
) -> ValueGrid:
    """Return one of every ``spare`` vertices along each axis, see :func:`classified_grid`, in the stage's values.

    ``function`` has the known values, their extinction and colours; codes are ``apart`` (:func:`coded`).
    """
    known, sigma, colour = function
    first, width = varying(known, np.column_stack([sigma, colour * (sigma > 0)[:, None]]))
    far = BEYOND * width if width > STEP else np.inf  # a step needs all values around it
    low, high = max(float(known[0]), first - far), min(float(known[-1]), first + width + far)
    seen = np.clip(known[sigma > 0], low, high)
    width = max(float(seen[-1] - seen[0]), 1e-3 * (high - low), 1e-9)
    beside = BESIDE * width
    low, high = max(float(known[0]), seen[0] - beside), min(float(known[-1]), seen[-1] + beside)
    high = max(high, low + beside)
    kept = values[::spare, ::spare, ::spare]
    wanted = [-(-(n - 1) // spare) + 1 for n in values.shape]  # a grid of fewer cells may end a vertex later
    own = np.pad(kept, [(0, after - n) for after, n in zip(wanted, kept.shape)], mode="edge")
    codes = np.zeros(own.shape[::-1], np.uint16)
    for k, layer in enumerate(own):  # one after another, because several whole grids would take much memory
        codes[:, :, k] = coded(layer, (low, high), apart).T
    at = np.linspace(low, high, VALUES)
    integral = np.interp(at, known, integral_of(known, sigma))
    visible = tuple(float(np.clip((v - low) / (high - low), 0.0, 1.0)) for v in (seen[0], seen[-1]))
    return ValueGrid(
        cells // spare, codes, (low, high), (visible[0], visible[1]),
        np.maximum.accumulate(integral - integral[0]) / (high - low),
    )  # fmt: skip


def coded(values: NDArray[np.float32], interval: tuple[float, float], apart: int = COARSE) -> NDArray[np.uint16]:
    """Return the codes of values over an interval; see :class:`svv.core.volumes.classified.ValueGrid`. Same shape

    They are ``apart``: 1 for labels, of which there may be thousands.
    """
    share = np.clip((values - interval[0]) / (interval[1] - interval[0]), 0.0, 1.0)
    steps = np.rint(LARGEST / apart * np.nan_to_num(share))
    return np.where(np.isnan(values), 0.0, 1.0 + apart * steps).astype(np.uint16)


def extinction(stage: Stage, box: Box, low: float, high: float) -> tuple[Array, Array]:
    """Return ascending values from low to high that miss no extremum, and their extinction, 1 / box unit. (K,), (K,)"""
    return _extinction_of(stage.tf, stage, box, low, high)


def as_voxels_are(stage: Stage, box: Box, known: Array) -> tuple[Array, Array] | None:
    """Return what :func:`extinction` does, however values at jumps are rounded, if only voxels are shown; or None."""
    if not stage.appearance.nearest:
        return None
    return _extinction_of(stage.settled, stage, box, float(known[0]), float(known[-1]))


def _extinction_of(tf: TransferFunction, stage: Stage, box: Box, low: float, high: float) -> tuple[Array, Array]:
    known = tf.resolved(low, high)
    sigma = -np.log1p(-np.minimum(tf.opacity_at(known), 1.0 - 1e-6)) / stage.unit_distance
    return known, sigma * stage.scale * box.size


def _ranges(known: Array, sigma: Array, colour: Array, weights: tuple[Array, Array]) -> list[int]:
    """Return the index among the known values at which each range begins; together the ranges contain all values.

    A range is an interval in which something is visible. A range whose colours differ too much is split so that its
    parts are as uniform as possible, and while there are too many ranges, the two most similar neighbours are joined.
    Both criteria are the variance of the colours (K, 3) within the ranges (Ward 1963), by the first of the ``weights``
    (K,), by which colours are averaged; then ranges are split by the other one.
    """
    seen = np.flatnonzero(sigma > 0)
    parts = np.split(seen, 1 + np.flatnonzero(np.diff(seen) > 1))

    def scatter(part: NDArray[np.intp], weight: Array) -> float:
        """Return the sum of the weighted squared distances to the mean colour."""
        w, c = weight[part], colour[part]
        return float(w @ np.square(c - np.average(c, axis=0, weights=w)).sum(axis=1))

    for weight in weights:
        while len(parts) < limits.MOST_RANGES:
            spread = [scatter(part, weight) / weight[part].sum() for part in parts]
            widest = int(np.argmax(spread))
            if spread[widest] <= limits.COLOUR_SPREAD**2:
                break
            w, c = weight[parts[widest]], colour[parts[widest]]
            before, behind = np.cumsum(w)[:-1], np.cumsum(w[::-1])[-2::-1]
            moment = np.cumsum(w[:, None] * (c - np.average(c, axis=0, weights=w)), axis=0)[:-1]
            less = np.square(moment).sum(axis=1) * (1.0 / before + 1.0 / behind)
            parts[widest : widest + 1] = np.split(parts[widest], [1 + int(np.argmax(less))])
    while len(parts) > limits.MOST_RANGES:
        joined = [scatter(np.concatenate(both), weights[0]) for both in pairwise(parts)]
        apart = [scatter(part, weights[0]) for part in parts]
        more = [whole - a - b for whole, (a, b) in zip(joined, pairwise(apart))]
        join = int(np.argmin(more))
        parts[join : join + 2] = [np.concatenate(parts[join : join + 2])]
    # Values between two ranges belong to the nearer one.
    middles = [0.5 * (known[one[-1]] + known[other[0]]) for one, other in pairwise(parts)]
    return [0, *np.searchsorted(known, middles).tolist()]


def frequencies(image: NDArray[np.number], known: Array, whole: int = 0) -> Array:
    """Return how often each known value is nearest to a voxel's, as a fraction of the ``whole`` volume's. (K,)"""
    values = image.ravel()
    values = values[:: max(1, max(whole, len(values)) // COUNTED_VOXELS)]
    nearest = np.searchsorted(0.5 * (known[1:] + known[:-1]), values)
    return np.bincount(nearest, minlength=len(known)) / len(values)


def classified_as(image: vtkImageData, tf: TransferFunction) -> ClassifiedVolume:
    """Classify a volume (see ``as_volume``) by a function for its values; BadInput if that shows nothing, or all."""
    values = to_array(image)
    fitted = tf.fitted(float(values.min()), float(values.max()), rescale=False)
    return classified(set_stage(image, fitted))
