"""What a window shows, read from outside as a screen reader reads it (AT-SPI): prints its widgets as JSON.

Run by the system's Python, which has GLib: ``python3 accessible.py`` with the variables of a session's bus. Nothing
of the project is imported.
"""

from __future__ import annotations

import json
from typing import Any

from gi.repository import Gio, GLib  # type: ignore[import-not-found, unused-ignore]

ACCESSIBLE = "org.a11y.atspi.Accessible"
CHECKED, ENABLED, SHOWING = 4, 8, 25
"""Numbers of states (AtspiStateType)."""
ALL, READ, FIRST = 300_000, (-1,), 0
"""Longest wait for an answer, milliseconds; arguments of calls."""
AUTHENTICATED = Gio.DBusConnectionFlags.AUTHENTICATION_CLIENT | Gio.DBusConnectionFlags.MESSAGE_BUS_CONNECTION


class Bus:
    """The bus on which programs say what they show."""

    def __init__(self) -> None:
        session = Gio.bus_get_sync(Gio.BusType.SESSION)
        asked = ("org.a11y.Bus", "/org/a11y/bus", "org.a11y.Bus", "GetAddress")
        (address,) = session.call_sync(*asked, None, None, 0, ALL, None).unpack()
        self.bus = Gio.DBusConnection.new_for_address_sync(address, AUTHENTICATED, None, None)

    def call(self, owner: str, path: str, interface: str, name: str, signature: str = "()", *arguments: Any) -> Any:
        given = GLib.Variant(signature, arguments)
        return self.bus.call_sync(owner, path, interface, name, given, None, 0, ALL, None).unpack()[0]

    def get(self, owner: str, path: str, name: str) -> Any:
        return self.call(owner, path, "org.freedesktop.DBus.Properties", "Get", "(ss)", ACCESSIBLE, name)

    def programs(self) -> list[tuple[str, str]]:
        """The programs on the bus: owner and path of each."""
        return self.call("org.a11y.atspi.Registry", "/org/a11y/atspi/accessible/root", ACCESSIBLE, "GetChildren")

    def add(self, one: tuple[str, str], within: list[str], shown: list[dict[str, Any]]) -> None:
        """Add a widget that is showing, and those in it; of a closed list, only what is chosen."""
        states = self.call(*one, ACCESSIBLE, "GetState")
        has = lambda state: bool(states[state // 32] >> state % 32 & 1)  # noqa: E731
        role = self.call(*one, ACCESSIBLE, "GetRoleName")
        if role != "application":
            if not has(SHOWING):
                return
            box = self.call(*one, "org.a11y.atspi.Component", "GetExtents", "(u)", FIRST)
            if box[0] + box[2] <= 0:  # in a dock that is not open
                return
        name, told = (self.get(*one, what) for what in ("Name", "Description"))
        if role != "application":
            read = (*one, "org.a11y.atspi.Text", "GetText", "(ii)", FIRST, *READ)
            kept = {"role": role, "name": name, "text": self.call(*read) if role == "text" else ""}
            kept |= {"told": told, "box": box, "within": within}
            shown.append({**kept, "checked": has(CHECKED), "enabled": has(ENABLED)})
        inner = [*within, name] if name else within
        for child in () if role == "combo box" else self.call(*one, ACCESSIBLE, "GetChildren"):
            try:
                self.add(child, inner, shown)
            except GLib.Error:  # it has gone since its parent named it
                continue


def main() -> None:
    """Print the widgets of all programs on the bus that are showing, outer ones first."""
    bus = Bus()
    shown: list[dict[str, Any]] = []
    for program in bus.programs():
        bus.add(program, [], shown)
    print(json.dumps(shown))


if __name__ == "__main__":
    main()
