"""Cameras from a JSON file, for pictures from chosen positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from svv.core.geometry.cameras import NOMINAL_FOV, Camera
from svv.core.geometry.given_cameras import DEFAULT_SIZE
from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.io.views.transforms import Frame, camera_in


def read_camera(path: str | Path, size: tuple[int, int] | None = None, frame: int | None = None) -> Camera:
    """Read a camera from JSON, in one of two forms.

    Our form is ``{"camera_to_world": [[...4] x 4], "fov": degrees}``, in which ``camera_angle_x`` (radians) may replace
    ``fov``; both are the full horizontal angle of view. For an orthographic camera, ``span_x``, the width of the image
    in world units, replaces them. ``width`` and ``height`` in pixels are optional. The other form is a
    ``transforms.json`` (:mod:`svv.io.views.transforms`), from which ``frame`` selects a view. Matrices are OpenGL
    camera-to-world.

    Args:
        path: The file.
        size: (width, height) in pixels; by default ``width`` and ``height`` in the file, otherwise 800 pixels wide and
            as high as the proportions of the view in a ``transforms.json`` require, or 800.
        frame: Number of the view, from 0; needed if the file has several.

    Raises:
        BadInput: The file is missing, is not JSON or contains no camera, or the matrix is not a rotation; or it has
            several cameras, and none was chosen.

    >>> import json, pathlib
    >>> told = {"camera_to_world": np.eye(4).tolist(), "fov": 30.0}
    >>> _ = pathlib.Path("camera.json").write_text(json.dumps(told))
    >>> svv.read_camera("camera.json", (640, 480)).height
    480
    """
    content = _object(Path(path))
    count = _count(Path(path), content)
    if frame is None and count > 1:
        raise BadInput(f"{path} has {count} views: choose one by its number, 0 to {count - 1}.")
    if not 0 <= (frame or 0) < count:
        raise BadInput(f"{path} has no view {frame}: its views are 0 to {count - 1}.")
    return _camera(Path(path), content, size, frame or 0)


def read_cameras(path: str | Path, size: tuple[int, int] | None = None) -> list[Camera]:
    """Read all cameras of a file, such as the key frames of a path (:func:`svv.camera_path`).

    Args:
        path: A file as :func:`read_camera` reads it. In our form, several cameras are the list ``frames`` of such
            objects; what they share, such as ``fov``, may stand beside the list.
        size: As for :func:`read_camera`.

    Returns:
        The cameras in the order of the file; one if it has no ``frames``.

    Raises:
        BadInput: As for :func:`read_camera`, or the list is empty.

    >>> import json, pathlib
    >>> told = {"fov": 30.0, "frames": [{"camera_to_world": np.eye(4).tolist()}] * 2}
    >>> _ = pathlib.Path("path.json").write_text(json.dumps(told))
    >>> len(svv.read_cameras("path.json"))
    2
    """
    content = _object(Path(path))
    return [_camera(Path(path), content, size, frame) for frame in range(_count(Path(path), content))]


def _count(path: Path, content: Frame) -> int:
    """Return how many cameras a file has."""
    frames = content.get("frames", [content])
    if not isinstance(frames, list) or not frames or not all(isinstance(one, dict) for one in frames):
        raise BadInput(f"{path} contains no cameras: its frames must be a list of them.")
    return len(frames)


def _camera(path: Path, content: Frame, size: tuple[int, int] | None, frame: int) -> Camera:
    """Return a camera from the content of a file."""
    if "frames" in content:
        own = content["frames"][frame]
        if "transform_matrix" in own:
            return _of_frame(path, content, own, size)
        content = {**content, **own}
    matrix = content.get("camera_to_world", content.get("transform_matrix"))
    if matrix is None:
        raise BadInput(f"{path} does not contain a camera: it needs camera_to_world (4 x 4) and fov (degrees).")
    try:
        span = float(content["span_x"]) if "span_x" in content else None
        if "camera_angle_x" in content:
            angle = float(content["camera_angle_x"])
        else:
            angle = np.radians(float(content["fov"])) if span is None or "fov" in content else NOMINAL_FOV
        stated = (int(content.get("width", 0)), int(content.get("height", 0)))
        rotation = np.asarray(matrix, dtype=np.float64)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BadInput(
            f"{path} does not contain a camera: camera_to_world must be 4 x 4 numbers, and fov (degrees) or "
            "camera_angle_x (radians) must be a number."
        ) from error
    width, height = size or (stated if min(stated) > 0 else DEFAULT_SIZE)
    return Camera(rotation, float(angle), width, height, span)


def _of_frame(path: Path, scene: Frame, frame: Frame, size: tuple[int, int] | None) -> Camera:
    """Return the camera of a frame of a ``transforms.json``."""
    try:
        stated, own = (
            tuple(int(frame.get(key, scene.get(key, 0))) for key in keys) for keys in (("w", "h"), ("width", "height"))
        )
    except (TypeError, ValueError, OverflowError):
        raise BadInput(f"{path}: w, h, width and height must be numbers of pixels.") from None
    camera, _ = camera_in(path, scene, frame, *(stated if min(stated) > 0 else DEFAULT_SIZE))
    wide = DEFAULT_SIZE[0]
    width, height = size or (own if min(own) > 0 else (wide, max(1, round(wide * camera.height / camera.width))))
    return camera.resized(width, height)


def _object(path: Path) -> Frame:
    try:
        content = parsed(path.read_bytes())
    except FileNotFoundError as error:
        raise BadInput(f"There is no camera file {path}; check the path.") from error
    except OSError as error:
        raise BadInput(f"The camera file {path} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise BadInput(f"The camera file {path} is not JSON: {error}.") from error
    if not isinstance(content, dict):
        raise BadInput(f"{path} does not contain a camera: it needs camera_to_world (4 x 4) and fov (degrees).")
    return content
