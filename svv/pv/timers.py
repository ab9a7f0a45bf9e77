"""ParaView's window: whether there is one and it is at work, and timers, from which client code may draw views."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from vtkmodules.vtkRenderingCore import vtkRenderWindowInteractor

from svv.pv.observers import WeakReference


class Timer:
    """One-shot timer of a window, in milliseconds; whoever starts it keeps it until it has gone off: VTK does not."""

    def __init__(self, interactor: vtkRenderWindowInteractor, pause: int, do: Callable[[], None]) -> None:
        self._interactor = WeakReference(interactor)
        self._do, self._observer = do, self._tick
        self._tag = interactor.AddObserver("TimerEvent", self._observer)
        self._id = interactor.CreateOneShotTimer(pause)

    @property
    def alive(self) -> bool:
        """Whether the window still exists."""
        return self._interactor.Get() is not None

    def _tick(self, *_: object) -> None:
        interactor = self._interactor.Get()
        interactor.RemoveObserver(self._tag)
        interactor.DestroyTimer(self._id)
        self._do()


class Alarm:
    """A timer of the window that is set at most once at a time; its pause is in milliseconds."""

    def __init__(self, pause: int, do: Callable[[], None]) -> None:
        self._pause, self._do = pause, do
        self._timer: Timer | None = None

    def set(self) -> bool:
        """Let it go off after the pause, if it is not set already; return False without a window (in a script)."""
        interactor = window()
        if self._timer is not None and not self._timer.alive:
            self._timer = None
        if self._timer is None and interactor is not None:
            self._timer = Timer(interactor, self._pause, self._go)
        return self._timer is not None

    def _go(self) -> None:
        self._timer = None
        self._do()


def window() -> vtkRenderWindowInteractor | None:
    """Return the interactor of one of the window's views; None if there is no window (in a script), or no view."""
    from paraview import simple

    for view in simple.GetRenderViews():
        interactor = view.GetInteractor()
        if interactor is not None and interactor.GetClassName().startswith("QVTK"):  # only Qt's has an event loop
            return interactor
    return None


def by_window() -> bool:
    """Return whether the window itself has called, and not a script: then the outermost function is one of ours.

    That may have called others that come back here: each proxy that is registered is an event of its own.
    """
    frame: Any = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
    return str(frame.f_globals.get("__package__")).startswith(str(__package__))
