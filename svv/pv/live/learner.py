"""The process that learns beside ParaView's window: a learner (:mod:`svv.job.learner`) in pvpython, at low priority.

It makes the requests that the filters would make, so its results are the same, and keeps them where those look.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkTable

from svv.errors import BadInput, Cancelled, Progress
from svv.io.files.cache import Cache
from svv.io.files.worker import Orders, be_worker
from svv.job.orders import Order
from svv.pv.failed import sentence_on
from svv.pv.live.handed import WARM, taken
from svv.pv.panel_values import Values
from svv.pv.work.vtk_data import scene_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet
    from svv.job.request import Request

IDLE = 120.0
"""Seconds without work after which the process ends; the next order starts another one."""

DIFFERS = "The process beside ParaView does not see the volume as ParaView does: turn Live off, and please report this."


def main() -> None:
    """Obey orders until none has come for a while."""
    orders, folder = be_worker(), Path(sys.argv[-1])
    with suppress(Cancelled):  # an order came
        warm(orders, folder / WARM)
    from svv.job.learner import Learner

    Learner(orders, folder, Window()).run(IDLE)


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


class Window:
    """ParaView's window: it orders what its filters have in their panels, and looks for the results in the cache."""

    def __init__(self) -> None:
        self._given: vtkDataObject | None = None
        self._held: int | None = None
        self._views: tuple[object, ViewSet] | None = None

    def request(self, order: Order) -> Request:
        """Return what an order asks for, with the input that it or one before brings; BadInput if that has changed."""
        from svv.fields.devices.gpu import device_named
        from svv.pv.work.requests import correcting, learning, painting

        if "input" in order:
            self._given = taken(Path(order["input"]))
            shutil.rmtree(order["input"], ignore_errors=True)  # they stay as long as they are mapped
        given, values = self._given, order["asked"]["values"]
        if not isinstance(given, vtkTable):
            self._check_seen_alike(order, values)
            return learning(given, values)
        scene = scene_of(given).on(device_named(values["Device"]))
        if order["asked"]["kind"] == "StyleRFPalette":
            return correcting(scene, self._reader(values), values)
        return painting(scene, values)

    def sketches(self, order: Order) -> bool:
        """Return True: whoever sits before the window sees them."""
        return True

    def found(self, name: str) -> Scene | None:
        """Return the scene in the cache."""
        from svv.fields.scene.scene import Scene

        return Cache.of_user().read(name, Scene.load)

    def keep(self, name: str, scene: Scene) -> Scene:
        """Put a scene into the cache; if that has no room, the window will say so."""
        from svv.job.request import round_trip

        Cache.of_user().write(name, scene.save)
        found = self.found(name)
        return round_trip(scene) if found is None else found.on(scene.device)

    def checkpoint(self, name: str) -> Path | None:
        """Return a file in the cache, which keeps it while this process holds it."""
        self._let_go()
        place = Cache.of_user()
        file, self._held = place.hold_checkpoint(name)
        place.trim()  # those of trainings that were replaced
        return file

    def learned(self, name: str) -> None:
        """Remove that file."""
        Cache.of_user().remove_checkpoint(name)
        self._let_go()

    def describe_error(self, error: Exception) -> str:
        """Return one sentence on an error."""
        return sentence_on(error)

    def _let_go(self) -> None:
        if self._held is not None:
            os.close(self._held)
            self._held = None

    def _check_seen_alike(self, order: Order, values: Values) -> None:
        """Refuse to learn under a name that another volume, or another display of it, has."""
        from svv.pv.results.keys import name_of, source_of
        from svv.pv.work.engine import training_moment

        if Cache.of_user().holds(order["scene"]):  # which may have been learned of an earlier state of the volume
            return
        now = training_moment(self._given, values, None)
        if name_of("scene", source_of(now), now.settings) != order["scene"]:
            raise BadInput(DIFFERS)

    def _reader(self, values: Values) -> Callable[[Progress], ViewSet]:
        """Return what reads the views that a panel names; they are read again only if they are others."""
        from svv.io.views.transforms import split_of
        from svv.io.views.viewset import ViewSet
        from svv.pv.work.requests import NO_VIEWS

        def read(progress: Progress) -> ViewSet:
            if not values["ViewsFile"]:
                raise BadInput(NO_VIEWS)
            file, key = Path(values["ViewsFile"]), values["KeyOfViews"]
            if self._views is None or self._views[0] != key:
                self._views = key, ViewSet.read(file.parent, split_of(file), progress)
            return self._views[1]

        return read
