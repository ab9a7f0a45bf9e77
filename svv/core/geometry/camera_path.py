"""Smooth paths of a camera through key frames.

The point that a camera turns around, the distance from it, its rotation and its lens each follow a curve of their own:
a camera that circles an object keeps its distance, as it would not if positions were interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from svv.core.geometry.cameras import Camera, CameraRig
from svv.errors import BadInput

Array = NDArray[np.float64]

MOST_FRAMES = 1 << 16
"""Most cameras of a path."""

HALF_TURN = np.radians(179.5)
"""Angle between two key frames from which on it is not known which way round the camera turns."""


def camera_path(keys: Sequence[Camera], frames: int, centre: ArrayLike | None = None) -> list[Camera]:
    """Return cameras on a smooth path through key frames, at equal times from one to the next.

    The path has no corners (its velocity is continuous), does not swing beyond a key frame at which it turns back, and
    rests between equal ones. Distances and angles of view change by equal factors in equal times, as the eye expects
    of a zoom.

    Args:
        keys: At least two cameras, all pinhole or all orthographic. The first gives the size of the images.
        frames: Number of cameras to return, 2 to 65536. The path goes through a key frame k exactly if the number is
            1 + m (len(keys) - 1), with any whole m.
        centre: Point that the cameras turn around, in world units; by default the point nearest to their lines of
            sight. Cameras that do not look towards it move from one position to the next instead. (3,)

    Returns:
        The cameras, from the first key frame to the last.

    Raises:
        BadInput: There are too few or too many cameras, both kinds of them, or two neighbours look in opposite
            directions, so that it is not known which way round the path goes.

    >>> front, side = svv.orbit(scene, 181, 64, 48)[90:136:45]
    >>> len(svv.camera_path([front, side], 10))
    10
    """
    if len(keys) < 2:
        raise BadInput(f"A path needs at least two cameras, not {len(keys)}.")
    if not 2 <= frames <= MOST_FRAMES:
        raise BadInput(f"A path has 2 to {MOST_FRAMES} frames, not {frames}.")
    parallel = keys[0].is_orthographic
    if any(key.is_orthographic != parallel for key in keys):
        raise BadInput("The cameras of a path must be all of perspective or all of parallel projection, not both.")
    first = keys[0]
    keys = [key.resized(first.width, first.height) for key in keys]
    rotations = Rotation.from_matrix(np.stack([key.camera_to_world[:3, :3] for key in keys]))
    positions, backs = (np.stack([key.camera_to_world[:3, column] for key in keys]) for column in (3, 2))
    away = np.zeros(len(keys))
    around = np.asarray(CameraRig.of(keys).centre if centre is None else centre, np.float64)
    ahead = np.einsum("kc,kc->k", positions - around, backs)
    turns = bool((ahead > 1e-3 * np.linalg.norm(positions - around, axis=1)).all())
    if turns:
        away = ahead
    at = np.linspace(0.0, len(keys) - 1.0, frames)
    turned = _turned(rotations, at)
    pivots = _along(positions - away[:, None] * backs, at)
    distance = np.exp(_along(np.log(away)[:, None], at)) if turns else np.zeros((frames, 1))
    spans = [key.span_x if key.span_x is not None else np.tan(0.5 * key.fov_x) for key in keys]
    wide = np.exp(_along(np.log(np.array(spans, np.float64))[:, None], at))[:, 0]
    centres = _along(np.array([key.principal_point for key in keys]), at)
    out = []
    for k in range(frames):
        pose = np.eye(4)
        pose[:3, :3] = turned[k]
        pose[:3, 3] = pivots[k] + distance[k] * turned[k][:, 2]
        column, row = (float(value) for value in centres[k])
        camera = replace(first, camera_to_world=pose, centre=(column, row))
        size = float(wide[k])
        out.append(replace(camera, span_x=size) if parallel else replace(camera, fov_x=2.0 * float(np.arctan(size))))
    return out


def _tangents(steps: Array) -> Array:
    """Return the velocity at each of K key values from the K - 1 steps (K - 1, C) between them. (K, C)

    Its length is half the sum of two unit vectors times the harmonic mean of the steps' lengths: none where the path
    turns back or rests, and the step itself where both are equal.
    """
    length = np.linalg.norm(steps, axis=1, keepdims=True)
    unit = np.divide(steps, length, out=np.zeros_like(steps), where=length > 0.0)
    both = length[:-1] + length[1:]
    mean = np.divide(2.0 * length[:-1] * length[1:], both, out=np.zeros_like(both), where=both > 0.0)
    return np.concatenate([steps[:1], 0.5 * mean * (unit[:-1] + unit[1:]), steps[-1:]])


def _segments(at: Array, keys: int) -> tuple[NDArray[np.intp], Array]:
    """Return the number of each time's segment, and how far it is in it, in [0, 1]."""
    segment = np.minimum(at.astype(np.intp), keys - 2)
    return segment, at - segment


def _along(values: Array, at: Array) -> Array:
    """Return key values (K, C) interpolated at times in [0, K - 1] by cubic Hermite curves. (len(at), C)"""
    velocity = _tangents(np.diff(values, axis=0))
    k, t = _segments(at, len(values))
    t = t[:, None]
    start, end = values[k], values[k + 1]
    blend = t * t * (3.0 - 2.0 * t)
    bend = t * (1.0 - t) * ((1.0 - t) * velocity[k] - t * velocity[k + 1])
    return start + blend * (end - start) + bend


def _turned(keys: Rotation, at: Array) -> Array:
    """Return key rotations interpolated at times, by Bezier curves on the sphere of rotations. (len(at), 3, 3)

    Source: K. Shoemake, Animating Rotation with Quaternion Curves, SIGGRAPH 1985.
    """
    steps = (keys[:-1].inv() * keys[1:]).as_rotvec()
    for number, angle in enumerate(np.linalg.norm(steps, axis=1)):
        if angle > HALF_TURN:
            raise BadInput(
                f"The cameras {number} and {number + 1} of the path are half a turn apart, and it is not known which "
                "way round it goes; put a camera between them."
            )
    velocity = _tangents(steps)
    out = np.empty((len(at), 3, 3))
    for index, (k, t) in enumerate(zip(*_segments(at, len(keys)), strict=True)):
        points = [
            keys[k], keys[k] * Rotation.from_rotvec(velocity[k] / 3.0),
            keys[k + 1] * Rotation.from_rotvec(-velocity[k + 1] / 3.0), keys[k + 1],
        ]  # fmt: skip
        while len(points) > 1:
            points = [a * Rotation.from_rotvec(t * (a.inv() * b).as_rotvec()) for a, b in pairwise(points)]
        out[index] = points[0].as_matrix()
    return out
