"""Marks on data that are made from a scene which another process is still learning (:mod:`svv.pv.live`)."""

from __future__ import annotations

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.dvr.read.appearance import named
from svv.errors import BadInput

MARK = "StyleRF Unfinished"
"""Field data of what is made from a scene that is still being learned."""


class NotYetThere(BadInput):
    """The input is still being made; the filter is executed again when it is there."""


def mark_unfinished(data: vtkDataObject) -> None:
    """Mark data as made from a scene that is still being learned."""
    data.GetFieldData().AddArray(named(MARK, np.ones(1, np.uint8)))


def is_unfinished(data: vtkDataObject | None) -> bool:
    """Return whether data are made from a scene that is still being learned."""
    return data is not None and data.GetFieldData() is not None and bool(data.GetFieldData().HasArray(MARK))
