"""The buttons Undo, Redo and Reset of a panel: they set its properties, as a hand would.

The filter itself runs where the data is and knows only the values that it was given, so this is client code: what was
applied is remembered here, and given back to the panel, which then shows what is true.
"""

from __future__ import annotations

from typing import Any

BUTTONS = {
    "UndoEdit": "undo", "RedoEdit": "redo", "ResetEdits": "reset", "ResetPalette": "reset",
}  # fmt: skip
"""What each button of our panels does."""

STEPS = 50
"""States of a panel that are remembered."""

_watched: dict[str, PanelHistory] = {}
"""By the proxies' names in the session: held here, for VTK alone would let Python collect them."""


class PanelHistory:
    """What was applied in one panel. It holds no filter, so that a deleted one goes."""

    def __init__(self) -> None:
        self.now: dict[str, Any] | None = None
        self.past: list[dict[str, Any]] = []
        self.future: list[dict[str, Any]] = []
        self.pressed.__func__.CallDataType = "string0"  # type: ignore[attr-defined]

    def applied(self, proxy: Any, event: str) -> None:
        """Remember what was applied before this."""
        values = values_of(proxy)
        if self.now is not None and values != self.now:
            self.past = [*self.past, self.now][-STEPS:]
            self.future = []
        self.now = values

    def pressed(self, proxy: Any, event: str, name: str) -> None:
        """Do what a button says."""
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


def watch(filter: Any) -> None:
    """Let a filter's buttons work, from now on.

    Args:
        filter: One of ours that has such buttons, as ParaView's Python has it.
    """
    proxy = filter.SMProxy
    key = f"{id(proxy.GetSession()):x} {proxy.GetGlobalIDAsString()}"
    if key in _watched:
        return
    history = _watched[key] = PanelHistory()
    proxy.AddObserver("UpdateDataEvent", history.applied)
    proxy.AddObserver("UpdatePropertyEvent", history.pressed)


NO_SETTINGS = ("SaveFile", "KeptAs")
"""Properties that no button sets: where the scene is saved to, and what the filter itself fills in."""


def values_of(proxy: Any) -> dict[str, Any]:
    """What people have set of a proxy by property, but its inputs and :data:`NO_SETTINGS`."""
    filter = _python(proxy)
    found = {}
    for name in filter.ListProperties():
        own = filter.GetProperty(name)
        plain = own.SMProperty
        settable = plain.IsA("vtkSMVectorProperty") and not plain.GetInformationOnly()
        if settable and plain.GetXMLName() not in NO_SETTINGS:
            data = own.GetData()
            found[name] = list(data) if isinstance(data, list | tuple) else data
    return found


def give(proxy: Any, values: dict[str, Any]) -> None:
    """Set a panel's values, and show what comes of them."""
    filter = _python(proxy)
    for name, value in values.items():
        filter.GetProperty(name).SetData(value)
    _show(proxy)


def reset(proxy: Any) -> None:
    """Set all of a panel back."""
    for name in values_of(proxy):
        _python(proxy).GetProperty(name).SMProperty.ResetToDefault()
    _show(proxy)


def _show(proxy: Any) -> None:
    from paraview import simple

    proxy.UpdateVTKObjects()
    simple.RenderAllViews()


def _python(proxy: Any) -> Any:
    from paraview import servermanager

    return servermanager._getPyProxy(proxy)
