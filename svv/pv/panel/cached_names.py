"""The property *Kept As*: after each run of a filter it holds the names under which the results are kept.

The filter itself runs on the server, with the data, and cannot set its own properties, whereas states consist of
properties. This is therefore client code. The property is not sent to the server, whose filter has the names already:
that would make ParaView discard what a view has just been given to show, if it is the view that updates the filter.
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
