"""The process that draws the scenes that are shown while better ones are learned.

Loading what draws a scene holds up a process for seconds, and so would hold up ParaView's window. The process waits for
orders, obeys the newest one, and gives small images, which :mod:`svv.pv.live.glimpse` enlarges.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, silent
from svv.io.files.worker import Orders, Worker, be_worker, say
from svv.pv.launch.programs import pvpython_here

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

Arrays = dict[str, NDArray[Any]]

IMAGE = "image.npz"
"""File in the process's folder with the image that was drawn last."""

PATIENCE = 0.12
"""Seconds that the window waits for an image from another camera, before it shows the last one."""

IDLE = 180.0
"""Seconds without orders after which the process ends."""

NAMES = (
    "Camera", "ParallelScale", "Frame", "ImageSize", "Show", "Background", "BackgroundColour", "Network", "Device",
    "Variant",
)  # fmt: skip
"""Properties on which an image depends."""


class Drawer:
    """The process, as the filter sees it; it is started when it is needed."""

    def __init__(self) -> None:
        self._worker: Worker | None = None
        self._asked: tuple[int, Any] = (0, None)
        self._drawn: tuple[int, Arrays, Camera] | None = None

    def start(self) -> Worker:
        """Start the process, unless it is running, and return it."""
        if self._worker is None or not self._worker.alive:
            self.end()
            self._worker = Worker([*pvpython_here(), "from svv.pv.live.drawer import main; main()"], polite=False)
        return self._worker

    def load(self, file: Path) -> None:
        """Let the process load what it takes, by drawing any scene, as soon as its file is there."""
        self.start().send({"warm": str(file)})

    def ask(self, file: Path, state: tuple[int, int], values: Mapping[str, Any]) -> bool:
        """Ask for an image, unless it was asked for last; return whether it was not.

        Args:
            file: A scene's file.
            state: What tells this scene from others in the same file.
            values: The panel's values, as which it is to be drawn.
        """
        wanted = (state, {name: values[name] for name in NAMES if name in values})
        if wanted == self._asked[1]:
            return False
        worker = self.start()
        self._asked = self._asked[0] + 1, wanted
        worker.send({"number": self._asked[0], "file": str(file), "state": state, "values": wanted[1]})
        return True

    def image(self, patience: float = 0.0) -> tuple[Arrays, Camera] | None:
        """Return the newest small image, and the camera that it is meant for; None before the first.

        Args:
            patience: Seconds to wait for the image that was asked for last, if it is not there.
        """
        until = time.monotonic() + patience
        while self.drawn < self._asked[0] and time.monotonic() < until:
            time.sleep(0.004)
        number = self.drawn
        if number and (self._drawn is None or self._drawn[0] != number) and self._worker is not None:
            try:
                with np.load(self._worker.folder / IMAGE) as stored:
                    arrays = dict(stored)
            except OSError:  # the process has just ended
                return None
            matrix, (width, height, fov, span) = arrays.pop("matrix"), arrays.pop("lens").tolist()
            self._drawn = number, arrays, Camera(matrix, fov, int(width), int(height), span or None)
        return None if self._drawn is None else self._drawn[1:]

    @property
    def drawn(self) -> int:
        """Number of the image that was drawn last; 0 if none was."""
        return 0 if self._worker is None else int(self._worker.said().get("number", 0))

    def end(self) -> None:
        """End the process."""
        if self._worker is not None:
            self._worker.stop()
        self._worker, self._asked, self._drawn = None, (0, None), None


def main() -> None:
    """Obey orders until none has come for a while."""
    orders, folder = be_worker(), Path(sys.argv[-1])
    import svv.fields.scene.scene  # noqa: F401  (while nothing is asked yet)

    scene: Scene | None = None
    shown: object = None
    while (order := _newest(orders)) is not None:
        if "warm" in order:
            _warm(Path(order["warm"]), orders)
            continue
        try:
            if scene is None or shown != order["state"]:
                scene, shown = _scene(Path(order["file"]), order["values"]), order["state"]
            _draw(scene, order["values"], folder)
        except BadInput:  # the filter itself says it, or the file is no longer there
            continue
        say(folder, {"number": order["number"]})


def _newest(orders: Orders) -> dict[str, Any] | None:
    """Return the last of the orders that wait."""
    order = orders.next(IDLE)
    while not orders.empty:
        order = orders.next(0.0)
    return order


def _warm(file: Path, orders: Orders) -> None:
    """Draw a scene in a file as soon as it is there; stop waiting for it when there is an order."""
    from svv.fields.scene.scene import Scene

    while orders.empty and file.parent.exists():
        if file.exists():
            scene = Scene.load(file)
            scene.while_moving().render(scene.rig.orbit(2, 64, [0])[0])
            return
        time.sleep(0.1)


def _scene(file: Path, values: Mapping[str, Any]) -> Scene:
    from svv.fields.scene.scene import Scene
    from svv.kernels.dispatch import device_named

    return Scene.load(file).on(device_named(values["Device"]))


def _draw(scene: Scene, values: Mapping[str, Any], folder: Path) -> None:
    from svv.pv.live.glimpse import drawn_small

    arrays, camera = drawn_small(scene, values, silent)
    lens = np.array([camera.width, camera.height, camera.fov_x, camera.span_x or 0.0])
    partial = folder / f".{IMAGE}"
    with partial.open("wb") as file:
        np.savez(file, matrix=camera.camera_to_world, lens=lens, **arrays)  # type: ignore[arg-type]
    os.replace(partial, folder / IMAGE)
