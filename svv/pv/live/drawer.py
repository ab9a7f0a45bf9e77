"""The process that draws scenes for ParaView's window with Live on: those that are being learned, and finished ones.

Loading what draws a scene holds up a process for seconds, and a sharp image takes a second. It obeys the newest order:
it gives a small image, which :mod:`svv.pv.live.glimpse` enlarges, and then the sharp one, unless the camera moves on.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Cancelled, silent
from svv.io.files.worker import Orders, Worker, be_worker, say
from svv.pv.failed import sentence_on
from svv.pv.launch.programs import pvpython_here
from svv.pv.live.glimpse import Arrays, drawn_small
from svv.pv.live.messages import DrawnOf, DrawOrder
from svv.pv.panel.groups import EDITS
from svv.pv.panel_values import Values, with_names
from svv.pv.work.own_edits import edits_of, painted_as_edited, sketch_as_edited

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

IMAGE = "image.npz"
"""File in the process's folder with the image that was drawn last."""

PATIENCE, MOVING_PATIENCE = 0.12, 0.2
"""Seconds that the window waits for an image, before it shows the last one: from another camera, from a moving one."""

IDLE = 900.0
"""Seconds without orders after which the process ends."""

NAMES = (
    "Camera", "ParallelScale", "Frame", "ImageSize", "Moving", "Show", "SeenWith", "Background", "BackgroundColour",
    "Network", "Device", "Variant", *EDITS,
)  # fmt: skip
"""Properties on which an image depends."""

ENDED = "The process that draws beside ParaView has ended ({why}): turn Live off, and ParaView draws itself."


class Gone(Exception):
    """The file of a finished scene is no longer in the cache."""


@dataclass(frozen=True)
class Shown:
    """A scene that is to be drawn."""

    file: Path
    state: tuple[int, int] = (0, 0)
    """What tells it from others that were in the same file."""
    finished: bool = False
    """Whether it is a finished one, and not a sketch."""


@dataclass(frozen=True)
class Drawn:
    """An image."""

    arrays: Arrays
    """RGBA, depth and regions, (height, width, ...) each."""
    camera: Camera
    """The camera that it is meant for; it may have more pixels."""


class Drawer:
    """The process, as the filter sees it; it is started when it is needed."""

    def __init__(self) -> None:
        self._worker: Worker | None = None
        self._number, self._died = 0, False
        self._wanted: tuple[Shown, Values] | None = None
        self._drawn: Drawn | None = None
        self._read: list[int | bool] | None = None

    def start(self) -> Worker:
        """Start the process, unless it is running, and return it."""
        if self._worker is None or not self.alive:
            self._stop()
            self._worker = Worker([*pvpython_here(), "from svv.pv.live.drawer import main; main()"], polite=False)
            self._read = None
        return self._worker

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self._worker is not None and self._worker.alive

    def load(self, file: Path) -> None:
        """Let the process load what it takes, by drawing any scene, as soon as its file is there."""
        self.start().send({"warm": str(file)})

    def ask(self, shown: Shown, values: Values) -> bool:
        """Ask for an image as a panel's values say, unless it was asked for last; return whether it was not."""
        wanted = (shown, with_names({name: value for name, value in values.items() if name in NAMES}))
        again = wanted == self._wanted
        if again and (self.alive or self._died):
            return False
        self._died = again  # it is tried once more
        worker = self.start()
        self._number, self._wanted = self._number + 1, wanted
        worker.send(
            {
                "number": self._number, "file": str(shown.file), "state": shown.state, "finished": shown.finished,
                "values": wanted[1],
            }
        )  # fmt: skip
        return True

    def image(self, patience: float = 0.0) -> Drawn | None:
        """Return the newest image, None before the first; wait some seconds for the sharp one that was asked for.

        Raises BadInput if it cannot be drawn, and Gone if the file is no longer there.
        """
        until = time.monotonic() + patience
        while self.pending and time.monotonic() < until:
            time.sleep(0.004)
        status = self._read_status()
        if status.get("number") == self._number and status.get("gone"):
            raise Gone
        if status.get("number") == self._number and "error" in status:
            raise BadInput(status["error"])
        if self._wanted is not None and not self.alive and not self._is_sharp(status) and self._died:
            raise BadInput(ENDED.format(why=self._worker.last_line() if self._worker else "it was stopped"))
        number = status.get("drawn")
        if number and number != self._read and self._worker is not None:
            try:
                with np.load(self._worker.folder / IMAGE) as stored:
                    arrays = dict(stored)
            except OSError:  # the process has just ended
                return self._drawn
            matrix, (width, height, fov, span) = arrays.pop("matrix"), arrays.pop("lens").tolist()
            self._read = number
            self._drawn = Drawn(arrays, Camera(matrix, fov, int(width), int(height), span or None))
        return self._drawn

    @property
    def drawn(self) -> str:
        """A text that changes with every image and error."""
        status = self._read_status()
        return f"{status.get('number', 0)}{'' if self._is_sharp(status) else '~'}{'' if self.alive else ' ended'}"

    @property
    def edited(self) -> str:
        """What to say of the edits in the newest image, after a space."""
        return self._read_status().get("edited", "")

    @property
    def pending(self) -> bool:
        """Whether an image is being drawn that is better than the newest one."""
        status = self._read_status()
        failed = status.get("number") == self._number and "error" in status
        return self._wanted is not None and self.alive and not failed and not self._is_sharp(status)

    def forget(self) -> None:
        """Forget what was asked for last; the newest image stays."""
        self._number, self._wanted = self._number + 1, None

    def end(self) -> None:
        """End the process, and forget its images."""
        self._stop()
        self._wanted, self._drawn, self._died = None, None, False

    def _stop(self) -> None:
        if self._worker is not None:
            self._worker.stop()
        self._worker = None

    def _read_status(self) -> DrawnOf:
        return {} if self._worker is None else cast(DrawnOf, self._worker.read_status())

    def _is_sharp(self, status: DrawnOf) -> bool:
        """Whether the newest image is the sharp one that was asked for last."""
        return status.get("drawn") == [self._number, True]


