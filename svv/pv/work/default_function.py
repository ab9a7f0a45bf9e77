"""Whether a volume is shown with the transfer function that ParaView gives every array: a ramp, mostly fog."""

from __future__ import annotations

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkDataSet

from svv.pv.failed import in_script, pressing
from svv.pv.panel.function_edits import nodes_of
from svv.pv.panel_values import Values
from svv.pv.work.parallel import crew_of

DEFAULT = (
    " The transfer function is ParaView's default, a ramp over all values that shows most volumes as fog: {edit}, and "
    "then {take}."
)

SAME = 1e-4
"""Difference of two colours, 0 to 1, or of two positions relative to the range, below which they are the same."""

RAMP = ((0.0, 0.0, 0.5, 0.0), (1.0, 1.0, 0.5, 0.0))
"""Position, opacity, midpoint and sharpness of the points of ParaView's default opacities."""


def describe_default_function(data: vtkDataObject | None, values: Values) -> str:
    """Return a sentence, after a space, if the panel's transfer function is ParaView's default; '' if it is not."""
    if not is_default(data, values):
        return ""
    edit = "set its colours and opacities" if in_script() else "edit it in the Color Map Editor"
    return DEFAULT.format(edit=edit, take=pressing())


def is_default(data: vtkDataObject | None, values: Values) -> bool:
    """Return whether neither colours, opacities nor their range have been changed since ParaView made them.

    The client tells the colours, which differ by version (``DefaultColours``). The range has to be that of the array
    that is shown, where this process has all of it.
    """
    from vtkmodules.vtkRenderingCore import vtkDiscretizableColorTransferFunction

    table, told = values["TransferFunction"], values.get("DefaultColours", "").split()
    if not isinstance(table, vtkDiscretizableColorTransferFunction) or not told:
        return False
    opacity = table.GetScalarOpacityFunction()
    low, high = table.GetRange()
    if opacity is None or not high > low or table.GetUseLogScale():
        return False
    space, *numbers = map(float, told)
    known = _range_of(data, values)
    if known is not None and np.abs(np.subtract(known, (low, high))).max() > SAME * (high - low):
        return False
    points = [(opacity, 4, RAMP), (table, 6, np.reshape(numbers, (-1, 4)))]
    return table.GetColorSpace() == space and all(
        _same([((at - low) / (high - low), *three[:3]) for at, *three in nodes_of(function, width)], given)
        for function, width, given in points
    )


def colours_of(positions_and_colours: list[float], space: int) -> str:
    """Return the text of ``DefaultColours`` for the points of a colour function (position, red, green, blue, ...)."""
    points = np.reshape(positions_and_colours, (-1, 4))
    first, last = points[0, 0], points[-1, 0]
    points[:, 0] = (points[:, 0] - first) / (last - first)
    return " ".join(f"{number:.6g}" for number in (space, *points.ravel()))


def _same(points: list[tuple[float, ...]], given: object) -> bool:
    ours, theirs = np.asarray(points), np.asarray(given)
    return ours.shape == theirs.shape and bool(np.abs(ours - theirs).max() < SAME)


def _range_of(data: vtkDataObject | None, values: Values) -> tuple[float, float] | None:
    """Return the range of the array that is shown; None if this process does not have all of it as one array."""
    if not isinstance(data, vtkDataSet) or crew_of(data) is not None:
        return None
    fields = data.GetCellData() if values.get("ScalarsOnCells") else data.GetPointData()
    array = fields.GetArray(values["Scalars"]) if values["Scalars"] else fields.GetScalars()
    return None if array is None else array.GetFiniteRange(0)
