"""Camera-to-world matrices as files give them: rigid motions, or a sentence that says what they are instead."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.errors import BadInput

Array = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-3
"""Largest entry of |R^T R - I| for which R counts as a rotation: view sets round theirs to 1e-8 ... 1e-4."""

LAST = (0.0, 0.0, 0.0, 1.0)


def validate_camera_matrix(values: ArrayLike) -> Array:
    """Return a camera-to-world matrix whose last row is (0, 0, 0, 1) exactly. (4, 4)

    Raises BadInput if it is not finite, or its 3x3 part is not a rotation.
    """
    matrix = np.array(values, dtype=np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise BadInput("A camera matrix must be a 4x4 matrix of finite numbers; check transform_matrix.")
    if np.abs(matrix[3] - LAST).max() > ROTATION_TOLERANCE:
        transposed = np.abs(matrix[:, 3] - LAST).max() <= ROTATION_TOLERANCE
        raise BadInput(
            "A camera matrix must end with the row 0, 0, 0, 1"
            + (", but its last column is this: it is transposed" if transposed else "")
            + "; check transform_matrix."
        )
    _check_rotation(matrix[:3, :3])
    matrix[3] = LAST  # files from other programs have 1e-8 here
    return matrix


def _check_rotation(rotation: Array) -> None:
    """Raise BadInput if a matrix is no rotation, and say what it is instead."""
    off, scale = _off(rotation), float(np.abs(rotation).max())
    if off <= ROTATION_TOLERANCE and np.linalg.det(rotation) > 0:
        return
    if off <= ROTATION_TOLERANCE:
        raise BadInput(
            "A camera matrix must contain a rotation, but its 3x3 part mirrors (its determinant is -1): the world or "
            "the camera axes are left-handed; negate one row (an axis of the world) or one of the first three columns "
            "(an axis of the camera) in each transform_matrix."
        )
    why = f"R^T R is off by {off:.3g}"
    if 0.0 < scale < np.inf:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # as in _off
            scale *= float(np.linalg.norm((rotation / scale)[:, 0]))
            unscaled = _off(rotation / scale)
        if unscaled <= ROTATION_TOLERANCE:
            why = f"it is scaled by {scale:.6g}: divide it by that, but not the last column"
    raise BadInput(
        "A camera matrix must contain a rotation (no scale, shear or mirror), but its 3x3 part is not one "
        f"({why}); check transform_matrix."
    )


def _off(rotation: Array) -> float:
    with np.errstate(over="ignore", invalid="ignore"):  # numbers may be as large as a file says
        off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    return off if np.isfinite(off) else np.inf
