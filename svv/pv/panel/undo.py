"""The buttons Undo, Redo and Reset of a panel: they set its properties, as a user would by hand.

Client code: the filter runs on the server and knows only its current values; this remembers those that were applied.
"""

from __future__ import annotations

from dataclasses import dataclass

from svv.pv.observers import Watched, python_proxy, with_data
from svv.pv.paraview_types import Proxy, SMProxy

BUTTONS = {
    "UndoEdit": "undo", "RedoEdit": "redo", "ResetEdits": "reset",
    "UndoPalette": "undo", "RedoPalette": "redo", "ResetPalette": "reset",
}  # fmt: skip
"""Action of each button of the StyleRF panels."""

STEPS = 50
"""Maximum number of a panel's states that are remembered."""

PanelValues = dict[str, object]
"""The applied settings of a panel, by property: numbers, texts, or lists of them, and shapes."""


@dataclass(frozen=True)
class Shape:
    """A surface with handles, as it was applied."""

    kind: str
    """Plane, Box, Sphere or Cylinder."""
    values: PanelValues
    """Its settings."""


_watched: Watched[PanelHistory] = Watched()
"""Histories of the filters; without this reference Python would collect them, because VTK holds none."""


class PanelHistory:
    """The values applied in one panel. It holds no reference to the filter, which can therefore be deleted."""

    def __init__(self) -> None:
        self.now: PanelValues | None = None
        self.past: list[PanelValues] = []
        self.future: list[PanelValues] = []

    def applied(self, proxy: SMProxy, event: str) -> None:
        """Remember the values that were applied before the current ones."""
        values = values_of(proxy) | shapes_of(proxy)
        if self.now is not None and values != self.now:
            self.past = [*self.past, self.now][-STEPS:]
            self.future = []
        self.now = values

    @with_data("string0")
    def pressed(self, proxy: SMProxy, event: str, name: str) -> None:
        """Carry out a button's action."""
        done = BUTTONS.get(name)
        if done == "reset":
            reset(proxy)
        elif done == "undo" and self.past and self.now is not None:
            self.future.append(self.now)
            self.now = self.past.pop()
            give(proxy, self.now)
        elif done == "redo" and self.future and self.now is not None:
            self.past.append(self.now)
            self.now = self.future.pop()
            give(proxy, self.now)


def watch(filter: Proxy) -> None:
    """Make the buttons of a StyleRF filter work, from now on."""
    proxy = filter.SMProxy
    if proxy in _watched:
        return
    history = PanelHistory()
    _watched.put(proxy, history)
    proxy.AddObserver("UpdateDataEvent", history.applied)
    proxy.AddObserver("UpdatePropertyEvent", history.pressed)


NO_SETTINGS = ("SaveFile", "KeptAs", "Pick", "PointRegion")
"""Properties that no button sets: the file for the scene, the names that the filter itself fills in, the place of
the last click, and what the next one means."""


def values_of(proxy: SMProxy) -> PanelValues:
    """Return a proxy's settings by property, without its inputs, what client code sets, and :data:`NO_SETTINGS`."""
    filter = python_proxy(proxy)
    found = {}
    for name in filter.ListProperties():
        own = filter.GetProperty(name)
        plain = own.SMProperty
        settable = plain.IsA("vtkSMVectorProperty") and not (plain.GetInformationOnly() or plain.GetIsInternal())
        if settable and plain.GetXMLName() not in NO_SETTINGS:
            data = own.GetData()
            found[name] = list(data) if isinstance(data, list | tuple) else data
    return found


def shapes_of(proxy: SMProxy) -> dict[str, Shape]:
    """Return a proxy's surfaces with handles, by property."""
    filter, found = python_proxy(proxy), {}
    for name in filter.ListProperties():
        own = filter.GetProperty(name)
        if own.SMProperty.FindDomain("vtkSMProxyListDomain") is not None and (chosen := own.GetData()) is not None:
            found[name] = Shape(chosen.SMProxy.GetXMLName(), values_of(chosen.SMProxy))
    return found


def give(proxy: SMProxy, values: PanelValues) -> None:
    """Set a panel's values, and show the result."""
    filter = python_proxy(proxy)
    for name, value in values.items():
        own = filter.GetProperty(name)
        if isinstance(value, Shape):
            own.SetData(value.kind)
            give_values(own.GetData(), value.values)
        else:
            own.SetData(value)
    _show(proxy)


def give_values(shape: Proxy, values: PanelValues) -> None:
    """Set a shape's values."""
    for name, value in values.items():
        shape.GetProperty(name).SetData(value)
    shape.SMProxy.UpdateVTKObjects()


def reset(proxy: SMProxy) -> None:
    """Reset all of a panel's settings to their defaults."""
    for name in values_of(proxy):
        python_proxy(proxy).GetProperty(name).SMProperty.ResetToDefault()
    _show(proxy)


def _show(proxy: SMProxy) -> None:
    from paraview import simple

    proxy.UpdateVTKObjects()
    simple.RenderAllViews()
