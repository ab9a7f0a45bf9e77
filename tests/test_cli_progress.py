"""The progress of long work: what it shows, and how Ctrl-C ends it."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time

import pytest

from svv.errors import Cancelled
from svv.progress import duration, shown


def test_durations_are_rounded_before_they_are_split() -> None:
    texts = {0.4: "0 s", 59.4: "59 s", 59.6: "1 min 0 s", 200: "3 min 20 s", 3599.7: "1 h 0 min", 7500: "2 h 5 min"}
    assert {seconds: duration(seconds) for seconds in texts} == texts


def test_without_a_terminal_there_is_a_line_at_each_tenth(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svv.progress.LINE_SECONDS", math.inf)  # else a busy machine may show one more
    with shown("Training") as progress:
        for step in range(1001):
            progress(step / 1000, "PSNR 30.1")
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 11
    assert lines[5].startswith("Training:  50% PSNR 30.1 (")
    assert "left" in lines[5]


def test_ctrl_c_stops_at_the_next_report_and_gives_the_signal_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    done = []
    with pytest.raises(Cancelled), shown("Training") as progress:
        progress(0.1, "")
        os.kill(os.getpid(), signal.SIGINT)
        done.append("went on to the next report")
        progress(0.2, "")
        done.append("never")
    assert done == ["went on to the next report"]
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_after_the_last_report_still_stops() -> None:
    with pytest.raises(Cancelled), shown("Training"):
        os.kill(os.getpid(), signal.SIGINT)


def test_an_error_passes_through() -> None:
    with pytest.raises(ZeroDivisionError), shown("Training"):
        raise ZeroDivisionError


WORK = """
import sys, time
from svv.cli import app
from svv.io import scene_file
from svv.progress import shown
def work(path):
    with shown("Working [1/2]") as progress:
        for step in range(10**6):
            progress(step / 10**6, "x [y]")
            time.sleep(0.01)
scene_file.read_scene_info = work
sys.argv = ["svv", "info", "scene.svv"]
app.main()
"""


@pytest.mark.parametrize("terminal", [False, True])
def test_ctrl_c_ends_the_command_with_130_and_no_traceback(terminal: bool) -> None:
    master, slave = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", WORK], stderr=slave if terminal else subprocess.PIPE, env={**os.environ, "TERM": "xterm"}
    )
    os.close(slave)
    stream = master if terminal else process.stderr.fileno()  # type: ignore[union-attr]
    text = b""
    while b"Working" not in text:
        piece = os.read(stream, 4096)
        assert piece, text
        text += piece
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    while True:
        try:
            piece = os.read(stream, 4096)
        except OSError:  # how Linux says that the other side of a terminal was closed
            break
        if not piece:
            break
        text += piece
    assert process.wait(timeout=600) == 130
    assert b"svv: stopped; run the same command again to resume." in text
    assert b"Traceback" not in text
    os.close(master)
    if process.stderr:
        process.stderr.close()
