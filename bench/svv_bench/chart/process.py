"""A separate process per run, which is started, reports its progress, and is stopped if the user cancels."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import IO, Any

from svv.errors import BadInput, Progress

PATIENCE = 10.0
"""Time in seconds that a stopped process has to leave its files in order."""

LISTEN = 0.5
"""Time in seconds between two checks whether the user wants to stop."""


def run_apart(task: dict[str, Any], progress: Progress, variables: Mapping[str, str] | None = None) -> None:
    """Do a task of :mod:`svv_bench.chart.trial` in a separate process.

    Args:
        task: The task as JSON.
        progress: Receives the progress of the process; if it raises, the process is stopped.
        variables: Environment variables to set in addition.

    Raises:
        BadInput: The process reported bad input, or the system ended it.
        RuntimeError: The process failed because of a defect; the message contains its output.
    """
    command = [sys.executable, "-m", "svv_bench.chart.trial"]
    with tempfile.TemporaryFile("w+") as said:
        # In a new session Ctrl-C reaches only us, and we decide when the process stops.
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, text=True, start_new_session=True,
            env={**os.environ, **(variables or {})},
        )  # fmt: skip
        assert process.stdin is not None and process.stdout is not None
        try:
            with suppress(BrokenPipeError), process.stdin:  # it ended at once; its exit code and output say why
                process.stdin.write(json.dumps(task))
            _listen(process.stdout, progress)
            code = process.wait()
        except BaseException:
            _stop(process)
            raise
        said.seek(0)
        words = said.read().strip()
    if code == 2 and words:
        raise BadInput(words.splitlines()[-1].removeprefix("chart: "))
    if code < 0:
        name = signal.Signals(-code).name
        raise BadInput(f"The system ended the run ({name}); if memory is short, use smaller views or the lattice.")
    if code:
        raise RuntimeError(f"The run ended with code {code}:\n{words}")


def _listen(lines: IO[str], progress: Progress) -> None:
    """Forward the progress written to ``lines`` until they end."""
    heard: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        with lines:
            for line in lines:
                heard.put(line)
        heard.put(None)

    threading.Thread(target=read, daemon=True).start()
    last: tuple[float, str] = (0.0, "starting")
    while True:
        try:
            line = heard.get(timeout=LISTEN)
        except queue.Empty:
            progress(*last)  # nothing new, but the user may want to stop
            continue
        if line is None:
            return
        fraction, label = json.loads(line)
        last = float(fraction), str(label)
        progress(*last)


def _stop(process: subprocess.Popen[str]) -> None:
    """Let the process end by itself, and kill it if it does not."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
