"""The values of a volume at several time steps, over one box, for a scene that follows them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.geometry.box import Box
from svv.core.volumes.classified import ValueGrid
from svv.dvr.draw.classify import coded, resampled, voxel_edges
from svv.dvr.draw.frame import place_whole, set_stage
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import to_array
from svv.errors import BadInput

ANY = TransferFunction.from_bumps([{"centre": 0.5, "width": 1.0, "opacity": 0.5, "colour": (1.0, 1.0, 1.0)}])
"""A transfer function for a stage of which only the values are used."""


def visible_bounds(image: vtkImageData, function: TransferFunction) -> NDArray[np.float64] | None:
    """Return the world bounds of what a transfer function shows of a volume (2, 3); None if it shows nothing."""
    values = to_array(image)
    try:
        fitted = function.fitted(float(values.min()), float(values.max()), rescale=False)
        return set_stage(image, fitted).bounds
    except BadInput:
        return None  # no error in a series, in which something may appear late


def values_over(image: vtkImageData, box: Box, cells: int, interval: tuple[float, float]) -> ValueGrid:
    """Return a volume's values on the vertices of a grid with ``cells`` per box unit over a box in world units.

    The ends of the interval count as 0 and 1, and values beyond as the nearer one.
    """
    stage = place_whole(image, ANY)
    own = resampled(stage, box, cells)
    low, high = stage.staged(interval)
    codes: NDArray[np.uint16] = np.ascontiguousarray(coded(own, (low, high)).transpose(2, 1, 0))
    return ValueGrid(cells, codes, interval, (0.0, 1.0), edges=voxel_edges(stage, box, cells))


def beyond(image: vtkImageData, function: TransferFunction, interval: tuple[float, float]) -> float:
    """Return which fraction of the voxels that a transfer function shows have values beyond an interval."""
    values = to_array(image).ravel()
    values = values[:: max(1, len(values) // 1_000_000)].astype(np.float64)
    seen = values[function.opacity_at(values) > 0.0]
    width = 1e-3 * (interval[1] - interval[0])
    outside = (seen < interval[0] - width) | (seen > interval[1] + width)
    return float(outside.mean()) if len(seen) else 0.0
