"""When a filter trains again as time passes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from svv.errors import Cancelled
from svv.pv.results.time_steps import KEPT, Moment, Steps


def at(time: float | None, data: str = "", settings: str = "draft", look: str = "red") -> Moment:
    """A source that gives other data at each time."""
    return Moment(settings, look, data or f"data at {time}", time, time)


class Learner:
    """Counts what is made."""

    def __init__(self, each: bool = False) -> None:
        self.steps: Steps[str] = Steps()
        self.each, self.made = each, 0

    def see(self, now: Moment) -> str:
        def make() -> str:
            self.made += 1
            return f"{now.data} in {now.look}"

        return self.steps.get(now, make, self.each)


def test_what_is_there_stays_while_time_passes() -> None:
    learner = Learner()
    seen = [learner.see(at(time)) for time in (0.0, 0.5, 0.5, 1.0, 0.5, 0.0)]
    assert (set(seen), learner.made) == ({"data at 0.0 in red"}, 1)
    learner.see(at(1.5))
    assert learner.steps.describe_staleness(at(1.5)) == (
        " Trained at time 0; the data is now at 1.5: Take What Is Shown Now trains it again."
    )
    assert learner.steps.describe_staleness(at(0.0)) == ""


@pytest.mark.parametrize(
    "change",
    [
        lambda learner: learner.see(at(1.0, "applied")),  # at the time that was there
        lambda learner: learner.see(at(1.0, settings="fast")),
        lambda learner: (learner.steps.ask(), learner.see(at(1.0))),
        lambda learner: (learner.steps.ask(), learner.see(at(2.0))),
    ],
    ids=["upstream", "settings", "asked", "asked, then another time"],
)
def test_it_learns_when_somebody_asks(change: Callable[[Learner], object]) -> None:
    learner = Learner()
    for time in (0.0, 1.0, 1.0):
        learner.see(at(time))
    change(learner)
    assert learner.made == 2 and learner.steps.made is not None
    learner.see(at(3.0, settings=learner.steps.made.settings))
    assert learner.made == 2, "it was asked once"


def test_an_upstream_change_at_another_time_is_no_wish() -> None:
    learner = Learner()
    learner.see(at(0.0))
    learner.see(at(1.0))
    learner.see(at(0.0, "changed while nobody looked"))
    assert learner.made == 1
    assert (
        learner.steps.describe_staleness(at(0.0, "changed"))
        == " The data has changed since: Take What Is Shown Now trains it again."
    )


def test_an_edited_transfer_function_waits_until_it_is_taken() -> None:
    learner = Learner()
    learner.see(at(0.0))
    assert learner.see(at(0.0, look="blue")) == learner.see(at(1.0, look="blue")) == "data at 0.0 in red"
    assert "transfer function has been edited" in learner.steps.describe_staleness(at(0.0, look="blue"))
    learner.steps.ask()
    assert learner.see(at(0.0, look="blue")) == "data at 0.0 in blue"
    assert learner.steps.describe_staleness(at(0.0, look="blue")) == ""


def test_nothing_is_made_where_nothing_changed() -> None:
    learner = Learner()
    learner.see(at(None))
    learner.steps.ask()
    learner.see(at(None))
    assert learner.made == 1


def test_each_time_step_has_its_own_and_none_is_made_twice() -> None:
    learner = Learner(each=True)
    seen = [learner.see(at(time)) for time in (0.0, 0.5, 1.0, 0.5, 0.0)]
    assert (seen[0], seen[1], learner.made) == (seen[4], seen[3], 3)
    assert learner.steps.describe_staleness(at(0.0)) == ""
    for time in range(10, 10 + KEPT):
        learner.see(at(time))
    assert len(learner.steps.results) == KEPT
    learner.see(at(0.0))
    assert learner.made == 3 + KEPT + 1, "the oldest are let go of"
    learner.each = False
    learner.see(at(11))
    assert list(learner.steps.results) == [("draft", "data at 0.0")]


def test_steps_of_an_old_transfer_function_are_made_again_once_the_new_one_was_taken() -> None:
    learner = Learner(each=True)
    learner.see(at(0.0))
    learner.see(at(1.0, look="rescaled"))  # as ParaView does at each step if it is told to
    assert learner.see(at(0.0)) == "data at 0.0 in red"
    learner.steps.ask()
    learner.see(at(0.0, look="blue"))
    assert learner.see(at(1.0, look="blue")) == "data at 1.0 in blue"
    assert learner.made == 4


def test_what_was_stopped_is_asked_for_still() -> None:
    learner = Learner()
    learner.see(at(0.0))

    def stop() -> str:
        raise Cancelled

    learner.steps.ask()
    with pytest.raises(Cancelled):
        learner.steps.get(at(1.0), stop)
    assert learner.steps.result == "data at 0.0 in red"
    assert learner.see(at(1.0)) == "data at 1.0 in red"
