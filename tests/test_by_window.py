"""Who has made a filter: the window, or a script."""

from __future__ import annotations

import _thread
import queue
from collections.abc import Callable
from typing import Any

import pytest

from svv.pv.client.timers import by_window


def called_through(*packages: str) -> bool:
    """What by_window says below functions of these packages, of which something outside of Python calls the first."""
    inner: Callable[[], Any] = by_window
    for package in reversed(packages):
        names: dict[str, Any] = {"__package__": package, "inner": inner}
        exec("def call(): return inner()", names)
        inner = names["call"]
    said: queue.Queue[bool] = queue.Queue()
    names = {"__package__": packages[0], "inner": inner, "put": said.put}
    exec("def begin(): put(inner())", names)
    _thread.start_new_thread(names["begin"], ())  # which no function of Python calls, as an observer
    return said.get(timeout=10.0)


@pytest.mark.parametrize(
    ("packages", "window"),
    [
        (["svv.pv.display"], True),
        # ParaView's Python makes a proxy of a class that it has not seen, whose event finds the filter at work.
        (["svv.pv.display", "paraview", "svv.pv.display"], True),
        (["__main__", "paraview", "svv.pv.display"], False),
        (["", "svv.pv.display"], False),
        (["paraview", "svv.pv.display"], False),
    ],
)
def test_whoever_begins_has_made_the_filter(packages: list[str], window: bool) -> None:
    assert called_through(*packages) is window
