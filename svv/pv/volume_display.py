"""Show a baked scene in a 3D view: as a volume in its own colours, with the opacity function that its codes mean.

Client code. It sets up each display of StyleRF Volume and of a file that `svv export` wrote once, when it is created;
afterwards only the opacity unit distance follows the data, which depends on the volume's grid.
"""

from __future__ import annotations

from typing import Any

from svv.core.opacity_code import opacity_points
from svv.pv.data import BAKED, UNIT_DISTANCE

VOLUME = "StyleRFVolume"
"""XML name of the filter."""

_watched: list[str] = []
"""Session and proxy IDs of the sources that are being watched."""


def unit_distance_of(source: Any) -> float | None:
    """Return the opacity unit distance of a baked volume, world units; None for anything else.

    Args:
        source: Proxy of a source or filter.
    """
    information = source.SMProxy.GetDataInformation(source.Port).GetFieldDataInformation()
    array = information.GetArrayInformation(UNIT_DISTANCE)
    return None if array is None else float(array.GetComponentRange(0)[0])


def as_volume(display: Any) -> bool:
    """Show a baked volume as it is meant; return False, and change nothing, if the display shows something else."""
    from paraview import simple

    source = display.Input
    unit = unit_distance_of(source)
    if unit is None:
        return False
    opacity = simple.GetOpacityTransferFunction(BAKED)
    opacity.Points = [x for code, value in opacity_points() for x in (code, value, 0.5, 0.0)]
    table = simple.GetColorTransferFunction(BAKED)
    table.AutomaticRescaleRangeMode = "Never"  # the codes' range is always the same
    display.ColorArrayName = ["POINTS", BAKED]
    display.LookupTable, display.ScalarOpacityFunction = table, opacity
    display.MapScalars = 0
    display.ScalarOpacityUnitDistance = unit
    display.Shade = 0
    display.Representation = "Volume"
    _watch(source)
    return True


def _watch(source: Any) -> None:
    """Let the displays of a source follow its unit distance from now on."""
    proxy = source.SMProxy
    key = f"{id(proxy.GetSession()):x} {proxy.GetGlobalIDAsString()}"
    if key not in _watched:
        _watched.append(key)
        proxy.AddObserver("UpdateDataEvent", _follow)


def _follow(proxy: Any, event: str) -> None:
    from paraview import servermanager, simple

    source = servermanager._getPyProxy(proxy)
    unit = unit_distance_of(source)
    for view in simple.GetRenderViews() if unit is not None else ():
        for display in view.Representations:
            given = getattr(display, "Input", None)
            if given is not None and given.SMProxy is proxy and display.ScalarOpacityUnitDistance != unit:
                display.ScalarOpacityUnitDistance = unit
