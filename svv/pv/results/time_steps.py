"""Results of time steps, which a filter keeps while the time changes.

An animation moves the time of all data, and training takes minutes: a filter trains only when it is asked to.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

Result = TypeVar("Result")

KEPT = 8
"""Maximum number of results kept if every time step has its own."""


@dataclass(frozen=True)
class Moment:
    """Inputs and settings of a filter at one execution.

    Args:
        settings: The properties that the result depends on, as text.
        look: The transfer function, as text. It can be edited without an *Apply*.
        data: Hash of the data.
        asked: Time requested by the pipeline; None if there was none.
        time: The data's own time; None if it has none.
        here: Setting that is meaningful in this process only: the identity of the table object.
    """

    settings: str
    look: str
    data: str
    asked: float | None = None
    time: float | None = None
    here: str = ""


class Steps(Generic[Result]):
    """The current result of a filter, and those of the most recent time steps.

    A result is made if there is none, if it is asked for (:meth:`ask`), if the settings have changed, and if the data
    has changed although the requested time has not: then something was applied upstream. Otherwise the current one is
    kept.
    """

    def __init__(self) -> None:
        self.results: OrderedDict[tuple[str, str], tuple[Moment, Result]] = OrderedDict()
        """Results by settings and data; the last one is current."""
        self._asked = False
        self._last: Moment | None = None

    def put(self, made: Moment, result: Result) -> None:
        """Start with a result that another process made."""
        self.results[made.settings, made.data] = made, result

    def ask(self) -> None:
        """Make a result for the next input, unless it is already there."""
        self._asked = True

    @property
    def made(self) -> Moment | None:
        """What the current result was made from."""
        return next(reversed(self.results.values()))[0] if self.results else None

    @property
    def result(self) -> Result | None:
        """The current result."""
        return next(reversed(self.results.values()))[1] if self.results else None

    def get(self, now: Moment, make: Callable[[], Result], each: bool = False) -> Result:
        """Return the current result, made anew if necessary; with ``each``, every time step has its own."""
        here, made, last = (now.settings, now.data), self.made, self._last
        asked = self._asked or made is None or (made.settings, made.here) != (now.settings, now.here)
        asked = asked or (last is not None and last.asked == now.asked and last.data != now.data)
        if asked or each:
            known = self.results.get(here)
            if known is None or (asked and known[0].look != now.look):
                result = make()
                if known is not None:
                    self.results.clear()  # the others belong to the old transfer function, too
                self.results[here] = now, result
            self.results.move_to_end(here)
        while len(self.results) > (KEPT if each else 1):
            self.results.popitem(last=False)
        self._asked, self._last = False, now
        return next(reversed(self.results.values()))[1]

    def describe_staleness(self, now: Moment, done: str = "Trained", again: str = "trains it again") -> str:
        """Return a sentence, after a space, if the result was made from other data than the present; otherwise ''."""
        made = self.made
        if made is None or (made.data, made.look) == (now.data, now.look):
            return ""
        if made.data == now.data:
            return f" The transfer function has been edited since: Take What Is Shown Now {again}."
        if made.time is None or now.time is None or made.time == now.time:
            return f" The data has changed since: Take What Is Shown Now {again}."
        return f" {done} at time {made.time:g}; the data is now at {now.time:g}: Take What Is Shown Now {again}."
