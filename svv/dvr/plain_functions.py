"""ParaView's transfer functions as plain ones: what VTK's functions can do, and ours cannot, is sampled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

SAMPLES = 1024
"""Samples over a function's range, as many as there are in the table of VTK's GPU ray caster."""

HSV = 1
"""VTK's number of the colour space HSV."""

Array = NDArray[np.float64]


def plain_colours(table: Any) -> Any:
    """Return a colour transfer function that looks the same and neither wraps hues nor has colours beyond its range.

    Args:
        table: A ``vtkColorTransferFunction``; it is returned itself if it does neither.
    """
    below, above = bool(table.GetUseBelowRangeColor()), bool(table.GetUseAboveRangeColor())
    wraps = table.GetColorSpace() == HSV and table.GetHSVWrap()
    if not (below or above or wraps) or not table.GetSize():
        return table
    smooth, plain = vtkColorTransferFunction(), vtkColorTransferFunction()
    smooth.DeepCopy(table)  # ParaView's colour maps have steps of their own, which its volumes do not show
    plain.AllowDuplicateScalarsOn()
    values = _samples([_node(table, i, 6)[0] for i in range(table.GetSize())], bool(table.GetScale()))
    if below:
        plain.AddRGBPoint(values[0], *table.GetBelowRangeColor())
    for value in values.tolist():
        plain.AddRGBPoint(value, *smooth.GetColor(value))
    if above:
        plain.AddRGBPoint(values[-1], *table.GetAboveRangeColor())
    return plain


def plain_opacities(function: Any) -> Any:
    """Return an opacity function that is the same and has no logarithmic scale.

    Args:
        function: A ``vtkPiecewiseFunction``; it is returned itself if it has none.
    """
    if not getattr(function, "GetUseLogScale", bool)() or not function.GetSize():
        return function
    plain = vtkPiecewiseFunction()
    plain.AllowDuplicateScalarsOn()
    for value in _samples([_node(function, i, 4)[0] for i in range(function.GetSize())], True).tolist():
        plain.AddPoint(value, function.GetValue(value))
    return plain


def _node(function: Any, number: int, count: int) -> list[float]:
    node = [0.0] * count
    function.GetNodeValue(number, node)
    return node


def _samples(nodes: list[float], logarithmic: bool) -> Array:
    """Return ascending values that miss none of a function's points, nor what is just beside a jump. (N,)"""
    points = np.array(nodes)
    low, high = points.min(), points.max()
    even = np.linspace(low, high, SAMPLES)
    if logarithmic and low > 0:
        even = np.concatenate([even, np.geomspace(low, high, SAMPLES)])
    beside = [np.nextafter(points, -np.inf), np.nextafter(points, np.inf)]
    return np.unique(np.clip(np.concatenate([points, even, *beside]), low, high))
