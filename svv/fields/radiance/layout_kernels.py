"""Which vertices of a sparse lattice are stored, and in which rows, compiled with numba.

Letters: (X, Y, Z) cells, W words of the index (:func:`svv.core.rays.encodings.stored_rows`), V vertices, L levels.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.kernels.numba.trilinear import ONE32, ones_in

BITS, STORED, ONE = np.int64(32), np.int64(0xFFFFFFFF), np.uint64(1)
"""Bits of a word that say which vertices are stored, as a number and as a mask."""


@njit(cache=True)
def _any_of(cells, x0, x1, y0, y1, row):  # type: ignore[no-untyped-def]
    """Write which cells (Z,) are occupied in any of some rows along z; return whether one is."""
    row[:] = 0
    for x in range(x0, x1):
        for y in range(y0, y1):
            for z in range(row.shape[0]):
                row[z] |= cells[x, y, z]
    found = np.uint8(0)
    for z in range(row.shape[0]):
        found |= row[z]
    return found > 0


@njit(parallel=True, cache=True)
def coarser(cells, side, out):  # type: ignore[no-untyped-def]
    """Mark the cells that are ``side`` times as long as others (X, Y, Z) if any of their parts is occupied.

    ``out``: result, zeros, uint8. (X / side, Y / side, Z / side), rounded up
    """
    nx, ny, nz = cells.shape
    for x in prange(out.shape[0]):
        row = np.empty(nz, np.uint8)
        for y in range(out.shape[1]):
            if _any_of(cells, side * x, min(side * (x + 1), nx), side * y, min(side * (y + 1), ny), row):
                for z in range(nz):
                    if row[z]:
                        out[x, y, z // side] = 1


@njit(parallel=True, cache=True)
def lay_out(cells, parts, first, words):  # type: ignore[no-untyped-def]
    """Write the words of the vertices of occupied cells (X, Y, Z), and return the number of these vertices.

    Each cell consists of ``parts`` of the lattice's cells along each side; ``first``: row of the first vertex;
    ``words``: result, zeros, int64. (parts X + 1, parts Y + 1, W)
    """
    nx, ny, nz = cells.shape
    counts = np.zeros(words.shape[0] + 1, np.int64)
    for x in prange(words.shape[0]):
        row, count = np.empty(nz, np.uint8), np.int64(0)
        x0, x1 = max(x - 1, 0) // parts, min(x // parts, nx - 1) + 1
        for y in range(words.shape[1]):
            if _any_of(cells, x0, x1, max(y - 1, 0) // parts, min(y // parts, ny - 1) + 1, row):
                for z in range(nz):
                    if row[z]:
                        for vertex in range(parts * z, parts * (z + 1) + 1):
                            words[x, y, vertex >> 5] |= np.int64(1) << (vertex & 31)
                for w in range(words.shape[2]):
                    count += np.int64(ones_in(np.uint64(words[x, y, w])))
        counts[x + 1] = count
    for x in range(words.shape[0]):
        counts[x + 1] += counts[x]
    for x in prange(words.shape[0]):
        row_of_next = first + counts[x]
        for y in range(words.shape[1]):
            for w in range(words.shape[2]):
                stored = words[x, y, w]
                words[x, y, w] = row_of_next << BITS | stored
                row_of_next += np.int64(ones_in(np.uint64(stored)))
    return counts[-1]


@njit(parallel=True, cache=True)
def vertices_in(words, first, out):  # type: ignore[no-untyped-def]
    """Write the coordinates (V, 3) of the vertices in rows from ``first`` on, from a level's words (X, Y, W)."""
    planes, last = words.shape[0], first + out.shape[0]
    for x in prange(planes):
        if words[x, 0, 0] >> BITS >= last or (x + 1 < planes and words[x + 1, 0, 0] >> BITS <= first):
            continue
        for y in range(words.shape[1]):
            for w in range(words.shape[2]):
                row, stored = words[x, y, w] >> BITS, words[x, y, w] & STORED
                z = 32 * w
                while stored:
                    if stored & 1:
                        if first <= row < last:
                            out[row - first, 0], out[row - first, 1], out[row - first, 2] = x, y, z
                        row += 1
                    stored >>= 1
                    z += 1


