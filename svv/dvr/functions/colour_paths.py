"""Colours in the space Lab/CIEDE2000, between which VTK searches the shortest path through all colours.

``vtkColorTransferFunction::GetColor`` searches it anew for each value, which takes 50 ms; its tables search it once.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

from svv.dvr.functions.scales import Points

ENTRIES = 4097
"""Entries of a table between two points, whose path has a few hundred colours."""


def colours_at(points: Points, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the colours (..., 3) of values, as VTK interpolates them between points on a linear scale."""
    colours = np.empty((*values.shape, 3))
    colours[values <= points[0][0]], colours[values > points[-1][0]] = points[0][1:], points[-1][1:]
    for before, after in pairwise(points):
        between = (values > before[0]) & (values <= after[0])
        if between.any():
            share = (values[between] - before[0]) / (after[0] - before[0])
            colours[between] = _path(before[1:], after[1:])[np.rint(share * (ENTRIES - 1)).astype(np.intp)]
    return colours


def _path(start: tuple[float, ...], stop: tuple[float, ...]) -> NDArray[np.float64]:
    """Return evenly spaced colours from one to another. (ENTRIES, 3)"""
    path = vtkColorTransferFunction()
    path.SetColorSpaceToLabCIEDE2000()
    path.AddRGBPoint(0.0, *start)
    path.AddRGBPoint(1.0, *stop)
    table = [0.0] * (3 * ENTRIES)
    path.GetTable(0.0, 1.0, ENTRIES, table)
    return np.array(table).reshape(ENTRIES, 3)
