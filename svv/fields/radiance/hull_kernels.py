"""Visual hull from alpha masks, compiled with numba."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.kernels.types import MOST_SEEN

CUT, NOTHING, SOME, ALL = 0, 1, 2, 3
"""What a view shows of cells: its frame cuts them or they are behind it; or how much of their square is visible."""

BLOCK = 4
"""Cells along each side of a block."""

FEW = 8
"""Number of cells of a block of which each is looked at by itself."""


@njit(parallel=True, cache=True)
def summed(masks, side, tables):  # type: ignore[no-untyped-def]
    """Write the summed-area tables of masks (N, H, W) uint8 in squares of ``side`` pixels, set if any pixel is > 0.

    ``tables``: result, zeros, int32. (N, H / side + 1, W / side + 1), rounded up
    """
    _, height, width = masks.shape
    for n in prange(masks.shape[0]):
        row = np.empty(tables.shape[2] - 1, np.uint8)
        for y in range(tables.shape[1] - 1):
            row[:] = 0
            for i in range(side * y, min(side * (y + 1), height)):
                for x in range(row.shape[0]):
                    for j in range(side * x, min(side * (x + 1), width)):
                        row[x] |= masks[n, i, j]
            total = 0
            for x in range(row.shape[0]):
                total += row[x] > 0
                tables[n, y + 1, x + 1] = tables[n, y, x + 1] + total


@njit
def _view(n, rotations, positions, lenses):  # type: ignore[no-untyped-def]
    """Return rotation, position and lens of a view as numbers, which need not be loaded again for each cell."""
    m, p = rotations[n], positions[n]
    turn = m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2]
    return turn, (p[0], p[1], p[2]), (lenses[n, 0], lenses[n, 1], lenses[n, 2], lenses[n, 3] > 0.0)


@njit
def _verdict(view, table, x, y, z, spread, reach):  # type: ignore[no-untyped-def]
    """Return what a view shows of cells whose middles are at most ``spread`` from a point: one of the constants.

    With ``spread`` > 0, the square that is looked at surely contains that of each of these cells.
    """
    m, (px, py, pz), (focal, column, row, parallel) = view
    dx, dy, dz = x - px, y - py, z - pz
    away = -(m[6] * dx + m[7] * dy + m[8] * dz)
    near = away - spread
    if near <= 2 * reach:
        return CUT
    d = 1.0 if parallel else away
    u = (m[0] * dx + m[1] * dy + m[2] * dz) / d
    v = (m[3] * dx + m[4] * dy + m[5] * dz) / d
    far_u, far_v, beside, below = u, v, 0.0, 0.0
    if spread > 0.0:  # the most that u and v may differ, and a pixel for whatever is rounded
        du = spread if parallel else spread * (1.0 + abs(u)) / near
        dv = spread if parallel else spread * (1.0 + abs(v)) / near
        far_u, far_v, beside, below = abs(u) + du, abs(v) + dv, du * focal + 1.0, dv * focal + 1.0
    slant = 1.0 if parallel else np.sqrt(1.0 + far_u * far_u + far_v * far_v)
    r = reach * focal / (1.0 if parallel else near) * slant + 0.5
    rx, ry = r + beside, r + below
    u, v = u * focal + column, row - v * focal
    x0, x1 = int(np.floor(u - rx)), int(np.ceil(u + rx))
    y0, y1 = int(np.floor(v - ry)), int(np.ceil(v + ry))
    if x0 < 0 or y0 < 0 or x1 >= table.shape[1] or y1 >= table.shape[0]:
        return CUT
    visible = table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]
    if visible == 0:
        return NOTHING
    return ALL if visible == (x1 - x0) * (y1 - y0) else SOME


@njit(cache=True)
def _carve_block(  # type: ignore[no-untyped-def]
    block, begin, cells, at, reach, tables, rotations, positions, lenses, left
):
    """Leave only those cells of a block in its list ``left`` (C, 4) that views keep, each with how many views decide.

    Returns their number, and the view to begin with: that which left out the last cell, or ``begin`` if some are left.
    """
    views, count, shown = tables.shape[0], left.shape[0], 0
    x, y, z = (block[0] + 0.5 * BLOCK) / cells, (block[1] + 0.5 * BLOCK) / cells, (block[2] + 0.5 * BLOCK) / cells
    for m in range(begin, begin + views):
        n = m if m < views else m - views
        view, table = _view(n, rotations, positions, lenses), tables[n]
        if count > FEW:
            verdict = _verdict(view, table, x, y, z, (BLOCK - 1) * reach, reach)
            if verdict == NOTHING:
                return 0, n
            if verdict == ALL:
                shown += 1
                continue
        kept = 0
        for q in range(count):
            i, j, k, seen = left[q, 0], left[q, 1], left[q, 2], left[q, 3]
            verdict = _verdict(view, table, at[i], at[j], at[k], 0.0, reach)
            if verdict != NOTHING:
                left[kept, 0], left[kept, 1], left[kept, 2] = i, j, k
                left[kept, 3] = seen if verdict == CUT else seen + 1
                kept += 1
        count = kept
        if count == 0:
            return 0, n
    left[:count, 3] += shown
    return count, begin


@njit(parallel=True, cache=True)
def visual_hull(tables, rotations, positions, lenses, cells, reach, occupied):  # type: ignore[no-untyped-def]
    """Count for each cell the views that contain it, unless its projection misses the mask in one of them.

    A view does not decide on cells that are behind it or not wholly in its frame. Cells on which none decides are left
    out. Most views decide alike on all cells of a block, and most of those outside are left out by the view that left
    out the one before.

    Args:
        tables: Summed-area tables of the masks, int32. (N, H + 1, W + 1)
        rotations: World-to-camera rotation in box axes. (N, 3, 3)
        positions: Camera positions in box coordinates. (N, 3)
        lenses: For each view the focal length in mask pixels (mask pixels per box unit if it is orthographic), column
            and row of the principal point in mask pixels, and 1 if it is orthographic, otherwise 0. (N, 4)
        cells: Cells per box unit.
        reach: Radius of a cell's bounding sphere in box units.
        occupied: Result, zeros, uint8: how many views contain the cell, at most
            :data:`svv.kernels.types.MOST_SEEN`. (X, Y, Z)
    """
    nx, ny, nz = occupied.shape
    at = (np.arange(max(nx, ny, nz)) + 0.5) / cells
    for x in prange(-(-nx // BLOCK)):
        begin, block, left = 0, np.empty(3, np.int64), np.empty((BLOCK**3, 4), np.int64)
        for y in range(-(-ny // BLOCK)):
            for z in range(-(-nz // BLOCK)):
                block[0], block[1], block[2] = BLOCK * x, BLOCK * y, BLOCK * z
                count = 0
                for i in range(BLOCK * x, min(BLOCK * (x + 1), nx)):
                    for j in range(BLOCK * y, min(BLOCK * (y + 1), ny)):
                        for k in range(BLOCK * z, min(BLOCK * (z + 1), nz)):
                            left[count, 0], left[count, 1], left[count, 2], left[count, 3] = i, j, k, 0
                            count += 1
                count, begin = _carve_block(
                    block, begin, cells, at, reach, tables, rotations, positions, lenses, left[:count]
                )
                for q in range(count):
                    occupied[left[q, 0], left[q, 1], left[q, 2]] = min(left[q, 3], MOST_SEEN)


@njit(parallel=True, cache=True)
def mark_unexplained(  # type: ignore[no-untyped-def]
    tables, rotations, positions, lenses, cells, counts, enough, marked
):
    """Mark cells that explain pixels which no cell that enough views contain explains.

    Rays run through visible pixels, about a cell apart in the middle of the box. Where none of a ray's cells is
    contained by ``enough`` views, those are marked that at least half as many views contain as any other of them.

    ``counts`` (X, Y, Z): how many views contain a cell, or 0, uint8: the largest of each cell and its neighbours;
    ``marked`` (X, Y, Z): result, zeros, uint8. The others are as for :func:`visual_hull`.
    """
    middle = np.array(counts.shape) / (2.0 * cells)
    for n in prange(tables.shape[0]):
        table, m, parallel = tables[n], rotations[n], lenses[n, 3] > 0.0
        focal, column, row = lenses[n, 0], lenses[n, 1], lenses[n, 2]
        away = 1.0 if parallel else math.sqrt(np.sum((positions[n] - middle) ** 2))
        stride = max(1, int(focal / (cells * max(away, 1.0 / cells))))
        origin, direction, cell = np.empty(3), np.empty(3), np.empty(3, np.int64)
        for y in range(stride // 2, table.shape[0] - 1, stride):
            for x in range(stride // 2, table.shape[1] - 1, stride):
                if table[y + 1, x + 1] - table[y, x + 1] - table[y + 1, x] + table[y, x] == 0:
                    continue
                u, v = (x + 0.5 - column) / focal, (row - y - 0.5) / focal
                for k in range(3):
                    across = m[0, k] * u + m[1, k] * v
                    origin[k] = positions[n, k] + (across if parallel else 0.0)
                    direction[k] = (0.0 if parallel else across) - m[2, k]
                start, steps, step = _within(origin, direction, counts.shape, cells)
                most = 0
                for i in range(steps):
                    _cell(origin, direction, start + (i + 0.5) * step, cells, counts.shape, cell)
                    most = max(most, counts[cell[0], cell[1], cell[2]])
                    if most >= enough:
                        break
                if most == 0 or most >= enough:
                    continue
                for i in range(steps):
                    _cell(origin, direction, start + (i + 0.5) * step, cells, counts.shape, cell)
                    if 2 * counts[cell[0], cell[1], cell[2]] >= most:
                        marked[cell[0], cell[1], cell[2]] = 1


@njit(cache=True)
def _within(origin, direction, shape, cells):  # type: ignore[no-untyped-def]
    """Return where a ray enters the box, and number and size of steps of at most half a cell to where it leaves it."""
    near, far, length = 0.0, np.inf, 0.0
    for k in range(3):
        length += direction[k] * direction[k]
        if abs(direction[k]) < 1e-12:
            if not 0.0 <= origin[k] * cells <= shape[k]:
                return 0.0, 0, 0.0
            continue
        a, b = -origin[k] / direction[k], (shape[k] / cells - origin[k]) / direction[k]
        near, far = max(near, min(a, b)), min(far, max(a, b))
    if not near < far:
        return 0.0, 0, 0.0
    steps = int(math.ceil((far - near) * math.sqrt(length) * cells * 2.0))
    return near, steps, (far - near) / steps


@njit(cache=True)
def _cell(origin, direction, t, cells, shape, cell):  # type: ignore[no-untyped-def]
    """Write the indices of the cell at a place of a ray."""
    for k in range(3):
        cell[k] = min(max(int((origin[k] + t * direction[k]) * cells), 0), shape[k] - 1)
