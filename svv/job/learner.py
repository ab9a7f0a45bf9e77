"""A process that learns for ParaView's window or a training in the background: it obeys orders, and shows sketches.

Each order is a :class:`svv.job.request.Request`. First sketches with broad strokes are painted
(:mod:`svv.job.sketching`); and when the scene is there, that with broad strokes. Orders that come meanwhile are obeyed
from the callback of the progress.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Any, Protocol, cast

import numpy as np

from svv.errors import BadInput, Cancelled, Progress, part
from svv.fields.devices.gpu import device_named
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import to_json
from svv.io.files.worker import Orders, say
from svv.job.orders import LEARNED, STATE, Order, Progressed
from svv.job.request import Request, learn, paint
from svv.job.sketching import REGIONS, Sketching, corrected_sketch
from svv.train.paint.ink import Ink, style_named
from svv.train.paint.plan import hand_of
from svv.train.run.report import Report
from svv.train.run.sketches import sketches_for

SKETCHED, STROKES = (0.06, 0.15), 0.03
"""Fractions of the work when the first sketch is done, and the finer one; and that which strokes as asked take."""

TELL_EVERY, LISTEN_EVERY = 0.2, 0.5
"""Seconds between two reports, and between two looks at the orders while it is paused."""


class Desk(Protocol):
    """Whoever gives the orders, as the learner sees it: what the orders mean, and where the results are kept."""

    def request(self, order: Order) -> Request:
        """Return what an order asks for. An input that it brings stays with those of the same scene that follow."""

    def sketches(self, order: Order) -> bool:
        """Return whether sketches are shown before the result."""

    def found(self, name: str) -> Scene | None:
        """Return the scene that is kept under a name; None if none is."""

    def keep(self, name: str, scene: Scene) -> Scene:
        """Keep a scene under a name, and return it as it will be read."""

    def checkpoint(self, name: str) -> Path | None:
        """Return the file from which learning this scene resumes; it is held until another one is asked for."""

    def learned(self, name: str) -> None:
        """Remove that file, as its scene is kept."""

    def describe_error(self, error: Exception) -> str:
        """Return one sentence on an error."""


class Learner:
    """Obeys the ``orders`` of a ``desk``, one after another; states and reports go to a folder."""

    def __init__(self, orders: Orders, folder: Path, desk: Desk) -> None:
        self.orders, self.folder, self.desk = orders, folder, desk
        self.order: Order = {}
        self.paused = self._stopped = False
        self._asked: Request | None = None
        self._pending: Order | None = None
        self._said: Progressed = {}
        self._began = self._told = 0.0
        self._sketch = Sketching()
        self._learning = self._repainting = False
        self._sketched = 0.0

    def run(self, idle: float) -> None:
        """Obey orders until none has come for ``idle`` seconds."""
        while self._pending is not None or self._listen(idle):
            if self._pending is not None:
                order, self._pending = self._pending, None
                self._do(order)

    # --- orders -----------------------------------------------------------------------------------------------------

    def take(self, order: Mapping[str, Any]) -> None:
        """Take an order of another kind; there is none."""
        raise ValueError(f"This is no order: {order}")

    def gives(self, scene: Scene) -> None:
        """Do what else is to be done with a scene that is given away; by default nothing."""

    def _listen(self, timeout: float) -> bool:
        """Take the next order; return whether there was one within ``timeout`` seconds."""
        order = self.orders.next(timeout)
        if order is None:
            return False
        if "pause" in order:
            self.paused = order["pause"]
        elif "stop" in order:
            self._stopped, self.paused = True, False
        elif "number" in order:
            last, new = self._pending, cast(Order, order)
            if last is not None and last["scene"] == new["scene"]:  # it has the input, which is sent only once
                new = {**last, **new}
            self._pending, self.paused = new, False
        else:
            self.take(order)
        return True

    def heard(self, fraction: float, label: str) -> None:
        """Tell the progress, and obey what was ordered meanwhile; raises Cancelled if the work is no longer wanted."""
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
            # What is being learned may not depend on how it is painted.
            if self._pending["scene"] != self.order["scene"] or not self._learning or self._sketch.scene is None:
                raise Cancelled
            self._repaint(self._pending)

    def _repaint(self, order: Order) -> None:
        """Paint the sketch anew, in the midst of the training, as an order asks that changes nothing else."""
        self._repainting, self._pending = True, None
        self.order, self._asked = order, self.desk.request(order)
        try:
            self._paint_anew(self._as_it_is)
        except BadInput:  # the painting itself will say why
            return
        finally:
            self._repainting = False

    def _as_it_is(self, fraction: float, label: str) -> None:
        """Obey orders while the progress stays what it is."""
        self.heard(self._said.get("fraction", 0.0), label)

    # --- work -------------------------------------------------------------------------------------------------------

    @property
    def request(self) -> Request:
        """What is asked for now; there is something from the first order on."""
        assert self._asked is not None
        return self._asked

    def _do(self, order: Order) -> None:
        self._began = time.monotonic()
        if self.order.get("scene") != order["scene"]:
            self._sketch = Sketching()
        self.order, self._said, self._stopped, self._sketched = order, {"state": 0}, False, 0.0
        try:
            self._asked = self.desk.request(order)
            if self.desk.sketches(order):
                self._show_sketches()
            report = self._make()
        except Cancelled:
            return
        except Exception as error:
            self._tell(1.0, "failed", error=self.desk.describe_error(error))
            return
        self._tell(1.0, "done", done=True, report=None if report is None else json.loads(to_json(report)))

    def _make(self) -> Report | None:
        """Make and keep the result; return the report on what has been learned."""
        report, request = None, self.request
        told = part(self.heard, self._sketched, 1.0)
        # Whatever is ordered meanwhile that is only painted otherwise has the same scene.
        given = request.input
        scene = given if isinstance(given, Scene) and request.correct is None else self._trained_before()
        if scene is None:
            until = 1.0 if request.paint is None else LEARNED
            checkpoint = self.desk.checkpoint(self.order["scene"])
            self._learning = request.correct is None
            try:
                scene, report = learn(request, part(told, 0.0, until), checkpoint)
            finally:
                self._learning = False
            scene = self.desk.keep(self.order["result"] if request.correct else self.order["scene"], scene)
            self.desk.learned(self.order["scene"])
            self._show_learned(scene)
        if self.request.paint is not None and self.desk.found(self.order["result"]) is None:
            scene = self.desk.keep(self.order["result"], paint(self.request, scene, part(told, LEARNED, 1.0))[0])
        self._said["state"] += 1
        self.gives(scene)
        return report

    def _trained_before(self) -> Scene | None:
        """Return the scene that is to be learned if it is kept."""
        found = self.desk.found(self.order["result"] if self.request.correct else self.order["scene"])
        return None if found is None else found.on(device_named(self.request.device))

    # --- sketches ---------------------------------------------------------------------------------------------------

    def _show_sketches(self) -> None:
        """Make the scenes that are shown first. If that cannot be done, the work itself will say why."""
        request, told = self.request, part(self.heard, 0.0, SKETCHED[0])
        measuring = Thread(target=_measure_pictures, args=[request], daemon=True)
        measuring.start()
        try:
            if request.correct is not None:
                self._sketched = SKETCHED[-1]
                self.show(corrected_sketch(request, part(self.heard, 0.0, SKETCHED[-1])), REGIONS)
                return
            trained = request.input if isinstance(request.input, Scene) else self._trained_before()
            self._sketched = SKETCHED[0]
            if trained is not None:
                self._sketch.take(trained)
                self._paint_sketch(told)
            elif self._sketch.scene is not None:
                self._paint_anew(told)
            else:
                self._sketch_anew(measuring)
        except BadInput:
            return

    def _sketch_anew(self, measuring: Thread) -> None:
        """Make one sketch after another; the last one also in the strokes that are asked for."""
        sketch, begun = self._sketch, 0.0
        for one, until in zip(sketches_for(self.request.train.preset), SKETCHED, strict=False):
            told = part(self.heard, begun, until)
            better = sketch.learn(one, self.request, part(told, 0.0, 0.6))
            measuring.join()
            shown = self._paint_sketch(part(told, 0.6, 1.0))
            begun = until
            if not better:
                break
        self._sketched = begun
        if sketch.refine(shown, self.request):
            self._sketched += STROKES
            self._paint_sketch(part(self.heard, begun, self._sketched))

    def _paint_anew(self, progress: Progress) -> None:
        """Paint a sketch as another order asks, with broad strokes first."""
        self._sketch.as_asked = False
        shown = self._paint_sketch(part(progress, 0.0, 0.5))
        if self._sketch.refine(shown, self.request):
            self._paint_sketch(part(progress, 0.5, 1.0))

    def _show_learned(self, scene: Scene) -> None:
        """Show a trained scene in broad strokes while it is painted as asked, unless that is quick, too."""
        if self.request.paint is None or self.request.train.preset == "draft":
            return
        if self._sketch.as_asked:
            return
        self._sketch.take(scene)
        self._sketch.broaden()
        with suppress(BadInput):  # the painting itself will say why
            self._paint_sketch(self._as_it_is)

    def _paint_sketch(self, progress: Progress) -> Scene:
        """Paint the sketch, or the trained scene, and show it; return it."""
        sketch = self._sketch
        assert sketch.scene is not None
        scene = sketch.scene if self.request.paint is None else sketch.painted(self.request, progress)
        self.show(scene, sketch.told)
        return scene

    def show(self, scene: Scene, said: str) -> None:
        """Give a scene away, to be shown until there is a better one; ``said`` tells the user what it is."""
        scene.save(self.folder / STATE)
        self._said["shown"] = said
        self._said["state"] = self._said["state"] + 1
        self.gives(scene)
        self._tell(self._said.get("fraction", 0.0), self._said.get("label", ""))

    def _tell(self, fraction: float, label: str, **more: object) -> None:
        """Say how far the work is, and how long it will take."""
        self._told = time.monotonic()
        spent = self._told - self._began
        left = spent * (1.0 - fraction) / fraction if fraction > 0.05 and spent > 2.0 else None
        self._said |= {"fraction": fraction, "label": label, "left": left, "paused": self.paused}
        say(self.folder, {**self._said, "order": self.order["number"], **more})


def _measure_pictures(request: Request) -> None:
    """Measure how the style pictures are painted, while views are drawn."""
    with suppress(BadInput):  # the painting itself will say why
        for source in () if request.paint is None else request.paint.sources:
            style = style_named(source)[1]
            if not isinstance(style, Ink):
                hand_of(np.asarray(style, np.float32), None)
