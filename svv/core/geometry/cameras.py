"""Pinhole and orthographic cameras, and the spheres and paths on which they stand.

Convention: OpenGL camera-to-world matrices (x right, y up, the camera looks along -z), world y up, square
pixels. Lengths are in the volume's world units, angles in radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.core.geometry.camera_matrix import validate_camera_matrix
from svv.core.geometry.directions import geodesic_directions
from svv.core.json_values import list_in, needed, number_in, object_in, vector_in, whole_in
from svv.errors import BadInput

Array = NDArray[np.float64]
Distance = TypeVar("Distance", float, NDArray[np.floating])

NOMINAL_FOV = np.pi / 6
"""``fov_x`` of orthographic cameras, in radians; nothing depends on it."""

MOST_PIXELS = 1 << 16
"""Largest width and height of an image."""

POLE_LIMIT = np.radians(89.99)
"""Largest latitude of the orbit, in radians: 'up' is undefined at the poles (as in the paper's code)."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera or, with ``span_x``, an orthographic one, whose rays are parallel to its axis.

    A point (X, Y, Z) in camera axes appears at column cx + f X / d and row cy - f Y / d, where (cx, cy) is the
    :attr:`principal_point`, f the :attr:`focal` length, and d = -Z, or 1 if the camera is orthographic.

    Args:
        camera_to_world: (4, 4) float64, OpenGL convention. Its last row is set to (0, 0, 0, 1) exactly.
        fov_x: Full horizontal angle of view in radians, in (0, pi); with ``centre``, that of an image of the same
            width and focal length whose principal point is at its centre. Orthographic cameras do not use it.
        width: Width of the image in pixels, >= 1.
        height: Height of the image in pixels, >= 1.
        span_x: Full width of the image in world units, > 0, if the camera is orthographic (see
            :meth:`orthographic`); None for a pinhole camera.
        centre: Principal point (column, row) in pixels from the image's upper left corner, so that the middle of the
            first pixel is at (0.5, 0.5); by default, and if it is given as such, the centre of the image.

    Raises:
        BadInput: The matrix is not finite, its 3x3 part is not a rotation, or an angle, width, point or size is out
            of range.

    >>> camera = svv.Camera(np.eye(4), np.radians(30.0), 640, 480)  # at the origin, looking along -z
    >>> round(camera.focal), camera.principal_point, camera.resized(320, 240).width
    (1194, (320.0, 240.0), 320)
    """

    camera_to_world: Array
    fov_x: float
    width: int
    height: int
    span_x: float | None = None
    centre: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        matrix = validate_camera_matrix(self.camera_to_world)
        _check_angle_and_span(self.fov_x, self.span_x, "a camera")
        if not (1 <= self.width <= MOST_PIXELS and 1 <= self.height <= MOST_PIXELS):
            raise BadInput(f"A camera's image has 1 to {MOST_PIXELS} pixels a side, not {self.width} x {self.height}.")
        if self.centre is not None and not np.isfinite(self.centre).all():
            raise BadInput(f"A camera's principal point must be two finite numbers, not {self.centre}.")
        matrix.setflags(write=False)
        object.__setattr__(self, "camera_to_world", matrix)
        if self.centre == (0.5 * self.width, 0.5 * self.height):
            object.__setattr__(self, "centre", None)

    @classmethod
    def orthographic(
        cls,
        camera_to_world: ArrayLike,
        span_x: float,
        width: int,
        height: int,
        centre: tuple[float, float] | None = None,
    ) -> Camera:
        """Return an orthographic camera: its rays start in the plane z = 0 of its axes and run along -z.

        ``span_x``: full width of the image in world units, > 0; VTK's parallel scale is half of the height,
        ``0.5 * span_x * height / width``. ``centre``: pixel at the position of the camera; by default the image's.
        """
        return cls(np.asarray(camera_to_world, np.float64), NOMINAL_FOV, width, height, span_x, centre)

    @cached_property
    def position(self) -> Array:
        """Position of the camera in world units. (3,)"""
        return self.camera_to_world[:3, 3]

    @property
    def is_orthographic(self) -> bool:
        """Whether the rays are parallel."""
        return self.span_x is not None

    @property
    def focal(self) -> float:
        """Focal length in pixels; pixels per world unit if the camera is orthographic."""
        if self.span_x is not None:
            return self.width / self.span_x
        return 0.5 * self.width / float(np.tan(0.5 * self.fov_x))

    @property
    def principal_point(self) -> tuple[float, float]:
        """Column and row of the camera's axis in pixels from the upper left corner of the image."""
        return (0.5 * self.width, 0.5 * self.height) if self.centre is None else self.centre

    @property
    def identity(self) -> tuple[object, ...]:
        """Values that tell the camera from others: matrix, fov_x, width, height, and span_x and centre if any."""
        unusual = () if self.span_x is None and self.centre is None else (self.span_x, self.centre)
        return (self.camera_to_world, self.fov_x, self.width, self.height, *unusual)

    def rays(self) -> tuple[Array, Array]:
        """Return world origins and unit directions of the rays through the pixel centres, (height, width, 3) each."""
        column, row = self.principal_point
        x = (np.arange(self.width) + 0.5 - column) / self.focal
        y = (row - np.arange(self.height) - 0.5) / self.focal
        if self.span_x is not None:
            local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 0.0), axis=-1)  # (h, w, 3)
            back = self.camera_to_world[:3, 2]
            directions = np.broadcast_to(-back / np.linalg.norm(back), local.shape).copy()
            return self.position + local @ self.camera_to_world[:3, :3].T, directions
        local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)  # (h, w, 3)
        directions = local @ self.camera_to_world[:3, :3].T
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def line_of_sight(self) -> tuple[Array, Array]:
        """Return the origin (3,) of the ray through the centre of the image, and its unit direction (3,)."""
        if self.centre is None:
            return self.camera_to_world[:3, 3], -self.camera_to_world[:3, 2]
        column, row = self.centre
        x, y = (0.5 * self.width - column) / self.focal, (row - 0.5 * self.height) / self.focal
        parallel = self.span_x is not None
        origin = self.position + self.camera_to_world[:3, :3] @ (np.array((x, y, 0.0)) * parallel)
        direction = self.camera_to_world[:3, :3] @ np.array((0.0, 0.0, -1.0) if parallel else (x, y, -1.0))
        return origin, direction / np.linalg.norm(direction)

    def project(self, points: ArrayLike) -> tuple[Array, Array, Array]:
        """Return columns and rows in pixels of world points (..., 3), and distances along the camera's axis. (...,)

        Pixels count from the image's upper left corner; distances are in world units. Columns and rows of points that
        are not in front of a pinhole camera are meaningless.
        """
        local = (np.asarray(points, np.float64) - self.position) @ self.camera_to_world[:3, :3]
        ahead = -local[..., 2]
        scale = self.focal / (1.0 if self.span_x is not None else ahead)
        column, row = self.principal_point
        return column + local[..., 0] * scale, row - local[..., 1] * scale, ahead

    def pixel_at(self, distance: Distance, pixels: float = 1.0) -> Distance:
        """Return the width of some pixels at distances (...,) from the camera; both in world units. (...,)"""
        size = pixels * (1.0 / self.focal)
        return size * distance if self.span_x is None else size + 0.0 * distance

    def resized(self, width: int, height: int) -> Camera:
        """Return the camera with another image size and the same horizontal angle of view, or width in world units."""
        centre = self.centre
        if centre is not None and (width, height) != (self.width, self.height):
            scale = width / self.width
            column, row = centre[0] - 0.5 * self.width, centre[1] - 0.5 * self.height
            centre = 0.5 * width + scale * column, 0.5 * height + scale * row
        return replace(self, width=width, height=height, centre=centre)


