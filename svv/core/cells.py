"""Cells of the box: the references for what is asked of the occupied ones. Letters: (X, Y, Z) cells."""

from __future__ import annotations

import numpy as np
import torch
from scipy.ndimage import distance_transform_cdt
from torch import Tensor


def leaps(occupied: Tensor) -> Tensor:
    """How far a ray may leap: 0 in occupied cells, else the chessboard distance to the nearest, at most 255.

    Args:
        occupied: uint8, on the CPU. (X, Y, Z)

    Returns:
        uint8; 255 everywhere if no cell is occupied. (X, Y, Z)
    """
    if not occupied.any():
        return torch.full_like(occupied, 255)
    distance = distance_transform_cdt(occupied.numpy() == 0, metric="chessboard")
    return torch.from_numpy(distance.clip(0, 255).astype(np.uint8))


def widened(chosen: Tensor) -> Tensor:
    """Chosen cells and their 26 neighbours. (X, Y, Z) bool -> (X, Y, Z) bool"""
    for axis, length in enumerate(chosen.shape):
        before, after = chosen.narrow(axis, 0, length - 1), chosen.narrow(axis, 1, length - 1)
        chosen = chosen.clone()
        chosen.narrow(axis, 1, length - 1).logical_or_(before)
        chosen.narrow(axis, 0, length - 1).logical_or_(after)
    return chosen
