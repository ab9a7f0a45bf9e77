"""The properties and buttons of the filters that learn beside ParaView's window."""

from __future__ import annotations

from typing import Protocol

from svv.pv.panel.properties import Owner, Property, button, hidden, hidden_text, stored, switch


class Learner(Owner, Protocol):
    """A filter that learns beside the window."""

    def prepare(self) -> None:
        """Start what takes long to start."""


def live() -> list[Property]:
    """Return the properties and buttons of a filter that learns beside the window (:mod:`svv.pv.live.beside`)."""

    def in_window(self: Learner, value: int) -> None:
        self.values["InWindow"] = bool(value)
        if value > 1:
            self.prepare()

    def late(self: Owner, value: int) -> None:
        self.values["Late"] = bool(value)

    internal = ' is_internal="1" animateable="0"'
    return [
        switch("Live", True, "In the window, learn in a process of its own and show what there is; scripts, and states "
                             "that they load, wait until all is done."),
        button("Pause", "Let the learning wait, until Go On is pressed."),
        button("StopHere", "Stop learning and keep what is shown, until Go On is pressed."),
        button("GoOn", "Go on after Pause or Stop Here."),
        hidden("Int", "InWindow", "1 if the window has made the filter, so that Live counts; 2 if it is soon to be "
               "applied, too.", in_window, "0", internal),
        hidden("String", "LiveState", "What the filter had to show when the client last asked.",
               stored("LiveState", lambda value: value or ""), "", internal),
        hidden("Int", "Late", "1 if the client asks for the image until it is there, so that it need not be waited "
               "for.", late, "0", internal),
        hidden_text("Learned", "GetLearned", "A text that changes when there is something new to show."),
    ]  # fmt: skip
