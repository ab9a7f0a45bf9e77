"""Operations on the occupied cells of the box: the reference for the kernels. Letters: (X, Y, Z) cells."""

from __future__ import annotations

import numpy as np
import torch
from scipy.ndimage import distance_transform_cdt
from torch import Tensor


def leaps(occupied: Tensor) -> Tensor:
    """Return how far a ray may leap: the chessboard distance to the nearest occupied cell, at most 255.

    Args:
        occupied: uint8, on the CPU. (X, Y, Z)

    Returns:
        uint8; 0 in occupied cells, 255 everywhere if no cell is occupied. (X, Y, Z)
    """
    if not occupied.any():
        return torch.full_like(occupied, 255)
    distance = distance_transform_cdt(occupied.numpy() == 0, metric="chessboard")
    return torch.from_numpy(distance.clip(0, 255).astype(np.uint8))


def widened(chosen: Tensor) -> Tensor:
    """Add the 26 neighbours of each chosen cell. (X, Y, Z) bool -> (X, Y, Z) bool"""
    for axis, length in enumerate(chosen.shape):
        before, after = chosen.narrow(axis, 0, length - 1), chosen.narrow(axis, 1, length - 1)
        chosen = chosen.clone()
        chosen.narrow(axis, 1, length - 1).logical_or_(before)
        chosen.narrow(axis, 0, length - 1).logical_or_(after)
    return chosen
