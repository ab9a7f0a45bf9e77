"""A lattice's values in bricks, from which an image reads them faster than from the sparse table; compiled with numba.

In the sparse table, the eight corners of a cell take four look-ups in the index, each followed by one of the values. A
brick holds all vertices of 8 x 8 x 8 cells next to each other, so the rays of a tile find them in the first level of
the cache. The values are the same numbers. Those of a scene's file are 256 levels
(:meth:`svv.fields.radiance.encodings.SparseLattice.packed`): for an image, bricks hold the numbers of these, a byte
each, because more of them fit into the caches (.7 of a march's time).

Letters: V vertices, B bricks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.kernels.numba.trilinear import row_at
from svv.kernels.types import Lattice, Limits

Values = NDArray[np.uint8] | NDArray[np.float32]
"""Values, or the numbers of levels that stand for them."""

CELLS = 8
"""Cells along each side of a brick; a power of two that divides the 32 vertices of a word of the index."""

SIDE, PLANE = CELLS + 1, (CELLS + 1) ** 2
"""Distance in memory of the neighbours in y and in x; the neighbour in z comes next."""

VERTICES = (CELLS + 1) ** 3
"""Vertices of a brick; those on its faces are in the neighbouring bricks, too."""

SHIFT, MASK = np.int32(3), np.int32(CELLS - 1)
"""Bits of a vertex's number within its brick, as a shift and as a mask."""

LEVELS = 255
"""The number of the highest level."""

NEAR = np.float32(1e-3)
"""Largest distance of a value from its level, in levels, for it to be the level's: float32 leaves a tenth of that at
most."""

MOST_ROOM = 4
"""Values in the bricks per value in the table above which memory is not spent on bricks; usual are 2.0 to 2.4."""


class Bricks(NamedTuple):
    """Bricks of a lattice's values, which are ``low + level * codes``; see :func:`made` for their order."""

    slots: NDArray[np.int32]
    """Number of each brick, of those along x, y and z."""
    codes: Values
    """Numbers of levels; or the values themselves if they are others, with a ``low`` of 0 and a ``level`` of 1."""
    low: np.float32
    """The lowest level."""
    level: np.float32
    """Distance of the levels."""


@dataclass
class _Known:
    """What is known of a table: its version, and its bricks."""

    version: int
    bricks: Bricks


NO_VALUES = np.zeros((0, 0, 0), np.int32), np.zeros(0, np.float32)
"""Stands for bricks that do not exist, as :func:`made` returns them."""

NO_BRICKS = Bricks(NO_VALUES[0], np.zeros(0, np.uint8), np.float32(0.0), np.float32(1.0))
"""The same for images."""

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


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def _number_levels(table, low, rate, codes):  # type: ignore[no-untyped-def]
    """Write to ``codes`` the nearest levels of values, ``rate`` levels in one; returns the largest distance from them.

    All three arrays are (V,); distances are in levels.
    """
    farthest = np.float32(0.0)
    for k in prange(len(table)):
        place = (table[k] - low) * rate
        code = np.uint8(place + np.float32(0.5))
        codes[k] = code
        farthest = max(farthest, abs(place - np.float32(code)))
    return farthest


def coded(table: NDArray[np.float32]) -> tuple[Values, np.float32, np.float32]:
    """Return a table (V,) as numbers of levels, the lowest level, and their distance, which is in the table's unit.

    Levels lie between the lowest and the highest value. The table itself, 0 and 1 are returned if it has other values.

    >>> coded(np.float32([0.0, 1.0, 510.0]))
    (array([  0.,   1., 510.], dtype=float32), np.float32(0.0), np.float32(1.0))
    >>> coded(np.float32([0.0, 2.0, 510.0]))
    (array([  0,   1, 255], dtype=uint8), np.float32(0.0), np.float32(2.0))
    """
    low, high = np.float32(table.min()), np.float32(table.max())
    level = (high - low) / np.float32(LEVELS)
    if np.isfinite(level) and level > 0.0:
        codes = np.empty(len(table), np.uint8)
        if _number_levels(table, low, np.float32(1.0) / level, codes) < NEAR:
            return codes, low, level
    return table, NO_BRICKS.low, NO_BRICKS.level


def made(where: Lattice, table: Values, most_room: float) -> tuple[NDArray[np.int32], Values]:
    """Return slots and values of the bricks of a lattice of one level; none if they would take too much memory.

    ``table`` (V,): its values or their codes; ``most_room``: most values in the bricks per value in the table. Slots
    are of each brick (bricks along x, y, z), values (B * VERTICES,); a vertex that is not stored has 0.
    """
    shape, index = where.shapes[0].numpy(), where.index.numpy()
    slots = np.empty([-(-(n - 1) // CELLS) for n in shape], np.int32)
    count = _number(shape, index, slots)
    if not 0 < count * VERTICES <= min(most_room * len(table), np.iinfo(np.int32).max):  # places are int32
        return NO_VALUES[0], table[:0]
    values = np.zeros(count * VERTICES, table.dtype)
    _fill(shape, index, table, slots, values)
    return slots, values


def keep_bricks(where: Lattice, table: Tensor, most_room: float) -> Bricks:
    """Make the bricks of a lattice of one level, and keep them for its table, log extinction (V, 1), as it is now.

    ``most_room``: most values in them per value in the table; with more, there are none.
    """
    codes, low, level = coded(table.detach().numpy()[:, 0])
    slots, codes = made(where, codes, most_room)
    bricks = Bricks(slots, codes, low, level) if slots.size > 0 else NO_BRICKS
    _KNOWN[table] = _Known(table._version, bricks=bricks)
    return bricks


def bricks_for(where: Lattice, table: Tensor, limits: Limits) -> Bricks:
    """Return the bricks through which rays of an image are marched, made for the first of them.

    With bricks, the last bits of an image are others, so it must not depend on what was drawn before. They are kept
    until the table, log extinction (V, 1), changes or is no longer used. There are none where they would be of no use:
    in training, for several levels.
    """
    if not limits.merge or table.requires_grad or len(where.scales) != 1 or table.is_inference():
        return NO_BRICKS
    known = _KNOWN.get(table)
    if known is None or known.version != table._version:
        return keep_bricks(where, table, MOST_ROOM)
    return known.bricks
