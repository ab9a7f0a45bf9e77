"""Training in the background, as a script or a notebook sees it: in a process of low priority that ends with theirs."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from svv.errors import BadInput, Cancelled, Progress, silent
from svv.fields.scene.scene import Scene
from svv.io.files.worker import Worker
from svv.io.views.viewset import ViewSet
from svv.options.making import TrainOptions
from svv.train.run.report import Report

STATE, RESULT, PAGE, VIEWS = "state.svv", "scene.svv", "page.html", "views"
"""Files in the process's folder: the newest sketch, the result, their page for browsers; and the folder of views."""

LOOK_EVERY = 0.2
"""Seconds between two looks at what the process says."""

ENDED = "The process that trains has ended ({why}): call train_scene again; with a checkpoint, it resumes."


class Learning:
    """A training in the background; :func:`svv.train_scene` starts it with ``background=True``.

    Sketches come first, after some ten seconds, and then the scene. The training ends with this process, or if this
    object is deleted.

    Args:
        command: The program of the process, with its arguments.
        views: Training views.
        options: How to train.
        checkpoint: File to save to regularly, and to resume from if it exists; it is removed when the scene is there.

    >>> learning = svv.train_scene(views, "fast", background=True)
    >>> part, label = learning.progress
    >>> part < 1.0, learning.done
    (True, False)
    >>> learning.stop()  # or scene, report = learning.wait()
    """

    def __init__(
        self, command: Sequence[str], views: ViewSet, options: TrainOptions, checkpoint: Path | None = None
    ) -> None:
        self._worker = Worker(command)
        self._end = weakref.finalize(self, self._worker.stop)
        self._failed, self._stopped, self._asked = "", False, False
        self._read: tuple[int, Scene] | None = None
        self._result: tuple[Scene, Report] | None = None
        self._page: tuple[int, str] | None = None
        self._looking = threading.RLock()
        file = None if checkpoint is None else str(checkpoint.absolute())
        asked = {"options": asdict(options), "checkpoint": file}
        order = {"number": 1, "scene": "", "result": "", "asked": asked}
        self._sending = threading.Thread(target=self._send, args=(views, order), daemon=True)
        self._sending.start()

    def _send(self, views: ViewSet, order: Mapping[str, object]) -> None:
        try:
            views.write(self._worker.folder / VIEWS)
            self._worker.send(order)
        except (BadInput, OSError, ValueError) as error:  # ValueError: it was stopped
            self._failed = str(error)

    @property
    def progress(self) -> tuple[float, str]:
        """The finished fraction in [0, 1], and what is being done."""
        if self._result is not None:
            return 1.0, "done"
        status = self._worker.read_status()
        label = "paused" if status.get("paused") else str(status.get("label", "starting"))
        return float(status.get("fraction", 0.0)), label

    @property
    def left(self) -> float | None:
        """Seconds that are left; None if that is not known."""
        left = self._worker.read_status().get("left")
        return None if left is None else float(left)

    @property
    def number(self) -> int:
        """Number of scenes that there have been, which tells a newer one from those before; 0 if there is none yet."""
        self._collect()
        return 0 if self._read is None else self._read[0]

    @property
    def scene(self) -> Scene | None:
        """The newest scene: a sketch, or at the end the result; None if there is none yet."""
        self._collect()
        return None if self._read is None else self._read[1]

    @property
    def done(self) -> bool:
        """Whether the scene is there, or will not come because the training was stopped or has failed."""
        return self._collect() or self._stopped or bool(self._error())

    def pause(self) -> None:
        """Let the training wait; that does not count towards its time limit."""
        self._worker.send({"pause": True})

    def go_on(self) -> None:
        """Let the training go on after a pause."""
        self._worker.send({"pause": False})

    def stop(self) -> None:
        """Stop the training for good; ``scene`` stays what it is."""
        if not self.done:
            self._stopped = True
        self._end()

    def wait(self, timeout: float | None = None, progress: Progress = silent) -> tuple[Scene, Report]:
        """Wait for the scene, and return it with its report, as :func:`svv.train_scene` returns them.

        Args:
            timeout: Most seconds to wait.
            progress: Called several times a second; the training goes on if it raises.

        Raises:
            BadInput: The training has failed; one sentence says why.
            Cancelled: It was stopped.
            TimeoutError: The scene is not there yet.
        """
        until = None if timeout is None else time.monotonic() + timeout
        while not self.done:
            if until is not None and time.monotonic() > until:
                raise TimeoutError(f"The scene is not there after {timeout:g} seconds; the training goes on.")
            progress(*self.progress)
            time.sleep(LOOK_EVERY)
        if self._result is not None:
            progress(1.0, "done")
            return self._result
        if self._stopped:
            raise Cancelled
        raise BadInput(self._error())

    def watch(self, call: Callable[[Learning], None]) -> threading.Thread:
        """Call a function, in a thread of its own, whenever there is something new, and at the end."""

        def look() -> None:
            last: object = None
            while True:
                done = self.done
                now = self.number, self.progress, done
                if now != last:
                    call(self)
                    last = now
                if done:
                    return
                time.sleep(LOOK_EVERY)

        thread = threading.Thread(target=look, daemon=True)
        thread.start()
        return thread

    def _error(self) -> str:
        """Return why the training has failed; '' if it has not."""
        if self._failed or self._result is not None:
            return self._failed
        alive, status = self._worker.alive, self._worker.read_status()  # in this order: the last status counts
        if "error" in status:
            return str(status["error"])
        return "" if alive or "report" in status else ENDED.format(why=self._worker.last_line() or "it was killed")

    def page(self, title: str, background: Sequence[float]) -> tuple[int, str] | None:
        """Return the page of the newest scene that has one, and the scene's number; None if there is none yet.

        The process makes pages, which takes seconds, from the first call on.

        Args:
            title: Heading of the page.
            background: RGB in [0, 1] behind the scene.
        """
        if not self._asked and self._result is None:
            self._asked = True
            self._worker.send({"page": {"title": title, "background": list(background)}})
        self._collect()
        return self._page

    def _collect(self) -> bool:
        """Read what is new; return whether the result is there."""
        with self._looking:
            return self._look()

    def _look(self) -> bool:
        if self._result is not None or not self._end.alive:
            return self._result is not None
        status = self._worker.read_status()
        if status.get("page", 0) and (self._page is None or self._page[0] != status["page"]):
            self._page = status["page"], (self._worker.folder / PAGE).read_text(encoding="utf-8")
        if "report" in status:
            scene = Scene.load(self._worker.folder / RESULT)
            self._read = int(status["state"]), scene
            self._result = scene, status["report"]
            self._end()
        elif status.get("state", 0) and (self._read is None or self._read[0] != status["state"]):
            with suppress(BadInput):  # the process has just been stopped
                self._read = int(status["state"]), Scene.load(self._worker.folder / STATE)
        return self._result is not None
