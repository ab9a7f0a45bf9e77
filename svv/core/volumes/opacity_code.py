"""Extinction as one byte of a volume that other programs draw, and the opacity function that turns it back.

Between fog that a ray crosses in hundreds of voxels and a surface that one voxel shows lie five orders of magnitude, so
a code is linear in the logarithm of the optical depth of one *unit distance*, the one that ParaView assumes by default.
Interpolated codes give the extinction that fields have between voxels (:mod:`svv.core.rays.extinction`).

Code 255 stands for the densest point that a volume shows, because VTK's mappers scale a component of bytes by the range
that the volume has of it, and not all of them scale the opacity function by the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEAST_LOG_DEPTH = -11.5
"""Logarithm of the optical depth of code 1: 200 unit distances of it dim a ray by 1/500, half an 8-bit step."""

MOST_LOG_DEPTH = 2.5
"""Upper bound of the logarithm of the optical depth of code 255: one unit distance keeps 5e-6 of the light."""

CODES = 255
"""Number of codes that show something; code 0 is empty."""


def unit_distance(cells: ArrayLike, spacing: ArrayLike) -> float:
    """Return ParaView's default opacity unit distance: diagonal of the bounds / cube root of the number of cells.

    It is in world units, as is ``spacing`` (3,); sqrt(3) voxels for a cube-shaped volume (vtkSMBoundsDomain, mode
    approximate_cell_length). ``cells`` (3,): along each axis, one less than points.
    """
    count = np.asarray(cells, np.float64)
    return float(np.linalg.norm(count * np.asarray(spacing)) / np.cbrt(count.prod()))


def most_of(log_depth: NDArray[np.float32]) -> float:
    """Return the logarithm that code 255 stands for in a volume with these optical depths, given as logarithms."""
    most = float(log_depth.max(initial=-np.inf))
    return float(np.clip(most, LEAST_LOG_DEPTH + 1.0, MOST_LOG_DEPTH))


def codes_of(log_depth: NDArray[np.float32], most: float) -> NDArray[np.uint8]:
    """Return the codes of optical depths of one unit distance, given as logarithms; -inf is empty. (S,)

    What is fainter than code 1 becomes 0, what is denser than code 255, which stands for :func:`most_of`, becomes 255.
    """
    step = (most - LEAST_LOG_DEPTH) / (CODES - 1)
    codes = (log_depth - np.float32(LEAST_LOG_DEPTH)) * np.float32(1.0 / step) + np.float32(1.0)
    return np.rint(np.clip(codes, 0.0, CODES)).astype(np.uint8)


def depths(most: float) -> NDArray[np.float64]:
    """Return the optical depth of one unit distance for each code; 0 for code 0. (256,)"""
    return np.concatenate([[0.0], np.exp(np.linspace(LEAST_LOG_DEPTH, most, CODES))])


def opacity_points(most: float) -> Sequence[tuple[float, float]]:
    """Return the opacity function: each code and the opacity 1 - exp(-depth) of one unit distance."""
    return [(float(code), float(-np.expm1(-depth))) for code, depth in enumerate(depths(most))]


def most_with(opacity: float) -> float:
    """Return what code 255 stands for in the opacity function whose largest opacity is this one."""
    return float(np.log(-np.log1p(-opacity)))
