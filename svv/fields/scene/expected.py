"""The errors that a scene's pictures are expected to have, as its file keeps them: a coarse grid, and what edges add.

:mod:`svv.train.expected_errors` learns them, :mod:`svv.fields.scene.doubt` shows them. Letters: S samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.json_values import number_in, object_in, vector_in, whole_in
from svv.core.volumes.classified import grid_shape
from svv.fields.radiance.occupancy import Occupancy

CELLS = 32
"""Cells per box unit of the grid of expected errors: with 64, it ranks the errors of unseen views no better."""

LEVELS = 255.0
"""Largest level of the grid; errors are squares of levels, so that small ones are told apart as well."""


@dataclass(frozen=True)
class ExpectedErrors:
    """What the errors of a scene's pictures are expected to be; errors are mean differences of RGB on white, in [0, 1].

    ``level`` (X, Y, Z) uint8 are square roots of the errors of cells, 255 for the largest, ``most``.
    """

    level: NDArray[np.uint8]
    most: float
    edge: float
    """Part of the difference of neighbouring pixels that is added, in pixels of the training views, >= 0."""
    mean: float
    """Mean error over what the training views show of the scene."""
    worst: float
    """Mean error around ``place``, where it is largest."""
    place: tuple[float, float, float]
    """The place, in world units."""

    def of(self, position: Tensor) -> Tensor:
        """Return the errors of samples at box coordinates (S, 3), interpolated between the middles of cells. (S,)"""
        grid = torch.from_numpy(self.level).to(position.device).float().div_(LEVELS).square_().mul_(self.most)
        if not len(position):
            return position[:, 0]
        size = position.new_tensor(self.level.shape)
        at = (2.0 * CELLS / size * position - 1.0).flip(1)[None, None, None]  # the last coordinate is the fastest
        found = torch.nn.functional.grid_sample(grid[None, None], at, padding_mode="border", align_corners=False)
        return found.view(-1)

    def to_json(self) -> dict[str, Any]:
        """Return the numbers, without ``level``."""
        return {name: getattr(self, name) for name in ("most", "edge", "mean", "worst", "place")} | {"cells": CELLS}

    @classmethod
    def from_file(cls, told: object, level: NDArray[np.generic], occupancy: Occupancy) -> ExpectedErrors:
        """Invert :meth:`to_json`; raises KeyError, TypeError or ValueError if the content does not fit the scene."""
        content = object_in(told, "expected")
        shape = grid_shape(occupancy.box, CELLS)
        if level.dtype != np.uint8 or level.shape != tuple(shape) or whole_in(content["cells"], "cells") != CELLS:
            raise ValueError("the grid of expected errors does not fit the box")
        most, edge, mean, worst = (float(number_in(content[k], k)) for k in ("most", "edge", "mean", "worst"))
        if not all(0.0 <= value <= 1.0 for value in (most, mean, worst)) or not 0.0 <= edge < np.inf:
            raise ValueError("expected errors are out of range")
        x, y, z = vector_in(content["place"], "place")
        return cls(level.astype(np.uint8, copy=False), most, edge, mean, worst, (x, y, z))