@njit(parallel=True, cache=True)
def into_cells(cells, parts, vertices, ahead, behind, out):  # type: ignore[no-untyped-def]
    """Write places of vertices a little within an occupied cell: of the eight around each, the first from the far end.

    ``parts``: as in :func:`lay_out`; ``ahead`` and ``behind``: place for each coordinate along an axis, a little
    towards the next, and towards the one before. Numbers are float32; ``out``: (V, 3).
    """
    nx, ny, nz = cells.shape
    for v in prange(vertices.shape[0]):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        found = 0
        for corner in range(8):
            i, j, k = x - (corner >> 2), y - (corner >> 1 & 1), z - (corner & 1)
            if i < 0 or j < 0 or k < 0 or i >= nx * parts or j >= ny * parts or k >= nz * parts:
                continue
            if cells[i // parts, j // parts, k // parts]:
                found = corner
                break
        out[v, 0] = behind[x] if found & 4 else ahead[x]
        out[v, 1] = behind[y] if found & 2 else ahead[y]
        out[v, 2] = behind[z] if found & 1 else ahead[z]


@njit(parallel=True, cache=True)
def rows_left(before, after, out):  # type: ignore[no-untyped-def]
    """Write the row that each vertex had before (V,), and return how many had none, by words (W,) before and after."""
    missing = np.int64(0)
    for w in prange(before.shape[0]):
        old, left = np.uint64(before[w] & STORED), np.uint64(after[w] & STORED)
        missing += np.int64(ones_in(left & ~old))
        row = after[w] >> BITS
        while left:
            rest = left & (left - ONE)
            behind = (left ^ rest) - ONE  # the vertices before the lowest one that is left
            out[row] = (before[w] >> BITS) + np.int64(ones_in(old & behind))
            left, row = rest, row + 1
    return missing


@njit(parallel=True, cache=True)
def sum_levels(words, shapes, steps, bases, index, table, out):  # type: ignore[no-untyped-def]
    """Write the sum of all levels of a lattice at vertices of the finest, ``out``, zeros, float32. (V of ``words``, F)

    ``words`` (X, Y, W): those of the vertices, whose first row is 0; ``steps`` (L,): cells of the finest level along a
    cell of each; ``shapes``, ``bases``, ``index`` and ``table``: see :class:`svv.kernels.types.Lattice`.
    """
    for x in prange(words.shape[0]):
        for y in range(words.shape[1]):
            for z in range(32 * words.shape[2]):
                word = words[x, y, z >> 5]
                if not word >> (z & 31) & 1:
                    continue
                row = (word >> BITS) + np.int64(ones_in(np.uint64(word & ((1 << (z & 31)) - 1))))
                for level in range(shapes.shape[0]):
                    _add_level(x, y, z, shapes[level], steps[level], index[bases[level] :], table, out[row])


@njit(cache=True)
def _add_level(x, y, z, shape, step, index, table, out):  # type: ignore[no-untyped-def]
    """Add a level's features at a vertex of the finest level to ``out`` (F,)."""
    part = np.float64(1.0) / step
    wx, wy, wz = np.float32((x % step) * part), np.float32((y % step) * part), np.float32((z % step) * part)
    words = (shape[2] + 31) >> 5
    for corner in range(8):
        i, j, k = corner >> 2, corner >> 1 & 1, corner & 1
        weight = (wx if i else ONE32 - wx) * (wy if j else ONE32 - wy) * (wz if k else ONE32 - wz)
        if weight > 0.0:  # others may lie beyond the lattice
            at = z // step + k
            word = index[((x // step + i) * shape[1] + y // step + j) * words + (at >> 5)]
            row = (word >> BITS) + np.int64(ones_in(np.uint64(word & ((1 << (at & 31)) - 1))))
            for f in range(out.shape[0]):
                out[f] += weight * table[row, f]


@njit(parallel=True, cache=True)
def largest_in_cells(corners, parts, shape, index, table, out):  # type: ignore[no-untyped-def]
    """Write the largest value at the vertices of occupied cells (C, 3), for a lattice of one level and feature.

    ``parts``: as in :func:`lay_out`; ``shape`` (3,), ``index`` (W,) and ``table`` (V, 1): see
    :class:`svv.kernels.types.Lattice`; ``out``: result, float32. (C,)
    """
    words = (shape[2] + 31) >> 5
    for c in prange(corners.shape[0]):
        z, largest = parts * corners[c, 2], np.float32(-np.inf)
        for x in range(parts * corners[c, 0], parts * (corners[c, 0] + 1) + 1):
            for y in range(parts * corners[c, 1], parts * (corners[c, 1] + 1) + 1):
                word = index[(x * shape[1] + y) * words + (z >> 5)]
                row = (word >> BITS) + np.int64(ones_in(np.uint64(word & ((1 << (z & 31)) - 1))))
                for k in range(parts + 1):
                    largest = max(largest, table[row + k, 0])
        out[c] = largest
