"""Rays through pixels, and the harmonics of their directions, compiled with numba."""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def pixel_rays(pixels, rotations, positions, lenses, width, height, origins, directions):  # type: ignore[no-untyped-def]
    """Compute the origins in box coordinates and unit directions (R, 3) of rays through pixel centres, all in float32.

    ``pixels`` (R,): flat indices (view * height + row) * width + column, row 0 at the top; ``rotations`` (N, 3, 3):
    camera to box; ``positions`` (N, 3): box coordinates; ``lenses`` (N, 4): the focal length in pixels (pixels per box
    unit if it is orthographic), what is added to a pixel's column and row to count them from the principal point, and 1
    if it is orthographic, otherwise 0.
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


BANDS = tuple(
    np.float32(factor)
    for factor in (
        0.28209479177387814, 0.48860251190291987, 1.0925484305920792, 0.94617469575755997, 0.31539156525251999,
        0.54627421529603959, 0.59004358992664352, 2.8906114426405538, 0.45704579946446572, 0.3731763325901154,
        1.4453057213202769,
    )
)  # fmt: skip
"""Factors of :func:`svv.core.rays.encodings.spherical_harmonics`, in single precision."""

ONE, THREE, FIVE = np.float32(1.0), np.float32(3.0), np.float32(5.0)


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def harmonics(directions, ray, out):  # type: ignore[no-untyped-def]
    """Write degree 4 harmonics of each sample's ray: (R, 3) and (S,) -> out (S, 16)."""
    b = BANDS
    for i in prange(ray.shape[0]):
        r = np.uint64(ray[i])
        x, y, z = directions[r, 0], directions[r, 1], directions[r, 2]
        xx, yy, zz = x * x, y * y, z * z
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = b[0], -b[1] * y, b[1] * z, -b[1] * x
        out[i, 4], out[i, 5], out[i, 6], out[i, 7] = b[2] * x * y, -b[2] * y * z, b[3] * zz - b[4], -b[2] * x * z
        out[i, 8], out[i, 9] = b[5] * (xx - yy), b[6] * y * (yy - THREE * xx)
        out[i, 10], out[i, 11] = b[7] * x * y * z, b[8] * y * (ONE - FIVE * zz)
        out[i, 12], out[i, 13] = b[9] * z * (FIVE * zz - THREE), b[8] * x * (ONE - FIVE * zz)
        out[i, 14], out[i, 15] = b[10] * z * (xx - yy), b[6] * x * (THREE * yy - xx)
