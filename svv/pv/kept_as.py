"""The property *Kept As*: after each run of a filter it says under which names the results are kept.

The filter itself runs where the data is and cannot set its own properties, and states are made of properties, so this
is client code. Setting it starts nothing: the filter stores it without being modified.
"""

from __future__ import annotations

from typing import Any

KEEPING = ("StyleRFViews", "StyleRFTrain", "StyleRFPalette", "StyleRFStylize", "StyleRFStylizedView")
"""Filters with this property."""

_watched: set[str] = set()
"""The proxies' names in the session."""


def watch_kept(filter: Any) -> None:
    """Let a filter's property follow what the filter says, from now on.

    Args:
        filter: One of :data:`KEEPING`, as ParaView's Python has it.
    """
    proxy = filter.SMProxy
    key = f"{id(proxy.GetSession()):x} {proxy.GetGlobalIDAsString()}"
    if key not in _watched:
        _watched.add(key)
        proxy.AddObserver("UpdateDataEvent", _note)


def _note(proxy: Any, event: str) -> None:
    told, carried = proxy.GetProperty("Kept"), proxy.GetProperty("KeptAs")
    proxy.UpdatePropertyInformation(told)
    names = told.GetElement(0)
    if names and names != carried.GetElement(0):
        carried.SetElement(0, names)
        proxy.UpdateProperty("KeptAs")
