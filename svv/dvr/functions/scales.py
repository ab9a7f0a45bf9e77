"""Values of a transfer function's points: stretching over the range of the data, and logarithmic scales.

ParaView draws a volume with a logarithmic scale otherwise than its colour legend shows. The mapper asks for a table of
colours over the range of the data, gets one whose entries are evenly spaced in the logarithm
(``vtkColorTransferFunction::GetTable``), and looks values up in it linearly. Opacities, in contrast, are interpolated
in the logarithm of the values, as one would expect.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction

from svv.errors import BadInput

Points = tuple[tuple[float, ...], ...]
"""Points of a function, four numbers each, the first of which is the value."""

LARGEST_VALUE = 1e100
"""Largest value of a point; differences of larger ones are not numbers any more."""

MOST_POINTS = 5000
"""Most points of a function; VTK looks each value up by going through them all."""

LOG_PARTS = 64
"""Straight lines that replace the curve between two points on a logarithmic scale: over six decades, they are off by
0.0004 of the difference between the points."""


def own_range(points: Points) -> tuple[float, float]:
    """Return the smallest and largest value of points, which are in ascending order."""
    return points[0][0], points[-1][0]


def doubled(points: Points) -> list[float]:
    """Return the values at which points jump, because two of them have it."""
    return [a[0] for a, b in pairwise(points) if a[0] == b[0]]


def stretched(points: Points, low: float, high: float, log: bool = False) -> Points:
    """Return points stretched from their own range over another one, as ParaView does with *Use preset range* off.

    Args:
        points: Points of a function.
        low: Where the first point comes to lie.
        high: Where the last point comes to lie.
        log: Whether the points are on a logarithmic scale; the result is on a linear one.
    """
    start, stop = own_range(points)
    values = np.array([point[0] for point in points])
    if log and start > 0:
        values, start, stop = np.log(values), float(np.log(start)), float(np.log(stop))
    share = (values - start) / (stop - start)
    return _moved(points, _between(low, high, share))


def as_drawn(colours: Points, low: float, high: float, name: str) -> Points:
    """Return colours on a linear scale that look as ParaView draws those on a logarithmic one, see the module.

    Args:
        colours: Points on a logarithmic scale.
        low: Smallest value of the data.
        high: Largest value of the data.
        name: Name of the function in messages.

    Raises:
        BadInput: The data has values that are not positive.
    """
    if colours[0][0] <= 0 or not high > low:  # VTK then ignores the scale
        return colours
    if low <= 0:
        raise BadInput(
            f"'{name}' has a logarithmic scale, but the data's smallest value is {low:g}, for which ParaView has no "
            "colour: it draws the volume black. Turn off its log scale, or cut off what is not positive (Threshold, "
            "Calculator)."
        )
    share = np.log(np.array([point[0] for point in colours]) / low) / np.log(high / low)
    return _moved(colours, _between(low, high, share))


def straightened(opacities: Points, name: str) -> Points:
    """Return opacities on a linear scale that equal those on a logarithmic one.

    Raises BadInput if a point's value is not positive.
    """
    if opacities[0][0] <= 0:
        raise BadInput(
            f"The opacities of '{name}' have a logarithmic scale, but a point at {opacities[0][0]:g}: turn off their "
            "log scale, or move the point to a positive value."
        )
    curve = vtkPiecewiseFunction()
    curve.AllowDuplicateScalarsOn()
    curve.SetUseLogScale(True)
    for point in opacities:
        curve.AddPoint(*point)
    parts = max(2, min(LOG_PARTS, MOST_POINTS // len(opacities)))
    result = [opacities[0]]
    for before, after in pairwise(opacities):
        if after[1] != before[1] and after[0] > before[0]:
            inner = np.geomspace(before[0], after[0], parts + 1)[1:-1].tolist()
            result += [(value, float(np.clip(curve.GetValue(value), 0.0, 1.0)), 0.5, 0.0) for value in inner]
        result.append(after)
    lines = [(value, opacity, 0.5, 0.0) for value, opacity, *_ in result]
    return tuple(lines)


def _between(low: float, high: float, share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values at shares of the way; exactly ``high`` at 1, and accurate if both ends are large and close."""
    return np.where(share == 1.0, high, low + share * (high - low))


def _moved(points: Points, values: NDArray[np.float64]) -> Points:
    return tuple((float(value), *rest) for value, (_, *rest) in zip(values, points))
