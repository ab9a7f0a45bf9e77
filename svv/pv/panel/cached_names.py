"""The property *Kept As*: after each run of a filter it holds the names under which the results are kept.

The filter runs on the server and cannot set its own properties, of which states consist: this is client code. The
property is not sent to the filter, which has the names: ParaView would discard what a view has just been given to show.
"""

from __future__ import annotations

from svv.pv.connection import server_gone
from svv.pv.paraview_types import SMProxy

KEEPING = ("StyleRFViews", "StyleRFTrain", "StyleRFPalette", "StyleRFStylize", "StyleRFStylizedView")
"""Filters with this property."""


def take_names(proxy: SMProxy, event: str) -> None:
    """Bring the property up to date with the names that the filter reports; an observer of these filters."""
    if server_gone(proxy):  # it ended during the work
        return
    told, carried = proxy.GetProperty("Kept"), proxy.GetProperty("KeptAs")
    proxy.UpdatePropertyInformation(told)
    names = told.GetElement(0)
    if names and names != carried.GetElement(0):
        carried.SetElement(0, names)
