"""The process of a training in the background (:class:`svv.train.run.learning.Learning`)."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.io.files.worker import Orders, be_worker
from svv.io.views.viewset import ViewSet
from svv.job.learner import Learner
from svv.job.orders import Order
from svv.job.request import Request
from svv.options.making import TrainOptions
from svv.render.web.page import write_html
from svv.train.run.learning import PAGE, RESULT, VIEWS

IDLE = 3600.0
"""Seconds without an order after which the process ends."""

UNEXPECTED = "This should not have failed ({error}): please report it, with the views and this line."


def main() -> None:
    """Train as the script or the notebook orders that has started this process."""
    orders, folder = be_worker(), Path(sys.argv[-1])
    InBackground(orders, folder).run(IDLE)


class Script:
    """The script: it orders one training, whose views are in a folder, and so will be the scene."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._checkpoint = folder, ""

    def request(self, order: Order) -> Request:
        """Return the training that an order asks for."""
        told, self._checkpoint = order["asked"]["options"], order["asked"]["checkpoint"] or ""
        values: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in told.items()}
        return Request(ViewSet.read(self._folder / VIEWS), train=TrainOptions(**values))

    def sketches(self, order: Order) -> bool:
        """Return whether sketches are shown: not of a training that resumes."""
        file = self.checkpoint("")
        return file is None or not file.exists()

    def found(self, name: str) -> Scene | None:
        """Return None: the script has no such scene yet."""
        return None

    def keep(self, name: str, scene: Scene) -> Scene:
        """Write the scene to the folder."""
        scene.save(self._folder / RESULT)
        return scene

    def checkpoint(self, name: str) -> Path | None:
        """Return the script's own checkpoint, if it wants one."""
        return Path(self._checkpoint) if self._checkpoint else None

    def learned(self, name: str) -> None:
        """Remove the checkpoint."""
        file = self.checkpoint(name)
        if file is not None:
            file.unlink(missing_ok=True)

    def describe_error(self, error: Exception) -> str:
        """Return one sentence on an error."""
        if isinstance(error, BadInput):
            return str(error)
        return UNEXPECTED.format(error=f"{type(error).__name__}: {error}")


class InBackground(Learner):
    """Trains, and writes the pages of its scenes for browsers as soon as they are wanted."""

    def __init__(self, orders: Orders, folder: Path) -> None:
        super().__init__(orders, folder, Script(folder))
        self._page: dict[str, Any] | None = None
        self._shown: Scene | None = None

    def take(self, order: Mapping[str, Any]) -> None:
        """Take the title and the background that pages are to have."""
        self._page = order["page"]
        self._write_page()

    def gives(self, scene: Scene) -> None:
        """Write the page of a scene that is given away."""
        self._shown = scene
        self._write_page()

    def _write_page(self) -> None:
        if self._page is not None and self._shown is not None:
            write_html(self.folder / PAGE, self._shown, **self._page)
            self._said["page"] = self._said["state"]
