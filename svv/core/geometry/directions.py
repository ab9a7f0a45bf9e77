"""Directions spread evenly over the sphere: geodesic icosahedra and Fibonacci spirals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput

Array = NDArray[np.float64]


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
    """Return n >= 3 unit vectors spread evenly over the sphere, from y = -1 upwards; BadInput for fewer. (n, 3)

    They are the vertices of the geodesic icosahedron of class (h, k) (Caspar & Klug 1962) if n = 10 T + 2 with T = h^2
    + h k + k^2 (12, 32, 42, 72, 92, 122, 132, 162, 192, 212, ..., 312); the 92, 42 and 312 viewpoints of StyleRF-VolVis
    are of this kind. Any other n gives a Fibonacci spiral.
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
