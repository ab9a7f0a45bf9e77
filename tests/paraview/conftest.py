"""Fixtures of tests inside the real ParaView: its programs, started as ``svv`` starts them, on displays in memory.

If ParaView or a tool is missing, tests that use them fail with a sentence; they are never skipped:

- ``pvpython(source, *args, timeout=600, check=True, environ=None, cwd=None, own=False)`` runs Python text or a script
  file, in a fork of a process that is ready unless ``own`` asks for a start of its own;
- ``mpiexec(source, *args, ranks=2, program=(), ...)`` does the same in pvbatch on several ranks (or another program);
- ``pvserver`` is the port of a separate server, ``start_pvserver(environ=None, ranks=1)`` starts more and returns the
  port;
- ``gui(source, *args, environ=None, timeout=600, aloud=False)`` starts ParaView's user interface, see :class:`Gui`;
  with ``aloud``, what it shows can be read (:mod:`tests.paraview.screen`).
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import coverage
import numpy as np
import pytest

from svv.errors import BadInput
from svv.io.pictures.output import write_png
from svv.pv.launch import programs
from tests.conftest import threads_each
from tests.cube import cube_paint, cube_scene
from tests.paraview.forked import LATE, LONG, Forked, run_to_end
from tests.paraview.panel_script import END, START

SETUP = "make test prepares all of it where it may; Debian, Ubuntu: sudo apt-get install"

EMPTY = 20_000
"""Bytes that a picture of a screen without windows stays below."""

GUI_MAIN = """
import os, sys, traceback, types
def done(text=""):
    marker = os.environ["GUI_MARKER"]
    with open(marker + ".partial", "w") as file:
        file.write(str(text))
    os.replace(marker + ".partial", marker)
try:
    # As a module: VTK lets Python collect an observer whose only owner is what it observes, though that lives on.
    script = sys.modules["script"] = types.ModuleType("script")
    script.done = done
    with open({source!r}) as file:
        exec(compile(file.read(), {source!r}, "exec"), vars(script))
except BaseException:
    done(traceback.format_exc())
"""


class Gui:
    """A running user interface on a display of its own, 1280 x 1024.

    The script that it was started with calls ``done(text)`` when there is something to see or to check; that may be
    from a timer, and again after every step. An exception in the script counts as a ``done``, and fails the test.
    """

    def __init__(self, process: subprocess.Popen[str], environ: Mapping[str, str], folder: Path) -> None:
        self.process, self.environ, self.folder = process, environ, folder
        self.first = ""
        """The text of the first ``done``, for which the start has waited."""

    def wait(self, timeout: float = LONG) -> str:
        """The text of the script's next ``done``."""
        marker = Path(self.environ["GUI_MARKER"])
        until = time.monotonic() + timeout
        while not marker.exists():
            assert self.process.poll() is None, f"ParaView ended:\n{self.log()}"
            assert time.monotonic() < until, f"ParaView did not get there in {timeout} s:\n{self.log()}"
            time.sleep(0.05)
        text = marker.read_text()
        marker.unlink()
        assert not text.startswith("Traceback"), f"{text}\n{self.log()}"
        return text

    def log(self) -> str:
        """What ParaView has written so far."""
        return (self.folder / "gui.log").read_text(errors="replace")

    def xdotool(self, *arguments: object) -> str:
        """Drive mouse and keyboard: ``gui.xdotool("mousemove", 215, 10, "click", 1)``."""
        return _tool(["xdotool", *map(str, arguments)], self.environ)

    def screenshot(self, path: str | Path) -> Path:
        """A picture of the whole screen, taken when it has come to rest."""
        before, until = b"", time.monotonic() + 20
        while True:
            _tool(["import", "-window", "root", f"png:{path}"], self.environ)
            now = Path(path).read_bytes()
            if (now == before and len(now) > EMPTY) or time.monotonic() > until:  # something may blink for ever
                return Path(path)
            before = now

    def snapshot(self, path: str | Path) -> Path:
        """A picture of the whole screen as it is now."""
        _tool(["import", "-window", "root", f"png:{path}"], self.environ)
        return Path(path)

    def fill_screen(self) -> str:
        """Give the main window all of the screen, and return its number."""
        window = self._main_window()
        self.xdotool("windowmove", window, 0, 0, "windowsize", window, 1280, 1024)
        return window

    def _main_window(self, searches: int = 10) -> str:
        """Number of the main window; a search in which another window closes, such as a splash, starts again."""
        try:
            return self.xdotool("search", "--sync", "--onlyvisible", "--name", "^ParaView").split()[0]
        except AssertionError as error:
            if "BadWindow" not in str(error) or searches == 1:
                raise
            return self._main_window(searches - 1)


