"""Whether a call comes from ParaView's window: its outermost function is then one of ours."""

from __future__ import annotations

import _thread
from collections.abc import Callable
from threading import Event
from typing import Any

import pytest

from svv.pv.timers import by_window

OURS, PARAVIEW, SCRIPT = "svv.pv.client", "paraview", None


def asked(packages: tuple[str | None, ...]) -> bool:
    """The answer to a function that functions of these packages have called, the first one from nowhere."""
    answers: list[bool] = []
    done = Event()
    call: Callable[[], Any] = by_window
    for package in packages[:0:-1]:
        call = of(package, "return call()", call=call)
    outermost = of(packages[0], "answers.append(call())\n    done.set()", call=call, answers=answers, done=done)
    _thread.start_new_thread(outermost, ())  # a thread of threading has a frame below
    assert done.wait(60)
    return answers[0]


def of(package: str | None, body: str, **names: Any) -> Callable[[], Any]:
    """A function as a package has it."""
    held: dict[str, Any] = {"__package__": package, **names}
    exec(f"def function():\n    {body}", held)
    function: Callable[[], Any] = held["function"]
    return function


@pytest.mark.parametrize(
    ("packages", "expected"),
    [
        ((OURS,), True),
        ((OURS, "svv.pv.display", "svv.pv"), True),
        ((OURS, PARAVIEW, OURS), True),  # what we do registers a proxy, which the window tells us
        ((SCRIPT, PARAVIEW, OURS), False),
        ((SCRIPT, OURS), False),
        ((PARAVIEW, OURS), False),
        (("svv.render", OURS), False),
    ],
)
def test_the_outermost_function_tells(packages: tuple[str | None, ...], expected: bool) -> None:
    assert asked(packages) == expected
