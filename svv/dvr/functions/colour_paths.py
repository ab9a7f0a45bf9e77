"""Colours in VTK's space Lab/CIEDE2000, many at once.

Between two points, VTK searches the shortest path through a lattice of colours, measured by CIEDE2000, and does so anew
for each colour that is asked for: 0.04 s each. A table of colours takes one search for all its entries.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

CLOSE = 2.0 / 255.0
"""Difference of colours below which there is nothing between them on VTK's lattice."""

Array = NDArray[np.float64]
Colour = tuple[float, ...]

ENTRIES = 4097
"""Colours along a path, several times as many as there are steps of 8 bits on the longest one."""


def colours_at(points: Array, values: Array, log: bool = False) -> Array:
    """Return the colours at values.

    Args:
        points: Values and their red, green and blue, in ascending order. (K, 4)
        values: Any values; beyond the points, the first or last colour holds. (N,)
        log: Whether the values are on a logarithmic scale, which VTK ignores unless all points are positive.

    Returns:
        Red, green and blue in [0, 1]. (N, 3)
    """
    if log and points[0, 0] > 0:
        values = np.log10(np.maximum(values, points[0, 0]))
        points = np.column_stack([np.log10(points[:, 0]), points[:, 1:]])
    after = np.clip(np.searchsorted(points[:, 0], values), 0, len(points) - 1)  # the first of several equal points
    colours = points[after, 1:].copy()
    between = (after > 0) & (values <= points[after, 0])
    for end in np.unique(after[between]).tolist():
        here = between & (after == end)
        (start, *first), (stop, *last) = points[end - 1 : end + 1].tolist()
        part = (values[here] - start) / (stop - start)
        colours[here] = _path(tuple(first), tuple(last))[np.rint(part * (ENTRIES - 1)).astype(int)]
    return colours


@lru_cache(64)
def _path(first: Colour, last: Colour) -> Array:
    """Return evenly spaced colours from one to another. (``ENTRIES``, 3)"""
    if max(abs(a - b) for a, b in zip(first, last, strict=True)) < CLOSE:  # nothing to search for
        return np.linspace(first, last, ENTRIES)
    function = vtkColorTransferFunction()
    function.SetColorSpaceToLabCIEDE2000()
    function.AddRGBPoint(0.0, *first)
    function.AddRGBPoint(1.0, *last)
    table = [0.0] * (3 * ENTRIES)
    function.GetTable(0.0, 1.0, ENTRIES, table)
    return np.array(table).reshape(ENTRIES, 3)
