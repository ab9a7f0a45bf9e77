"""Directions of Cinema databases: cameras on a sphere that two angles, phi and theta, name.

A rotation is that of a camera-to-world matrix: its columns are the camera's right, up and back in the world, and the
camera stands at ``focal point + distance * back``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def paraview_rotations(phi: ArrayLike, theta: ArrayLike) -> Array:
    """Return the rotations of ParaView's image extractors, R = R_y(phi) R_x(-theta), from angles in degrees. (n, 3, 3)

    From (0, 0, distance) with the y axis up, the camera goes to ``Azimuth(phi)``, from z towards x, and then to
    ``Elevation(theta)``, and its view-up turns with it (``vtkSMImageExtractWriterProxy::WriteInternal``). Beyond theta
    = 90 degrees, it is therefore upside down: (phi, theta) and (phi + 180, 180 - theta) are one direction, and one
    image is the other turned by 180 degrees.
    """
    return _about(1, phi) @ _about(0, -np.asarray(theta, np.float64))


def ascent_rotations(phi: ArrayLike, theta: ArrayLike) -> Array:
    """Return the rotations of Ascent's Cinema databases, R = R_z(phi) R_x(theta), from angles in degrees. (n, 3, 3)

    At theta = 0 the camera stands on the z axis; phi turns it about that axis (Ascent's ``CinemaManager``).
    """
    return _about(2, phi) @ _about(0, theta)


def _about(axis: int, degrees: ArrayLike) -> Array:
    """Return right-handed rotations about an axis of the world. (n, 3, 3)"""
    angle = np.radians(np.asarray(degrees, np.float64))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.zeros((*angle.shape, 3, 3))
    matrix[..., axis, axis] = 1.0
    matrix[..., a, a] = matrix[..., b, b] = np.cos(angle)
    matrix[..., b, a] = np.sin(angle)
    matrix[..., a, b] = -matrix[..., b, a]
    return matrix
