"""A volume of any size that is generated brick by brick: for benchmarks, and to try out what a machine can draw.

Space is bent by two flows, a broad and a fine one, of the kind of Arnold, Beltrami and Childress (each component is a
sum of two sines of the other coordinates); in the bent space lie a torus (values near 1), shells around it (near 0.6)
and a sphere (near 0.3). Each voxel has the field's value at its centre, at every level, so that a level is a sample
of the same field and not a mean of the level below.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from svv.bricks.formats.source import Box, Level, level_of
from svv.core.fast_math import FAST_MATH
from svv.errors import BadInput

BROAD, FINE = (3.1, 0.11), (61.0, 0.004)
"""Wave number and strength of the two flows, in a cube that reaches from -1 to 1."""

COARSEST = 64
"""Longest side below which there is no further level."""


class GeneratedSource:
    """The field in the cube [-1, 1]^3, with whole numbers from 0 to 255 as values.

    Args:
        side: Voxels along each axis.

    Raises:
        BadInput: There are fewer than 16.
    """

    assumed: str | None = None
    planes = None

    def __init__(self, side: int) -> None:
        if side < 16:
            raise BadInput(f"The generated volume needs at least 16 voxels along each axis, not {side}.")
        self.name, self.dtype = f"generated, {side}^3", np.dtype(np.uint8)
        first = level_of((side,) * 3, np.eye(3) * 2.0 / side, np.full(3, 1.0 / side - 1.0), self.name)
        levels = [first]
        while max(levels[-1].shape) > COARSEST:
            levels.append(levels[-1].halved())
        self.levels: Sequence[Level] = tuple(levels)

    def read(self, level: int, start: Box, stop: Box) -> NDArray[Any]:
        """Generate a box; see :meth:`svv.bricks.formats.source.Source.read`."""
        grid = self.levels[level]
        x, y, z = (
            (grid.origin[axis] + grid.axes[axis, axis] * np.arange(a, b)).astype(np.float32)
            for axis, (a, b) in enumerate(zip(start[::-1], stop[::-1]))
        )
        out = np.empty((len(z), len(y), len(x)), np.uint8)
        _generate(x, _waves(x), y, _waves(y), z, _waves(z), out)
        return out


def _waves(place: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the two terms that coordinates along one axis add to the flows across it. (n, 2)"""
    terms = [(strength * np.sin(k * place), strength * np.cos(k * place)) for k, strength in (BROAD, FINE)]
    return np.sum(terms, axis=0).T.astype(np.float32).copy()


@njit(nogil=True, fastmath=FAST_MATH, cache=True)
def _generate(x, across_x, y, across_y, z, across_z, out):  # type: ignore[no-untyped-def]
    for k in range(len(z)):
        for j in range(len(y)):
            px0 = across_z[k, 0] + across_y[j, 1]
            py0 = y[j] + across_z[k, 1]
            pz0 = z[k] + across_y[j, 0]
            for i in range(len(x)):
                px = x[i] + px0
                py = py0 + across_x[i, 0]
                pz = pz0 + across_x[i, 1]
                flat = px * px + py * py
                around = np.sqrt(flat) - np.float32(0.42)
                ring = np.sqrt(around * around + pz * pz)
                ball = np.sqrt(flat + pz * pz)
                # Values fall off around the torus' core; below it lies the sphere.
                value = np.float32(255.0) * (np.float32(1.0) - np.float32(2.4) * ring)
                outer = np.float32(255.0) * (np.float32(1.05) - np.float32(1.15) * ball) * np.float32(0.62)
                value = max(np.float32(0.0), max(value, outer))
                out[k, j, i] = np.uint8(min(value + np.float32(0.5), np.float32(255.0)))
