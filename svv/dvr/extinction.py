"""The extinction of a volume under a transfer function, for the training to begin with.

The optical model is that of Max (1995): absorption and emission along a ray, opacity by Beer's law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_FLOAT
from vtkmodules.vtkCommonMath import vtkMatrix4x4
from vtkmodules.vtkImagingCore import vtkImageReslice

from svv.core.box import Box
from svv.core.extinction import LEAST, MOST, Extinction, grid_shape
from svv.dvr.grids import to_array
from svv.dvr.stage import Stage

FINEST = 256
"""Cells along the longest side at most."""

A_VOXEL = 2
"""Cells a voxel at least, as far as ``FINEST`` allows: between two voxels a transfer function may do a lot."""

WIDTH = 1.0
"""Of the averaging, in cells: found by comparing rays dimmed by it with the ray caster's alpha (docs/training.md)."""


def extinction_of(stage: Stage) -> Extinction:
    """What a volume on its stage lets through.

    A ray that runs the opacity unit distance u through a value of opacity a keeps 1 - a of its light, so the extinction
    is -ln(1 - a) / u, whatever the sample distance of the ray caster is. Values are interpolated trilinearly first and
    classified then, as ray casters do.

    Args:
        stage: A volume with its transfer function and unit distance.

    Returns:
        The extinction over the visible box of the world, with ``A_VOXEL`` cells a voxel but not more than ``FINEST``
        along the longest side.
    """
    box = Box.of_bounds(*stage.bounds)
    voxels = float((stage.visible_size / np.array(stage.image.GetSpacing()) * stage.scale).max())
    cells = FINEST
    while cells > 16 and cells // 2 >= A_VOXEL * voxels:
        cells //= 2
    shape = grid_shape(box, cells) + 1
    turn = stage.scale * stage.rotation.T
    to_stage = vtkMatrix4x4()  # from a vertex' number
    for i in range(3):
        for j in range(3):
            to_stage.SetElement(i, j, turn[i, j] * box.size / cells)
        to_stage.SetElement(i, 3, float(turn[i] @ (np.asarray(box.low) - stage.centre)))
    reslice = vtkImageReslice()
    reslice.SetInputData(stage.image)
    reslice.SetResliceAxes(to_stage)
    reslice.SetOutputSpacing(1.0, 1.0, 1.0)
    reslice.SetOutputOrigin(0.0, 0.0, 0.0)
    reslice.SetOutputExtent(0, int(shape[0]) - 1, 0, int(shape[1]) - 1, 0, int(shape[2]) - 1)
    reslice.SetInterpolationModeToLinear()
    reslice.SetOutputScalarType(VTK_FLOAT)
    reslice.SetBackgroundLevel(float("nan"))
    reslice.Update()
    values = vtk_to_numpy(reslice.GetOutput().GetPointData().GetScalars()).reshape(shape[::-1])
    return Extinction(box, cells, _exponents(values, stage, box))


def _exponents(values: NDArray[np.float32], stage: Stage, box: Box) -> NDArray[np.float16]:
    """Logarithms of the mean extinction around each vertex: values (Z, Y, X), NaN outside the volume -> (X, Y, Z).

    Where the values run across a range of the function between two vertices, its extinction there would be missed or
    met by chance. So it is averaged over the values within a cell around the vertex, by its integral over the values
    (as in pre-integrated classification, Engel et al. 2001).
    """
    image = to_array(stage.image)
    low, high = float(image.min()), float(image.max())
    known = np.unique(np.concatenate([stage.tf.samples(low, high), np.linspace(low, high, 4097)]))
    depth = -np.log1p(-np.minimum(stage.tf.opacity_at(known), 1.0 - 1e-6)) / stage.unit_distance
    depth *= stage.scale * box.size
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (depth[1:] + depth[:-1]) * np.diff(known))])
    least = 1e-4 * (high - low)  # half the values' spread at least, for differences of the integral to be exact
    exponent = np.empty(values.shape[::-1], np.float16)  # NaN, outside the volume, becomes nothing there
    for k, layer in enumerate(values):
        slope = np.gradient(values[max(k - 1, 0) : k + 2], axis=0)[min(k, 1)]
        squared = np.square(np.nan_to_num(slope))
        for axis in (0, 1):
            squared += np.square(np.nan_to_num(np.gradient(layer, axis=axis)))
        half = np.maximum(0.5 * WIDTH * np.sqrt(squared), least)
        start, stop = np.clip(layer - half, low, high), np.clip(layer + half, low, high)
        inside = np.interp(stop, known, integral) - np.interp(start, known, integral)
        spread = stop - start
        here = np.interp(layer, known, depth)  # of a volume of one value, which has no spread
        found = np.nan_to_num(np.where(spread > 0, inside / np.where(spread > 0, spread, 1.0), here))
        exponent[:, :, k] = np.log(np.clip(found, np.exp(LEAST), np.exp(MOST))).T
    return exponent
