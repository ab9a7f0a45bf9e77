"""A command leaves at once, but only after its output is written and what is to be done at its end is done."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROGRAM = """
import atexit, os, sys, threading, time
from svv.cli import app
from svv.io import scene_file
class Held:
    def __del__(self):
        os.write(2, b"taken down")
held = Held()
def work(path):
    print("x" * 100000)
    atexit.register(print, "at the end")
    if {thread}:
        threading.Thread(target=lambda: (time.sleep(0.2), print("of a thread"))).start()
    if {wrong}:
        raise app.BadInput("It is wrong.")
    return {{}}
scene_file.read_scene_info = work
sys.argv = ["svv", "info", "a.svv"]
app.program()
"""


def ended(thread: bool = False, wrong: bool = True) -> tuple[int, str, str]:
    """Exit code, output and errors of a program that reads a wrong scene."""
    program = PROGRAM.format(thread=thread, wrong=wrong)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout, done.stderr


def test_the_output_is_written_and_nothing_is_taken_down() -> None:
    code, output, errors = ended()
    assert (code, errors) == (2, "svv: It is wrong.\n")
    assert output == "x" * 100000 + "\nat the end\n"


def test_threads_that_work_end_first() -> None:
    code, output, errors = ended(thread=True)
    assert code == 2
    assert "of a thread\n" in output
    assert output.endswith("at the end\n")
    assert "taken down" in errors


@pytest.mark.skipif(not hasattr(os, "pipe"), reason="needs pipes")
def test_a_reader_that_has_gone_is_no_error() -> None:
    read, write = os.pipe()
    process = subprocess.Popen([sys.executable, "-m", "svv", "--help"], stdout=write, stderr=subprocess.PIPE)
    os.close(read)
    os.close(write)
    assert b"Traceback" not in process.communicate(timeout=60)[1]
