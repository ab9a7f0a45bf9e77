"""Show a baked scene in a 3D view: as a volume in its own colours, with the opacity function that its codes mean.

Client code. Before a view is drawn, the function and its unit distance are set if the data ask for others than the last
time, so that what the user changes stays.
"""

from __future__ import annotations

from svv.core.volumes.opacity_code import most_with, opacity_points
from svv.pv.observers import Watched, python_proxy
from svv.pv.paraview_types import Display, Proxy, PVDataRepresentation, SMProxy, SMViewProxy
from svv.pv.work.connected import BAKED, OPACITY, UNIT_DISTANCE

SET = "StyleRF.look"
"""Annotation of a display: the look that it was last given."""

SETTER = "StyleRFUnitDistance"
"""The proxy that sets the unit distance where a server draws."""

_told: Watched[float] = Watched()
"""The unit distance that each display was given on its server."""


def look_of(source: Proxy) -> tuple[float, float] | None:
    """Return the opacity unit distance, world units, and largest opacity of a source's baked volume, or None."""
    information = source.SMProxy.GetDataInformation(source.Port).GetFieldDataInformation()
    unit, function = (information.GetArrayInformation(name) for name in (UNIT_DISTANCE, OPACITY))
    if unit is None or function is None:
        return None
    return float(unit.GetComponentRange(0)[0]), float(function.GetComponentRange(1)[1])


def as_volume(display: Display) -> bool:
    """Show a baked volume as one, in its own colours; change nothing and return False if it is something else."""
    if look_of(display.Input) is None:
        return False
    display.ColorArrayName = ["POINTS", BAKED]
    display.UseSeparateColorMap = 1  # each volume has an opacity function of its own
    display.MapScalars = display.Shade = 0
    display.Representation = "Volume"
    return True


def set_looks(proxy: SMViewProxy, event: str) -> None:
    """Give baked volumes the look that their data ask for before a 3D view is drawn; an observer of the views."""
    view = python_proxy(proxy)
    for display in view.Representations:
        kind = getattr(display, "Representation", "")  # which those of images do not have
        if getattr(display, "MapScalars", 1) or not display.Visibility or kind != "Volume":
            continue
        display.Input.UpdatePipeline(view.ViewTime)  # as the view does next, which is too late for the look
        look = look_of(display.Input)
        if look is not None:
            _set(display, *look)


def _set(display: Display, unit: float, opacity: float) -> None:
    from paraview import servermanager, simple

    said = f"{unit:.9g} {opacity:.9g}"
    if display.SMProxy.GetAnnotation(SET) != said:
        display.SMProxy.SetAnnotation(SET, said)
        function = simple.GetOpacityTransferFunction(BAKED, display, True)
        function.Points = [x for code, value in opacity_points(most_with(opacity)) for x in (code, value, 0.5, 0.0)]
        table = simple.GetColorTransferFunction(BAKED, display, True)
        table.AutomaticRescaleRangeMode = "Never"  # codes mean the same whatever the range of the data
        display.LookupTable, display.ScalarOpacityFunction = table, function
        display.ScalarOpacityUnitDistance = unit
    set_unit_distance(display.SMProxy.GetClientSideObject(), display.ScalarOpacityUnitDistance)
    if servermanager.ActiveConnection.IsRemote():
        _set_on_server(display.SMProxy, display.ScalarOpacityUnitDistance)


def set_unit_distance(display: PVDataRepresentation, distance: float) -> None:
    """Set the opacity unit distance, world units, of the fourth component in a display's VTK object.

    The representation sets that of the first component, but VTK's mapper takes that of the code's.
    """
    actor = display.GetActiveRepresentation().GetActor()
    if actor is not None:
        actor.GetProperty().SetScalarOpacityUnitDistance(3, distance)


def _set_on_server(display: SMProxy, distance: float) -> None:
    """Set the unit distance where the server draws a display, once for each value."""
    from paraview.modules.vtkRemotingServerManager import vtkSMPropertyHelper

    manager = display.GetSessionProxyManager()
    if (
        _told.get(display) == distance or manager.GetPrototypeProxy("internal_filters", SETTER) is None
    ):  # the server lacks the plugin
        return
    _told.put(display, distance)
    setter = manager.NewProxy("internal_filters", SETTER)
    vtkSMPropertyHelper(setter, "Display").Set(display, 0)
    vtkSMPropertyHelper(setter, "Distance").Set(distance)
    setter.UpdateVTKObjects()
    setter.UpdatePipeline()
