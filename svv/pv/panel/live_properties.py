"""The properties and buttons of the filters that learn beside ParaView's window."""

from __future__ import annotations

from typing import TYPE_CHECKING

from svv.pv.panel.properties import Owner, Property, button, hidden_text, stored, switch

if TYPE_CHECKING:
    from svv.pv.live.beside import Beside


def live() -> list[Property]:
    """Return the properties and buttons of a filter that learns beside the window (:mod:`svv.pv.live.beside`)."""

    def in_window(self: Beside, value: int) -> None:
        self.values["InWindow"] = bool(value)
        if value > 1:
            self.prepare()

    def late(self: Owner, value: int) -> None:
        self.values["Late"] = bool(value)

    hidden = (
        ("IntVectorProperty", "InWindow", "0", in_window,
         "1 if the window has made the filter, so that Live counts; 2 if it is soon to be applied, too."),
        ("StringVectorProperty", "LiveState", "", stored("LiveState", lambda value: value or ""),
         "What the filter had to show when the client last asked."),
        ("IntVectorProperty", "Late", "0", late,
         "1 if the client asks for the image until it is there, so that it need not be waited for."),
    )  # fmt: skip
    found = [
        switch("Live", True, "In ParaView's window, learn in a process of its own and show what there is as it becomes "
               "better; scripts, and states that they load, wait until all is done."),
        button("Pause", "Let the learning wait, until Go On is pressed."),
        button("StopHere", "Stop learning and keep what is shown, until Go On is pressed."),
        button("GoOn", "Go on after Pause or Stop Here."),
    ]  # fmt: skip
    for kind, name, default, setter, help in hidden:
        xml = (
            f'<{kind} name="{name}" command="Set{name}" number_of_elements="1" default_values="{default}" '
            f'panel_visibility="never" is_internal="1" animateable="0"><Documentation>{help}</Documentation></{kind}>'
        )
        found.append(Property(name, xml, False if default else "", {f"Set{name}": setter}))
    return [*found, hidden_text("Learned", "GetLearned", "A text that changes when there is something new to show.")]
