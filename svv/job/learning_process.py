"""The process of a training in the background (:class:`svv.train.run.learning.Learning`)."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from svv.errors import BadInput, Progress, part
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import to_json
from svv.io.files.worker import Orders, be_worker, say
from svv.io.views.viewset import ViewSet
from svv.options.making import TrainOptions
from svv.render.web.page import write_html
from svv.train.pipeline import LEAST_VIEWS, train_scene
from svv.train.run.learning import PAGE, RESULT, STATE, VIEWS
from svv.train.value_sketch import sketches_of

TELL_EVERY = 0.2
"""Seconds between two reports."""

SKETCHED = 0.15
"""Fraction of the work that sketches are counted as."""

UNEXPECTED = "This should not have failed ({error}): please report it, with the views and this line."


def main() -> None:
    """Obey one order."""
    orders = be_worker()
    LearningProcess(orders, Path(sys.argv[-1])).run()


class LearningProcess:
    """Trains as an order says, and reports to a folder.

    Args:
        orders: Where the order, and pauses, come from.
        folder: Where the views are, and where results and reports go.
    """

    def __init__(self, orders: Orders, folder: Path) -> None:
        self._orders, self._folder = orders, folder
        self._said: dict[str, Any] = {"state": 0}
        self._begun = self._told = 0.0
        self._page: dict[str, Any] | None = None
        self._scene: Scene | None = None

    def run(self) -> None:
        """Wait for the order and train; say the result, or one sentence on why there is none."""
        order = None
        while order is None or "options" not in order:
            order = self._orders.next(3600.0)
            if order is not None and "page" in order:
                self._page = order["page"]
        self._begun = time.monotonic()
        try:
            report = self._train(_options(order["options"]), order["checkpoint"])
            say(self._folder, {**self._said, "fraction": 1.0, "label": "done", "report": report})
        except BadInput as error:
            self._fail(str(error))
        except Exception as error:
            self._fail(UNEXPECTED.format(error=f"{type(error).__name__}: {error}"))

    def _train(self, options: TrainOptions, checkpoint: str | None) -> dict[str, object]:
        views = ViewSet.read(self._folder / VIEWS)
        resumes = checkpoint is not None and Path(checkpoint).exists()
        if len(views) >= LEAST_VIEWS and not resumes:
            self._sketch(views, options, part(self._heard, 0.0, SKETCHED))
        file = None if checkpoint is None else Path(checkpoint)
        scene, report = train_scene(views, options, part(self._heard, SKETCHED, 1.0), file)
        self._give(scene, RESULT)
        if file is not None:
            file.unlink(missing_ok=True)
        return dict(json.loads(to_json(report)))

    def _sketch(self, views: ViewSet, options: TrainOptions, progress: Progress) -> None:
        """Train the sketches. If one cannot be trained, the training itself will say why."""
        try:
            for scene in sketches_of(views, options, progress):
                self._give(scene, STATE)
        except BadInput:
            return

    def _give(self, scene: Scene, name: str) -> None:
        """Give a scene away, and its page if that is wanted."""
        scene.save(self._folder / name)
        self._scene = scene
        self._said["state"] += 1
        self._write_page()

    def _write_page(self) -> None:
        if self._page is not None and self._scene is not None:
            write_html(self._folder / PAGE, self._scene, **self._page)
            self._said["page"] = self._said["state"]

    def _heard(self, fraction: float, label: str) -> None:
        """Tell the progress, and wait while the training is paused."""
        paused = False
        while (order := self._orders.next(0.5 if paused else 0.0)) is not None or paused:
            if order is not None and "page" in order:
                self._page = order["page"]
                self._write_page()
            elif order is not None:
                paused = bool(order["pause"])
            self._tell(fraction, "paused" if paused else label)
        if time.monotonic() - self._told > TELL_EVERY:
            self._tell(fraction, label)

    def _tell(self, fraction: float, label: str) -> None:
        self._told = time.monotonic()
        spent = self._told - self._begun
        left = spent * (1.0 - fraction) / fraction if fraction > 0.05 else None
        self._said |= {"fraction": fraction, "label": label, "left": left}
        say(self._folder, self._said)

    def _fail(self, sentence: str) -> None:
        say(self._folder, {**self._said, "error": sentence})


def _options(told: dict[str, object]) -> TrainOptions:
    """Return options from their JSON, which has lists for tuples."""
    values: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in told.items()}
    return TrainOptions(**values)
