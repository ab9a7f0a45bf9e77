"""Operations on the occupied cells of the box: the reference for the kernels. Letters: (X, Y, Z) cells."""

from __future__ import annotations

import itertools

import numpy as np
import torch
from torch import Tensor

FARTHEST_LEAP = 255
"""The longest leap, in cells: what a byte holds."""


def leaps(occupied: Tensor) -> Tensor:
    """Return how far a ray may leap in each octant: the chessboard distance to the nearest occupied cell there.

    The octant 4 a + 2 b + c of a cell holds the cells that a ray reaches whose direction is negative along x, y or z
    where a, b or c is 1. A ray that only approaches a surface from the side is not held up by cells behind it: it needs
    half as many leaps as with one distance for all directions (cf. Deakin & Knoll 2019). (X, Y, Z) uint8 on the CPU ->
    (8, X, Y, Z) uint8: 0 in occupied cells, 255 where the octant holds none within 255 cells.
    """
    sides = list(itertools.product((1, -1), repeat=3))
    there = np.stack([occupied.numpy()[::a, ::b, ::c] > 0 for a, b, c in sides])
    _, x, y, z = there.shape
    found = np.full((8, x + 1, y + 1, z + 1), FARTHEST_LEAP, np.int64)  # beyond the box is nothing
    number = np.arange(z)
    for i, j in itertools.product(reversed(range(x)), reversed(range(y))):
        rows = np.stack([found[:, i + 1, j], found[:, i, j + 1], found[:, i + 1, j + 1]]).min(axis=0)
        beside = 1 + np.minimum(rows[:, :-1], rows[:, 1:])
        own = np.where(there[:, i, j], 0, beside) + number
        found[:, i, j, :-1] = np.minimum.accumulate(own[:, ::-1], axis=1)[:, ::-1] - number
    near = found[:, :-1, :-1, :-1].clip(max=FARTHEST_LEAP).astype(np.uint8)
    return torch.from_numpy(np.stack([one[::a, ::b, ::c] for one, (a, b, c) in zip(near, sides, strict=True)]))


def widened(chosen: Tensor) -> Tensor:
    """Add the 26 neighbours of each chosen cell. (X, Y, Z) bool -> (X, Y, Z) bool"""
    for axis, length in enumerate(chosen.shape):
        before, after = chosen.narrow(axis, 0, length - 1), chosen.narrow(axis, 1, length - 1)
        chosen = chosen.clone()
        chosen.narrow(axis, 1, length - 1).logical_or_(before)
        chosen.narrow(axis, 0, length - 1).logical_or_(after)
    return chosen
