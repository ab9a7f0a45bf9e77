"""Surfaces with handles, placed around the scene that they cut open.

Client code. ParaView places them by the bounds of the filter's input; a scene's table has none, and those of an image
of it are its pixels.
"""

from __future__ import annotations

import numpy as np

from svv.pv.observers import Watched
from svv.pv.paraview_types import Proxy

SHAPED = {"StyleRFEdit": "CutOpenBy", "StyleRFVolume": "CutBy"}
"""Filters of scenes with such a surface, and its property."""

_placed: Watched[bool] = Watched()
"""The filters whose surfaces have been placed; afterwards they are left to the user."""


def place(filter: Proxy, loading: bool) -> None:
    """Place all surfaces that a new filter offers; a loaded state says itself where they are."""
    if filter.SMProxy in _placed:
        return
    _placed.put(filter.SMProxy, True)
    if loading:
        return
    filter.UpdatePropertyInformation()
    told = str(filter.GetProperty("SceneBounds").GetData() or "")
    if not told:
        return
    low, high = np.array([float(number) for number in told.split()]).reshape(2, 3)
    centre, sides = 0.5 * (low + high), high - low
    places = {
        "Origin": centre, "Center": centre, "Radius": [0.25 * sides.max()], "Position": low + 0.25 * sides,
        "Length": 0.5 * sides,
    }  # fmt: skip
    domain = filter.GetProperty(SHAPED[filter.SMProxy.GetXMLName()]).SMProperty.FindDomain("vtkSMProxyListDomain")
    for number in range(domain.GetNumberOfProxies()):
        shape = domain.GetProxy(number)
        for name, values in places.items():
            own = shape.GetProperty(name)
            for k, value in enumerate(values) if own is not None else ():
                own.SetElement(k, float(value))
        shape.UpdateVTKObjects()
