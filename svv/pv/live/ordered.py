"""What a filter has ordered from the processes beside ParaView's window: the learner and the drawer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias, cast

from svv.errors import BadInput
from svv.io.files.worker import Worker
from svv.job.orders import STATE, Order, Progressed
from svv.pv.launch.programs import pvpython_here
from svv.pv.live.drawer import MOVING_PATIENCE, PATIENCE, Drawer, Drawn, Shown
from svv.pv.live.handed import WARM
from svv.pv.panel_values import Values
from svv.pv.results.expected import duration
from svv.pv.results.stored import Stored

Wanted: TypeAlias = tuple[str, str, str]
"""Names of the scene and of the result, and what else a new order is made for (:meth:`Beside.wants`)."""

ENDED = "The process that learned beside ParaView has ended ({why}): press Go On, and it resumes."
NOT_KEPT = (
    "The result could not be kept, and so not be shown: raise SVV_CACHE_SIZE, or make room on the disk, or turn Live "
    "off."
)
KEEPS = " Stop Here keeps it."
STOPPED = "Stopped; press Go On to resume. {shown}"
SHARPENS = " A sharper image is being drawn."


class Ordered:
    """What one filter has ordered, and the process that makes it; another one draws it, if that is wanted."""

    def __init__(self, kind: str, draws: bool) -> None:
        self._kind, self._draws = kind, draws
        self._worker: Worker | None = None
        self._wanted: Wanted | None = None
        self._number = 0
        self._stopped = self._paused = False
        self._drawer = Drawer()
        self._shown: Shown | None = None
        """What is drawn: the newest state, or the last result."""
        self._sent = ""

    def start(self) -> None:
        """Start the process, unless it is running."""
        if self._worker is not None and self._worker.alive:
            return
        if self._worker is not None:
            self._worker.stop()
        self._sent = ""
        self._worker = Worker([*pvpython_here(), "from svv.pv.live.learner import main; main()"])
        if self._draws:
            self._drawer.load(self._worker.folder / WARM)

    def asks_for(self, wanted: Wanted) -> bool:
        """Return whether this is being made, or was stopped by the user; raise BadInput if it could not be made."""
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

    def order(self, wanted: Wanted, values: Values, hand: Callable[[Path], None]) -> None:
        """Order a result instead of the last one; ``hand`` writes the input for a process that does not have it."""
        self.start()
        assert self._worker is not None
        self._number += 1
        scene, result, _ = wanted
        asked = {"kind": self._kind, "values": values}
        order: Order = {"number": self._number, "scene": scene, "result": result, "asked": asked}
        if self._sent != wanted[0]:
            folder = self._worker.folder / f"input-{self._number}"
            hand(folder)
            order["input"] = str(folder)
            self._sent = wanted[0]
        self._worker.send(order)
        self._wanted, self._stopped, self._paused = wanted, False, False

    def picture(self, values: Values) -> Drawn | None:
        """Return the newest image of the newest state, or of the last result, None before any; or raise BadInput."""
        return self._drawer.image(self._patience(values) if self._ask(values) else 0.0)

    def state(self) -> Path | None:
        """Return the file with the newest state of what was ordered; None if there is none yet."""
        there = self._worker is not None and self._answer().get("state", 0)
        return self._worker.folder / STATE if there and self._worker is not None else None

    def result(self, stored: Stored, values: Values, late: bool) -> tuple[Drawn | None, bool, str]:
        """Return the newest image of a result, whether it is the one that was asked for, and what to say of its edits.

        If it may be late, it comes as news, and is not waited for. Raises BadInput, or Gone if the result is not kept.
        """
        shown = Shown(stored.path, finished=True)
        new, self._shown = shown != self._shown, shown
        asked = self._drawer.ask(shown, values)
        if not (late or new or values["Moving"]):
            patience = float("inf")
        else:
            patience = self._patience(values) if asked and not new else 0.0
        drawn = self._drawer.image(patience)
        return drawn, not self._drawer.pending, self._drawer.edited

    def _patience(self, values: Values) -> float:
        return MOVING_PATIENCE if values["Moving"] else PATIENCE

    def _ask(self, values: Values) -> bool:
        """Ask for an image of the newest state, or of the last result; return whether that is news."""
        number = int(self._answer().get("state", 0))
        if number and self._worker is not None:
            self._shown = Shown(self._worker.folder / STATE, (self._number, number))
        return self._shown is not None and self._drawer.ask(self._shown, values)

    @property
    def busy(self) -> bool:
        """Whether something has been ordered that is not there yet."""
        said = self._answer()
        return bool(
            self._wanted and not self._stopped and self._worker is not None and self._worker.alive
            and not said.get("done") and "error" not in said
        )  # fmt: skip

    def news(self, values: Values) -> str:
        """Return a text that changes with every image, and at the end; it ends in * while more is to come."""
        if self._wanted is None and self._shown is None:
            return f"{self._number} none"
        if self.busy and self._draws:
            self._ask(values)
        learning = "learning" if self.busy else "ended"
        there = self._drawer.drawn if self._draws else self._answer().get("state", 0)
        return f"{self._number} {learning} {there}{'*' if self.busy or self._drawer.pending else ''}"

    def describe_progress(self, nothing: str) -> str:
        """Return one line about the work; ``nothing`` says what is shown before the first state."""
        answer = self._answer()
        shown = f"{answer.get('shown') or nothing}{self._drawer.edited if self._draws else ''}"
        if self._stopped:
            return STOPPED.format(shown=shown)
        if not answer:
            return f"Learning begins. {shown}"
        if answer["paused"] or self._paused:
            return f"Paused at {answer['fraction']:.0%}; press Go On. {shown}"
        left = "" if answer["left"] is None else f", {duration(answer['left'])} left"
        keeps = KEEPS if answer.get("shown") else ""
        return f"Learning, {answer['fraction']:.0%}{left}: {answer['label']}. {shown}{keeps}"

    def made(self, wanted: Wanted) -> bool:
        """Return whether the process has made this."""
        return self._wanted == wanted

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

    def lose(self) -> None:
        """Forget the last result, which is no longer in the cache, so that it is ordered again."""
        self.forget()
        self._shown = None
        self._drawer.forget()

    def end(self) -> None:
        """End the process, and forget what it has been given."""
        if self._worker is not None:
            self._worker.stop()
        self._worker, self._sent, self._shown = None, "", None
        self._drawer.end()

    def _answer(self) -> Progressed:
        """Return what the process says about the last order; empty if nothing yet."""
        status = {} if self._worker is None else self._worker.read_status()
        return cast(Progressed, status) if status.get("order") == self._number else {}
