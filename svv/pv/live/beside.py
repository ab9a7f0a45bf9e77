"""Filters that learn beside ParaView's window: in a process of their own, whose results they show as they arrive.

With *Live* on, and if the window has made the filter (:mod:`svv.pv.live.sharpening`), a result that is not kept yet is
ordered from :mod:`svv.pv.live.learner` instead of being made here. Until it is kept, the filter outputs the best there
is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.dvr.parallel.ranks import ranks_here
from svv.errors import BadInput
from svv.io.files.cache import Cache
from svv.io.files.worker import Worker
from svv.pv.filters.parallel import crew_of
from svv.pv.filters.vtk_data import key_of_views, time_of
from svv.pv.launch.programs import pvpython_here
from svv.pv.live.drawer import PATIENCE, Arrays, Drawer
from svv.pv.live.handed import STATE, WARM, hand_over
from svv.pv.results.cached import FOUND, Keeping
from svv.pv.results.keys import name_of, source_of
from svv.pv.results.time_steps import Moment

if TYPE_CHECKING:
    from svv.core.geometry.cameras import Camera

ONLY_SHOWN = (
    "Live", "InWindow", "LiveState", "KeptAs", "FollowCamera", "Moving", "ImageSize", "Camera", "ParallelScale",
    "Frame", "Show", "Background", "BackgroundColour",
)  # fmt: skip
"""Properties that do not go to the process, as it shows nothing."""

ENDED = "The process that learned beside ParaView has ended ({why}): press Go On, and it resumes."
NOT_KEPT = (
    "The result could not be kept, and so not be shown: raise SVV_CACHE_SIZE, or make room on the disk, or turn Live "
    "off."
)
STOPPED = "Stopped; press Go On to resume. {shown}"
SHOWN = {0: "The volume is shown as it is.", 1: "A sketch is shown."}

_deleters: list[Any] = []
"""Deletion observers; if only the filters held them, Python would collect them too early."""


class NotYet(Exception):
    """A result is being made in another process."""


class Beside(Keeping):
    """A filter that learns in a process of its own if it may; the one in ParaView's window otherwise."""

    checkpoint: Path | None = None
    """File from which training resumes, in the process of its own."""

    shows = True
    """Whether the results are to be shown, which they are not in that process."""

    def __init__(self, inputs: int, outputs: int, kind: str) -> None:
        super().__init__(inputs, outputs, kind)
        self._learner = Ordered(type(self).__name__)
        self._wanted: tuple[str, str] = ("", "")
        self._data: vtkDataObject | None = None
        self._moment: Moment | None = None
        self._take = False
        self.AddObserver("DeleteEvent", _stopper(self._learner))

    # --- for subclasses ---------------------------------------------------------------------------------------------

    def result(self, inputs: list[Any], outputs: list[Any], out_info: Any) -> str:
        """Do the work, as :meth:`Filter.work`; raises :class:`NotYet` from :meth:`found_or_made`."""
        raise NotImplementedError

    def meanwhile(self, inputs: list[Any], outputs: list[Any], learner: Ordered) -> None:
        """Fill the outputs with the best there is, while there is no result yet."""
        raise NotImplementedError

    def wants(self, now: Moment, painting: str) -> None:
        """Say what the result depends on: the scene's training, and how it is painted."""
        self._wanted = name_of("scene", source_of(now), now.settings), painting

    def settled(self, now: Moment) -> Moment:
        """Return what is being learned from: it stays the same while the time or the transfer function changes."""
        before, take = self._moment, self._take
        self._take = False
        if (
            self._lives() and before is not None and not take
            and (before.settings, before.here) == (now.settings, now.here)
            and (before.data == now.data or before.asked != now.asked)
        ):  # fmt: skip
            return before
        self._moment = now
        return now

    def TakeAsEdited(self) -> None:
        """Update the result to the current transfer function and time step."""
        self._take = True
        super().TakeAsEdited()

    # --- the work ---------------------------------------------------------------------------------------------------

    def work(self, inputs: list[Any], outputs: list[Any], out_info: Any) -> str:
        """Output the result, or what there is of it."""
        self._data = inputs[0]
        if not self._lives():
            self._learner.end()
        try:
            said = self.result(inputs, outputs, out_info)
        except NotYet:
            self.meanwhile(inputs, outputs, self._learner)
            return self._learner.told()
        self._moment = None
        self._learner.rest()
        return said

    def found_or_made(
        self, slot: str, kind: str, now: Moment, make: Callable[[], Any], own: Callable[[], Any] | None = None
    ) -> tuple[Any, str]:
        """Return a result and its name as :meth:`Keeping.found_or_made`, or order it.

        Raises:
            NotYet: It has been ordered.
            BadInput: It could not be made.
        """
        found, name = super().found_or_made(slot, kind, now, self._order if self._lives() else make, own)
        if self._learner.made(self._wanted) and self.note == FOUND:
            self.note = ""
        return found, name

    def _lives(self) -> bool:
        """Whether results are made in another process."""
        return (
            bool(self.values["Live"] and self.values["InWindow"] and not self.values["TrainEachTimeStep"])
            and key_of_views(self._data) is None
            and crew_of(self._data) is None
            and ranks_here() is None
            and Cache.of_user().bound > 0
        )

    def _order(self) -> Any:
        from svv.pv.filters.engine import transfer_function_of, volume_of

        if not self._learner.asks_for(self._wanted):
            values = {k: v for k, v in self.values.items() if k not in ONLY_SHOWN}
            values["TransferFunction"] = transfer_function_of(self.values).to_dict()
            image = volume_of(self._data, self.values)
            self._learner.order(self._wanted, values, image, time_of(self._data))
        raise NotYet

    # --- what the client asks and the panel's buttons ---------------------------------------------------------------

    def prepare(self) -> None:
        """Start the process, so that it has loaded what it takes when the first order comes."""
        if self._lives():
            with suppress(BadInput):  # the first order will say so
                self._learner.start()

    def GetLearned(self) -> str:
        """Return a text that changes whenever there is something new to show; it ends in * while more is to come."""
        if self._learner.busy:
            self._status = self._learner.told()
        return self._learner.news(self.values)

    def Pause(self) -> None:
        """Let the process wait."""
        self._learner.pause(True)

    def GoOn(self) -> None:
        """Let the process go on, after a pause, a stop or its end."""
        if not self._learner.pause(False):
            self._learner.forget()
            self.Modified()

    def StopHere(self) -> None:
        """Stop learning; what is shown stays."""
        self._learner.stop_here()
        self._status = self._learner.told()


