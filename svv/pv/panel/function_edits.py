"""Edits of what a filter was given, told to the filter: of its transfer function, and of surfaces with handles."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkDiscretizableColorTransferFunction

    from svv.pv.paraview_types import Observed, Observer


class Modifiable(Protocol):
    """A filter."""

    def Modified(self) -> None: ...


class Shows(Modifiable, Protocol):
    """A filter with a transfer function."""

    shows_edits: bool
    """Whether an edit of the function changes what it shows without any work being asked for."""


def watch(filter: Shows, table: object) -> None:
    """Mark a filter as modified at every edit of a transfer function, as long as it exists and shows edits."""
    from vtkmodules.vtkRenderingCore import vtkDiscretizableColorTransferFunction  # not needed for the panel

    if isinstance(table, vtkDiscretizableColorTransferFunction) and table.GetScalarOpacityFunction() is not None:
        opacity = table.GetScalarOpacityFunction()
        told = _teller(filter, table, opacity)
        for function in (table, opacity):
            observe_for(filter, function, told)


def observe_for(filter: Modifiable, function: Observed, do: Observer) -> None:
    """Call an observer at every modification of a function, until a filter is gone.

    What ends that also keeps the function's Python object: without it, Python would collect the observer together with
    that, while VTK still calls it: a crash.
    """
    end = weakref.finalize(filter, function.RemoveObserver, function.AddObserver("ModifiedEvent", do))
    end.atexit = False


def _teller(filter: Shows, table: vtkDiscretizableColorTransferFunction, opacity: vtkPiecewiseFunction) -> Observer:
    """Return the observer. Views touch a function whenever they draw, so its points are compared."""
    reference, known = weakref.ref(filter), [_points(table, opacity)]

    def tell(*_: object) -> None:
        this, now = reference(), _points(table, opacity)
        if now == known[0]:
            return
        known[0] = now
        if this is not None and this.shows_edits:
            this.Modified()

    return tell


def _points(table: vtkDiscretizableColorTransferFunction, opacity: vtkPiecewiseFunction) -> list[tuple[float, ...]]:
    """Return the points of a function, its colours' first."""
    return [*nodes_of(table, 6), *nodes_of(opacity, 4)]


def nodes_of(
    function: vtkDiscretizableColorTransferFunction | vtkPiecewiseFunction, width: int
) -> Iterator[tuple[float, ...]]:
    """Yield the numbers of each point of a function, of which a colour has 6 and an opacity has 4."""
    for number in range(function.GetSize()):
        function.GetNodeValue(number, node := [0.0] * width)
        yield tuple(node)


def marker(filter: Modifiable) -> Observer:
    """Return an observer that marks a filter as modified as long as it exists."""
    reference = weakref.ref(filter)

    def mark(*_: object) -> None:
        this = reference()
        if this is not None:
            this.Modified()

    return mark
