"""A pvpython that has imported everything once, and forks for every script that tests run.

A start of pvpython with the imports of svv, torch and numba takes five seconds of a CPU, a fork a tenth of one. Each
script still has a process of its own with its own output, variables, folder and end, which begins as a started one
does, but for what the imports have done. Nothing that has threads runs before the fork, so nothing is lost by it.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

LONG = 600.0
"""Seconds after which a program hangs: a hundred times what it takes, as machines may be busy with other things."""

LATE = {"SVV_CACHE", "SVV_CACHE_SIZE"}
"""Variables that are read whenever they are needed; with others, a script needs a process that started with them."""

SERVER = """
import gc, importlib, json, os, pkgutil, sys
answers = int(sys.argv[1])
import paraview.simple
import svv, torch, numba
for part in ("pv", "train", "job", "dvr", "fields", "kernels.numba"):
    package = importlib.import_module(f"svv.{part}")
    for found in pkgutil.walk_packages(package.__path__, f"svv.{part}."):
        if found.name != "svv.job.dataset":  # of PyVista, which ParaView has not
            importlib.import_module(found.name)
from numba.core.registry import cpu_target
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
gc.collect()
gc.freeze()
if len(os.listdir("/proc/self/task")) > 1:
    os.write(answers, b"threads\\n")  # which a fork would lose
    raise SystemExit
os.write(answers, b"ready\\n")
ended = used = told = None
with open(0, closefd=False) as requests:
    for request in requests:
        request = json.loads(request)
        process = os.fork()
        if not process:
            break
        os.write(answers, f"{process}\\n".encode())
        _, ended, used = os.wait4(process, 0)
        told = f"{used.ru_utime + used.ru_stime:.1f} s of a CPU: {request['arguments'][:2]}\\n"
        os.write(1, told.encode())  # ParaView's print may keep it in a buffer, of which each fork has a copy
        os.write(answers, f"{os.waitstatus_to_exitcode(ended)}\\n".encode())
    else:
        raise SystemExit
os.setsid()
os.close(answers)
for number, path in enumerate((os.devnull, request["out"], request["err"])):
    file = os.open(path, os.O_RDWR)
    os.dup2(file, number)
    os.close(file)
os.environ.clear()
os.environ.update(request["environ"])
os.chdir(request["cwd"])
sys.argv = request["arguments"]
sys.path[0] = os.path.dirname(sys.argv[0])
del gc, importlib, json, pkgutil, paraview, svv, torch, numba, part, package, found, cpu_target, answers, requests
del request, process, number, path, file, ended, used, told
with open(sys.argv[0], encoding="utf-8") as source:
    source = compile(source.read(), sys.argv[0], "exec")
exec(source)
"""


class Forked:
    """The process that forks; ``end`` ends it, and so does the end of this one.

    Args:
        command: How pvpython is started.
        environ: Its variables.
        folder: Where its script, its log and what scripts write are kept.
    """

    def __init__(self, command: Sequence[str | Path], environ: Mapping[str, str], folder: Path) -> None:
        self._folder, self._count = folder, 0
        script = folder / "forked.py"
        script.write_text(SERVER)
        self._answers, theirs = os.pipe()
        with (folder / "log").open("w") as log:
            self._process = subprocess.Popen(
                [*map(str, command), str(script), str(theirs)],
                env=dict(environ), pass_fds=(theirs,), stdin=subprocess.PIPE, stdout=log, stderr=log, text=True,
            )  # fmt: skip
        os.close(theirs)
        answer = self._answer(None)
        self.ready = answer == "ready"
        """Whether it forks; a ParaView that has threads from the beginning cannot."""
        if not answer:
            self.end()
            raise AssertionError(f"pvpython ended:\n{(folder / 'log').read_text(errors='replace')}")

    def run(
        self, words: Sequence[str], environ: Mapping[str, str], cwd: str | Path | None, timeout: float
    ) -> tuple[int | None, str, str]:
        """Run a script with its arguments; returns its code, None if it took too long, its output and its errors."""
        self._count += 1
        written = [self._folder / f"{self._count}.{name}" for name in ("out", "err")]
        for path in written:
            path.touch()
        request = {"arguments": list(words), "environ": dict(environ), "cwd": str(cwd or Path.cwd())}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({**request, "out": str(written[0]), "err": str(written[1])}) + "\n")
        self._process.stdin.flush()
        process = int(self._answer(None))
        code = self._answer(timeout)
        if not code:
            os.killpg(process, signal.SIGKILL)
            self._answer(None)
        out, err = (path.read_text(errors="replace") for path in written)
        return int(code) if code else None, out, err

    def end(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        os.close(self._answers)

    def _answer(self, timeout: float | None) -> str:
        """The next line of what it answers; empty if there is none in time, or it has ended."""
        until = None if timeout is None else time.monotonic() + timeout
        line = b""
        while not line.endswith(b"\n"):
            left = None if until is None else max(0.0, until - time.monotonic())
            if not select.select([self._answers], [], [], left)[0]:
                return ""
            read = os.read(self._answers, 1)
            if not read:
                return ""
            line += read
        return line.decode().strip()


def run_to_end(
    command: Sequence[object],
    variables: Mapping[str, str],
    timeout: float = LONG,
    check: bool = True,
    environ: Mapping[str, str] | None = None,
    cwd: str | Path | None = None,
    forked: Forked | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end; ``environ`` is added to the launcher's variables."""
    words, variables = [str(part) for part in command], {**variables, **(environ or {})}
    if forked is None:
        code, out, err = _started(words, variables, cwd, timeout)
    else:
        code, out, err = forked.run(words[1:], variables, cwd, timeout)
    name = Path(words[0]).name
    if code is None:
        pytest.fail(f"{name} did not end in {timeout} s:\n{out}\n{err}", pytrace=False)
    if check and code:
        pytest.fail(f"{name} ended with {code}:\n{out}\n{err}", pytrace=False)
    return subprocess.CompletedProcess(words, code, out, err)


def _started(
    words: list[str], variables: Mapping[str, str], cwd: str | Path | None, timeout: float
) -> tuple[int | None, str, str]:
    """Start a program and wait for its end; returns what :meth:`Forked.run` does."""
    process = subprocess.Popen(
        words, env=dict(variables), cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, errors="replace", start_new_session=True,
    )  # fmt: skip
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return None, *process.communicate()
    return process.returncode, out, err
