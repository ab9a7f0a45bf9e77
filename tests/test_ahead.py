"""Kernels are compiled ahead by a small job, once, in a process that does no harm if it fails."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from svv.io.files.locks import alone
from svv.job import compile_ahead


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """The commands that are started instead of being run; the user's cache is empty."""
    commands: list[list[str]] = []
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv(compile_ahead.SWITCH, raising=False)
    monkeypatch.setattr("svv.job.compile_ahead.subprocess.Popen", lambda command, **_: commands.append(command))
    return commands


def test_compiling_starts_until_it_was_done_once(started: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    compile_ahead.compile_beside()
    assert started == [[sys.executable, "-m", "svv.job.compile_ahead"]]
    monkeypatch.setattr(compile_ahead, "compile_all", lambda: None)
    monkeypatch.setattr("svv.job.compile_ahead.os.nice", lambda _: 0)
    compile_ahead.main()
    compile_ahead.compile_beside()
    assert len(started) == 1


def test_one_process_compiles_at_a_time(started: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []
    monkeypatch.setattr(compile_ahead, "compile_all", lambda: done.append(1))
    monkeypatch.setattr("svv.job.compile_ahead.os.nice", lambda _: 0)
    marker = compile_ahead._marker()
    marker.parent.mkdir(parents=True, exist_ok=True)
    with alone(marker):
        compile_ahead.main()
    assert not done and not marker.exists()
    compile_ahead.main()
    compile_ahead.main()
    assert done == [1] and marker.exists()


def test_another_version_or_cpu_compiles_again(started: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    before = compile_ahead._marker()
    monkeypatch.setattr(compile_ahead, "__version__", "0.0.0")
    assert compile_ahead._marker() != before
    monkeypatch.undo()
    monkeypatch.setattr(compile_ahead, "_cpu", lambda: "another")
    assert compile_ahead._marker() != before


def test_little_memory_is_left_to_the_command(started: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "memory_there", lambda: 2 << 30)
    compile_ahead.compile_beside()
    assert not started


def test_the_switch_turns_it_off(started: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(compile_ahead.SWITCH, "0")
    compile_ahead.compile_beside()
    assert not started


def test_a_process_that_cannot_start_does_no_harm(started: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr("svv.job.compile_ahead.subprocess.Popen", refuse)
    compile_ahead.compile_beside()


@pytest.mark.slow
def test_the_small_job_trains_both_lights_and_paints(monkeypatch: pytest.MonkeyPatch) -> None:
    from svv.kernels.numba import image as numba_image
    from svv.kernels.numba import kernels as numba_kernels

    called: set[str] = set()

    def watched(name: str, own: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object) -> object:
            called.add(name)
            return own(*arguments)

        return call

    for module, names in (
        (numba_kernels, ("march", "lattice_encode", "lattice_backward", "adam", "composite_backward")),
        (numba_image, ("features", "light", "phong", "composite")),
    ):
        for name in names:
            monkeypatch.setattr(module, name, watched(name, getattr(module, name)))
    compile_ahead.compile_all()
    assert called >= {"march", "lattice_backward", "adam", "composite_backward", "features", "light", "phong"}


@pytest.mark.slow
def test_a_command_finds_everything_compiled(tmp_path: Path) -> None:
    """In a fresh cache of numba's: after the small job, another one compiles nothing."""
    environment = {"NUMBA_CACHE_DIR": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    count = (
        "from numba.core import event\n"
        "class Count(event.Listener):\n"
        "    def on_start(self, e): print('compiled', e.data.get('dispatcher').py_func.__qualname__)\n"
        "    def on_end(self, e): pass\n"
        "event.register('numba:compile', Count())\n"
        "from svv.job.compile_ahead import compile_all\ncompile_all()\n"
    )

    def run() -> str:
        done = subprocess.run(
            [sys.executable, "-c", count], env=environment, check=True, capture_output=True, text=True
        )
        return done.stdout

    assert "compiled march" in run()
    assert "compiled" not in run()
