"""Intrinsics of other programs' images, and images resampled to those of a pinhole camera with square pixels.

Pixel coordinates count from the upper left corner of the image, so that the middle of the first pixel is at (0.5, 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput

Array = NDArray[np.float64]
Images = NDArray[np.uint8]

SQUARE = 0.25
"""Pixels by which rows may be off, at the edge of the image, for pixels to count as square."""

MOST_ZOOM = 4.0
"""Largest factor by which an image is magnified to fill the frame once its distortion is removed."""

EDGE_POINTS = 2048
"""Most points of an edge of an image at which a lens is looked at: its terms are smooth."""


@dataclass(frozen=True)
class Lens:
    """Intrinsics in pixels, with the distortion models of OpenCV that COLMAP and nerfstudio write.

    Raises BadInput if a number is not finite, or a focal length is not positive.
    """

    width: int
    height: int
    focal: tuple[float, float]
    """Focal lengths along x and y, > 0."""
    centre: tuple[float, float]
    """Principal point: column and row."""
    radial: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """k1, k2, k3, k4."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """p1, p2."""
    fisheye: bool = False
    """Whether the radial terms are those of OpenCV's fisheye model (Kannala & Brandt 2006)."""

    def __post_init__(self) -> None:
        numbers = (*self.focal, *self.centre, *self.radial, *self.tangential)
        if not np.isfinite(numbers).all() or min(self.focal) <= 0:
            raise BadInput(f"Focal lengths must be positive and all intrinsics finite numbers, not {numbers}.")

    @property
    def is_pinhole(self) -> bool:
        """Whether the image is that of a pinhole camera with square pixels."""
        stretch = abs(1.0 - self.focal[1] / self.focal[0]) * max(self.centre[1], self.height - self.centre[1])
        return not (self.fisheye or any(self.radial) or any(self.tangential)) and stretch < SQUARE

    @property
    def rectified(self) -> float:
        """Focal length of the resampled image: as short as possible without showing anything outside this one.

        BadInput is raised if the distortion is so strong that no such length was found.
        """
        columns, rows = (0.5 + np.linspace(0.0, n - 1, min(n, EDGE_POINTS)) for n in (self.width, self.height))
        edge = [(columns, np.full_like(columns, y)) for y in (rows[0], rows[-1])]
        edge += [(np.full_like(rows, x), rows) for x in (columns[0], columns[-1])]
        x, y = (np.concatenate(part) for part in zip(*edge, strict=True))
        least = max(self.focal)

        def fits(zoom: float) -> bool:
            focal = zoom * least
            u, v = self.seen_at(x, y, focal)
            inside = ((u >= 0) & (u <= self.width) & (v >= 0) & (v <= self.height)).all()
            # From the principal point to the edge, the distance in this image must grow: a polynomial may turn back.
            part = np.linspace(0.0, 1.0, 33)[:, None]
            along = self.seen_at(
                self.centre[0] + part * (x - self.centre[0]), self.centre[1] + part * (y - self.centre[1]), focal
            )
            with np.errstate(all="ignore"):
                away = np.hypot(along[0] - self.centre[0], along[1] - self.centre[1])
                return bool(inside and (np.diff(away, axis=0) >= 0.0).all())

        if fits(1.0):
            return least
        if not fits(MOST_ZOOM):
            raise BadInput("The lens distortion (k1, k2, k3, k4, p1, p2) is too strong; undistort the images first.")
        low, high = 1.0, MOST_ZOOM
        while high - low > 1e-4:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if fits(middle) else (middle, high)
        return high * least

    @np.errstate(all="ignore")  # whatever is not finite there is outside of this image
    def seen_at(self, column: Array, row: Array, focal: float) -> tuple[Array, Array]:
        """Return columns and rows (...,) at which this image shows what a pinhole camera shows at its own (...,).

        That camera has the same principal point, and a focal length in pixels. Radial and tangential terms are those of
        Brown (1971), as in OpenCV: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2); the fisheye
        model scales (x, y) by (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9) / r with a = atan r.
        """
        x, y = (column - self.centre[0]) / focal, (row - self.centre[1]) / focal
        k, (p1, p2), square = self.radial, self.tangential, x * x + y * y
        if self.fisheye:
            r = np.sqrt(square)
            a = np.arctan(r)
            bent = a * (1.0 + a**2 * (k[0] + a**2 * (k[1] + a**2 * (k[2] + a**2 * k[3]))))
            scale = np.where(r > 1e-12, bent / np.maximum(r, 1e-12), 1.0)
            u, v = x * scale, y * scale
        else:
            scale = 1.0 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3])))
            u = x * scale + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
            v = y * scale + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
        return self.focal[0] * u + self.centre[0], self.focal[1] * v + self.centre[1]


def rectify(image: Images, lens: Lens) -> Images:
    """Resample an image (height, width, 4), straight alpha, to a pinhole camera of focal length ``lens.rectified``."""
    from scipy.ndimage import map_coordinates

    where = _map(lens)
    alpha = map_coordinates(image[..., 3].astype(np.float32), where, order=1, mode="nearest")
    result = np.empty_like(image)
    for channel in range(3):
        weighted = image[..., channel].astype(np.float32) * image[..., 3]
        colour = map_coordinates(weighted, where, order=1, mode="nearest") / np.maximum(alpha, 1e-3)
        result[..., channel] = np.rint(np.clip(colour, 0, 255))
    result[..., 3] = np.rint(alpha)
    result[result[..., 3] == 0] = 0
    return result


@lru_cache(maxsize=4)
def _map(lens: Lens) -> NDArray[np.float32]:
    """Return row and column, from the middle of the first pixel, at which each pixel is sampled. (2, height, width)"""
    column, row = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    u, v = lens.seen_at(column, row, lens.rectified)
    return np.stack([v - 0.5, u - 0.5]).astype(np.float32)
