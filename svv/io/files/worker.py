"""A process of its own that works for this one, and never longer than this one lives.

Orders go to it as lines of JSON through its standard input, whose end means that the other side has gone. What it says
and the results that it has are files in a folder, each replaced as a whole, so reading them never waits.
"""

from __future__ import annotations

import ctypes
import json
import os
import queue
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.io.files.locks import hold_folder

NICE = 10
"""Added to the niceness of a worker: whoever watches comes first."""

PREFIX = "svv-live-"
"""Beginning of the names of workers' folders, which lie where temporary files do."""

SAID, LOG = "said.json", "log.txt"
"""Files in a worker's folder: what it says, and what it wrote to its error stream."""

PARENT = "SVV_PARENT"
"""Environment variable with the number of the process for which a worker works."""

POLITE = "SVV_POLITE"
"""Environment variable that tells a worker whether to have a low priority."""

PR_SET_PDEATHSIG = 1


class Worker:
    """The process, as the one that started it sees it; ``stop`` ends it, and so does the end of this process.

    Its folder is added at the end of the command. A ``polite`` one has a low priority. Raises BadInput if it cannot be
    started.
    """

    def __init__(self, command: Sequence[str | Path], polite: bool = True) -> None:
        remove_left_behind()
        self.folder = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._held = hold_folder(self.folder)
        variables = {**os.environ, PARENT: str(os.getpid()), POLITE: str(int(polite))}
        try:
            with (self.folder / LOG).open("wb") as log:
                self._process = subprocess.Popen(
                    [*map(str, command), str(self.folder)],
                    env=variables,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=log,
                    start_new_session=True,  # Ctrl-C is for this process, whose end ends the other
                )
        except OSError as error:
            self._remove_folder()
            raise BadInput(
                f"{Path(command[0]).name} cannot be started beside this program ({error.strerror}): turn Live off."
            ) from error

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def send(self, order: Mapping[str, object]) -> None:
        """Send an order; a process that has ended gets none, which ``alive`` tells."""
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(order).encode() + b"\n")
            self._process.stdin.flush()

    def read_status(self) -> dict[str, Any]:
        """Return the status that the process wrote last; empty if it has written none yet."""
        try:
            status = parsed((self.folder / SAID).read_text(encoding="utf-8"))
        except (OSError, ValueError):  # nothing yet
            return {}
        return status if isinstance(status, dict) else {}

    def last_line(self) -> str:
        """Return the last line of what the process wrote to its error stream."""
        try:
            lines = (self.folder / LOG).read_text(errors="replace").strip().splitlines()
        except OSError:
            return ""
        return lines[-1] if lines else ""

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the process ends; raise TimeoutError if it does not within ``timeout`` seconds."""
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired as error:
            raise TimeoutError(str(error)) from error

    def stop(self) -> None:
        """End the process now, whatever it is doing, and remove its folder."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        assert self._process.stdin is not None
        with suppress(OSError):  # what it has not read
            self._process.stdin.close()
        self._remove_folder()

    def _remove_folder(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        if self._held is not None:
            os.close(self._held)
            self._held = None


def remove_left_behind() -> None:
    """Remove the folders of workers whose parents were killed: nobody holds them any more."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        try:
            held = hold_folder(folder)
        except OSError:  # another user's, or somebody else has just removed it
            continue
        if held is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(held)


# --- the process itself ---------------------------------------------------------------------------------------------


class Orders:
    """The orders that reach this process; the end of the process that gives them ends this one at once."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._input = open(0, "rb", closefd=False)  # pvpython replaces sys.stdin
        threading.Thread(target=self._read, daemon=True).start()

    def next(self, timeout: float) -> dict[str, Any] | None:
        """Return the next order, or None if there is none within ``timeout`` seconds."""
        try:
            return self._waiting.get(timeout=timeout) if timeout > 0 else self._waiting.get_nowait()
        except queue.Empty:
            return None

    @property
    def empty(self) -> bool:
        """Whether no order waits."""
        return self._waiting.empty()

    def _read(self) -> None:
        for line in self._input:
            self._waiting.put(json.loads(line))
        os._exit(0)


def be_worker() -> Orders:
    """Make this process a worker, of low priority, which ends with its parent. Return the orders that reach it."""
    if hasattr(os, "nice") and os.environ.get(POLITE) != "0":
        os.nice(NICE)
    if sys.platform.startswith("linux"):  # elsewhere, and as well, the end of the input does it
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != int(os.environ.get(PARENT) or os.getppid()):
            os._exit(0)  # the parent ended before that
    return Orders()


def say(folder: Path, said: Mapping[str, object]) -> None:
    """Replace what this process says."""
    partial = folder / f".{SAID}-{secrets.token_hex(4)}"
    with suppress(FileNotFoundError):  # the folder has just been removed, and this process is about to end
        partial.write_text(json.dumps(said), encoding="utf-8")
        os.replace(partial, folder / SAID)
