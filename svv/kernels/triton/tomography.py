"""The visual hull, and projection and back-projection of an extinction, in Triton: one thread per cell, ray or vertex.

:mod:`svv.fields.radiance.hull_kernels` and :mod:`svv.train.base.tomography_kernels` describe what each function
computes. ``BLOCK`` is the number of cells, rays or vertices of one program.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import triton
import triton.language as tl
from torch import Tensor

from svv.kernels.triton.rays import exponent_at, leap, slab
from svv.kernels.types import MOST_SEEN, Lattice

RAY_BLOCK = 32
VERTEX_BLOCK = 128
CELL_BLOCK = 128

FARTHEST = 1 << 30
"""Pixels from the middle of a mask at which a cell counts as infinitely far away."""


@triton.jit(do_not_specialize=["tables", "count", "height", "width", "number", "ny", "nz", "occupied"])
def carved(  # type: ignore[no-untyped-def]
    tables, rotations, positions, lenses, sizes, number, height, width, ny, nz, count, occupied, FAR: tl.constexpr,
    MOST: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Write how many views contain each of ``count`` cells whole, at most ``MOST``; 0 if one shows nothing there.

    ``sizes`` (2,) float64: cells per box unit, and their reach; ``height``, ``width``: of the tables.
    """
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    cells, reach = tl.load(sizes), tl.load(sizes + 1)
    x = ((i // (ny * nz)).to(tl.float64) + 0.5) / cells
    y = ((i // nz % ny).to(tl.float64) + 0.5) / cells
    z = ((i % nz).to(tl.float64) + 0.5) / cells
    left, seen, table, n = i < count, tl.zeros((BLOCK,), tl.int32), tables, 0
    while (n < number) & (tl.max(left.to(tl.int32), axis=0) > 0):
        m, lens = rotations + 9 * n, lenses + 4 * n
        focal, parallel = tl.load(lens), tl.load(lens + 3) > 0.0
        dx, dy, dz = (
            x - tl.load(positions + 3 * n),
            y - tl.load(positions + 3 * n + 1),
            z - tl.load(positions + 3 * n + 2),
        )
        away = -(tl.load(m + 6) * dx + tl.load(m + 7) * dy + tl.load(m + 8) * dz)
        ahead = away > 2.0 * reach
        d = tl.where(ahead, tl.where(parallel, 1.0, away), 1.0)
        u = (tl.load(m) * dx + tl.load(m + 1) * dy + tl.load(m + 2) * dz) / d
        v = (tl.load(m + 3) * dx + tl.load(m + 4) * dy + tl.load(m + 5) * dz) / d
        r = reach * focal / d * tl.where(parallel, 1.0, tl.sqrt(1.0 + u * u + v * v)) + 0.5
        column = tl.minimum(tl.maximum(u * focal + tl.load(lens + 1), -FAR), FAR)
        row = tl.minimum(tl.maximum(tl.load(lens + 2) - v * focal, -FAR), FAR)
        r = tl.minimum(r, FAR)
        x0, x1 = tl.floor(column - r), tl.ceil(column + r)
        y0, y1 = tl.floor(row - r), tl.ceil(row + r)
        whole = left & ahead & (x0 >= 0.0) & (y0 >= 0.0) & (x1 < width) & (y1 < height)
        low, high = table + y0.to(tl.int32) * width, table + y1.to(tl.int32) * width
        visible = tl.load(high + x1.to(tl.int32), mask=whole, other=1)
        visible -= tl.load(low + x1.to(tl.int32), mask=whole, other=0)
        visible -= tl.load(high + x0.to(tl.int32), mask=whole, other=0)
        visible += tl.load(low + x0.to(tl.int32), mask=whole, other=0)
        left, seen = left & (visible > 0), seen + whole.to(tl.int32)
        n += 1
        table += height * width
    tl.store(occupied + i, tl.where(left, tl.minimum(seen, MOST), 0).to(tl.uint8), mask=i < count)


@triton.jit(do_not_specialize=["origins", "directions", "nx", "ny", "nz", "rays", "out"])
def depths(  # type: ignore[no-untyped-def]
    origins, directions, distance, nx, ny, nz, cells, extent_x, extent_y, extent_z, step, shift, shapes, scales, bases,
    index, table, stop, rays, out, BLOCK: tl.constexpr,
):  # fmt: skip
    """Write the optical depth of rays (R,) through an extinction whose logarithm a lattice of one level holds."""
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = r < rays
    ox = tl.load(origins + 3 * r, mask=there, other=0.0)
    oy = tl.load(origins + 3 * r + 1, mask=there, other=0.0)
    oz = tl.load(origins + 3 * r + 2, mask=there, other=0.0)
    dx = tl.load(directions + 3 * r, mask=there, other=1.0)
    dy = tl.load(directions + 3 * r + 1, mask=there, other=1.0)
    dz = tl.load(directions + 3 * r + 2, mask=there, other=1.0)
    near, far = tl.zeros((BLOCK,), tl.float32), tl.full((BLOCK,), 1e30, tl.float32)
    near, far, inverse_x = slab(ox, dx, extent_x, near, far)
    near, far, inverse_y = slab(oy, dy, extent_y, near, far)
    near, far, inverse_z = slab(oz, dz, extent_z, near, far)
    hit = there & (near < far)
    i = tl.ceil(tl.where(hit, near, 0.0) / step - shift).to(tl.int32)
    last = tl.floor(tl.where(hit, far, 0.0) / step - shift).to(tl.int32)
    going = hit & (i <= last)
    octant = 4 * (dx < 0).to(tl.int64) + 2 * (dy < 0).to(tl.int64) + (dz < 0).to(tl.int64)
    side, rate = 1.0 / cells, 1.0 / step
    depth = tl.zeros((BLOCK,), tl.float32)
    while tl.max(going.to(tl.int32), axis=0) > 0:
        t = (i.to(tl.float32) + shift) * step
        x = tl.minimum(tl.maximum(ox + t * dx, 0.0), extent_x)
        y = tl.minimum(tl.maximum(oy + t * dy, 0.0), extent_y)
        z = tl.minimum(tl.maximum(oz + t * dz, 0.0), extent_z)
        cx = tl.minimum((x * cells).to(tl.int32), nx - 1)
        cy = tl.minimum((y * cells).to(tl.int32), ny - 1)
        cz = tl.minimum((z * cells).to(tl.int32), nz - 1)
        empty = tl.load(distance + ((octant * nx + cx) * ny + cy) * nz + cz, mask=going, other=0).to(tl.int32)
        inside = going & (empty == 0)
        tx = leap(cx, empty, dx, ox, inverse_x, side)
        ty = leap(cy, empty, dy, oy, inverse_y, side)
        tz = leap(cz, empty, dz, oz, inverse_z, side)
        behind = tl.ceil(tl.where(inside | (there == 0), 0.0, tl.minimum(tx, tl.minimum(ty, tz))) * rate - shift)
        raw = exponent_at(x, y, z, inside, shapes, scales, bases, index, table, 1)
        depth += tl.where(inside, tl.exp(raw) * step, 0.0)
        i = tl.where(inside, i + 1, tl.maximum(i + 1, behind.to(tl.int32)))
        going = going & (i <= last) & (depth <= stop)
    tl.store(out + r, depth, mask=there)


@triton.jit(do_not_specialize=["vertices", "sums", "count", "height", "width", "number"])
def projected_back(  # type: ignore[no-untyped-def]
    vertices, scale, rotations, positions, lenses, images, sums, count, height, width, number, BLOCK: tl.constexpr
):
    """Write for each vertex the sum over ``number`` views of what ``images`` (N, H, W, 2) hold where it is seen."""
    p = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = p < count
    x = tl.load(vertices + 3 * p, mask=there, other=0).to(tl.float32) / scale
    y = tl.load(vertices + 3 * p + 1, mask=there, other=0).to(tl.float32) / scale
    z = tl.load(vertices + 3 * p + 2, mask=there, other=0).to(tl.float32) / scale
    first, second = tl.zeros((BLOCK,), tl.float32), tl.zeros((BLOCK,), tl.float32)
    for n in range(number):
        m, lens = rotations + 9 * n, lenses + 4 * n
        dx = x - tl.load(positions + 3 * n)
        dy = y - tl.load(positions + 3 * n + 1)
        dz = z - tl.load(positions + 3 * n + 2)
        away = -(tl.load(m + 2) * dx + tl.load(m + 5) * dy + tl.load(m + 8) * dz)
        ahead = there & (away > 0.0)
        parallel = tl.load(lens + 3) > 0.0
        zoom = tl.load(lens) / tl.where(parallel, 1.0, tl.where(ahead, away, 1.0))
        column = (tl.load(m) * dx + tl.load(m + 3) * dy + tl.load(m + 6) * dz) * zoom - tl.load(lens + 1)
        row = -(tl.load(m + 1) * dx + tl.load(m + 4) * dy + tl.load(m + 7) * dz) * zoom - tl.load(lens + 2)
        seen = ahead & (row >= -1.0) & (column >= -1.0) & (row < height) & (column < width)
        row, column = tl.where(seen, row, 0.0), tl.where(seen, column, 0.0)
        i, j = tl.floor(row).to(tl.int32), tl.floor(column).to(tl.int32)
        below, beside = row - i.to(tl.float32), column - j.to(tl.float32)
        for corner in tl.static_range(4):
            a, b = i + (corner >> 1), j + (corner & 1)
            inside = seen & (a >= 0) & (b >= 0) & (a < height) & (b < width)
            w = (below if corner & 2 else 1.0 - below) * (beside if corner & 1 else 1.0 - beside)
            at = images + 2 * ((n * height + a).to(tl.int64) * width + b)
            first += w * tl.load(at, mask=inside, other=0.0)
            second += w * tl.load(at + 1, mask=inside, other=0.0)
    tl.store(sums + 2 * p, first, mask=there)
    tl.store(sums + 2 * p + 1, second, mask=there)


def visual_hull(
    tables: Tensor, cameras: tuple[Tensor, Tensor, Tensor], cells: float, reach: float, shape: Sequence[int]
) -> Tensor:
    """Count the views of cells that masks leave; see :meth:`svv.kernels.types.TomographyKernels.visual_hull`."""
    occupied = torch.empty(*shape, dtype=torch.uint8, device=tables.device)
    sizes = torch.tensor([cells, reach], dtype=torch.float64, device=tables.device)
    rotations, positions, lenses = (t.contiguous() for t in cameras)
    carved[(triton.cdiv(occupied.numel(), CELL_BLOCK),)](
        tables.contiguous(), rotations, positions, lenses, sizes, *tables.shape, *shape[1:], occupied.numel(), occupied,
        FARTHEST, MOST_SEEN, CELL_BLOCK,
    )  # fmt: skip
    return occupied


def optical_depths(
    rays: tuple[Tensor, Tensor], distance: Tensor, cells: int, extent: Sequence[float], step: float, shift: float,
    where: Lattice, table: Tensor, stop: float,
) -> Tensor:  # fmt: skip
    """Return the optical depth of rays; see :meth:`svv.kernels.types.TomographyKernels.optical_depths`."""
    origins, directions = rays
    out = torch.empty(len(origins), device=origins.device)
    if len(origins):
        depths[(triton.cdiv(len(origins), RAY_BLOCK),)](
            origins, directions, distance, *distance.shape[1:], float(cells), *extent, step, shift, where.shapes,
            where.scales, where.bases, where.index, table, stop, len(origins), out, RAY_BLOCK, num_warps=1,
        )  # fmt: skip
    return out


def back_project(vertices: Tensor, scale: float, cameras: tuple[Tensor, Tensor, Tensor], images: Tensor) -> Tensor:
    """Return sums over views; see :meth:`svv.kernels.types.TomographyKernels.back_project`."""
    sums = torch.empty(len(vertices), 2, device=vertices.device)
    number, height, width = images.shape[:3]
    if len(vertices):
        projected_back[(triton.cdiv(len(vertices), VERTEX_BLOCK),)](
            vertices.contiguous(),
            scale,
            *cameras,
            images.contiguous(),
            sums,
            len(vertices),
            height,
            width,
            number,
            VERTEX_BLOCK,
        )
    return sums
