"""Cameras as other programs hold them: VTK's and PyVista's objects, positions in nine numbers, and names of sides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera, CameraRig, look_at
from svv.errors import BadInput

DEFAULT_SIZE = (800, 800)
"""Width and height in pixels of a picture whose size nothing says."""

VIEW_ANGLE = 30.0
"""Vertical angle of view in degrees that VTK's cameras have, and that nine numbers do not say."""

SIDES: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "xy": ((0, 0, 1), (0, 1, 0)), "yx": ((0, 0, -1), (1, 0, 0)),
    "xz": ((0, -1, 0), (0, 0, 1)), "zx": ((0, 1, 0), (1, 0, 0)),
    "yz": ((1, 0, 0), (0, 0, 1)), "zy": ((-1, 0, 0), (0, 1, 0)),
    "iso": ((1, 1, 1), (0, 0, 1)),
}  # fmt: skip
"""Names of sides, as PyVista has them -> the direction from the middle to the camera, and the one that points up."""

NO_CAMERA = (
    "{given} is no camera: give an svv.Camera, svv.read_camera(file), a plotter or its camera, a camera_position "
    "(position, focal point, view up), a direction (x, y, z), or one of " + ", ".join(SIDES) + "."
)


@runtime_checkable
class VtkCamera(Protocol):
    """What is read of a ``vtkCamera`` or ``pyvista.Camera``."""

    def GetPosition(self) -> Any:
        """Return the position, world units."""

    def GetFocalPoint(self) -> Any:
        """Return the point that the camera looks at, world units."""


@runtime_checkable
class Plotter(Protocol):
    """What is read of a ``pyvista.Plotter``."""

    @property
    def camera(self) -> Any:
        """Its camera."""

    @property
    def renderers(self) -> Any:
        """Its renderers."""

    @property
    def render_window(self) -> Any:
        """Its window; None once it is closed."""


class Place(Protocol):
    """What is read of a ``pyvista.CameraPosition``."""

    def to_list(self) -> Any:
        """Return position, focal point and view up."""


class HasRig(Protocol):
    """A scene, which knows where the cameras of its views stood."""

    @property
    def rig(self) -> CameraRig:
        """Their rig."""


GivenCamera = Camera | VtkCamera | Plotter | Place | str | Sequence[Any] | NDArray[Any]
"""What :func:`camera_of` makes a camera of."""


def camera_of(given: object, scene: HasRig, size: tuple[int, int] | None = None) -> Camera:
    """Return the camera that is meant.

    Args:
        given: A :class:`Camera`; a ``vtkCamera`` or ``pyvista.Camera``, perspective or parallel; a ``pyvista.Plotter``,
            for its camera; the position, focal point and view-up direction that PyVista calls ``camera_position``, as
            three vectors or nine numbers, with a vertical angle of view of 30 degrees; the direction (x, y, z) from the
            middle to the camera; or the name of a side (``SIDES``).
        scene: What is seen: sides and directions are seen from the distance of the cameras of its views.
        size: Width and height of the picture in pixels; by default the camera's own, the plotter's window's, or 800 x
            800. VTK's cameras keep their vertical angle of view, others their horizontal one.

    Raises:
        BadInput: It is none of these, or shears or stretches what it sees.
    """
    if isinstance(given, Camera):
        return given if size is None else given.resized(*size)
    if isinstance(given, VtkCamera):
        return _of_vtk(given, *(size or DEFAULT_SIZE))
    if isinstance(given, Plotter):
        return _of_vtk(given.camera, *(size or _size_of(given)))
    if isinstance(given, str):
        if given.lower() not in SIDES:
            raise BadInput(NO_CAMERA.format(given=f"'{given}'"))
        return _of_side(*SIDES[given.lower()], scene.rig, *(size or DEFAULT_SIZE))
    try:
        numbers = np.array(given.to_list() if hasattr(given, "to_list") else given, np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if not (numbers.size in (3, 9) and np.isfinite(numbers).all()):
        raise BadInput(NO_CAMERA.format(given=str(given) if isinstance(given, (tuple, list)) else type(given).__name__))
    if numbers.size == 3:
        return _of_side(numbers.ravel(), (0, 0, 1), scene.rig, *(size or DEFAULT_SIZE))
    position, focal, up = numbers.reshape(3, 3)
    width, height = size or DEFAULT_SIZE
    return Camera(look_at(position, focal, up), _across(VIEW_ANGLE, width, height), width, height)


def _size_of(plotter: Plotter) -> tuple[int, int]:
    """Return width and height of a plotter's picture: of its last one if it is closed."""
    window, last = plotter.render_window, getattr(plotter, "last_image", None)
    width, height = window.GetSize() if window else DEFAULT_SIZE if last is None else last.shape[1::-1]
    return int(width), int(height)


def _of_vtk(camera: Any, width: int, height: int) -> Camera:
    """Return the camera of a picture that VTK would draw with its own."""
    moves = [move.GetMatrix() for move in (camera.GetUserTransform(), camera.GetUserViewTransform()) if move]
    moves.append(camera.GetModelTransformMatrix())
    bent = any(move.GetElement(i, j) != (i == j) for move in moves for i in range(4) for j in range(4))
    if bent or camera.GetUseOffAxisProjection() or tuple(camera.GetViewShear()[:2]) != (0.0, 0.0):
        raise BadInput(
            "The camera stretches, shears or moves what it sees (a model or user transform, view shear, off-axis "
            "projection), which svv's cameras do not: move and scale the data instead."
        )
    pose = look_at(camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp())
    right, up = camera.GetWindowCenter()
    centre = 0.5 * width * (1.0 - right), 0.5 * height * (1.0 + up)
    if camera.GetParallelProjection():
        return Camera.orthographic(pose, 2.0 * camera.GetParallelScale() * width / height, width, height, centre)
    angle = camera.GetViewAngle()
    fov = np.radians(angle) if camera.GetUseHorizontalViewAngle() else _across(angle, width, height)
    return Camera(pose, float(fov), width, height, centre=centre)


def _across(angle: float, width: int, height: int) -> float:
    """Return the horizontal angle of view in radians that belongs to a vertical one in degrees."""
    return float(2.0 * np.arctan(np.tan(0.5 * np.radians(angle)) * width / height))


def _of_side(direction: Any, up: Any, rig: CameraRig, width: int, height: int) -> Camera:
    """Return a camera in a direction from the middle of a rig, at its distance."""
    pose = look_at(direction, np.zeros(3), up)
    pose[:3, 3] = rig.centre + rig.radius * pose[:3, 2]
    return Camera(pose, rig.fov_x, width, height, rig.span_x)
