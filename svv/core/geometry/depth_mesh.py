"""An image with depth as a surface in space: one vertex a pixel, where the pixel's ray meets what it shows.

Seen from the image's own camera, with as many pixels, the surface repeats the image. From elsewhere it is a relief.
Letters: H, W rows and columns of the image; N vertices, M quadrilaterals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera

HALF = 128
"""Least alpha, of 255, of a pixel that an opaque surface shows."""

AROUND = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]
"""Offsets of a pixel's neighbours."""


@dataclass(frozen=True)
class DepthMesh:
    """A surface of quadrilaterals with colours."""

    points: NDArray[np.float32]
    """World coordinates. (N, 3)"""
    colours: NDArray[np.uint8]
    """Straight RGBA. (N, 4)"""
    quads: NDArray[np.int64]
    """Vertices of each quadrilateral. (M, 4)"""


def depth_mesh(rgba: NDArray[np.uint8], depth: NDArray[np.float32], camera: Camera, opaque: bool = False) -> DepthMesh:
    """Return the surface that shows an image, straight RGBA with row 0 at the top (H, W, 4), at its depth.

    Around it lies a rim of vertices with the depth of their neighbours: transparent ones at the centres of the pixels
    beside it or, if the surface is opaque, half a pixel away, so that it covers whole pixels.

    ``depth``: distance along the pixel's ray, world units; NaN where nothing is shown (H, W). ``opaque``: leave out
    pixels whose alpha is below a half, and make the others opaque.
    """
    height, width = depth.shape
    seen = (depth > 0.0) & (rgba[..., 3] >= (HALF if opaque else 1))  # faint haze without a sample has the depth 0
    # Pixels beyond the image repeat those at its edge, or the outer half of a pixel at the edge would be missing.
    seen, depth = np.pad(seen, 1, "edge"), np.pad(depth, 1, "edge")
    rgba = np.pad(rgba, [(1, 1), (1, 1), (0, 0)], "edge")
    colours = np.where(seen[..., None], rgba, 0)
    if opaque:
        colours[..., 3] = np.where(seen, 255, 0)
    depth = np.where(seen, depth, 0.0)
    rows, columns = np.mgrid[-1.0 : height + 1, -1.0 : width + 1]
    rim, count, offset = _rim(seen)
    depth[rim] = _sums(depth.astype(np.float64))[rim] / count  # the mean of the neighbours that are seen
    colours[rim] = np.rint(_sums(colours.astype(np.float64))[rim] / count[:, None])
    colours[..., 3][rim] = 255 if opaque else 0
    if opaque:
        rows[rim], columns[rim] = rows[rim] + 0.5 * offset[0], columns[rim] + 0.5 * offset[1]
    used = seen.copy()
    used[rim] = True
    number = np.cumsum(used.ravel()).reshape(used.shape) - 1
    some = seen[:-1, :-1] | seen[:-1, 1:] | seen[1:, :-1] | seen[1:, 1:]  # then all four are used
    corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    points = _places(camera, columns[used], rows[used], depth[used])
    return DepthMesh(points.astype(np.float32), colours[used], np.stack([c[some] for c in corners], axis=1))


def _rim(seen: NDArray[np.bool_]) -> tuple[tuple[NDArray[np.intp], ...], NDArray[np.float64], NDArray[np.float64]]:
    """Return the pixels beside seen ones, the number of those beside each (R,), and their mean offset (2, R)."""
    there = seen.astype(np.float64)
    count = _sums(there)
    rim = np.nonzero(~seen & (count > 0))
    moments = [_sums(there, weights)[rim] / count[rim] for weights in np.array(AROUND).T]
    return rim, count[rim], np.stack(moments)


def _sums(values: NDArray[np.float64], weights: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
    """Return the sum over the neighbours of each pixel, by default without weights (8,). (H, W) or (H, W, C)"""
    height, width = values.shape[:2]
    wide = np.pad(values, [(1, 1), (1, 1), (0, 0)][: values.ndim])
    total = np.zeros_like(values)
    for (row, column), weight in zip(AROUND, np.ones(8) if weights is None else weights, strict=True):
        total += weight * wide[1 + row : 1 + row + height, 1 + column : 1 + column + width]
    return total


def _places(
    camera: Camera, columns: NDArray[np.float64], rows: NDArray[np.float64], depth: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the world coordinates at a depth along the rays of pixels, which may lie outside the image. (N, 3)"""
    column, row = camera.principal_point
    x, y = (columns + 0.5 - column) / camera.focal, (row - rows - 0.5) / camera.focal
    if camera.is_orthographic:
        local = np.stack([x, y, -depth.astype(np.float64)], axis=1)
    else:
        local = np.stack([x, y, np.full_like(x, -1.0)], axis=1)
        local *= (depth / np.linalg.norm(local, axis=1))[:, None]
    return np.asarray(camera.position + local @ camera.camera_to_world[:3, :3].T)
