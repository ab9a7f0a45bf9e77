"""Pinhole cameras and the directions from which a volume is viewed.

Convention: OpenGL camera-to-world matrices (x right, y up, the camera looks along -z), world y up, square
pixels, the principal point at the centre of the image. Lengths are in the volume's world units, angles in radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.core.json_values import list_in, needed, number_in, object_in, vector_in, whole_in
from svv.errors import BadInput

Array = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-3
"""Largest entry of |R^T R - I| for which R counts as a rotation: view sets round theirs to 1e-8 ... 1e-4."""

POLE_LIMIT = np.radians(89.99)
"""Largest latitude of the orbit, in radians: 'up' is undefined at the poles (as in the paper's code)."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Args:
        camera_to_world: (4, 4) float64, OpenGL convention. Its last row is set to (0, 0, 0, 1) exactly.
        fov_x: Full horizontal angle of view in radians, in (0, pi).
        width: Width of the image in pixels, >= 1.
        height: Height of the image in pixels, >= 1.

    Raises:
        BadInput: The matrix is not finite, its 3x3 part is not a rotation, or an angle or size is out of range.
    """

    camera_to_world: Array
    fov_x: float
    width: int
    height: int

    def __post_init__(self) -> None:
        matrix = np.array(self.camera_to_world, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise BadInput("A camera matrix must be a 4x4 matrix of finite numbers; check transform_matrix.")
        if np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)).max() > ROTATION_TOLERANCE:
            raise BadInput("A camera matrix must end with the row 0, 0, 0, 1; check transform_matrix.")
        rotation = matrix[:3, :3]
        off = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if off > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            raise BadInput(
                "A camera matrix must contain a rotation (no scale, shear or mirror), but its 3x3 part is not one "
                f"(R^T R is off by {off:.3g}, its determinant is {np.linalg.det(rotation):.3g}); "
                "check transform_matrix."
            )
        if not 0.0 < self.fov_x < np.pi:
            raise BadInput(f"A camera's angle of view must lie between 0 and pi radians, not {self.fov_x}.")
        if self.width < 1 or self.height < 1:
            raise BadInput(f"A camera's image needs at least one pixel, not {self.width} x {self.height}.")
        matrix[3] = (0.0, 0.0, 0.0, 1.0)  # files from other programs have 1e-8 here
        matrix.setflags(write=False)
        object.__setattr__(self, "camera_to_world", matrix)

    @cached_property
    def position(self) -> Array:
        """Position of the camera in world units. (3,)"""
        return self.camera_to_world[:3, 3]

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return 0.5 * self.width / float(np.tan(0.5 * self.fov_x))

    def rays(self) -> tuple[Array, Array]:
        """Return the rays through the pixel centres, row 0 at the top.

        Returns:
            Origins (height, width, 3) in world units and unit directions (height, width, 3).
        """
        x = (np.arange(self.width) + 0.5 - 0.5 * self.width) / self.focal
        y = (0.5 * self.height - np.arange(self.height) - 0.5) / self.focal
        local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)  # (h, w, 3)
        directions = local @ self.camera_to_world[:3, :3].T
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def resized(self, width: int, height: int) -> Camera:
        """Return the camera with another image size and the same horizontal angle of view."""
        return replace(self, width=width, height=height)


def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Array:
    """Return the camera-to-world matrix of a camera at ``position`` that looks at ``target``.

    If ``up`` is parallel to the view direction, the z axis replaces it; for views close to the z axis, the x axis.

    Args:
        position: Position of the camera in world units. (3,)
        target: Point in world units, different from ``position``. (3,)
        up: Direction that points up in the image. (3,)

    Returns:
        The matrix, float64. (4, 4)

    Raises:
        BadInput: Position and target coincide.
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


def geodesic_class(n: int) -> tuple[int, int] | None:
    """Return (h, k), h >= k >= 0, with n = 10 (h^2 + h k + k^2) + 2, or None if n is not of this form."""
    t, rest = divmod(n - 2, 10)
    if rest or t < 1:
        return None
    for k in range(int(t**0.5) + 1):
        for h in range(k, int(t**0.5) + 1):
            if h * h + h * k + k * k == t:
                return h, k
    return None


def geodesic_directions(n: int) -> Array:
    """Return ``n`` directions spread evenly over the sphere.

    They are the vertices of the geodesic icosahedron of class (h, k) (Caspar & Klug 1962) if n = 10 T + 2 with
    T = h^2 + h k + k^2 (12, 32, 42, 72, 92, 122, 132, 162, 192, 212, ..., 312); the 92, 42 and 312 viewpoints
    of StyleRF-VolVis are of this kind. Any other n gives a Fibonacci spiral.

    Args:
        n: Number of directions, >= 3.

    Returns:
        Unit vectors, from y = -1 upwards. (n, 3)

    Raises:
        BadInput: n is less than 3.
    """
    if n < 3:
        raise BadInput(f"At least 3 views are needed, not {n}.")
    found = geodesic_class(n)
    if found is None:
        y = -1.0 + (2.0 * np.arange(n) + 1.0) / n
        angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
        ring = np.sqrt(1.0 - y * y)
        return np.stack([ring * np.cos(angle), y, ring * np.sin(angle)], axis=1)
    h, k = found
    t = h * h + h * k + k * k
    # Barycentric coordinates (times T) of the triangular lattice's points (i, j) in the triangle (0, 0),
    # (h, k), (-k, h + k): integers, so that points on an edge are identified exactly.
    i, j = np.meshgrid(np.arange(-k, h + 1), np.arange(h + k + 1), indexing="ij")
    b, c = (h + k) * i + k * j, h * j - k * i
    inside = (b >= 0) & (c >= 0) & (b + c <= t)
    weights = np.stack([t - b - c, b, c], axis=-1)[inside] / t  # (points, 3)
    corners, faces = icosahedron()
    points = np.einsum("pc,fcx->fpx", weights, corners[faces]).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    _, first = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True)  # edges belong to two faces
    points = points[first]
    return points[np.lexsort((points[:, 0], points[:, 2], np.round(points[:, 1], 9)))]