def _check_angle_and_span(fov_x: float, span_x: float | None, whom: str) -> None:
    if not 0.0 < fov_x < np.pi:
        raise BadInput(f"The fov_x of {whom} must lie between 0 and pi radians (180 degrees), not {fov_x}.")
    if span_x is not None and not 0.0 < span_x < np.inf:
        raise BadInput(
            f"The span_x of {whom}, the width of its image in world units, must be a positive number, not {span_x}."
        )


def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Array:
    """Return the camera-to-world matrix (4, 4) of a camera at ``position`` (3,) that looks at ``target`` (3,).

    If ``up`` (3,), which points up in the image, is parallel to the view direction, the z axis replaces it; for views
    close to the z axis, the x axis. Raises BadInput if position and target coincide.
    """
    eye, aim = np.asarray(position, dtype=np.float64), np.asarray(target, dtype=np.float64)
    length = np.linalg.norm(eye - aim)
    if not length > 0:
        raise BadInput("A camera cannot look at its own position; move it away from its target.")
    back = (eye - aim) / length
    right = np.cross(np.asarray(up, dtype=np.float64), back)
    if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(up))):
        axis = np.array([(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)][int(abs(back[2]) > 0.9)])
        right = np.cross(axis, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    matrix[:3, 3] = eye
    return matrix


def sphere_cameras(
    n: int, centre: ArrayLike, radius: float, fov_x: float, size: int, span_x: float | None = None
) -> list[Camera]:
    """Return at least 3 cameras on a sphere (see ``geodesic_directions``) that look at its centre.

    ``centre`` and ``radius`` are in world units, ``fov_x`` in radians; ``size``: side of the images in pixels;
    ``span_x``: their width in world units, for orthographic cameras. Raises BadInput if something is out of range.
    """
    return [_on_sphere(direction, centre, radius, fov_x, size, span_x) for direction in geodesic_directions(n)]


def orbit_cameras(
    n: int = 181,
    centre: ArrayLike = (0.0, 0.0, 0.0),
    radius: float = 4.0311,
    fov_x: float = np.pi / 6,
    size: int = 800,
    frames: Sequence[int] | None = None,
    span_x: float | None = None,
) -> list[Camera]:
    """Return the camera path for showing and testing results: from the south to the north pole in one full turn.

    phi = -90 ... 90 degrees in n >= 2 steps, theta = 2 phi, direction (cos phi cos theta, sin phi, -cos phi sin theta):
    the 181 inference views of StyleRF-VolVis. The first and last views are 0.01 degrees from the poles. ``frames``:
    numbers of the views to return; all by default. The other arguments and errors are those of :func:`sphere_cameras`.
    """
    if n < 2:
        raise BadInput(f"An orbit needs at least 2 views, not {n}.")
    phi = np.linspace(-0.5 * np.pi, 0.5 * np.pi, n)
    if frames is not None:
        phi = phi[list(frames)]
    theta = 2.0 * phi
    phi = np.clip(phi, -POLE_LIMIT, POLE_LIMIT)
    directions = np.stack([np.cos(phi) * np.cos(theta), np.sin(phi), -np.cos(phi) * np.sin(theta)], axis=1)
    return [_on_sphere(direction, centre, radius, fov_x, size, span_x) for direction in directions]


@dataclass(frozen=True)
class CameraRig:
    """The sphere on which a scene's cameras lie; other cameras can be placed on it, too. BadInput if out of range."""

    centre: tuple[float, float, float]
    """The point that the cameras look at, in world units."""
    radius: float
    """Distance of the cameras from the centre in world units, >= 0."""
    fov_x: float
    """Full horizontal angle of view in radians, in (0, pi); orthographic cameras do not use it."""
    size: tuple[int, int] | None = None
    """Width and height of the images in pixels, if known."""
    span_x: float | None = None
    """Width of the images in world units if the cameras are orthographic, > 0."""

    def __post_init__(self) -> None:
        if not np.isfinite(np.asarray(self.centre, np.float64)).all():
            raise BadInput(f"The centre of a camera rig must be finite, not {self.centre}.")
        if not 0.0 <= self.radius < np.inf:
            raise BadInput(f"The radius of a camera rig must be a number of at least 0, not {self.radius}.")
        _check_angle_and_span(self.fov_x, self.span_x, "a camera rig")

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> CameraRig:
        """Return the rig of some cameras: the point nearest to all lines of sight, and medians of the rest.

        A line of sight goes through the centre of the image. The rig is orthographic if most cameras are.
        """
        sights = [camera.line_of_sight() for camera in cameras]
        positions, axes = (np.stack(part) for part in zip(*sights, strict=True))
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # removes the component along the axis
        centre = np.linalg.lstsq(across.sum(0), np.einsum("nij,nj->i", across, positions), rcond=None)[0]
        x, y, z = (float(v) for v in centre)
        radius = float(np.median(np.linalg.norm(positions - centre, axis=1)))
        spans = [c.span_x for c in cameras if c.span_x is not None]
        span_x = float(np.median(spans)) if 2 * len(spans) > len(cameras) else None
        fov_x = float(np.median([c.fov_x for c in cameras if c.is_orthographic == (span_x is not None)]))
        return cls((x, y, z), radius, fov_x, (cameras[0].width, cameras[0].height), span_x)

    @classmethod
    def from_json(cls, content: object, name: str = "camera_rig") -> CameraRig:
        """Invert :meth:`to_json`; raises BadInput, with the value's ``name``, if something is missing or invalid."""
        values = object_in(content, name)
        centre = vector_in(needed(values, "centre", name), f"{name}.centre")
        radius, fov_x = (number_in(needed(values, key, name), f"{name}.{key}") for key in ("radius", "fov_x"))
        size = None
        if values.get("size") is not None:
            width, height = (whole_in(v, f"{name}.size") for v in list_in(values["size"], 2, f"{name}.size"))
            size = width, height
        span_x = None if values.get("span_x") is None else number_in(values["span_x"], f"{name}.span_x")
        try:
            return cls(centre, radius, fov_x, size, span_x)
        except BadInput as error:
            raise BadInput(f"{name}: {error}") from None

    def to_json(self) -> dict[str, object]:
        """Return the fields as plain values under their names, without those that are None."""
        content: dict[str, object] = {"centre": list(self.centre), "radius": self.radius, "fov_x": self.fov_x}
        if self.size is not None:
            content["size"] = list(self.size)
        return content if self.span_x is None else {**content, "span_x": self.span_x}

    @property
    def view_width(self) -> float:
        """Width of the area that a camera sees at the centre, in world units."""
        return float(2.0 * self.radius * np.tan(self.fov_x / 2.0)) if self.span_x is None else self.span_x

    def sphere(self, n: int, size: int) -> list[Camera]:
        """Return cameras spread over the sphere; see :func:`sphere_cameras`."""
        return sphere_cameras(n, self.centre, self.radius, self.fov_x, size, self.span_x)

    def orbit(self, n: int, size: int, frames: Sequence[int] | None = None) -> list[Camera]:
        """Return cameras on the path for showing results; see :func:`orbit_cameras`."""
        return orbit_cameras(n, self.centre, self.radius, self.fov_x, size, frames, self.span_x)


def _on_sphere(
    direction: Array, centre: ArrayLike, radius: float, fov_x: float, size: int, span_x: float | None
) -> Camera:
    if not (np.isfinite(radius) and radius > 0):
        raise BadInput(f"The cameras' distance must be a positive number, not {radius}.")
    # The rotation depends on the direction alone, so it is the same however small or far from the origin the volume is.
    matrix = look_at(direction, np.zeros(3))
    matrix[:3, 3] = np.asarray(centre, dtype=np.float64) + radius * direction
    return Camera(matrix, fov_x, size, size, span_x)
