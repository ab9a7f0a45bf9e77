"""Edits of transfer functions are told to filters for as long as these exist."""

from __future__ import annotations

import gc

import pytest

pytest.importorskip("vtkmodules")

from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkDiscretizableColorTransferFunction

from svv.pv.panel.function_edits import watch


class Told:
    """A filter that counts how often it was marked as modified."""

    shows_edits = True

    def __init__(self) -> None:
        self.count = 0

    def Modified(self) -> None:
        self.count += 1


def test_a_filter_hears_of_edits_and_is_forgotten_when_it_is_gone() -> None:
    table, opacity = vtkDiscretizableColorTransferFunction(), vtkPiecewiseFunction()
    table.SetScalarOpacityFunction(opacity)
    filter = Told()
    watch(filter, table)
    opacity.AddPoint(0.5, 0.25)
    table.AddRGBPoint(0.5, 1.0, 0.0, 0.0)
    assert filter.count == 2
    table.Modified()  # as a view does when it draws
    filter.shows_edits = False
    opacity.AddPoint(0.75, 0.5)
    assert filter.count == 2
    del filter
    gc.collect()
    table.Modified()
    assert not table.HasObserver("ModifiedEvent") and not opacity.HasObserver("ModifiedEvent")
