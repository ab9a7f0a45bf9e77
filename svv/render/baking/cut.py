"""Cut a baked volume: nothing is left on one side of a surface.

Letters: S points of the volume that show something.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from svv.core.volumes.opacity_code import CODES, LEAST_LOG_DEPTH, codes_of
from svv.render.baking.baked_volume import BakedVolume

Side = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""A function of world coordinates (N, 3) whose values (N,) are positive on the side that is cut off."""

DROP = 3.0
"""Logarithm by which extinction drops over a voxel at the cut; if it dropped at once, mappers would draw steps."""

REACH = 2.0
"""Voxels beyond the cut at which nothing is left."""

CHUNK = 1 << 19
"""Points that are looked at together."""


def cut(volume: BakedVolume, side: Side) -> BakedVolume:
    """Return a volume without what lies where ``side`` is positive; it is 0 at a surface, and smooth there.

    Extinction is halved at the surface, drops to 1/20 over each voxel beyond it, and ends after two.
    """
    grid, codes = volume.grid, volume.rgba[..., 3].ravel().copy()
    places = np.flatnonzero(codes)
    step = (volume.most - LEAST_LOG_DEPTH) / (CODES - 1)
    for first in range(0, len(places), CHUNK):
        place = places[first : first + CHUNK]
        index = np.stack(np.unravel_index(place, grid.shape[::-1])[::-1], axis=1)
        at = np.array(grid.origin) + index * grid.spacing  # (S, 3)
        beyond = _voxels_beyond(side, at, grid.spacing)
        drop = DROP / step * np.maximum(beyond + np.log(2.0) / DROP, 0.0)
        codes[place] = np.where(beyond > REACH, 0.0, np.rint(np.maximum(codes[place] - drop, 0.0)))
    most, largest = volume.most, int(codes.max(initial=0))
    if 1 < largest < CODES:  # the largest code has to be 255, see svv.core.volumes.opacity_code
        logs = LEAST_LOG_DEPTH + step * (codes - 1.0)
        most = max(LEAST_LOG_DEPTH + step * (largest - 1), LEAST_LOG_DEPTH + 1.0)
        codes = np.where(codes > 0, codes_of(logs.astype(np.float32), most), 0).astype(np.uint8)
    rgba = volume.rgba.copy()
    rgba[..., 3] = codes.reshape(rgba.shape[:3])
    ends, norms = volume.ranges
    ends = np.array([*ends[:3], [0.0, codes.max(initial=0)]])
    return replace(volume, rgba=rgba, most=most, ranges=(ends, norms))


def _voxels_beyond(side: Side, at: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return how far points (S, 3) lie beyond the surface, in voxels, exact to first order. (S,)"""
    value = side(at)
    steps = [side(at + np.eye(3)[axis] * spacing) - value for axis in range(3)]
    slope = np.linalg.norm(steps, axis=0)
    return np.asarray(value / np.maximum(slope, np.finfo(np.float64).tiny))
