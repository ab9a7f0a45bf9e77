"""Visual hull from alpha masks, compiled with numba."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(parallel=True, cache=True)
def visual_hull(tables, rotations, positions, lenses, cells, shape, reach, occupied):  # type: ignore[no-untyped-def]
    """Keep the cells whose projection meets the mask in every view that contains them.

    A view does not decide on cells that are behind it or not wholly in its frame. Cells on which none decides are left
    out.

    Args:
        tables: Summed-area tables of the masks, int32. (N, H + 1, W + 1)
        rotations: World-to-camera rotation in box axes. (N, 3, 3)
        positions: Camera positions in box coordinates. (N, 3)
        lenses: For each view the focal length in mask pixels (mask pixels per box unit if it is orthographic), column
            and row of the principal point in mask pixels, and 1 if it is orthographic, otherwise 0. (N, 4)
        cells: Cells per box unit.
        shape: Cells per axis. (3,)
        reach: Radius of a cell's bounding sphere in box units.
        occupied: Result, uint8. (X, Y, Z)
    """
    views, height, width = tables.shape[0], tables.shape[1] - 1, tables.shape[2] - 1
    for i in prange(shape[0]):
        for j in range(shape[1]):
            for k in range(shape[2]):
                inside, seen = True, False
                for n in range(views):
                    dx = (i + 0.5) / cells - positions[n, 0]
                    dy = (j + 0.5) / cells - positions[n, 1]
                    dz = (k + 0.5) / cells - positions[n, 2]
                    z = -(rotations[n, 2, 0] * dx + rotations[n, 2, 1] * dy + rotations[n, 2, 2] * dz)
                    if z <= 2 * reach:
                        continue
                    focal, parallel = lenses[n, 0], lenses[n, 3] > 0.0
                    d = 1.0 if parallel else z
                    u = (rotations[n, 0, 0] * dx + rotations[n, 0, 1] * dy + rotations[n, 0, 2] * dz) / d
                    v = (rotations[n, 1, 0] * dx + rotations[n, 1, 1] * dy + rotations[n, 1, 2] * dz) / d
                    px, py = u * focal + lenses[n, 1], lenses[n, 2] - v * focal
                    slant = 1.0 if parallel else np.sqrt(1.0 + u * u + v * v)
                    r = reach * focal / d * slant + 0.5
                    x0, x1 = int(np.floor(px - r)), int(np.ceil(px + r))
                    y0, y1 = int(np.floor(py - r)), int(np.ceil(py + r))
                    if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
                        continue  # the view's frame cuts the cell, so the view does not decide
                    seen = True
                    t = tables[n]
                    if t[y1, x1] - t[y0, x1] - t[y1, x0] + t[y0, x0] == 0:
                        inside = False
                        break
                occupied[i, j, k] = 1 if inside and seen else 0
