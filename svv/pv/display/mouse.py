"""The mouse in a view with an image turns the camera that it follows: its events go to the followed view."""

from __future__ import annotations

from vtkmodules.vtkRenderingCore import vtkRenderWindowInteractor

from svv.pv.observers import WeakReference
from svv.pv.paraview_types import View

BUTTONS = ("Left", "Middle", "Right")
EVENTS = (
    *(f"{button}Button{what}Event" for button in BUTTONS for what in ("Press", "Release")),
    "MouseMoveEvent", "MouseWheelForwardEvent", "MouseWheelBackwardEvent",
)  # fmt: skip

BEFORE_OTHERS = 1.0
"""Priority of the observers: before the view's own handling of the mouse, which does not come to it."""


class ForwardedMouse:
    """Passes mouse events from one view on to another, at the same place relative to its size; holds neither."""

    def __init__(self, view: View, other: View) -> None:
        self._from, self._to = WeakReference(view.GetInteractor()), WeakReference(other.GetInteractor())
        self._held: set[str] = set()
        # VTK holds no references to observers, so without this one Python would collect it.
        self._do = self._pass_on
        self._tags: dict[str, int] = {}
        source = self._from.Get()
        if source is not None and self._to.Get() is not None:
            self._tags = {event: source.AddObserver(event, self._do, BEFORE_OTHERS) for event in EVENTS}

    def _pass_on(self, source: vtkRenderWindowInteractor, event: str) -> None:
        to = self._to.Get()
        if to is None:
            return
        button = event.partition("Button")[0]
        if event.endswith("PressEvent"):
            self._held.add(button)
        elif event.endswith("ReleaseEvent"):
            self._held.discard(button)
        source.GetCommand(self._tags[event]).SetAbortFlag(1)
        if event == "MouseMoveEvent" and not self._held:
            return
        x, y = (
            round(at * theirs / max(ours, 1))
            for at, ours, theirs in zip(source.GetEventPosition(), source.GetSize(), to.GetSize(), strict=True)
        )
        for _ in range(2 if event.endswith("PressEvent") else 1):  # the other view has not seen the mouse come here
            to.SetEventInformation(x, y, source.GetControlKey(), source.GetShiftKey(), "\0")
        to.InvokeEvent(event)

    def stop(self) -> None:
        """Leave the mouse to the view again."""
        source = self._from.Get()
        for tag in self._tags.values() if source is not None else ():
            source.RemoveObserver(tag)
        self._tags = {}
