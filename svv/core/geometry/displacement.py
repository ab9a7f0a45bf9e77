"""Where the matter of a time-varying volume comes from: a displacement between two of its time steps.

Paint that stays in space while matter moves through it flickers. Optical flow (iterative Lucas and Kanade, in three
dimensions), followed from step to step, leads back to the step that was painted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, zoom
from skimage.registration import optical_flow_ilk

CELLS = 48
"""Cells along the longest side of the grids that are compared."""

RADIUS = 4
"""Radius of the windows that move as one, in those cells."""

SMOOTH = 1.2
"""Standard deviation by which a displacement is smoothed before strokes follow it, in those cells: what moves single
places apart is noise, and crumples them."""

Field = NDArray[np.float32]


def small(values: Field) -> Field:
    """Return a grid of values with at most ``CELLS`` cells along its longest side."""
    factor = min(1.0, CELLS / (max(values.shape) - 1))
    shape = [max(2, round((n - 1) * factor) + 1) for n in values.shape]
    scale = [a / b for a, b in zip(shape, values.shape)]
    smooth = gaussian_filter(values, 0.3 / factor) if factor < 1.0 else values
    return np.asarray(zoom(smooth, scale, order=1, mode="nearest", grid_mode=False), np.float32)


def came_from(before: Field, after: Field, earlier: Field | None = None) -> Field:
    """Return where the matter of a time step was in the first one, relative to where it is, in cells. (3, X, Y, Z)

    ``before`` and ``after``: values of the step before and of the step (X, Y, Z); ``earlier``: what this function
    returned for the step before, if that is not the first one.
    """
    if min(after.shape) < 3:
        return np.zeros((3, *after.shape), np.float32)
    step = np.nan_to_num(np.asarray(optical_flow_ilk(after, before, radius=RADIUS, gaussian=True), np.float32))
    if earlier is None:
        return step
    place = np.indices(after.shape, np.float32) + step
    return step + np.stack([map_coordinates(axis, place, order=1, mode="nearest") for axis in earlier])


def smoothed(moved: Field) -> Field:
    """Return displacements (3, X, Y, Z) without the noise of single places."""
    return np.asarray(gaussian_filter(moved, (0.0, SMOOTH, SMOOTH, SMOOTH), mode="nearest"), np.float32)