@contextmanager
def read_aloud(folder: Path) -> Iterator[dict[str, str]]:
    """Start a bus in a folder on which programs say what they show; gives the variables of such a program."""
    _need("dbus-daemon", "dbus at-spi2-core python3-gi")
    runs = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
    command = ["dbus-daemon", "--session", "--nofork", "--nopidfile", "--print-address"]
    with (folder / "bus.log").open("w") as log:
        bus = subprocess.Popen(command, env=runs, stdout=subprocess.PIPE, stderr=log, text=True)
    with bus:
        assert bus.stdout is not None
        address = bus.stdout.readline().strip()
        assert address, (folder / "bus.log").read_text()
        try:
            yield {"DBUS_SESSION_BUS_ADDRESS": address, "QT_LINUX_ACCESSIBILITY_ALWAYS_ON": "1"}
        finally:
            bus.terminate()


@pytest.fixture(scope="session")
def paraview() -> programs.ParaView:
    """The ParaView that is tested, prepared."""
    try:
        found = programs.find()
        programs.environ_for(found)
    except BadInput as error:
        pytest.fail(str(error), pytrace=False)
    return found


@pytest.fixture(scope="session")
def display(paraview: programs.ParaView) -> Iterator[str]:
    """One display for all tests that look at no window."""
    yield from _display()


