"""Processes that work for another one: they obey, end with it, and leave nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from svv.errors import BadInput
from svv.io.files import worker
from svv.io.files.worker import PREFIX, Worker
from tests.ending import has_ended

ECHO = """
import os, sys
from pathlib import Path
from svv.io.files.worker import be_worker, say
orders, folder = be_worker(), Path(sys.argv[-1])
say(folder, {"nice": os.nice(0)})
while True:
    order = orders.next(60.0)
    say(folder, {"heard": order, "nice": os.nice(0)})
"""
COMMAND = [sys.executable, "-c", ECHO]

PARENT = f"""
import signal, sys, time
from svv.io.files.worker import Worker
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
one = Worker([sys.executable, "-c", {ECHO!r}])
while not one.read_status():
    time.sleep(0.01)
print(one.pid, flush=True)
time.sleep(600)
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files, of this test alone."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def heard(one: Worker, key: str, within: float = 60.0) -> object:
    """What a worker says under a key, once it does."""
    until = time.monotonic() + within
    while key not in one.read_status():
        assert one.alive and time.monotonic() < until, one.last_line()
        time.sleep(0.01)
    return one.read_status()[key]


def test_a_worker_obeys_at_low_priority(here: Path) -> None:
    one = Worker(COMMAND)
    try:
        one.send({"a": [1, "é"]})
        assert heard(one, "heard") == {"a": [1, "é"]}
        assert one.read_status()["nice"] == min(os.nice(0) + worker.NICE, 19)
    finally:
        one.stop()
    assert list(here.iterdir()) == []


def test_a_worker_that_is_looked_at_is_not_slowed_down() -> None:
    one = Worker(COMMAND, polite=False)
    try:
        assert heard(one, "nice") == os.nice(0)
    finally:
        one.stop()


def test_starts_and_stops_leave_no_process_file_or_handle(here: Path) -> None:
    processes, before = [], None
    for number in range(10):
        one = Worker(COMMAND)
        processes.append(one.pid)
        if number % 2:
            one.send({"number": number})
            heard(one, "heard")
        one.stop()
        handles = len(os.listdir("/proc/self/fd"))
        before = before or handles
        assert handles == before
    assert list(here.iterdir()) == []
    assert not any(Path(f"/proc/{process}").exists() for process in processes)


def test_a_worker_that_fails_says_why() -> None:
    one = Worker([sys.executable, "-c", "raise SystemExit('no more paint')"])
    try:
        one.wait(60.0)
        assert not one.alive and one.last_line() == "no more paint"
        one.send({"a": 1})  # nobody hears it
    finally:
        one.stop()
    with pytest.raises(BadInput, match="turn Live off"):
        Worker([here_is_nothing := "/no/such/program", here_is_nothing])


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_worker_ends_with_its_parent_and_the_next_one_clears_up(here: Path, how: signal.Signals) -> None:
    environ = {**os.environ, "TMPDIR": str(here)}
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True, env=environ)
    assert parent.stdout is not None
    process = int(parent.stdout.readline())
    parent.send_signal(how)
    parent.wait()
    parent.stdout.close()
    assert has_ended(process)
    (left,) = here.glob(f"{PREFIX}*")
    one = Worker(COMMAND)
    try:
        assert not left.exists() and one.folder.exists()
        two = Worker(COMMAND)
        two.stop()
        assert one.folder.exists(), "the folder of a worker whose parent lives was removed"
    finally:
        one.stop()
