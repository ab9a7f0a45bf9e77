"""Projection and back-projection of an extinction, compiled with numba, for :mod:`svv.train.base.tomography`.

Each ray and each vertex is computed by one thread without any shared sum, so results do not depend on the number of
threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from svv.core.fast_math import FAST_MATH
from svv.kernels.numba.bricks import NO_BRICKS, value_in_brick
from svv.kernels.numba.leaping import octant
from svv.kernels.numba.marching import clip_to_box, interpolate_scalar, inverse, leap
from svv.kernels.numba.trilinear import ONE32


def optical_depths(  # type: ignore[no-untyped-def]
    origins, directions, distance, cells, extent, step, shift, shapes, scales, bases, index, table, stop, out,
    bricks=NO_BRICKS,
):  # fmt: skip
    """Write each ray's optical depth through an extinction of which a lattice holds the logarithm.

    Args:
        origins: Box coordinates, float32. (R, 3)
        directions: Unit vectors, float32. (R, 3)
        distance: How far a ray may leap, uint8 (8, X, Y, Z); see :func:`svv.core.rays.cells.leaps`.
        cells: Cells per box unit of ``distance``.
        extent: Sides of the box. (3,)
        step: Sample distance in box units.
        shift: Place of each sample within its step, in [0, 1).
        shapes: Layout of the lattice, like the next three; see :class:`svv.kernels.types.Lattice`.
        scales: Cells per box unit of each level.
        bases: First entry of each level in ``index``.
        index: Row of each vertex.
        table: Log extinction, float32. (V,)
        stop: Optical depth at which a ray ends.
        out: Result, float32. (R,)
        bricks: The same values in bricks (:func:`svv.kernels.numba.bricks.made`), from which they are read faster.
    """
    _optical_depths(
        origins, directions, distance, cells, extent, step, shift, shapes, scales, bases, index, table, *bricks, stop,
        out,
    )  # fmt: skip


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _optical_depths(  # type: ignore[no-untyped-def]
    origins, directions, distance, cells, extent, step, shift, shapes, scales, bases, index, table, slots, bricks, stop,
    out,
):  # fmt: skip
    """Do the work of :func:`optical_depths`."""
    nx, ny, nz = distance.shape[1:]
    side, rate = ONE32 / cells, ONE32 / step
    in_bricks, scale = slots.size > 0, scales[0]
    cell = np.int32(shapes[0, 0] - 2), np.int32(shapes[0, 1] - 2), np.int32(shapes[0, 2] - 2)  # the last one
    for r in prange(origins.shape[0]):
        ox, oy, oz = origins[r, 0], origins[r, 1], origins[r, 2]
        dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
        near, far = clip_to_box(origins, directions, r, extent)
        depth = np.float32(0.0)
        if near < far:
            ix_, iy_, iz_ = inverse(dx), inverse(dy), inverse(dz)
            ahead = octant(dx, dy, dz)
            i, last = int(math.ceil(near * rate - shift)), int(math.floor(far * rate - shift))
            while i <= last:
                t = (np.float32(i) + shift) * step
                x = min(max(ox + t * dx, np.float32(0.0)), extent[0])
                y = min(max(oy + t * dy, np.float32(0.0)), extent[1])
                z = min(max(oz + t * dz, np.float32(0.0)), extent[2])
                cx, cy, cz = min(int(x * cells), nx - 1), min(int(y * cells), ny - 1), min(int(z * cells), nz - 1)
                empty = int(distance[ahead, cx, cy, cz])
                if empty > 0:
                    tx = leap(cx, empty, dx, ox, ix_, side)
                    ty = leap(cy, empty, dy, oy, iy_, side)
                    tz = leap(cz, empty, dz, oz, iz_, side)
                    i = max(i + 1, int(math.ceil(min(tx, min(ty, tz)) * rate - shift)))
                    continue
                if in_bricks:
                    value = value_in_brick(x, y, z, scale, cell, slots, bricks)
                else:
                    value = interpolate_scalar(x, y, z, shapes, scales, bases, index, table)
                depth += np.exp(value) * step
                if depth > stop:
                    break
                i += 1
        out[r] = depth


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def back_project(vertices, scale, rotations, positions, lenses, images, sums):  # type: ignore[no-untyped-def]
    """Write, for each vertex, the sum over views of what their images hold where the vertex is seen.

    Args:
        vertices: Integer coordinates, int32. (V, 3)
        scale: Vertices per box unit.
        rotations: Camera-to-box rotations, float32. (N, 3, 3)
        positions: Camera positions in box coordinates, float32. (N, 3)
        lenses: See :func:`svv.kernels.numba.rays.pixel_rays`, float32. (N, 4)
        images: Interpolated bilinearly; pixels beyond the frame are 0. float32 (N, H, W, 2)
        sums: Result, float32. (V, 2)
    """
    count, height, width = images.shape[:3]
    for p in prange(vertices.shape[0]):
        x, y, z = vertices[p, 0] / scale, vertices[p, 1] / scale, vertices[p, 2] / scale
        first = second = np.float32(0.0)
        for n in range(count):
            m = rotations[n]
            dx, dy, dz = x - positions[n, 0], y - positions[n, 1], z - positions[n, 2]
            away = -(m[0, 2] * dx + m[1, 2] * dy + m[2, 2] * dz)
            if away <= 0.0:
                continue
            zoom = lenses[n, 0] if lenses[n, 3] > 0.0 else lenses[n, 0] / away
            column = (m[0, 0] * dx + m[1, 0] * dy + m[2, 0] * dz) * zoom - lenses[n, 1]
            row = -(m[0, 1] * dx + m[1, 1] * dy + m[2, 1] * dz) * zoom - lenses[n, 2]
            i, j = int(math.floor(row)), int(math.floor(column))
            if i < -1 or j < -1 or i >= height or j >= width:
                continue
            below, beside = row - np.float32(i), column - np.float32(j)
            for a in range(2):
                for b in range(2):
                    if 0 <= i + a < height and 0 <= j + b < width:
                        w = (below if a else ONE32 - below) * (beside if b else ONE32 - beside)
                        first += w * images[n, i + a, j + b, 0]
                        second += w * images[n, i + a, j + b, 1]
        sums[p, 0], sums[p, 1] = first, second
