"""Rays through pixels, compiled with numba."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from svv.core.fast_math import FAST_MATH


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def pixel_rays(pixels, rotations, positions, lenses, width, height, origins, directions):  # type: ignore[no-untyped-def]
    """Compute the rays through pixel centres.

    Args:
        pixels: Flat indices (view * height + row) * width + column, row 0 at the top. (R,)
        rotations: Camera-to-box rotations, float32. (N, 3, 3)
        positions: Camera positions in box coordinates, float32. (N, 3)
        lenses: For each camera the focal length in pixels (pixels per box unit if it is orthographic), what is added to
            a pixel's column and row to count them from the principal point, and 1 if it is orthographic, otherwise 0;
            float32. (N, 4)
        width: Image width in pixels.
        height: Image height in pixels.
        origins: Result, box coordinates, float32. (R, 3)
        directions: Result, unit vectors, float32. (R, 3)
    """
    for r in prange(pixels.shape[0]):
        view, rest = pixels[r] // (width * height), pixels[r] % (width * height)
        u = (np.float32(rest % width) + lenses[view, 1]) / lenses[view, 0]
        v = -(np.float32(rest // width) + lenses[view, 2]) / lenses[view, 0]
        if lenses[view, 3] > 0.0:
            for k in range(3):
                m = rotations[view, k]
                directions[r, k] = -m[2]
                origins[r, k] = positions[view, k] + m[0] * u + m[1] * v
            continue
        norm = np.float32(1.0) / np.sqrt(u * u + v * v + np.float32(1.0))
        for k in range(3):
            m = rotations[view, k]
            directions[r, k] = (m[0] * u + m[1] * v - m[2]) * norm
            origins[r, k] = positions[view, k]
