"""Normals of a field on a grid, of either sign: where thin shells rise and fall again, the gradient alone vanishes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.grid_kernels import filtered, principal_directions

SQUARINGS = 5
"""Squarings of a matrix that leave of it only the direction of the largest eigenvalue: its 32nd power."""

LEAST_TRACE = 1e-20
"""Trace of a structure tensor below which the field is constant."""

TRUNCATED = 4.0
"""Standard deviations at which Gaussians end."""


def surface_normals(
    field: NDArray[np.floating], places: NDArray[np.integer], inner: float, outer: float
) -> NDArray[np.float32]:
    """Return the directions in which a field (X, Y, Z) changes most around voxels, zero where it is constant. (V, 3)

    The principal eigenvector, of either sign, of the structure tensor, which averages g g^T over a neighbourhood
    (Förstner and Gülch 1987): the gradient g on both sides of a thin shell is opposite, and only their squares add up.
    ``inner`` and ``outer``: standard deviations in voxels of the Gaussians of the gradient and of the neighbourhood.
    """
    at = tuple(places.T)
    values = np.ascontiguousarray(field, np.float32)
    gradient = [blurred(values, inner, along=axis) for axis in range(3)]
    pairs = [(row, column) for row in range(3) for column in range(row + 1)]
    tensors = np.stack([blurred(gradient[row] * gradient[column], outer)[at] for row, column in pairs])
    normals = np.empty((len(places), 3), np.float32)
    principal_directions(tensors, LEAST_TRACE, SQUARINGS, normals)
    return normals


def blurred(
    values: NDArray[np.float32], deviation: float, along: int | None = None, beyond: bool = True
) -> NDArray[np.float32]:
    """Return a grid (X, Y, Z) blurred with a Gaussian, or with the derivative of that ``along`` an axis.

    ``deviation``: in voxels, > 0; ``beyond``: whether the outermost values go on beyond the grid; else nothing is
    there.
    """
    weights, signs = filters(deviation, along)
    out = np.empty_like(values)
    filtered(values, weights, signs, np.float32(beyond), out)
    return out


def filters(deviation: float, along: int | None) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the filters of :func:`blurred` along the axes: the middle of each and what follows (3, N), and signs (3,).

    The sign is 1 if a filter is even, or -1 if it is odd.
    """
    distance = np.arange(int(TRUNCATED * deviation + 0.5) + 1)
    even = np.exp(-0.5 * np.square(distance / deviation))
    even /= 2.0 * even.sum() - even[0]
    odd = even * distance / deviation**2
    weights = np.stack([odd if axis == along else even for axis in range(3)]).astype(np.float32)
    signs = np.where(np.arange(3) == (math.nan if along is None else along), -1.0, 1.0).astype(np.float32)
    return weights, signs
