"""Smooth paths of a camera through key frames.

The point that a camera turns around, the distance from it, its rotation and its lens each follow a curve of their own:
a camera that circles an object keeps its distance, as it would not if positions were interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.geometry.key_curves import along, turned
from svv.errors import BadInput

Array = NDArray[np.float64]

MOST_FRAMES = 1 << 16
"""Most cameras of a path."""


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
    path = CameraPath(keys, range(len(keys)), centre)
    return path.at(np.linspace(0.0, len(keys) - 1.0, frames))


class CameraPath:
    """A smooth path through key frames at given times; see :func:`camera_path`, whose times are equal."""

    def __init__(
        self,
        keys: Sequence[Camera],
        times: Sequence[float],
        centre: ArrayLike | None = None,
        names: Sequence[str] | None = None,
    ) -> None:
        """Lay a path through at least one camera, at ascending times.

        ``centre``: as in :func:`camera_path`; ``names`` call the key frames in errors, by default by their numbers.
        Raises BadInput if there are pinhole and orthographic cameras, or two neighbours look in opposite directions.
        """
        from scipy.spatial.transform import Rotation

        self._parallel = keys[0].is_orthographic
        if any(key.is_orthographic != self._parallel for key in keys):
            raise BadInput("The cameras of a path must be all of perspective or all of parallel projection, not both.")
        self._first, self._times = keys[0], np.asarray(times, np.float64)
        self._names = names or [str(number) for number in range(len(keys))]
        keys = [key.resized(keys[0].width, keys[0].height) for key in keys]
        self._rotations = Rotation.from_matrix(np.stack([key.camera_to_world[:3, :3] for key in keys]))
        positions, backs = (np.stack([key.camera_to_world[:3, column] for key in keys]) for column in (3, 2))
        around = np.asarray(CameraRig.of(keys).centre if centre is None else centre, np.float64)
        ahead = np.einsum("kc,kc->k", positions - around, backs)
        self._turns = bool((ahead > 1e-3 * np.linalg.norm(positions - around, axis=1)).all())
        away = ahead if self._turns else np.zeros(len(keys))
        self._pivots = positions - away[:, None] * backs
        self._distances = np.log(ahead)[:, None] if self._turns else np.zeros((len(keys), 1))
        spans = [key.span_x if key.span_x is not None else np.tan(0.5 * key.fov_x) for key in keys]
        self._spans = np.log(np.array(spans, np.float64))[:, None]
        self._centres = np.array([key.principal_point for key in keys])
        self.at(self._times[:1])  # says now if it is not known which way round the path goes

    def at(self, times: ArrayLike) -> list[Camera]:
        """Return the cameras at some times; before the first key frame and after the last one, these."""
        turns = turned(self._rotations, self._times, times, self._names)
        pivots, distance, wide, centres = (
            along(values, self._times, times) for values in (self._pivots, self._distances, self._spans, self._centres)
        )
        distance, wide = np.exp(distance) if self._turns else distance, np.exp(wide)
        out = []
        for k, turn in enumerate(turns):
            pose = np.eye(4)
            pose[:3, :3] = turn
            pose[:3, 3] = pivots[k] + distance[k] * turn[:, 2]
            column, row = (float(value) for value in centres[k])
            size = float(wide[k, 0])
            camera = replace(self._first, camera_to_world=pose, centre=(column, row))
            lens = 2.0 * float(np.arctan(size))
            out.append(replace(camera, span_x=size) if self._parallel else replace(camera, fov_x=lens))
        return out