@pytest.fixture(scope="session")
def environ(paraview: programs.ParaView, display: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The variables that our launcher would set, and what measures coverage where that is asked for."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), str(threads_each()))
    ours = {**threads, **programs.environ_for(paraview), "DISPLAY": display}
    if "COVERAGE_PROCESS_CONFIG" in os.environ:
        folder = tmp_path_factory.mktemp("coverage")
        (folder / "coverage").symlink_to(Path(coverage.__file__).parent)
        (folder / "sitecustomize.py").write_text("import coverage\ncoverage.process_startup()\n")
        ours["PYTHONPATH"] += os.pathsep + str(folder)
    return ours


@pytest.fixture(scope="session")
def forked(
    paraview: programs.ParaView, environ: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Forked]:
    """The pvpython that forks for scripts, if it can. MPI has threads, which do not survive that."""
    started = Forked([paraview.program("pvpython"), "--no-mpi"], environ, tmp_path_factory.mktemp("forked"))
    yield started
    started.end()


@pytest.fixture(scope="session")
def pvpython(
    paraview: programs.ParaView,
    environ: dict[str, str],
    tmp_path_factory: pytest.TempPathFactory,
    request: pytest.FixtureRequest,
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run Python text or a script file in pvpython: in a fork of one that is ready, unless ``own`` or variables forbid.

    With SVV_TESTS_FORK=0, and where coverage is measured, all are started.
    """
    forks = os.environ.get("SVV_TESTS_FORK") != "0" and "COVERAGE_PROCESS_CONFIG" not in os.environ

    def run(source: str | Path, *arguments: object, own: bool = False, **options) -> subprocess.CompletedProcess[str]:
        command = [paraview.program("pvpython"), _script(source, tmp_path_factory), *arguments]
        late = LATE.issuperset(options.get("environ") or {})
        ready = request.getfixturevalue("forked") if forks and late and not own else None
        if ready is not None and not ready.ready:
            ready = None
        return run_to_end(command, _alone(environ, tmp_path_factory), forked=ready, **options)

    return run


@pytest.fixture(scope="session")
def mpiexec(
    paraview: programs.ParaView, environ: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run Python text or a script file in pvbatch, on several ranks."""

    def run(
        source: str | Path, *arguments: object, ranks: int = 2, program: Sequence[str | Path] = (), **options
    ) -> subprocess.CompletedProcess[str]:
        script = _script(source, tmp_path_factory)
        command = [*_on_ranks(ranks), *(program or [paraview.program("pvbatch")]), script, *arguments]
        return run_to_end(command, _alone(environ, tmp_path_factory), **options)

    return run


@pytest.fixture
def servers() -> Iterator[list[subprocess.Popen[str]]]:
    """The processes that ``start_pvserver`` has started, in order."""
    processes: list[subprocess.Popen[str]] = []
    yield processes
    for process in processes:
        _end(process)


@pytest.fixture
def start_pvserver(
    paraview: programs.ParaView,
    environ: dict[str, str],
    servers: list[subprocess.Popen[str]],
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[..., int]:
    """Start a server that takes one client, on this machine only; returns its port."""

    def launch(environ: Mapping[str, str] = environ, ranks: int = 1) -> int:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        log = tmp_path / f"pvserver-{port}.log"
        command = [str(paraview.program("pvserver")), f"--server-port={port}", "--hostname=127.0.0.1"]
        command = [*(_on_ranks(ranks) if ranks > 1 else []), *command]
        server = _start(command, _alone(environ, tmp_path_factory), log)
        servers.append(server)
        until = time.monotonic() + LONG
        while "Accepting connection" not in log.read_text(errors="replace"):
            assert server.poll() is None, f"pvserver ended:\n{log.read_text(errors='replace')}"
            assert time.monotonic() < until, f"pvserver takes no client:\n{log.read_text(errors='replace')}"
            time.sleep(0.05)
        return port

    return launch


@pytest.fixture
def pvserver(start_pvserver: Callable[..., int]) -> int:
    """The port of a server."""
    return start_pvserver()


@pytest.fixture
def gui(
    paraview: programs.ParaView, environ: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., Gui]]:
    """Start ParaView's user interface with Python text or a script file, and wait for its first ``done``."""
    _need("xdotool", "xdotool")
    _need("import", "imagemagick")
    running: list[Gui] = []
    displays: list[Iterator[str]] = []
    buses = ExitStack()

    def launch(
        source: str | Path,
        *arguments: object,
        environ: Mapping[str, str] = environ,
        timeout: float = LONG,
        aloud: bool = False,
    ) -> Gui:
        folder = tmp_path_factory.mktemp("gui")
        folder.chmod(0o700)
        main = folder / "main.py"
        main.write_text(GUI_MAIN.format(source=str(_script(source, tmp_path_factory))))
        screen = _display()
        displays.append(screen)
        variables = {
            **_alone(environ, tmp_path_factory),
            "DISPLAY": next(screen),
            "GUI_MARKER": str(folder / "done"),
            "XDG_RUNTIME_DIR": str(folder),
            "XDG_CONFIG_HOME": str(folder),  # the settings of whoever runs the tests stay out of it
        }
        if aloud:
            variables |= buses.enter_context(read_aloud(folder))
        command = [str(paraview.program("paraview")), "--dr", *map(str, arguments), f"--script={main}"]
        running.append(Gui(_start(command, variables, folder / "gui.log"), variables, folder))
        running[-1].first = running[-1].wait(timeout)
        running[-1].fill_screen()
        running[-1].screenshot(folder / "start.png")  # a click after this finds the window where it stays
        return running[-1]

    yield launch
    for one in running:
        _end(one.process)
    buses.close()
    for screen in displays:
        next(screen, None)


@pytest.fixture
def inside(pvpython: Callable, tmp_path: Path) -> Callable[[str], dict[str, Any]]:
    """Run a script in pvpython in a folder with `cube.svv`, the painted `two.svv`, and two pictures."""
    cube = cube_scene()
    cube.save(tmp_path / "cube.svv")
    ink = cube.painted(cube_paint(cube, 1), {0: "brush"}, {}, "ink")
    ink.painted(cube_paint(cube, 2), {0: "oil", 1: "oil"}, {}, "oil").save(tmp_path / "two.svv")
    picture = np.full((60, 80, 3), (0.85, 0.2, 0.1), np.float32)
    picture[:, 40:] = (0.1, 0.7, 0.25)
    picture[:, ::2] *= 0.9
    write_png(tmp_path / "halves.png", picture)
    write_png(tmp_path / "blue.png", np.where(picture > 0.5, picture, 0.3)[..., ::-1])

    def run(script: str) -> dict[str, Any]:
        pvpython(START + script + END, tmp_path)
        return json.loads((tmp_path / "said.json").read_text())

    return run


def _alone(environ: Mapping[str, str], folders: pytest.TempPathFactory) -> dict[str, str]:
    """With a cache of its own: what another test has learned is not found, nor what the user has."""
    return {**environ, "SVV_CACHE": str(folders.mktemp("kept"))}


def _display() -> Iterator[str]:
    try:
        server, name = programs.start_display()
    except BadInput as error:
        pytest.fail(str(error), pytrace=False)
    yield name
    _end(server)


def _script(source: str | Path, folders: pytest.TempPathFactory) -> Path:
    """A script file: Python text is written to one."""
    if isinstance(source, Path):
        return source
    path = folders.mktemp("script") / "script.py"
    path.write_text(source)
    return path


def _on_ranks(count: int) -> list[str]:
    """The beginning of a command that starts a program on several ranks."""
    _need("mpiexec", "openmpi-bin")
    return ["mpiexec", "-n", str(count), "--oversubscribe", "--allow-run-as-root"]


def _start(command: list[str], variables: Mapping[str, str], log: Path) -> subprocess.Popen[str]:
    with log.open("w") as file:
        return subprocess.Popen(
            command,
            env=dict(variables),
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )


def _end(process: subprocess.Popen) -> None:
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _need(tool: str, package: str) -> None:
    if shutil.which(tool) is None:
        pytest.fail(f"There is no {tool}: {SETUP} {package}.", pytrace=False)


def _tool(command: list[str], variables: Mapping[str, str]) -> str:
    done = subprocess.run(command, env=dict(variables), capture_output=True, text=True, timeout=LONG)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout
