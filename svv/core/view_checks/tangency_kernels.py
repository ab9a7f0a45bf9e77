"""Epipolar tangency of pairs of views, compiled with numba."""

from __future__ import annotations

import math

import numpy as np

from svv.core.compiled import njit

AHEAD = 0.05
"""Cosine of the angle to the middle of both objects that all rays must exceed for two views to be compared."""


@njit(cache=True)
def compare_tangents(positions, units, focal, pairs, found):  # type: ignore[no-untyped-def]
    """Compare the outermost planes through both positions of each pair of pinhole cameras; angles name them.

    ``units`` (n, tangents, 3): unit vectors of rays to the outermost points of each silhouette; ``focal`` (n,): in
    pixels; ``found`` (pairs, 2): differences on either side in pixels, or NaN for cameras at one point, which have no
    line between them, or a plane that runs through the object.
    """
    count = units.shape[1]
    middle = np.zeros((len(units), 3))
    for n in range(len(units)):
        for t in range(count):
            for k in range(3):
                middle[n, k] += units[n, t, k] / count
    line, ahead, side = np.empty(3), np.empty(3), np.empty(3)
    angles, scales = np.empty((2, 2)), np.empty((2, 2))  # of the highest and the lowest plane in each view
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        for k in range(3):
            line[k] = positions[j, k] - positions[i, k]
            ahead[k] = middle[i, k] + middle[j, k]
        length = math.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
        clear = length > 0.0
        if clear:
            line /= length
            ahead -= (ahead[0] * line[0] + ahead[1] * line[1] + ahead[2] * line[2]) * line
            size = math.sqrt(ahead[0] ** 2 + ahead[1] ** 2 + ahead[2] ** 2)
            clear = size > 0.0
        if clear:
            ahead /= size
            side[0] = line[1] * ahead[2] - line[2] * ahead[1]
            side[1] = line[2] * ahead[0] - line[0] * ahead[2]
            side[2] = line[0] * ahead[1] - line[1] * ahead[0]
            for v in range(2):
                clear = clear and _outermost(units[pairs[p, v]], line, ahead, side, angles[v], scales[v])
        for k in range(2):
            if clear:
                scale = 0.5 * (scales[0, k] * focal[i] + scales[1, k] * focal[j])
                found[p, k] = (angles[0, k] - angles[1, k]) * scale
            else:
                found[p, k] = np.nan


@njit(cache=True)
def _outermost(rays, line, ahead, side, angles, scales):  # type: ignore[no-untyped-def]
    """Find the highest and the lowest plane of a view, and radians of its image a radian of angle there.

    Returns False if a ray does not lead ahead.
    """
    high, low = -math.inf, math.inf
    first, last = 0, 0
    for t in range(len(rays)):
        x, y, z = rays[t, 0], rays[t, 1], rays[t, 2]
        forward = x * ahead[0] + y * ahead[1] + z * ahead[2]
        if not forward > AHEAD:
            return False
        slope = (x * side[0] + y * side[1] + z * side[2]) / forward  # grows with the angle, which takes longer
        if slope > high:
            high, first = slope, t
        if slope < low:
            low, last = slope, t
    angles[0], angles[1] = math.atan(high), math.atan(low)
    for k, t in enumerate((first, last)):
        along = rays[t, 0] * line[0] + rays[t, 1] * line[1] + rays[t, 2] * line[2]
        scales[k] = math.sqrt(max(1.0 - along * along, 1e-6))
    return True
