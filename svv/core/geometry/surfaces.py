"""Normals of a field on a grid, of either sign: where thin shells rise and fall again, the gradient alone vanishes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

SQUARINGS = 5
"""Squarings of a matrix that leave of it only the direction of the largest eigenvalue: its 32nd power."""

LEAST_TRACE = 1e-20
"""Trace of a structure tensor below which the field is constant."""


def surface_normals(
    field: NDArray[np.floating], places: NDArray[np.integer], inner: float, outer: float
) -> NDArray[np.float32]:
    """Return the directions in which a field changes most, around given voxels.

    The principal eigenvector of the structure tensor, which averages g g^T over a neighbourhood (Förstner and
    Gülch 1987): the gradient g on both sides of a thin shell is opposite, and only their squares add up.

    Args:
        field: Values on a grid. (X, Y, Z)
        places: Indices of V voxels. (V, 3)
        inner: Standard deviation in voxels of the Gaussian whose derivatives give the gradient.
        outer: Standard deviation in voxels of the neighbourhood.

    Returns:
        Unit vectors of either sign; zero where the field is constant. (V, 3)
    """
    at = tuple(places.T)
    values = np.asarray(field, np.float32)
    gradient = [gaussian_filter(values, inner, order=[int(k == a) for k in range(3)], mode="nearest") for a in range(3)]
    tensor = np.empty((len(places), 3, 3))
    for row in range(3):
        for column in range(row + 1):
            mean = gaussian_filter(gradient[row] * gradient[column], outer, mode="nearest")[at]
            tensor[:, row, column] = tensor[:, column, row] = mean
    trace = np.trace(tensor, axis1=1, axis2=2)
    there = trace > LEAST_TRACE
    power = tensor[there] / trace[there, None, None]
    for _ in range(SQUARINGS):
        power = power @ power
        power /= np.trace(power, axis1=1, axis2=2)[:, None, None]
    longest = np.diagonal(power, axis1=1, axis2=2).argmax(axis=1)
    column = power[np.arange(len(power)), :, longest]
    normals = np.zeros((len(places), 3), np.float32)
    normals[there] = column / np.linalg.norm(column, axis=1, keepdims=True)
    return normals
