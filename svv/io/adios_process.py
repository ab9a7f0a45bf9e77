"""Files of ADIOS, read by adios2 in a process of its own (:mod:`svv.io.adios_script`).

ParaView's programs have an ADIOS of their own, which another one would not go with.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput
from svv.io import adios_script

SECONDS = 60
"""Longest time that an answer may take; then the file is damaged, or its disk too slow."""

BLOCK = 1 << 26
"""Most bytes that are asked for at a time, if a row has fewer."""

STARTED_BY = "SVV_PYTHON"
"""Environment variable with the Python that started ParaView."""

NO_PYTHON = "{} is read by a Python of its own, and this ParaView knows none: start it with `svv paraview`."
MISSING = "{} needs the package adios2: pip install 'svv[formats]'."
DAMAGED = "Cannot read {}: it is damaged, incomplete, or not a file of ADIOS ({})."


class AdiosFile:
    """A file, its variables and its attributes; reading it is safe for threads, and after a fork.

    Raises:
        BadInput: It is damaged, or adios2 is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        with self._lock:
            told = self._start()
        self.variables: dict[str, dict[str, Any]] = told["variables"]
        self.attributes: dict[str, Any] = told["attributes"]

    def read(self, name: str, start: Sequence[int], count: Sequence[int], step: int) -> NDArray[Any]:
        """Read a box of a variable at a step, both counted from 0. (count)

        Raises:
            BadInput: The file is damaged.
        """
        parts: list[NDArray[Any]] = []
        first, rows = start[0], 1
        while first < start[0] + count[0]:
            rows = min(rows, start[0] + count[0] - first)
            box = [first, *start[1:]], [rows, *count[1:]]
            with self._lock:
                if self._owner != os.getpid() or self._process.poll() is not None:
                    self._start()
                parts.append(self._asked({"name": name, "start": box[0], "count": box[1], "step": step}, box[1]))
            first, rows = first + rows, max(1, BLOCK * rows // max(parts[-1].nbytes, 1))
        return np.concatenate(parts) if parts else np.empty(count)

    def _start(self) -> dict[str, Any]:
        python, environ = sys.executable or "", dict(os.environ)
        if Path(python).name.startswith("python"):
            environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
        else:
            python = environ.get(STARTED_BY, "")
            for name in ("PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "LD_PRELOAD"):
                environ.pop(name, None)
        if not python:
            raise BadInput(NO_PYTHON.format(self.path))
        command = [python, adios_script.__file__, str(self.path), str(SECONDS)]
        self._process = subprocess.Popen(
            command, env=environ, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._owner = os.getpid()
        weakref.finalize(self, _end, self._process, self._owner)
        return self._answer()

    def _asked(self, question: dict[str, Any], count: Sequence[int]) -> NDArray[Any]:
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(question).encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # what ended it is told below
        told = self._answer()
        content = self._process.stdout.read(told["bytes"])
        if len(content) != told["bytes"] or told["bytes"] != np.dtype(told["dtype"]).itemsize * int(np.prod(count)):
            raise BadInput(DAMAGED.format(self.path, "it has other values than it says"))
        return np.frombuffer(content, told["dtype"]).reshape(count)

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line.endswith(b"\n"):
            raise BadInput(DAMAGED.format(self.path, _describe_end(self._process.wait())))
        told: dict[str, Any] = json.loads(line)
        if "missing" in told:
            raise BadInput(MISSING.format(self.path))
        if "says" in told:
            said = re.sub(r"\x1b\[[0-9;]*m|\[[^]]*\]|<[^>]*>", "", str(told["says"]))
            raise BadInput(DAMAGED.format(self.path, " ".join(said.split())[:200].strip(" :.") or "no reason given"))
        return told


def _describe_end(code: int) -> str:
    if code == -signal.SIGALRM:
        return f"ADIOS had no answer within {SECONDS} s"
    return f"ADIOS ended with {signal.Signals(-code).name if code < 0 else f'exit code {code}'}"


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    """End a process that this one has started."""
    if owner != os.getpid():
        return
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            try:
                stream.close()
            except BrokenPipeError:
                pass  # what it has not read
