"""Tools of an assistant in the background: each works in a process of its own, which ends with the server.

Clients of the Model Context Protocol may give up after a minute; what they started so goes on, and is asked after.
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from svv.errors import BadInput, Cancelled, Progress, silent
from svv.io.files.atomic import to_json
from svv.io.files.worker import Worker, be_worker, say
from svv.job.workshop import Workshop

COMMAND = "from svv.job.background import main; main()"
"""What the process runs."""

LONGEST_WAIT = 50.0
"""Most seconds that an answer is waited for: clients give up after 60."""

LOOK_EVERY = 0.2
"""Seconds between two looks at what a process says, and between two things that it says."""

STOP_WITHIN, END_WITHIN = 10.0, 1.0
"""Seconds that a process has to put away what it has half written: when its job is stopped, and when the server ends,
for which clients wait two seconds."""

ENDED = "Its process has ended ({why}): start it again."

UNEXPECTED = "This should not have failed ({error}): please report it, with the call and this line."


class Jobs:
    """The jobs of a server, which the tools of a workshop do, by their numbers from 1; one works at a time."""

    def __init__(self, workshop: Workshop) -> None:
        self.workshop = workshop
        self._jobs: list[Job] = []

    def start(self, tool: str, given: dict[str, object]) -> str:
        """Start a tool; return a sentence that says how to ask for it. Raises BadInput if another job is at work.

        The process ends with the thread that calls this (Linux), which should be the main one.
        """
        last = self._jobs[-1] if self._jobs else None
        if last is not None and last.poll()["state"] == "running":
            raise BadInput(
                f"Job {last.number} ({last.tool}) is still at work: wait for it with the tool job, or stop it there."
            )
        self._jobs.append(Job(len(self._jobs) + 1, self.workshop, tool, given))
        return f"Job {len(self._jobs)} ({tool}) is at work: ask for it with the tool job."

    def job(self, number: int, wait: float = 30.0, stop: bool = False, progress: Progress = silent) -> dict[str, Any]:
        """Say how far a job is that was started with background=true, and its result or error when it has ended.

        Its state is running, done, failed or stopped. Waits for its end for up to `wait` seconds, 50 at most; with
        `stop`, ends it.
        """
        if not 1 <= number <= len(self._jobs):
            raise BadInput(f"There is no job {number}: {len(self._jobs)} were started, numbered from 1.")
        job, until = self._jobs[number - 1], time.monotonic() + min(wait, LONGEST_WAIT)
        if stop:
            job.stop()
        while (status := job.poll())["state"] == "running" and time.monotonic() < until:
            progress(status["fraction"], status["label"])
            time.sleep(LOOK_EVERY)
        return status

    def end(self) -> None:
        """Stop all jobs."""
        for job in self._jobs:
            job.stop(END_WITHIN)


class Job:
    """A tool at work in a process of its own."""

    def __init__(self, number: int, workshop: Workshop, tool: str, given: dict[str, object]) -> None:
        self.number, self.tool = number, tool
        self._said: dict[str, Any] = {"state": "running", "fraction": 0.0, "label": "starting"}
        self._begun = time.monotonic()
        self._seconds = 0.0
        self._worker = Worker([sys.executable, "-c", COMMAND])
        self._worker.send({"root": str(workshop.root), "tool": tool, "given": given})

    def poll(self) -> dict[str, Any]:
        """Return what the tool `job` tells."""
        if self._said["state"] == "running":
            alive = self._worker.alive  # before what it said last
            self._said |= self._worker.read_status()
            self._seconds = time.monotonic() - self._begun
            if self._said["state"] == "running" and not alive:
                why = self._worker.last_line() or "it was killed"
                self._said |= {"state": "failed", "error": ENDED.format(why=why)}
            if self._said["state"] != "running":
                self._worker.stop()
        status = {"job": self.number, "tool": self.tool, **self._said, "seconds": round(self._seconds, 1)}
        fraction = status["fraction"]
        if status["state"] == "running" and fraction > 0.05:
            status["left"] = round(self._seconds * (1.0 - fraction) / fraction, 1)
        return status

    def stop(self, within: float = STOP_WITHIN) -> None:
        """Stop the tool; what it has half written is put away."""
        if self.poll()["state"] != "running":
            return
        self._worker.send({"stop": True})
        with suppress(TimeoutError):
            self._worker.wait(within)
        self.poll()  # it may have been done
        if self._said["state"] in ("running", "failed"):
            self._said |= {"state": "stopped"}
        self._worker.stop()


# --- the process itself ---------------------------------------------------------------------------------------------


def main() -> None:
    """Do what one order says, and say how it ended."""
    orders, folder = be_worker(), Path(sys.argv[-1])
    order = orders.next(3600.0)
    if order is None:
        return
    last = 0.0

    def heard(fraction: float, label: str) -> None:
        nonlocal last
        if not orders.empty:  # there is no other order than to stop
            raise Cancelled
        if time.monotonic() - last > LOOK_EVERY:
            last = time.monotonic()
            say(folder, {"fraction": fraction, "label": label})

    try:
        result = getattr(Workshop(order["root"]), order["tool"])(**order["given"], progress=heard)
        say(folder, {"state": "done", "fraction": 1.0, "label": "done", "result": json.loads(to_json(result))})
    except Cancelled:
        say(folder, {"state": "stopped"})
    except BadInput as error:
        say(folder, {"state": "failed", "error": str(error)})
    except Exception as error:
        say(folder, {"state": "failed", "error": UNEXPECTED.format(error=f"{type(error).__name__}: {error}")})
