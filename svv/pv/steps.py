"""What is learned at a time step, and stays while time passes.

An animation moves the time of all data. Learning takes minutes, so a filter learns when somebody asks for it, and
otherwise gives out what it has.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

Result = TypeVar("Result")

KEPT = 8
"""Results of time steps that are kept at most, where each step has one of its own."""


@dataclass(frozen=True)
class Moment:
    """What came to a filter.

    Args:
        settings: The properties that the result depends on, as text.
        look: The transfer function, as text. It can be edited without an *Apply*.
        data: Hash of the data.
        asked: The time that the pipeline asks for; None without.
        time: The data's own time; None for data without.
        here: What also counts as a setting, and means nothing in another process: which object the table is.
    """

    settings: str
    look: str
    data: str
    asked: float | None = None
    time: float | None = None
    here: str = ""


class Steps(Generic[Result]):
    """The result of a filter, and those of the last time steps.

    A result is made when there is none, when it is asked for (:meth:`ask`), when the settings are others, and when the
    data changed although the time that is asked for did not: then something was applied further up. If only time has
    passed, or the transfer function was edited, what there is stays.
    """

    def __init__(self) -> None:
        self.results: OrderedDict[tuple[str, str], tuple[Moment, Result]] = OrderedDict()
        """By settings and data; the last one is what the filter gives out."""
        self._asked = False
        self._last: Moment | None = None

    def put(self, made: Moment, result: Result) -> None:
        """Begin with a result that another process made."""
        self.results[made.settings, made.data] = made, result

    def ask(self) -> None:
        """Make the result of what comes next, if it is not there yet."""
        self._asked = True

    @property
    def made(self) -> Moment | None:
        """What the present result was made of."""
        return next(reversed(self.results.values()))[0] if self.results else None

    @property
    def result(self) -> Result | None:
        """The present result."""
        return next(reversed(self.results.values()))[1] if self.results else None

    def get(self, now: Moment, make: Callable[[], Result], each: bool = False) -> Result:
        """The result to give out; what ``make`` raises leaves everything as it was.

        Args:
            now: What came.
            make: Makes a result of it.
            each: Whether each time step is to have a result of its own.
        """
        here, made, last = (now.settings, now.data), self.made, self._last
        asked = self._asked or made is None or (made.settings, made.here) != (now.settings, now.here)
        asked = asked or (last is not None and last.asked == now.asked and last.data != now.data)
        if asked or each:
            known = self.results.get(here)
            if known is None or (asked and known[0].look != now.look):
                result = make()
                if known is not None:
                    self.results.clear()  # the others are of the old transfer function, too
                self.results[here] = now, result
            self.results.move_to_end(here)
        while len(self.results) > (KEPT if each else 1):
            self.results.popitem(last=False)
        self._asked, self._last = False, now
        return next(reversed(self.results.values()))[1]

    def told(self, now: Moment, done: str = "Learned", again: str = "learns it again") -> str:
        """A sentence about what was made of other data than there is now, after a space; '' where there is none."""
        made = self.made
        if made is None or (made.data, made.look) == (now.data, now.look):
            return ""
        if made.data == now.data:
            return f" The transfer function was edited since: Take As Edited {again}."
        if made.time is None or now.time is None or made.time == now.time:
            return f" The data is no longer what it was then: Take As Edited {again}."
        return f" {done} at time {made.time:g}; the data is at {now.time:g} now: Take As Edited {again}."
