"""Extinction as a function of a volume's values, while it is learned (:mod:`svv.fields.radiance.of_values`)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.core.volumes.classified import ValueGrid
from svv.fields.radiance.of_values import SLOPE_RANGE, SLOPES, VALUES, Places, looked_up

BETAS = 0.9, 0.99
"""Decay rates of Adam's moments."""


def mean_extinction(integral: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the mean extinction over the values within half a cell, for each value and slope. (VALUES, SLOPES)

    ``integral`` is that of the extinction up to evenly spaced values (pre-integration, Engel et al. 2001).
    """
    value = np.linspace(0.0, 1.0, VALUES)[:, None]
    half = 0.5 * np.geomspace(*SLOPE_RANGE, SLOPES)[None]
    low, high = np.clip(value - half, 0.0, 1.0), np.clip(value + half, 0.0, 1.0)
    known = np.linspace(0.0, 1.0, len(integral))
    return np.asarray((np.interp(high, known, integral) - np.interp(low, known, integral)) / (high - low))


class ExtinctionTable:
    """Logarithm of the extinction for each value and slope, and its optimiser (Adam)."""

    def __init__(self, grid: ValueGrid, device: torch.device) -> None:
        """Start from the grid's :func:`mean_extinction`."""
        assert grid.integral is not None
        least, most = np.exp([EMPTY_LOG_EXTINCTION, MOST_LOG_EXTINCTION])
        start = np.log(np.clip(mean_extinction(grid.integral), least, most)).ravel()
        self.table = torch.tensor(start, dtype=torch.float32, device=device)
        self.moments = torch.zeros(2, len(self.table), device=device)
        self.age = 0

    def step(self, gradient: Tensor, places: Places, rate: float) -> None:
        """Take one step against the gradient of the logarithms at V vertices. (V,)"""
        each = gradient[places.inside, None] * places.weight
        total = torch.zeros_like(self.table).index_add_(0, places.row.reshape(-1), each.reshape(-1))
        self.age += 1
        first, second = self.moments
        first.mul_(BETAS[0]).add_(total, alpha=1.0 - BETAS[0])
        second.mul_(BETAS[1]).addcmul_(total, total, value=1.0 - BETAS[1])
        mean, square = first / (1.0 - BETAS[0] ** self.age), second / (1.0 - BETAS[1] ** self.age)
        self.table -= rate * mean / (square.sqrt() + 1e-12)

    def at(self, places: Places) -> Tensor:
        """Return the logarithms at V vertices. (V,)"""
        return looked_up(self.table, places)