def icosahedron() -> tuple[Array, NDArray[np.intp]]:
    """Return vertices (12, 3) on the unit sphere and faces (20, 3), all with the same winding seen from outside."""
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    signs = [(a, b) for a in (-1.0, 1.0) for b in (-golden, golden)]
    corners = np.array([np.roll((0.0, b, a), shift) for shift in range(3) for a, b in signs])
    edge = np.linalg.norm(corners[:, None] - corners[None], axis=-1).round(9) == 2.0
    faces = []
    for p in range(12):
        for q in range(12):
            for r in range(12):
                if p < q and p < r and edge[p, q] and edge[q, r] and edge[r, p]:
                    if np.linalg.det(corners[[p, q, r]]) > 0:
                        faces.append((p, q, r))
    return corners / np.linalg.norm(corners[0]), np.array(faces)


def sphere_cameras(n: int, centre: ArrayLike, radius: float, fov_x: float, size: int) -> list[Camera]:
    """Return ``n`` cameras on a sphere (see ``geodesic_directions``) that look at its centre.

    Args:
        n: Number of cameras, >= 3.
        centre: Centre of the sphere in world units. (3,)
        radius: Radius of the sphere in world units, > 0.
        fov_x: Full horizontal angle of view in radians.
        size: Width and height of the square images in pixels.

    Raises:
        BadInput: There are fewer than 3 cameras, or the radius, angle or size is out of range.
    """
    return [_on_sphere(direction, centre, radius, fov_x, size) for direction in geodesic_directions(n)]


def orbit_cameras(
    n: int = 181,
    centre: ArrayLike = (0.0, 0.0, 0.0),
    radius: float = 4.0311,
    fov_x: float = np.pi / 6,
    size: int = 800,
    frames: Sequence[int] | None = None,
) -> list[Camera]:
    """Return the camera path for showing and testing results: from the south to the north pole in one full turn.

    phi = -90 ... 90 degrees in n steps, theta = 2 phi, direction
    (cos phi cos theta, sin phi, -cos phi sin theta): the 181 inference views of StyleRF-VolVis. The first and
    last views are 0.01 degrees from the poles.

    Args:
        n: Number of views, >= 2.
        centre: Centre of the sphere in world units. (3,)
        radius: Radius of the sphere in world units, > 0.
        fov_x: Full horizontal angle of view in radians.
        size: Width and height of the square images in pixels.
        frames: Numbers of the views to return, 0 to n - 1; all by default.

    Raises:
        BadInput: There are fewer than 2 views, or the radius, angle or size is out of range.
    """
    if n < 2:
        raise BadInput(f"An orbit needs at least 2 views, not {n}.")
    phi = np.linspace(-0.5 * np.pi, 0.5 * np.pi, n)
    if frames is not None:
        phi = phi[list(frames)]
    theta = 2.0 * phi
    phi = np.clip(phi, -POLE_LIMIT, POLE_LIMIT)
    directions = np.stack([np.cos(phi) * np.cos(theta), np.sin(phi), -np.cos(phi) * np.sin(theta)], axis=1)
    return [_on_sphere(direction, centre, radius, fov_x, size) for direction in directions]


