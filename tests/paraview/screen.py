"""ParaView's window as its user has it: widgets are found by the words on them, and clicked where they are.

What the window shows is read as screen readers do it (:mod:`tests.paraview.accessible`), so that words that are not
there, hidden or cut off are not found.
"""

from __future__ import annotations

import json
import re
import subprocess
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tests.paraview.conftest import Gui

READER = Path(__file__).with_name("accessible.py")
LONG = 300.0
"""Seconds after which what is not there is missing; a busy machine may need many."""
PANEL = "Properties"
"""Title of the dock whose panel is scrolled."""
SEARCH = "Search for properties"
"""Part of what the tooltip of the panel's search field says."""
BAR = 20
"""Height of a scroll bar at the end of the panel, pixels."""
BUTTON = "push button", "button"
"""Roles of buttons in the versions of Qt."""
MENU_TRIES = 6
"""Clicks until a menu is open."""
NOTCH = 60
"""What a turn of the wheel may move the panel by, pixels."""


@dataclass(frozen=True)
class Widget:
    """What is showing: its role, words and tooltip, its box on the screen (left, upper, width, height), and states."""

    role: str
    name: str
    text: str
    told: str
    box: tuple[int, int, int, int]
    within: tuple[str, ...]
    checked: bool
    enabled: bool

    @property
    def centre(self) -> tuple[int, int]:
        x, y, width, height = self.box
        return x + width // 2, y + height // 2

    @property
    def right(self) -> int:
        return self.box[0] + self.box[2]

    @property
    def lower(self) -> int:
        return self.box[1] + self.box[3]

    def says(self, words: str) -> bool:
        """Whether these are its words, or its tooltip's; dots at the end promise a dialog, and | is between choices."""
        own = {self.name.rstrip(". ").lower(), self.told.rstrip(". ").lower()}
        return not own.isdisjoint(words.lower().split("|"))


