"""Work that is done for a 3D view before it is drawn. Client code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vtkmodules.vtkCommonCore import vtkWeakReference

Do = Callable[..., None]
"""What is done, given the proxy of the view, the name of the event, and its data if it asks for them."""

_watched: list[tuple[vtkWeakReference, Do]] = []


def before_drawing(view: Any, do: Do) -> None:
    """Call a function before a 3D view is drawn, from now on, however often this is asked for."""
    _watched[:] = [known for known in _watched if known[0].Get() is not None]
    if not any(known.Get() is view.SMProxy and own is do for known, own in _watched):
        reference = vtkWeakReference()
        reference.Set(view.SMProxy)
        _watched.append((reference, do))
        view.SMProxy.AddObserver("StartEvent", do)