class Ordered:
    """What one filter has ordered, and the process that makes it; the process is started when it is needed.

    Args:
        kind: Name of the filter's class.
    """

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._worker: Worker | None = None
        self._wanted: tuple[str, str] | None = None
        self._number = 0
        self._stopped = self._paused = False
        self._drawer = Drawer()
        self._state: tuple[int, int] | None = None
        """Number of an order and of its newest state; None if nothing was learned yet."""
        self._sent = ""

    def start(self) -> None:
        """Start the process, unless it is running."""
        if self._worker is not None and self._worker.alive:
            return
        self.end()
        self._worker = Worker([*pvpython_here(), "from svv.pv.live.learner import main; main()"])
        self._drawer.load(self._worker.folder / WARM)

    def asks_for(self, wanted: tuple[str, str]) -> bool:
        """Return whether this is being made, or has been stopped by the user.

        Raises:
            BadInput: It could not be made.
        """
        if self._wanted != wanted:
            return False
        if self._stopped:
            return True
        said = self._answer()
        if "error" in said:
            raise BadInput(said["error"])
        if said.get("done"):
            raise BadInput(NOT_KEPT)
        if self._worker is None or not self._worker.alive:
            raise BadInput(ENDED.format(why=self._worker.last_line() if self._worker else "it was stopped"))
        return True

    def order(self, wanted: tuple[str, str], values: dict[str, Any], image: Any, time: float | None) -> None:
        """Order a result, instead of the last one."""
        self.start()
        assert self._worker is not None
        self._number += 1
        order = {"number": self._number, "kind": self._kind, "scene": wanted[0], "values": values}
        if self._sent != wanted[0]:
            folder = self._worker.folder / f"volume-{self._number}"
            hand_over(image, values, time, folder)
            order["volume"] = str(folder)
            self._sent = wanted[0]
        self._worker.send(order)
        self._wanted, self._stopped, self._paused = wanted, False, False

    def picture(self, values: Mapping[str, Any]) -> tuple[Arrays, Camera] | None:
        """Return a small image of the newest state, and the camera that it is meant for; None if there is none yet."""
        asked = self._ask(values)
        return None if asked is None else self._drawer.image(PATIENCE if asked else 0.0)

    def _ask(self, values: Mapping[str, Any]) -> bool | None:
        """Ask for an image of the newest state; return whether that is news, and None if there is no state."""
        state = self._newest()
        if state is None or self._worker is None:
            return None
        return self._drawer.ask(self._worker.folder / STATE, state, values)

    def _newest(self) -> tuple[int, int] | None:
        number = int(self._answer().get("state", 0))
        if number:
            self._state = self._number, number
        return self._state

    @property
    def busy(self) -> bool:
        """Whether something has been ordered that is not there yet."""
        said = self._answer()
        return bool(
            self._wanted and not self._stopped and self._worker is not None and self._worker.alive
            and not said.get("done") and "error" not in said
        )  # fmt: skip

    def news(self, values: Mapping[str, Any]) -> str:
        """Return a text that changes with every image of a state, and at the end; it ends in * before that."""
        if self._wanted is None:
            return f"{self._number} none"
        if not self.busy:
            return f"{self._number} ended"
        self._ask(values)
        return f"{self._number} {self._drawer.drawn}*"

    def told(self) -> str:
        """Return one line about the work."""
        said = self._answer()
        shown = SHOWN[min(said.get("state", 0), 1)]
        if self._stopped:
            return STOPPED.format(shown=shown)
        if not said:
            return f"Learning begins. {shown}"
        if said["paused"] or self._paused:
            return f"Paused at {said['fraction']:.0%}; press Go On. {shown}"
        left = "" if said["left"] is None else f", {duration(said['left'])} left"
        return f"Learning, {said['fraction']:.0%}{left}: {said['label']}. {shown}"

    def made(self, wanted: tuple[str, str]) -> bool:
        """Return whether the process has made this."""
        return self._wanted == wanted

    def rest(self) -> None:
        """Take note that all that was ordered is there."""
        if self._answer().get("done"):
            self._state, self._paused = None, False

    def pause(self, paused: bool) -> bool:
        """Let the process wait or go on; return whether it is at work."""
        if not self.busy or self._worker is None:
            return False
        self._paused = paused
        self._worker.send({"pause": paused})
        return True

    def stop_here(self) -> None:
        """Stop the work for now; what there is can still be drawn."""
        if self.busy and self._worker is not None:
            self._worker.send({"stop": True})
            self._stopped = True

    def forget(self) -> None:
        """Forget what was ordered, so that it is ordered again."""
        self._wanted, self._stopped = None, False

    def end(self) -> None:
        """End the process, and forget what it has been given."""
        if self._worker is not None:
            self._worker.stop()
        self._worker, self._sent = None, ""
        self._drawer.end()

    def _answer(self) -> dict[str, Any]:
        """Return what the process says about the last order; empty if nothing yet."""
        said = {} if self._worker is None else self._worker.said()
        return said if said.get("order") == self._number else {}


def duration(seconds: float) -> str:
    """Return a duration as people say it: ``about 40 s`` or ``about 3 min``."""
    if seconds < 90:
        return f"about {max(5 * round(seconds / 5), 5)} s"
    return f"about {round(seconds / 60)} min"


def _stopper(learner: Ordered) -> Callable[[Any, str], None]:
    """Return an observer that ends a deleted filter's process."""

    def stop(_: Any, event: str) -> None:
        learner.end()
        _deleters.remove(stop)

    _deleters.append(stop)
    return stop
