"""Sheets: what a viewer sees of a region along a ray, and where. :mod:`svv.kernels.numba.sheets` computes it quickly.

The samples of a region that follow one another on a ray without a gap are one sheet of paint or glass, seen at its mean
position, weighted by how visible its samples are. Paint has one colour there: through its depth, a stroke would be
mixed with what lies below it. Letters: S samples in the order of their rays, front to back; G regions; K sheets.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def sheets(
    position: NDArray[np.floating],
    weight: NDArray[np.floating],
    ray: NDArray[np.integer],
    region: NDArray[np.integer],
    apart: NDArray[np.floating],
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the number of each sample's sheet, -1 for none (S,), and where each sheet is seen: mean positions (K, 3).

    Sheets are numbered in the order of their first samples. ``position`` (S, 3); ``weight`` (S,): in the pixel, >= 0;
    ``apart`` (G,): distance of two successive samples of a region above which they belong to different sheets, in box
    units; 0 for a region whose samples belong to no sheet.

    >>> x = np.array([0.1, 0.11, 0.5, 0.12])
    >>> position = np.stack([x, x * 0, x * 0], 1)
    >>> own, where = sheets(position, np.ones(4), np.array([0, 0, 0, 1]), np.zeros(4, int), np.array([0.1]))
    >>> own.tolist(), [round(float(x), 3) for x in where[:, 0]]
    ([0, 0, 1, 2], [0.105, 0.5, 0.12])
    """
    own = np.full(len(position), -1, np.int64)
    last: dict[tuple[int, int], int] = {}
    count = 0
    for j in range(len(position)):
        k = int(region[j])
        if not apart[k] > 0.0:
            continue
        i = last.get((int(ray[j]), k))
        if i is not None and np.linalg.norm(position[j].astype(np.float64) - position[i]) <= apart[k]:
            own[j] = own[i]
        else:
            own[j] = count
            count += 1
        last[int(ray[j]), k] = j
    seen = np.asarray(weight, np.float64) + LEAST
    inside = own >= 0
    total = np.bincount(own[inside], seen[inside], count)
    sums = [np.bincount(own[inside], (seen * position[:, f])[inside], count) for f in range(3)]
    return own, (np.stack(sums, 1) / total[:, None]).astype(np.float32)


LEAST = 1e-9
"""Added to weights, so that a sheet that is wholly hidden has a place as well."""
