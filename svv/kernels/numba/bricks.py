"""A lattice's values in bricks, from which an image reads them faster than from the sparse table; compiled with numba.

In the sparse table, the eight corners of a cell take four look-ups in the index, each followed by one of the values. A
brick holds all vertices of 8 x 8 x 8 cells next to each other (3 kB), so the rays of a tile find them in the first
level of the cache. The values are the same numbers.

Letters: V vertices, B bricks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary

from svv.kernels.numba.trilinear import row_at
from svv.kernels.types import Lattice, Limits

CELLS = 8
"""Cells along each side of a brick; a power of two that divides the 32 vertices of a word of the index."""

SIDE, PLANE = CELLS + 1, (CELLS + 1) ** 2
"""Distance in memory of the neighbours in y and in x; the neighbour in z comes next."""

VERTICES = (CELLS + 1) ** 3
"""Vertices of a brick; those on its faces are in the neighbouring bricks, too."""

SHIFT, MASK = np.int32(3), np.int32(CELLS - 1)
"""Bits of a vertex's number within its brick, as a shift and as a mask."""

RAYS_FIRST = 1 << 15
"""Rays that are marched without bricks before they are worth making: as long as making them takes (0.02 s of one
core for the head's 8,903 bricks, which save 0.7 microseconds of each ray)."""

MOST_ROOM = 4
"""Values in the bricks per value in the table above which memory is not spent on bricks; usual are 2.0 to 2.4."""


@dataclass
class _Known:
    """What is known of a table: its version, the rays marched through it so far, and its bricks if they were made."""

    version: int
    rays: int = 0
    bricks: tuple[NDArray[np.int32], NDArray[np.float32]] | None = None


NO_BRICKS = np.zeros((0, 0, 0), np.int32), np.zeros(0, np.float32)
"""Stands for bricks that do not exist."""

_KNOWN = WeakTensorKeyDictionary()


@njit(cache=True)
def _number(shape, index, slots):  # type: ignore[no-untyped-def]
    """Number the bricks in which a vertex is stored, in ``slots``; returns how many there are."""
    words = (shape[2] + 31) >> 5
    count = 0
    for bx in range(slots.shape[0]):
        for by in range(slots.shape[1]):
            for bz in range(slots.shape[2]):
                found = np.uint64(0)
                for x in range(bx * CELLS, min((bx + 1) * CELLS, shape[0])):
                    for y in range(by * CELLS, min((by + 1) * CELLS, shape[1])):
                        word = np.uint64(index[(x * shape[1] + y) * words + ((bz * CELLS) >> 5)])
                        found |= (word >> np.uint64((bz * CELLS) & 31)) & np.uint64((1 << CELLS) - 1)
                slots[bx, by, bz] = count if found else -1
                count += found != 0
    return count


@njit(parallel=True, cache=True)
def _fill(shape, index, table, slots, values):  # type: ignore[no-untyped-def]
    """Copy the stored vertices of all bricks to ``values``, and make every brick without any the first one."""
    words, last = (shape[2] + 31) >> 5, np.uint64(len(table) - 1)
    for bx in prange(slots.shape[0]):
        for by in range(slots.shape[1]):
            for bz in range(slots.shape[2]):
                slot = slots[bx, by, bz]
                if slot < 0:
                    slots[bx, by, bz] = 0
                    continue
                at = slot * VERTICES
                for x in range(bx * CELLS, (bx + 1) * CELLS + 1):
                    for y in range(by * CELLS, (by + 1) * CELLS + 1):
                        for z in range(bz * CELLS, (bz + 1) * CELLS + 1):
                            if x < shape[0] and y < shape[1] and z < shape[2]:
                                word = index[(x * shape[1] + y) * words + (z >> 5)]
                                before = (np.uint64(1) << np.uint64(z & 31)) - np.uint64(1)
                                if (np.uint64(word) >> np.uint64(z & 31)) & np.uint64(1):
                                    values[at] = table[row_at(word, before, last)]
                            at += 1


def made(where: Lattice, table: NDArray[np.float32], most_room: float) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Return slots and values of the bricks of a lattice of one level; none if they would take too much memory.

    ``table`` (V,): its values; ``most_room``: most values in the bricks per value in the table. Slots are of each brick
    (bricks along x, y, z), values (B * VERTICES,); a vertex that is not stored has 0.
    """
    shape, index = where.shapes[0].numpy(), where.index.numpy()
    slots = np.empty([-(-(n - 1) // CELLS) for n in shape], np.int32)
    count = _number(shape, index, slots)
    if not 0 < count * VERTICES <= min(most_room * len(table), np.iinfo(np.int32).max):  # places are int32
        return NO_BRICKS
    values = np.zeros(count * VERTICES, np.float32)
    _fill(shape, index, table, slots, values)
    return slots, values


def bricks_for(
    where: Lattice, table: Tensor, limits: Limits, rays: int
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Return the bricks through which rays of an image are marched, made when enough rays have been.

    They are kept until the table, log extinction (V, 1), changes or is no longer used. There are none where they would
    be of no use: in training, for several levels, for a few rays.
    """
    if not limits.merge or table.requires_grad or len(where.scales) != 1 or table.is_inference():
        return NO_BRICKS
    known = _KNOWN.get(table)
    if known is None or known.version != table._version:
        known = _KNOWN[table] = _Known(table._version)
    known.rays += rays
    if known.bricks is None and known.rays > RAYS_FIRST:
        known.bricks = made(where, table.detach().numpy()[:, 0], MOST_ROOM)
    return known.bricks or NO_BRICKS
