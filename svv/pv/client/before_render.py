"""Work that is done for a 3D view before it is drawn. Client code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from svv.pv.client.observers import Watched

Do = Callable[..., None]
"""What is done, given the proxy of the view, the name of the event, and its data if it asks for them."""

_watched: Watched[list[Do]] = Watched()
"""What is done for each view."""


def before_drawing(view: Any, do: Do) -> None:
    """Call a function before a 3D view is drawn, from now on, however often this is asked for."""
    known = _watched.get(view.SMProxy) or []
    if do not in known:
        _watched.put(view.SMProxy, [*known, do])
        view.SMProxy.AddObserver("StartEvent", do)