# --- the process itself ---------------------------------------------------------------------------------------------


def main() -> None:
    """Obey orders until none has come for a while."""
    orders, folder = be_worker(), Path(sys.argv[-1])
    import svv.fields.scene.scene  # noqa: F401  (while nothing is asked yet)

    Drawing(orders, folder).run()


class Drawing:
    """Obeys orders, always the newest one, and puts images into a folder."""

    def __init__(self, orders: Orders, folder: Path) -> None:
        self._orders, self._folder = orders, folder
        self._scene: Scene | None = None
        self._is: object = None
        self._drawn: tuple[int, bool] | None = None
        self._edited: tuple[object, Scene | None, str] = (None, None, "")

    def run(self) -> None:
        """Obey orders until none has come for a while."""
        while (order := self._newest()) is not None:
            if "warm" in order:
                self._warm(Path(order["warm"]))
                continue
            try:
                self._draw(self._scene_for(order), order)
            except Cancelled:  # another order has come
                continue
            except Gone:
                self._say(order["number"], gone=True, error="")
            except Exception as error:
                self._say(order["number"], error=sentence_on(error))

    def _newest(self) -> DrawOrder | None:
        """Return the last of the orders that wait; to load comes after to draw, which does it."""
        order = cast("DrawOrder | None", self._orders.next(IDLE))
        while not self._orders.empty:
            later = cast("DrawOrder | None", self._orders.next(0.0))
            if later is not None and (order is None or "warm" in order or "warm" not in later):
                order = later
        return order

    def _warm(self, file: Path) -> None:
        """Draw a scene in a file as soon as it is there; stop waiting for it when there is an order."""
        from svv.fields.scene.scene import Scene

        while self._orders.empty and file.parent.exists():
            if file.exists():
                scene = Scene.load(file)
                (camera,) = scene.rig.orbit(2, 64, [0])
                for still in (scene.while_moving(), scene):
                    still.render(camera)
                return
            time.sleep(0.1)

    def _scene_for(self, order: DrawOrder) -> Scene:
        """Return the scene that an order is about; it is read once."""
        from svv.fields.devices.gpu import device_named
        from svv.fields.scene.scene import Scene
        from svv.io.files.cache import Cache

        this = order["file"], order["state"], order["values"]["Device"]
        if self._scene is None or self._is != this:
            file = Path(order["file"])
            scene = Cache(file.parent, 0).read(file.name, Scene.load) if order["finished"] else Scene.load(file)
            if scene is None:
                raise Gone
            self._scene, self._is = scene.on(device_named(order["values"]["Device"])), this
        return self._scene

    def _draw(self, scene: Scene, order: DrawOrder) -> None:
        """Draw a small image, and then the sharp one; only one of them while the camera moves."""
        from svv.pv.work.engine import camera_for, draw

        values, number, moving = order["values"], order["number"], bool(order["values"]["Moving"])
        scene = self._as_edited(scene, order)
        if not moving or not order["finished"]:
            self._give(*drawn_small(scene, values, silent), number, sharp=moving)
        if not moving or order["finished"]:
            camera = camera_for(scene.rig, values)
            self._give(draw(scene, camera, values, self._unless_ordered), camera, number, sharp=True)

    def _as_edited(self, scene: Scene, order: DrawOrder) -> Scene:
        """Return a scene with the edits of the panel; a sketch has those that it can have."""
        edits = edits_of(order["values"])
        this = self._is, repr(edits)
        if self._edited[0] != this:
            as_edited = painted_as_edited if order["finished"] else sketch_as_edited
            self._edited = this, *as_edited(scene, edits)
        edited = self._edited[1]
        assert edited is not None
        return edited

    def _unless_ordered(self, fraction: float, label: str) -> None:
        if not self._orders.empty:
            raise Cancelled

    def _give(self, arrays: Arrays, camera: Camera, number: int, sharp: bool) -> None:
        """Replace the image in the folder."""
        lens = np.array([camera.width, camera.height, camera.fov_x, camera.span_x or 0.0])
        partial = self._folder / f".{IMAGE}"
        with partial.open("wb") as file:
            np.savez(file, matrix=camera.camera_to_world, lens=lens, **arrays)  # type: ignore[arg-type]
        os.replace(partial, self._folder / IMAGE)
        self._drawn = number, sharp
        self._say(number)

    def _say(self, number: int, **more: bool | str) -> None:
        say(self._folder, {"number": number, "drawn": self._drawn, "edited": self._edited[2], **more})
