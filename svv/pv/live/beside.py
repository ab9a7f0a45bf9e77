"""Filters that learn beside ParaView's window: in a process of their own, whose results they show as they arrive.

With *Live* on, and if the window has made the filter (:mod:`svv.pv.live.sharpening`), a result that is not kept yet is
ordered from :mod:`svv.pv.live.learner`. Until it is kept, the filter outputs the best there is.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.dvr.parallel.ranks import ranks_here
from svv.errors import BadInput
from svv.io.files.cache import Cache
from svv.pv.live.drawer import Drawn, Gone
from svv.pv.live.ordered import Ordered, Wanted
from svv.pv.panel_values import Values, with_names
from svv.pv.results.keys import key_of, name_of, source_of
from svv.pv.results.stored import Stored
from svv.pv.results.time_steps import Moment
from svv.pv.vtk_types import Data, OutInfo
from svv.pv.work.cached import FOUND, Keeping
from svv.pv.work.parallel import crew_of
from svv.pv.work.unfinished import mark_unfinished
from svv.pv.work.vtk_data import key_of_views, put_drawn, put_stored, time_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

ONLY_SHOWN = (
    "Live", "InWindow", "Late", "LiveState", "KeptAs", "FollowCamera", "Moving", "ImageSize", "Camera",
    "ParallelScale", "Frame", "Show", "SeenWith", "Background", "BackgroundColour", "MaskFolder",
    "PointRegion",
)  # fmt: skip
"""Properties that do not go to the process, as it shows nothing."""

_deleters: list[Callable[[object, str], None]] = []
"""Deletion observers; if only the filters held them, Python would collect them too early."""


class NotYet(Exception):
    """A result is being made in another process."""


class Beside(Keeping):
    """A filter that learns in a process of its own if it may; the one in ParaView's window otherwise."""

    draws = False
    """Whether another process draws what there is."""

    headers = True
    """Whether the headers of results are enough in this process."""

    nothing = "There is no scene yet."
    """What is shown before there is anything."""

    def __init__(self) -> None:
        super().__init__()
        self._learner = Ordered(type(self).__name__, self.draws)
        self._wanted: Wanted = ("", "", "")
        self.data: vtkDataObject | None = None
        self._moment: Moment | None = None
        self._take = False
        self._lived: bool | None = None
        self._again = False
        self.AddObserver("DeleteEvent", _stopper(self._learner))

    # --- for subclasses ---------------------------------------------------------------------------------------------

    def result(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        """Do the work, as :meth:`Filter.work`; raises :class:`NotYet` from :meth:`found_or_made`."""
        raise NotImplementedError

    def meanwhile(self, inputs: list[Data], outputs: list[Data], learner: Ordered) -> None:
        """Fill the outputs with the best there is, while there is no result yet."""
        raise NotImplementedError

    def wants(self, scene: str, result: str = "", more: str = "") -> None:
        """Say which scene is learned, or is the input, which painted or corrected one is wanted of it, and more."""
        self._wanted = scene, result, more

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

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        """Output the result, or what there is of it."""
        self.data = inputs[0]
        lives = self._lives()
        if not lives:
            self._learner.end()
        if self._lived not in (None, lives):
            self.release()
        self._lived = lives
        try:
            try:
                said = self.result(inputs, outputs, out_info)
            except Gone:  # it is made again
                self.release()
                self._learner.lose()
                said = self.result(inputs, outputs, out_info)
        except NotYet:
            self.meanwhile(inputs, outputs, self._learner)
            return self._learner.describe_progress(self.nothing)
        finally:
            self.values["Late"] = False
        self._moment = None
        return said

    def put_newest(self, table: Data) -> bool:
        """Fill a table with the newest state of the scene, marked as unfinished; return whether there is one."""
        file = self._learner.state()
        if file is not None:
            with suppress(BadInput):  # its process has just ended
                put_stored(*Stored.and_content(file), table)
                mark_unfinished(table)
                return True
        return False

    def release(self) -> None:
        """Forget the results in memory: in this process they are scenes, beside it no more than their headers."""
        self.steps.results.clear()

    def load_cached(self, name: str, kind: str) -> Scene | Stored | None:
        """Return the result that is kept under a name, or None; only its header, if another process draws it."""
        if not (self.headers and self._lives()):
            return super().load_cached(name, kind)
        found = Cache.of_user().read(name, Stored.read)
        return super().load_cached(name, kind) if found is not None and self._follows(found) else found

    def found_in(self, file: Path, now: Moment) -> Scene | Stored | None:
        """Return the scene in the user's file, as :meth:`load_cached` does; None if it is something else."""
        from svv.pv.work.engine import scene_in

        if self.headers and self._lives():
            found = Stored.read(file) if file.exists() else None
            if found is None or found.made.get("key") != key_of(now):
                return None
            if not self._follows(found):
                return found
        return scene_in(file, now, self.values)

    def _follows(self, stored: Stored) -> bool:
        """Whether a scene is to follow its volume in time, for which it has to be in this process."""
        return stored.follows_time and time_of(self.data) is not None

    def found_or_made(
        self, slot: str, kind: str, now: Moment, make: Callable[[], Any], own: Callable[[], Any] | None = None
    ) -> tuple[Any, str]:
        """Return a result and its name as :meth:`Keeping.found_or_made`, or order it and raise NotYet."""
        lives = self._lives()
        if lives and self._anew:
            Cache.of_user().remove(name_of(kind, source_of(now), now.settings))
            self._anew, self._again = False, True
        found, name = super().found_or_made(slot, kind, now, self._order if lives else make, own)
        if self._learner.made(self._wanted) and self.note == FOUND:
            self.note = ""
        return found, name

    def _lives(self) -> bool:
        """Whether results are made in another process."""
        return (
            bool(self.values["Live"] and self.values["InWindow"] and not self.values.get("TrainEachTimeStep"))
            and not self.values.get("Continue")  # from a painting that only this process has
            and key_of_views(self.data) is None
            and crew_of(self.data) is None
            and ranks_here() is None
            and Cache.of_user().bound > 0
        )

    def _order(self) -> NoReturn:
        if self._again or not self._learner.asks_for(self._wanted):
            values = with_names({k: v for k, v in self.values.items() if k not in ONLY_SHOWN})
            self._learner.order(self._wanted, *self.handed(values))
            self._again = False
        raise NotYet

    def handed(self, values: Values) -> tuple[Values, Callable[[Path], None]]:
        """Return the values for the process, and what writes the input to a new folder: a volume."""
        from svv.pv.live.handed import hand_over
        from svv.pv.work.engine import transfer_function_of, volume_of

        values = {**values, "TransferFunction": transfer_function_of(self.values).to_dict()}
        image, time = volume_of(self.data, self.values), time_of(self.data)
        return values, lambda folder: hand_over(image, values, time, folder)

    # --- what the client asks and the panel's buttons ---------------------------------------------------------------

    def prepare(self) -> None:
        """Start the process, so that it has loaded what it takes when the first order comes."""
        if self._lives():
            with suppress(BadInput):  # the first order will say so
                self._learner.start()

    def GetLearned(self) -> str:
        """Return a text that changes whenever there is something new to show; it ends in * while more is to come."""
        if self._learner.busy:
            self._status = self._learner.describe_progress(self.nothing)
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
        self._status = self._learner.describe_progress(self.nothing)


class DrawnBeside(Beside):
    """Such a filter whose output is an image, which another process draws."""

    draws = True
    nothing = "The volume is shown as it is."

    def meanwhile(self, inputs: list[Data], outputs: list[Data], learner: Ordered) -> None:
        self.drawn_beside(inputs[0], outputs[0], learner.picture(self.values))

    def drawn_beside(self, data: Data, image: Data, drawn: Drawn | None) -> None:
        """Output an image that another process has drawn, or at first the volume as ParaView shows it."""
        from svv.pv.live.glimpse import enlarged, glanced
        from svv.pv.work.engine import size_of

        arrays, camera = glanced(self, data) if drawn is None else (drawn.arrays, drawn.camera)
        if drawn is not None:
            self.get_or_make("glance", None, lambda: None)  # no longer needed
        camera = camera.resized(*size_of(self.values))
        put_drawn(image, enlarged(arrays, camera), camera)


def _stopper(learner: Ordered) -> Callable[[object, str], None]:
    """Return an observer that ends a deleted filter's process."""

    def stop(_: object, event: str) -> None:
        learner.end()
        _deleters.remove(stop)

    _deleters.append(stop)
    return stop
