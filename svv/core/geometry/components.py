"""Connected parts of what is visible in a grid of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEAST_PART = 1e-3
"""Size of a piece, as a fraction of the cells that are looked at, below which it is dust: it belongs to the nearest
larger piece, unless it is the one that is asked for."""

TOUCHING = np.ones((3, 3, 3), bool)
"""Cells that share a face, an edge or a corner are connected: sheets and wires one cell thick do not fall apart."""


def least_opacity(opacity: NDArray[np.float32], level: float) -> float:
    """Return the opacity from which a region's cells connect: ``level`` in [0, 1] times its mean opacity.

    Each cell counts by its ``opacity`` in [0, 1] (N,), so haze, which fills most cells, hardly matters.
    """
    total = float(opacity.sum(dtype=np.float64))
    return level * float(np.square(opacity, dtype=np.float64).sum()) / max(total, 1e-12)


def pieces(visible: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the connected piece of each cell, 0 where nothing is visible (X, Y, Z), and the sizes of pieces (K + 1,).

    The size of piece 0 is 0.
    """
    from scipy.ndimage import label

    labels, _ = label(visible, TOUCHING)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return labels.astype(np.int32, copy=False), sizes


def nearest_piece(labels: NDArray[np.int32], place: NDArray[np.float64]) -> tuple[int, float]:
    """Return the piece with the cell nearest to a place, and the distance to its centre; 0 and infinity for none.

    ``labels`` (X, Y, Z): piece of each cell, 0 for none. Lengths are in cells; the first cell's centre is at 0.5.
    """
    there = np.argwhere(labels)
    if not len(there):
        return 0, np.inf
    distance = np.linalg.norm(there + 0.5 - place, axis=1)
    first = int(distance.argmin())
    return int(labels[tuple(there[first])]), float(distance[first])


def large(sizes: NDArray[np.int64], asked: int) -> NDArray[np.bool_]:
    """Return which pieces are no dust, the one that is asked for always among them, from the sizes of all. (K + 1,)"""
    found = sizes >= max(1.0, LEAST_PART * float(sizes.sum()))
    found[0], found[asked] = False, True
    return found
