"""An L of four values off the centre of 22 x 18 x 14 voxels, which no exchange or turn of axes leaves as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.bricks.formats.axes import Choice
from svv.bricks.opened import open_bricks
from svv.dvr.read.grids import assumed_of, index_to_world, to_array
from svv.dvr.read.volumes import read_here

STEP, FIRST = np.array([1.5, 2.0, 3.0]), np.array([10.0, 20.0, 30.0])
"""Size of a voxel and place of the first one, along x, y, z."""


def ell(kind: str = "f4") -> NDArray[Any]:
    """The values. (z, y, x)"""
    values = np.zeros((14, 18, 22), kind)
    values[3, 4, 5:13], values[3, 5:9, 5], values[4:6, 4, 5], values[3, 4, 5] = 200, 150, 100, 50
    return values


def planes(letter: str) -> NDArray[np.float64]:
    """Places of the voxels along an axis."""
    k = "xyz".index(letter)
    return FIRST[k] + STEP[k] * np.arange(ell().shape[2 - k])


def _seen(values: NDArray[Any], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The world places of voxels that are not 0, and their values, in one order. (n, 4)"""
    z, y, x = np.nonzero(values)
    there = (matrix @ [x, y, z, np.ones(len(x))])[:3]
    rows = np.vstack([there, values[z, y, x]]).T
    return rows[np.lexsort(np.round(rows / np.abs(rows).max(axis=0), 9).T)]


def assert_shown(
    path: Path,
    step: ArrayLike = STEP,
    first: ArrayLike = FIRST,
    factor: float = 1.0,
    says: str | None = None,
    background: float = 0.0,
    **how: Any,
) -> None:
    """Check a file by both ways in which it is read: each value at its place, and what is said to be assumed.

    Args:
        path: The file.
        step: Steps along x, y, z, or the matrix of them. (3,) or (3, 3)
        first: Place of the first voxel. (3,)
        factor: Values are this times those of :func:`ell`.
        background: To which they are added.
        says: Part of what is assumed; None if nothing is.
        how: Options: ``array``, ``channel``, ``time``.
    """
    steps, expected = np.asarray(step, float), np.eye(4)
    expected[:3, :3], expected[:3, 3] = np.diag(steps) if steps.ndim == 1 else steps, first
    truth = _seen(factor * ell(), expected)
    image = read_here(path, **how)
    found = [(to_array(image), index_to_world(image), assumed_of(image))]
    source = open_bricks(path, array=how.get("array"), choice=Choice(how.get("channel"), how.get("time")))
    if source is not None:
        level, matrix = source.levels[0], np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = level.axes, level.origin
        found.append((source.read(0, (0, 0, 0), level.shape), matrix, source.assumed))
    for values, matrix, assumed in found:
        np.testing.assert_allclose(
            _seen(values - background, matrix), truth, rtol=1e-6, atol=1e-6 * float(np.abs(steps).max())
        )
        assert (assumed is None) if says is None else (assumed is not None and says in assumed), assumed
