"""The process that learns beside ParaView's window: a filter of the same kind, in pvpython, at low priority.

It does what the filter in ParaView would do (:mod:`svv.pv.live.beside` gives the orders), so its results are the same,
and it keeps them in the cache under the names under which that filter looks for them. First it paints sketches with
broad strokes (:mod:`svv.train.run.sketches`); and when the scene is there, that with broad strokes. Orders that come
meanwhile are obeyed from the callback of the progress.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, Protocol, cast

from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkTable
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithmOutput, vtkTrivialProducer

from svv.errors import BadInput, Cancelled, Progress, part
from svv.io.files.cache import Cache
from svv.io.files.worker import Orders, be_worker, say
from svv.options.making import TrainOptions
from svv.pv.failed import sentence_on
from svv.pv.filters import scene_filters, volume_filters
from svv.pv.filters.vtk_data import scene_of
from svv.pv.live.handed import STATE, WARM, taken
from svv.pv.live.messages import Order, Progressed
from svv.pv.live.sketching import Sketching, measure_pictures
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values
from svv.pv.results.time_steps import Moment
from svv.train.run.sketches import sketches_for

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

SKETCHED, STROKES = (0.06, 0.15), 0.03
"""Fractions of the work when the first sketch is done, and the finer one; and that which strokes as asked take."""

IDLE = 120.0
"""Seconds without work after which the process ends; the next order starts another one."""

DIFFERS = "The process beside ParaView does not see the volume as ParaView does: turn Live off, and please report this."

TELL_EVERY, LISTEN_EVERY = 0.2, 0.5
"""Seconds between two reports, and between two looks at the orders while it is paused."""


def main() -> None:
    """Obey orders until none has come for a while."""
    orders = be_worker()
    learner = Learner(orders, Path(sys.argv[-1]))
    with suppress(Cancelled):  # an order came
        warm(orders, learner.folder / WARM)
    learner.run()


def warm(orders: Orders, file: Path) -> None:
    """Load all that a job takes, by doing a whole small one; stop as soon as there is an order. Save its result."""
    from svv.job.compile_ahead import ball_views
    from svv.train.pipeline import stylize_scene, train_scene
    from svv.train.run.config import preset

    def hurry(fraction: float, label: str) -> None:
        if not orders.empty:
            raise Cancelled

    draft = preset("draft")
    few = replace(
        draft,
        reconstruct=replace(draft.reconstruct, iterations=60, cells=32),
        recolour=replace(draft.recolour, iterations=6),
        stylize=replace(draft.stylize, style_views=4, style_size=64),
    )
    views = ball_views()
    scene, _ = train_scene(views, few, hurry)
    picture = views.images[0, ..., :3].astype("float32") / 255.0
    stylize_scene(scene, [picture], few, hurry, manner="strokes", stroke_size=4.0)[0].save(file)


class Learner:
    """Obeys orders, one after another.

    Args:
        orders: Where they come from.
        folder: Where states and reports go.
    """

    def __init__(self, orders: Orders, folder: Path) -> None:
        self.orders, self.folder = orders, folder
        self.order: Order = {}
        self.paused = self._stopped = False
        self._pending: Order | None = None
        self._said: Progressed = {}
        self._began = self._told = 0.0
        self._made: LearningFilter | None = None
        self._sketch = Sketching()
        self._repainting = self._known = False
        self._held: int | None = None
        self.sketched = 0.0
        """Fraction of the work that the sketches of the last order took."""

    def run(self) -> None:
        """Obey orders until none has come for a while."""
        while self._pending is not None or self._listen(IDLE):
            if self._pending is not None:
                order, self._pending = self._pending, None
                self._do(order)

    @property
    def _filter(self) -> LearningFilter:
        """The filter that does the work; there is one from the first order on."""
        assert self._made is not None
        return self._made

    # --- orders -----------------------------------------------------------------------------------------------------

    def _listen(self, timeout: float) -> bool:
        """Take the next order; return whether there was one within ``timeout`` seconds."""
        order = cast("Order | None", self.orders.next(timeout))
        if order is None:
            return False
        if "pause" in order:
            self.paused = order["pause"]
        elif "stop" in order:
            self._stopped, self.paused = True, False
        else:
            last = self._pending
            if last is not None and last["scene"] == order["scene"]:  # it has the volume, which is sent only once
                order = {**last, **order}
            self._pending, self.paused = order, False
        return True

    def heard(self, fraction: float, label: str) -> None:
        """Tell the progress of the present work, and obey what has been ordered meanwhile.

        Raises:
            Cancelled: The work is no longer wanted as it is.
        """
        while self._listen(0.0):
            pass
        begun = time.monotonic()
        while self.paused:
            self._tell(fraction, label)
            self._listen(LISTEN_EVERY)
        if self._stopped:
            raise Cancelled
        self._began += time.monotonic() - begun
        if time.monotonic() - self._told > TELL_EVERY:
            self._tell(fraction, label)
        if self._pending is not None and not self._repainting:
            if self._pending["scene"] != self.order["scene"] or not self._goes_on():
                raise Cancelled
            self._repaint(self._pending)

    def _goes_on(self) -> bool:
        """Return whether what is being learned does not depend on how it is painted."""
        return self._sketch.scene is not None and self._filter.trains

    def _repaint(self, order: Order) -> None:
        """Paint the sketch anew, in the midst of the training, as an order asks that changes nothing else."""
        self._repainting = True
        try:
            self.order, self._pending = order, None
            self._filter.repaints = True
            self._paint_anew(lambda fraction, label: self.heard(self._said.get("fraction", 0.0), label))
        except BadInput:  # the painting itself will say why
            return
        finally:
            self._repainting = False

    # --- work -------------------------------------------------------------------------------------------------------

    def _do(self, order: Order) -> None:
        self._began = time.monotonic()
        same = self.order.get("scene") == order["scene"]
        self.order, self._said, self._stopped = order, {"state": 0}, False
        try:
            self._open(order, same)
            self._show_sketches()
            while True:
                self._finish()
                if not self._filter.repaints:  # its painting is no longer the one that is asked for
                    break
        except Cancelled:
            return
        except Exception as error:
            self._tell(1.0, "failed", error=sentence_on(error))
            return
        self._tell(1.0, "done", done=True)

    def _open(self, order: Order, same: bool) -> None:
        """Make a filter that has the order's input, unless the last one's has it."""
        if same and self._made is not None:
            return
        self._sketch, self._made = Sketching(), None
        given = taken(Path(order["input"]))
        shutil.rmtree(order["input"], ignore_errors=True)  # they stay as long as they are mapped
        producer = vtkTrivialProducer()
        producer.SetOutput(given)
        self._made = learning(order["kind"], self)
        self._filter.SetInputConnection(producer.GetOutputPort())
        self._filter.given = given

    def _finish(self) -> None:
        """Do all of the work, as the filter in ParaView would."""
        filter = self._filter
        filter.values.update(self.order["values"])
        # What is made of a scene depends on all that can be ordered.
        filter.failed, filter.repaints, filter.trains = "", False, not isinstance(filter.given, vtkTable)
        if not Cache.of_user().holds(self.order["scene"]):
            filter.release()  # what it has may be no longer there for the filter in ParaView
        if self.order["anew"]:
            filter.anew()
        self._hold_checkpoint()
        filter.Modified()
        filter.Update()
        if self._pending is not None or self._stopped:
            raise Cancelled
        if filter.failed and not filter.repaints:
            raise BadInput(filter.failed)
        Cache.of_user().remove_checkpoint(self.order["scene"])
        self._let_go()

    def _hold_checkpoint(self) -> None:
        """Let the training resume from a file in the cache, which keeps it while this process holds it."""
        self._let_go()
        place = Cache.of_user()
        self._filter.checkpoint, self._held = place.hold_checkpoint(self.order["scene"])
        place.trim()  # those of trainings that were replaced

    def _let_go(self) -> None:
        if self._held is not None:
            os.close(self._held)
            self._held = None

    def _show_sketches(self) -> None:
        """Make the scenes that are shown first. If that cannot be done, the work itself will say why."""
        filter = self._filter
        filter.values.update(self.order["values"])
        filter.trains = False
        measuring = Thread(target=measure_pictures, args=[self.order["values"]], daemon=True)
        measuring.start()
        try:
            trained = self._trained_before()
            self.sketched = SKETCHED[0]
            made = None if trained is None else filter.sketch(trained, part(self.heard, 0.0, SKETCHED[-1]))
            self._known = trained is not None
            if made is not None:
                self.sketched = SKETCHED[-1]
                self.show(*made)
            elif trained is not None:
                self._sketch.take(trained)
                self._paint_sketch(part(self.heard, 0.0, SKETCHED[0]))
            elif self._sketch.scene is not None:
                self._paint_anew(part(self.heard, 0.0, SKETCHED[0]))
            else:
                self._sketch_anew(measuring)
        except BadInput:
            return

    def _sketch_anew(self, measuring: Thread) -> None:
        """Make one sketch after another; the last one also in the strokes that are asked for."""
        sketch, values, begun = self._sketch, self.order["values"], 0.0
        few = sketches_for(options_in(TrainOptions, values).preset)
        for one, until in zip(few, SKETCHED, strict=False):
            told = part(self.heard, begun, until)
            better = sketch.learn(one, self._filter.given, values, part(told, 0.0, 0.6))
            measuring.join()
            shown = self._paint_sketch(part(told, 0.6, 1.0))
            begun = until
            if not better:
                break
        self.sketched = begun
        if self._paints and sketch.refine(shown, values):
            self.sketched += STROKES
            self._paint_sketch(part(self.heard, begun, self.sketched))

    def _paint_anew(self, progress: Progress) -> None:
        """Paint a sketch as another order asks, with broad strokes first."""
        self._sketch.as_asked = False
        shown = self._paint_sketch(part(progress, 0.0, 0.5))
        if self._paints and self._sketch.refine(shown, self.order["values"]):
            self._paint_sketch(part(progress, 0.5, 1.0))

    def trained(self, scene: Scene) -> None:
        """Show the trained scene in broad strokes while it is painted as asked, unless that is quick, too."""
        values, known = self.order["values"], self._known
        if known or not self._paints or options_in(TrainOptions, values).preset == "draft" or self._sketch.as_asked:
            return
        self._sketch.take(scene)
        self._sketch.broaden()
        with suppress(BadInput):  # the painting itself will say why
            self._paint_sketch(lambda fraction, label: self.heard(self._said.get("fraction", 0.0), label))

    def _trained_before(self) -> Scene | None:
        """Return the trained scene if there is one: the filter's input, or what is in the cache."""
        from svv.fields.devices.gpu import device_named
        from svv.fields.scene.scene import Scene

        if isinstance(self._filter.given, vtkTable):
            found: Scene | None = scene_of(self._filter.given)
        else:
            found = Cache.of_user().read(self.order["scene"], Scene.load)
        return None if found is None else found.on(device_named(self.order["values"]["Device"]))

    def _paint_sketch(self, progress: Progress) -> Scene:
        """Paint the sketch, or the trained scene, and show it; return it."""
        sketch = self._sketch
        assert sketch.scene is not None
        scene = sketch.painted(self.order["values"], progress) if self._paints else sketch.scene
        self.show(scene, sketch.told)
        return scene

    @property
    def _paints(self) -> bool:
        """Whether the order is about a painting, and not only about the scene below it."""
        return self.order["kind"] == "StyleRFStylize" or bool(self.order["values"].get("StyleFiles"))

    def show(self, scene: Scene, said: str) -> None:
        """Give a scene away, to be shown until there is a better one; ``said`` tells the user what it is."""
        scene.save(self.folder / STATE)
        self._said["shown"] = said
        self._said["state"] = self._said["state"] + 1
        self._tell(self._said.get("fraction", 0.0), self._said.get("label", ""))

    def _tell(self, fraction: float, label: str, **more: bool | str) -> None:
        """Say how far the work is, and how long it will take."""
        self._told = time.monotonic()
        spent = self._told - self._began
        left = spent * (1.0 - fraction) / fraction if fraction > 0.05 and spent > 2.0 else None
        self._said |= {"fraction": fraction, "label": label, "left": left, "paused": self.paused}
        say(self.folder, {**self._said, "order": self.order["number"], **more})


