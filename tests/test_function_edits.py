"""Edits of transfer functions are told to filters for as long as these exist."""

from __future__ import annotations

import gc

import pytest

pytest.importorskip("vtkmodules")

from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkDiscretizableColorTransferFunction, vtkVolumeProperty

from svv.pv.panel.function_edits import watch


class Told:
    """A filter that counts how often it was marked as modified."""

    shows_edits = True

    table: vtkDiscretizableColorTransferFunction

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
    assert not table.HasObserver("ModifiedEvent") and not opacity.HasObserver("ModifiedEvent")


def test_an_edit_after_a_filter_has_gone_finds_no_observer_that_python_has_collected() -> None:
    display = vtkVolumeProperty()
    display.SetColor(vtkDiscretizableColorTransferFunction())
    display.GetRGBTransferFunction().SetScalarOpacityFunction(vtkPiecewiseFunction())
    filter = Told()
    filter.table = display.GetRGBTransferFunction()
    watch(filter, filter.table)
    gc.collect()
    display.GetRGBTransferFunction().AddRGBPoint(0.25, 1.0, 0.0, 0.0)
    assert filter.count == 1
    del filter
    gc.collect()  # nothing in Python refers to the function any more; a crash here would end the test's process
    display.GetRGBTransferFunction().AddRGBPoint(0.5, 1.0, 0.0, 0.0)
    assert not display.GetRGBTransferFunction().HasObserver("ModifiedEvent")
