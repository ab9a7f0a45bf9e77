"""Palette shares of pixels, used when no volume determines the regions: how much of the light each colour contributes.

Of similar hues, and of more than three colours, the weights of eq. 4 (StyleRF-VolVis) choose by chance. Pixels resolve
this: a pure one is a shade of a single colour. Letters: R rays, P colours, G of them in one mixture, N mixtures.
"""

from __future__ import annotations

import itertools

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

HIGHLIGHT = 0.5
"""Weight of a pixel's squared grey light relative to the squared error: pure colours are preferred to highlights."""

PLAIN = 0.02
"""Decrease of the RGB error from which a second colour counts as part of a pixel."""


class Unmixing:
    """Decomposes pixels by a palette: c = sum_i a_i P_i + b (1, 1, 1) with a, b >= 0 and at most two a_i above 0."""

    def __init__(self, palette: NDArray[np.floating], device: torch.device) -> None:
        """Prepare all mixtures of one or two colours of ``palette``, RGB in [0, 1]. (P, 3)"""
        colours = np.asarray(palette, np.float64)
        self._count = len(colours)
        groups = [g for size in (1, 2) for g in itertools.combinations(range(len(colours)), size)]
        solvers, mixes, places, costs = [], [], [], []
        for group in groups:
            for lit in (False, True):
                # Unknowns a, a' and b; the column of an unused one is 0, and so is its solution.
                matrix = np.zeros((3, 3))
                matrix[:, : len(group)] = colours[list(group)].T
                matrix[:, 2] = float(lit)
                ridge = np.diag([1e-9, 1e-9, HIGHLIGHT if lit else 1e-9])
                solvers.append(np.linalg.solve(matrix.T @ matrix + ridge, matrix.T))
                mixes.append(matrix)
                places.append((group[0], group[-1]))
                costs.append(PLAIN**2 * (len(group) - 1))
        self._solvers, self._mixes, self._costs = (
            torch.as_tensor(np.array(a), dtype=torch.float32, device=device) for a in (solvers, mixes, costs)
        )
        self._places = torch.as_tensor(places, device=device)  # (N, 2)

    def shares(self, colour: Tensor) -> Tensor:
        """Return each palette colour's share of a pixel's coloured light; 0 if it has none. (R, 3) -> (R, P)"""
        found = torch.einsum("nij,rj->nri", self._solvers, colour)  # (N, R, 3): a, a', b
        error = torch.einsum("nij,nrj->nri", self._mixes, found) - colour
        cost = error.square().sum(2) + HIGHLIGHT * found[..., 2].square() + self._costs[:, None]
        cost = cost.masked_fill((found < -1e-4).any(dim=2), torch.inf)
        best = cost.argmin(dim=0)  # (R,)
        rows = torch.arange(len(colour), device=colour.device)
        amount, place = found[best, rows, :2].clamp_min(0.0), self._places[best]
        amount[:, 1] = torch.where(place[:, 0] == place[:, 1], 0.0, amount[:, 1])
        shares = colour.new_zeros(len(colour), self._count).scatter_add_(1, place, amount)
        total = shares.sum(dim=1, keepdim=True)
        return torch.where(total > 1e-6, shares / total.clamp_min(1e-6), 0.0)