class LearningFilter(Protocol):
    """What the learner needs of a filter that :func:`learning` has made."""

    values: Values
    failed: str
    """Why its work has failed; empty if it has not."""
    trains: bool
    """Whether it does what does not depend on how it is painted."""
    repaints: bool
    """Whether its painting is no longer what is asked for."""
    given: vtkDataObject
    """Its input."""
    checkpoint: Path

    def SetInputConnection(self, port: vtkAlgorithmOutput) -> None: ...
    def Modified(self) -> None: ...
    def Update(self) -> None: ...
    def release(self) -> None: ...
    def anew(self) -> None: ...
    def sketch(self, scene: Scene, progress: Progress) -> tuple[Scene, str] | None: ...


def learning(kind: str, learner: Learner) -> LearningFilter:
    """Return a filter of a kind that reports to a learner instead of ParaView's window."""
    decorated = getattr(scene_filters if hasattr(scene_filters, kind) else volume_filters, kind)
    plain: Any = getattr(decorated, "_pv_original_func", decorated)

    class Learning(plain):
        shows = False
        failed = ""
        trains = True
        repaints = False

        def wants(self, now: Moment, painting: str) -> None:
            super().wants(now, painting)
            if self._wanted[0] != learner.order["scene"]:
                raise BadInput(DIFFERS)

        def progress(self, fraction: float, label: str) -> None:
            if self.repaints and not self.trains:
                raise Cancelled
            learner.heard(learner.sketched + (1.0 - learner.sketched) * fraction, label)

        def gives(self, **names: str) -> None:
            super().gives(**names)
            if self.trains and "scene" in names:
                self.trains = False
                learner.trained(self.steps.result[0])

        def say(self, sentence: str, error: bool = True) -> None:
            self.failed = sentence

    return Learning()