@dataclass(frozen=True)
class CameraRig:
    """The sphere on which a scene's cameras lie; other cameras can be placed on it, too.

    Raises:
        BadInput: The centre, radius or angle of view is not finite or out of range.
    """

    centre: tuple[float, float, float]
    """The point that the cameras look at, in world units."""
    radius: float
    """Distance of the cameras from the centre in world units, >= 0."""
    fov_x: float
    """Full horizontal angle of view in radians, in (0, pi)."""
    size: tuple[int, int] | None = None
    """Width and height of the images in pixels, if known."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.centre).all():
            raise BadInput(f"The centre of a camera rig must be finite, not {self.centre}.")
        if not 0.0 <= self.radius < np.inf:
            raise BadInput(f"The radius of a camera rig must be a number of at least 0, not {self.radius}.")
        if not 0.0 < self.fov_x < np.pi:
            raise BadInput(f"The fov_x of a camera rig must lie between 0 and pi radians, not {self.fov_x}.")

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> CameraRig:
        """Return the rig of some cameras: the point nearest to all axes, and the median distance and angle of view."""
        positions = np.stack([c.camera_to_world[:3, 3] for c in cameras])
        axes = np.stack([-c.camera_to_world[:3, 2] for c in cameras])
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # removes the component along the axis
        centre = np.linalg.lstsq(across.sum(0), np.einsum("nij,nj->i", across, positions), rcond=None)[0]
        x, y, z = (float(v) for v in centre)
        radius = float(np.median(np.linalg.norm(positions - centre, axis=1)))
        fov_x = float(np.median([c.fov_x for c in cameras]))
        return cls((x, y, z), radius, fov_x, (cameras[0].width, cameras[0].height))

    @classmethod
    def from_json(cls, content: object, name: str = "camera_rig") -> CameraRig:
        """Create a rig from the output of :meth:`to_json`.

        Args:
            content: The JSON value read from a file.
            name: Name of the value in error messages.

        Raises:
            BadInput: A value is missing or invalid.
        """
        values = object_in(content, name)
        centre = vector_in(needed(values, "centre", name), f"{name}.centre")
        radius, fov_x = (number_in(needed(values, key, name), f"{name}.{key}") for key in ("radius", "fov_x"))
        size = None
        if values.get("size") is not None:
            width, height = (whole_in(v, f"{name}.size") for v in list_in(values["size"], 2, f"{name}.size"))
            size = width, height
        try:
            return cls(centre, radius, fov_x, size)
        except BadInput as error:
            raise BadInput(f"{name}: {error}") from None

    def to_json(self) -> dict[str, object]:
        """Return the fields as plain values under their names, without the size if it is unknown."""
        content: dict[str, object] = {"centre": list(self.centre), "radius": self.radius, "fov_x": self.fov_x}
        return content if self.size is None else {**content, "size": list(self.size)}

    @property
    def view_width(self) -> float:
        """Width of the area that a camera sees at the centre, in world units."""
        return float(2.0 * self.radius * np.tan(self.fov_x / 2.0))

    def sphere(self, n: int, size: int) -> list[Camera]:
        """Return cameras spread over the sphere; see :func:`sphere_cameras`."""
        return sphere_cameras(n, self.centre, self.radius, self.fov_x, size)

    def orbit(self, n: int, size: int, frames: Sequence[int] | None = None) -> list[Camera]:
        """Return cameras on the path for showing results; see :func:`orbit_cameras`."""
        return orbit_cameras(n, self.centre, self.radius, self.fov_x, size, frames)


def _on_sphere(direction: Array, centre: ArrayLike, radius: float, fov_x: float, size: int) -> Camera:
    if not (np.isfinite(radius) and radius > 0):
        raise BadInput(f"The cameras' distance must be a positive number, not {radius}.")
    # The rotation depends on the direction alone, so it is the same however small or far from the origin the volume is.
    matrix = look_at(direction, np.zeros(3))
    matrix[:3, 3] = np.asarray(centre, dtype=np.float64) + radius * direction
    return Camera(matrix, fov_x, size, size)
