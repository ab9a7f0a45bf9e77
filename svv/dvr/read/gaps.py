"""Voxels without a value: NaN, infinities, and what a file marks as missing. Nothing is drawn there.

They are blanked (:class:`svv.dvr.read.appearance.Appearance`), and get the value of a neighbour, so that interpolation
and gradients beside them know no value that no voxel has: a number far away would show as a rim.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput

LAYERS = 3
"""Layers of voxels around those with a value that get a neighbour's: what is shown interpolates the first layer, and
its gradients the second one."""

SAID = "{name} has no value (NaN, infinite or missing) at {count} voxels ({share:.2g} %): nothing is drawn there."

NEIGHBOURS = sorted((step for step in product((-1, 0, 1), repeat=3) if any(step)), key=lambda step: np.abs(step).sum())
"""Steps to the neighbours of a voxel, the nearest first."""


def without_gaps(
    values: NDArray[np.number], name: str
) -> tuple[NDArray[np.number], NDArray[np.bool_] | None, str | None]:
    """Return finite values, which voxels had none, and a sentence on these; None twice if all had one. (nz, ny, nx)

    Raises BadInput if no voxel has a value.
    """
    if values.dtype.kind != "f":
        return values, None, None
    gaps = ~np.isfinite(values)
    count = int(gaps.sum())
    if not count:
        return values, None, None
    if count == values.size:
        raise BadInput(f"{name} has no voxel with a value: all are NaN, infinite or missing.")
    result, left = values.copy(), gaps.copy()
    result[gaps] = values[~gaps].min()
    for _ in range(LAYERS):
        _fill_layer(result, left)
    return result, gaps, SAID.format(name=name, count=count, share=100.0 * count / values.size)


def _fill_layer(values: NDArray[np.number], left: NDArray[np.bool_]) -> None:
    """Give the voxels that are left, and border on others, the value of the nearest of these."""
    from scipy.ndimage import binary_dilation  # not before it is needed: ParaView's window imports this module

    here = np.argwhere(left & binary_dilation(~left, np.ones((3, 3, 3), bool)))
    last, found = np.array(values.shape) - 1, np.zeros(len(here), bool)
    for step in NEIGHBOURS:
        there = here + step
        known = ~found & ((there >= 0) & (there <= last)).all(axis=1)
        known[known] = ~left[tuple(there[known].T)]
        values[tuple(here[known].T)] = values[tuple(there[known].T)]
        found |= known
    left[tuple(here[found].T)] = False