class Screen:
    """The screen of a window that was started with the variables of :func:`tests.paraview.conftest.read_aloud`."""

    def __init__(self, gui: Gui) -> None:
        self.gui = gui

    def widgets(self) -> list[Widget]:
        """All that is showing, outer ones first."""
        command = ["/usr/bin/python3", str(READER)]  # which has GLib; ours may be another one
        done = subprocess.run(command, env=dict(self.gui.environ), capture_output=True, text=True, timeout=LONG)
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        for one in found:
            one["told"] = re.sub(r"<[^>]*>", "", one["told"])
        return [Widget(**{**one, "box": tuple(one["box"]), "within": tuple(one["within"])}) for one in found]

    def found(self, words: str, *roles: str, within: str = "") -> list[Widget]:
        """The widgets that say these words, have one of these roles, and are in something of that name."""
        return [
            one
            for one in self.widgets()
            if one.says(words) and (not roles or one.role in roles) and (not within or within in one.within)
        ]

    def find(self, words: str, *roles: str, within: str = "", timeout: float = LONG) -> Widget:
        """The last of the widgets that :meth:`found` gives, as soon as there is an enabled one."""
        until = time.monotonic() + timeout
        while not (enabled := [one for one in self.found(words, *roles, within=within) if one.enabled]):
            assert time.monotonic() < until, f"the window shows no {words!r} {roles}: {self.words()}"
        return enabled[-1]

    def words(self) -> str:
        """What can be read on the screen."""
        return ", ".join(repr(one.name) for one in self.widgets() if one.name)

    def click(self, at: Widget | tuple[int, int], *more: object) -> None:
        """Click on a widget or a place, and then do more with xdotool."""
        x, y = at.centre if isinstance(at, Widget) else at
        self.gui.xdotool("mousemove", x, y, "sleep", "0.3", "click", 1, "sleep", "0.5", *more)

    def press(self, words: str, within: str = "") -> None:
        """Press a button."""
        self.click(self.find(words, *BUTTON, within=within))

    def menu(self, *entries: str) -> Widget:
        """Open a menu, and entries in entries; returns the last one, with the mouse on it."""
        for depth, entry in enumerate(entries):
            found = self.find(entry, "menu item", within=entries[depth - 1] if depth else "")
            x, y = found.centre
            self.gui.xdotool("mousemove", x, y, "sleep", "1")
            for _ in range(MENU_TRIES):  # a click closes what the mouse alone has opened, or is about to open
                if depth == len(entries) - 1 or self.found(entries[depth + 1], "menu item", within=entry):
                    break
                self.gui.xdotool("click", 1, "sleep", "1", "mousemove", x + 4, y, "sleep", "1", "mousemove", x, y)
        return found

    def choose(self, *entries: str) -> None:
        """Choose an entry of a menu."""
        self.click(self.menu(*entries))

    def focus(self, title: str = "^ParaView") -> None:
        """Give the keyboard to a window; without a window manager, nobody else does."""
        found = self.gui.xdotool("search", "--sync", "--onlyvisible", "--name", title).split()[-1]
        self.gui.xdotool("windowfocus", found, "sleep", "0.5")

    def in_panel(self, words: str, *roles: str) -> Widget:
        """A widget of the panel, which is scrolled until the whole of it shows."""
        for _ in range(20):
            shown = self.widgets()
            panel = [one for one in shown if PANEL in one.within]
            dock = dock_of(shown, PANEL)
            fit = [one for one in panel if one.says(words) and (not roles or one.role in roles)]
            assert fit, f"the panel shows no {words!r} {roles}: {[one.name or one.told for one in panel]}"
            upper, lower = max(one.lower for one in panel if SEARCH in one.told), dock.lower - BAR
            above, below = upper - fit[-1].box[1], fit[-1].lower - lower
            if above <= 0 and below <= 0:
                return fit[-1]
            turn = (4, above) if above > 0 else (5, below)
            clicks = ("click", "--repeat", max(1, turn[1] // NOTCH), turn[0])
            self.gui.xdotool("mousemove", dock.box[0] + 12, (upper + lower) // 2, *clicks, "sleep", "0.5")
        raise AssertionError(f"the panel does not scroll to {words!r}")

    def select(self, name: str) -> None:
        """Click on a source in the Pipeline Browser.

        The browser does not say what it shows: the right row is the one after which the panel has the source's name.
        """
        browser = dock_of(self.widgets(), "Pipeline Browser")
        x, y, _, _ = browser.box
        for row in range(y + 30, browser.lower, 11):
            self.click((x + 90, row))
            headings = [one.name for one in self.widgets() if PANEL in one.within and one.role == "label"]
            if any(heading.startswith("Properties (") and name in heading for heading in headings):
                return
        raise AssertionError(f"the Pipeline Browser has no {name!r}")

    def beside(self, label: Widget, *roles: str) -> Widget:
        """The widget of one of these roles that is next to a label on its right, or else below it."""
        others = [one for one in self.widgets() if one.role in roles and label.within == one.within]
        row = [one for one in others if one.box[1] <= label.centre[1] <= one.lower and one.box[0] >= label.centre[0]]
        below = [one for one in others if one.box[1] >= label.lower]
        assert row or below, f"there is no {roles} beside {label}"
        return min(row or below, key=lambda one: (one.box[1], one.box[0]))

    def set_to(self, label: str, entry: str) -> None:
        """Choose an entry of the list beside a label of the panel."""
        box = self.beside(self.in_panel(label, "label"), "combo box")
        self.click(box)
        self.gui.xdotool("type", entry)
        self.gui.xdotool("key", "Return", "sleep", "1")

    def tick(self, words: str, on: bool = True, within: str = PANEL) -> None:
        """Tick a box, or untick it."""
        find = self.in_panel if within == PANEL else partial(self.find, within=within)
        box = find(words, "check box")
        if box.checked != on:
            x, y, _, height = box.box
            self.click((x + height // 2, y + height // 2))
        assert find(words, "check box").checked == on

    def choose_file(self, title: str, file: Path) -> None:
        """Name a file in a dialog."""
        self.focus(title)
        self.gui.xdotool("key", "ctrl+a", "type", str(file))
        self.gui.xdotool("sleep", "0.5", "key", "Return", "sleep", "1")

    def drag(self, *places: tuple[int, int]) -> None:
        """Move the mouse from place to place with its left button held."""
        first, *others = places
        steps = [word for x, y in others for word in ("mousemove", x, y, "sleep", "0.5")]
        self.gui.xdotool("mousemove", *first, "mousedown", 1, *steps, "mouseup", 1)

    def gear(self) -> None:
        """Press the gear beside the panel's search field, which shows the advanced properties or hides them."""
        (search,) = (one for one in self.widgets() if PANEL in one.within and SEARCH in one.told)
        self.click(self.beside(search, "check box"))


def dock_of(widgets: list[Widget], title: str) -> Widget:
    """Return the dock of a title, whose role differs among versions of Qt: the largest widget of that name."""
    return max((one for one in widgets if one.name == title), key=lambda one: one.box[2] * one.box[3])
