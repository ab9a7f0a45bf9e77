"""Which part of the cameras' pictures the panels of a figure show, and where there is room beside what is visible.

Lengths in a picture are in pixels of a small preview unless stated otherwise; row 0 is at the top.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera

PREVIEW = 320
"""Width of a preview in pixels."""

LEAST_SEEN = 0.01
"""Alpha above which a pixel counts as visible."""

MARGIN = 0.015
"""Room around what is visible, as a fraction of the longer side of the window."""

CORNERS = ("lower left", "lower right", "upper left", "upper right")
"""Corners of a panel in the order in which annotations are placed there."""


@dataclass(frozen=True)
class Window:
    """The part of a preview that a panel shows; it may reach beyond the preview."""

    left: float
    top: float
    width: float
    height: float

    @property
    def aspect(self) -> float:
        """Height over width."""
        return self.height / self.width

    def widened(self, aspect: float) -> Window:
        """Return the smallest window around this one, with the same middle, of another aspect."""
        width, height = max(self.width, self.height / aspect), max(self.height, self.width * aspect)
        return Window(self.left - 0.5 * (width - self.width), self.top - 0.5 * (height - self.height), width, height)


def preview_camera(camera: Camera) -> Camera:
    """Return the camera of a preview: the same frame, :data:`PREVIEW` pixels wide."""
    return camera.resized(PREVIEW, max(1, round(PREVIEW * camera.height / camera.width)))


def together(seen: Sequence[NDArray[np.float32]], cameras: Sequence[Camera]) -> list[NDArray[np.float32]]:
    """Return what each camera sees in any of its previews of alpha (h, w), so that all of them are trimmed alike."""
    whole: dict[object, NDArray[np.float32]] = {}
    names = [(c.camera_to_world.tobytes(), c.fov_x, c.width, c.height, c.span_x, *c.principal_point) for c in cameras]
    for name, alpha in zip(names, seen, strict=True):
        whole[name] = np.maximum(whole[name], alpha) if name in whole else alpha
    return [whole[name] for name in names]


def windows_of(seen: Sequence[NDArray[np.floating]], content: bool) -> list[Window]:
    """Return the window of each preview's alpha (h, w), of one size: the whole frame, or only visible ``content``."""
    boxes = [_box(alpha) if content else (0.0, 0.0, float(alpha.shape[1]), float(alpha.shape[0])) for alpha in seen]
    width, height = max(box[2] for box in boxes), max(box[3] for box in boxes)
    more = 2.0 * MARGIN * max(width, height) if content else 0.0
    width, height = width + more, height + more
    return [Window(x + 0.5 * (w - width), y + 0.5 * (h - height), width, height) for x, y, w, h in boxes]


def _box(alpha: NDArray[np.floating]) -> tuple[float, float, float, float]:
    """Return left, top, width and height of what is visible; the whole preview if nothing is."""
    rows, columns = np.nonzero(alpha > LEAST_SEEN)
    if not len(rows):
        return 0.0, 0.0, float(alpha.shape[1]), float(alpha.shape[0])
    left, top = float(columns.min()), float(rows.min())
    return left, top, float(columns.max()) + 1.0 - left, float(rows.max()) + 1.0 - top


def camera_through(camera: Camera, window: Window, width: int, height: int) -> Camera:
    """Return the camera whose picture of ``width`` x ``height`` pixels is a window of the camera's preview."""
    small = preview_camera(camera)
    scale = width / window.width
    column, row = small.principal_point
    centre = scale * (column - window.left), scale * (row - window.top)
    focal = scale * small.focal
    if camera.is_orthographic:
        return Camera.orthographic(camera.camera_to_world, width / focal, width, height, centre)
    return Camera(camera.camera_to_world, 2.0 * float(np.arctan(0.5 * width / focal)), width, height, None, centre)


def parallel(camera: Camera, middle: NDArray[np.floating]) -> Camera:
    """Return the orthographic camera that shows what lies in the plane through a point (3,) as the camera does."""
    if camera.is_orthographic:
        return camera
    span = camera.width * float(camera.pixel_at(distance_to(camera, middle)))
    return Camera.orthographic(camera.camera_to_world, span, camera.width, camera.height, camera.centre)


def distance_to(camera: Camera, middle: NDArray[np.floating]) -> float:
    """Return the distance along the camera's axis of the plane through a point (3,), world units."""
    return float((np.asarray(middle) - camera.position) @ -camera.camera_to_world[:3, 2])


def free_corner(
    alpha: NDArray[np.floating], window: Window, size: tuple[float, float], taken: Sequence[str], strip: float = 0.0
) -> str | None:
    """Return a corner of a preview's window, not ``taken``, where its alpha (h, w) shows nothing, or None.

    ``size`` of the corner and ``strip``, the height of what is empty below, are fractions of the window's width.
    """
    height, width = alpha.shape
    across, down, more = (part * window.width for part in (*size, strip))
    bottom = min(height, int(np.ceil(window.top + window.height)))
    for corner in CORNERS:
        left = window.left + (window.width - across if "right" in corner else 0.0)
        top = window.top + (window.height + more - down if "lower" in corner else 0.0)
        columns = slice(max(0, int(np.floor(left))), min(width, int(np.ceil(left + across))))
        rows = slice(max(0, int(np.floor(top))), min(bottom, int(np.ceil(top + down))))
        if corner not in taken and not (alpha[rows, columns] > LEAST_SEEN).any():
            return corner
    return None


def round_length(most: float) -> float:
    """Return the longest of 1, 2 and 5 times a power of ten that is at most ``most`` (> 0).

    >>> [round_length(x) for x in (99.0, 0.3, 7.0)]
    [50.0, 0.2, 5.0]
    """
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most * (1.0 + 1e-9)))
