"""Starts ParaView's programs with our plugin and with an environment of ours that holds no second VTK.

Needs nothing beyond Python's own library and imports no ``paraview``: it runs before ParaView does.

The program replaces our process: exit code and signals are its own, and ``mpiexec`` may start one a rank.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from svv.errors import BadInput
from svv.measure import share_cores

PROGRAMS = ("paraview", "pvpython", "pvbatch", "pvserver")
OLDEST = (5, 11)
STAMP = "svv-environment.json"
"""File in a prepared environment which says what it was made from."""

SECOND_VTK = ("vtk", "vtk.py", "vtkmodules", "pyvista", "matplotlib")
"""What must not stand before ParaView's own modules: VTK's wheel ends its process, the others bring or meet VTK."""

INSTALL_HINT = (
    "install ParaView 5.11 or newer (Debian, Ubuntu: sudo apt-get install paraview python3-paraview xvfb; "
    "Fedora: sudo dnf install paraview; without root: conda create -n paraview -c conda-forge paraview, or an archive "
    "from https://www.paraview.org/download/), or name the folder of one that is unpacked with --paraview DIR"
)


@dataclass(frozen=True)
class ParaView:
    """A ParaView that was found."""

    bin: Path
    """The folder of its programs."""
    version: tuple[int, int]
    """Such as (5, 11)."""
    python: tuple[int, int]
    """The Python that it carries, such as (3, 11)."""

    def program(self, name: str) -> Path:
        """Where one of its programs is.

        Raises:
            BadInput: this ParaView came without it.
        """
        path = self.bin / name
        if not path.is_file():
            raise BadInput(f"The ParaView in {self.bin} has no {name}; {INSTALL_HINT}.")
        return path


def find(folder: str | Path | None = None, environ: Mapping[str, str] = os.environ) -> ParaView:
    """The user's ParaView.

    Args:
        folder: Where it is unpacked (or its ``bin``); without it SVV_PARAVIEW says, and then PATH.
        environ: Environment variables.

    Raises:
        BadInput: none there, too old, or one that does not start.
    """
    named = folder or environ.get("SVV_PARAVIEW")
    if named:
        folders = [Path(named).expanduser() / sub for sub in ("bin", "", "Contents/bin", "Contents/MacOS")]
        found = next((place / "pvpython" for place in folders if (place / "pvpython").is_file()), None)
        if found is None:
            raise BadInput(f"There is no ParaView in {named}: name the folder that holds bin/pvpython.")
    else:
        which = shutil.which("pvpython", path=environ.get("PATH"))
        if which is None:
            raise BadInput(f"There is no pvpython on the PATH; {INSTALL_HINT}.")
        found = Path(which)
    version, python = _versions(found.absolute())
    if version < OLDEST:
        raise BadInput(f"{found} is ParaView {_dotted(version)}, which is too old; {INSTALL_HINT}.")
    return ParaView(found.absolute().parent, version, python)


def _versions(pvpython: Path) -> tuple[tuple[int, int], tuple[int, int]]:
    """ParaView's and its Python's version; asking takes seconds, so the answer is kept until the program changes."""
    kept = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "svv" / "paraview.json"
    program = pvpython.resolve()
    key = f"{program} {program.stat().st_mtime_ns}"
    try:
        known = json.loads(kept.read_text())
        (a, b), (c, d) = known[key]
        return (a, b), (c, d)
    except (OSError, ValueError, KeyError, TypeError):
        known = {}
    ask = "import sys, paraview; print('svv:', paraview.__version__, *sys.version_info[:2])"
    bare = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PV_PLUGIN_PATH")}
    try:
        done = subprocess.run([pvpython, "-c", ask], env=bare, capture_output=True, text=True, timeout=120)
        answer = next(line for line in done.stdout.splitlines() if line.startswith("svv:")).split()
        major, minor = answer[1].split(".")[:2]
        version, python = (int(major), int(minor)), (int(answer[2]), int(answer[3]))
    except (OSError, subprocess.TimeoutExpired, StopIteration, ValueError, IndexError) as error:
        raise BadInput(f"{pvpython} does not run as ParaView's Python; {INSTALL_HINT}.") from error
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        partial = kept.with_name(f"{kept.name}-{os.getpid()}")
        partial.write_text(json.dumps({**known, key: [version, python]}))
        partial.replace(kept)
    except OSError:
        pass  # it is asked again next time
    return version, python


def environment_folder(paraview: ParaView, environ: Mapping[str, str] = os.environ) -> Path:
    """Where the packages for a ParaView are, or are to be: one folder for each version of Python.

    SVV_ENVIRONMENT names the folder above it; in a checkout that is ``.venv-paraview``, else a folder of the user's.
    """
    named = environ.get("SVV_ENVIRONMENT")
    if named:
        above = Path(named).expanduser().absolute()
    elif (_home() / "constraints.txt").is_file():
        above = _home() / ".venv-paraview"
    else:
        above = Path(environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share").absolute() / "svv" / "paraview"
    return above / f"python{_dotted(paraview.python)}"


def is_whole(environment: Path) -> bool:
    """Whether the packages to which an environment holds links are still there, in the versions they had.

    A package's metadata lie in a folder with its version in the name, to which there is a link, too.
    """
    with os.scandir(environment) as entries:
        return all(os.path.exists(entry.path) for entry in entries if entry.is_symlink())


def plugin_folder() -> Path:
    """The folder of ``StyleRF.py``: in a checkout, beside an installed ``svv``, or where pip puts data files.

    Raises:
        BadInput: it is in none of them.
    """
    places = [
        _home() / "plugin",
        _home(),
        _home() / "../../../share/svv/plugin",
    ]  # from PREFIX/lib/python3.X/site-packages
    for place in places:
        if (place / "StyleRF.py").is_file():
            return place.resolve()
    raise BadInput("The plugin StyleRF.py lies nowhere beside svv: install svv again.")


def python_path(paraview: ParaView, environment: Path, environ: Mapping[str, str] = os.environ) -> list[str]:
    """Folders that go before ParaView's own modules.

    First the shim (only where this ParaView needs it), then svv, then the packages it works with, then what the user
    has on PYTHONPATH, less the folders that hold another VTK.
    """
    folders = [_svv_alone(environment), environment]
    if paraview.version < (5, 12) and paraview.python >= (3, 11):
        folders.insert(0, plugin_folder() / "compat")
    theirs = [Path(entry) for entry in environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    folders += [folder for folder in theirs if not holds_second_vtk(folder)]
    return list(dict.fromkeys(str(folder) for folder in folders))


def holds_second_vtk(folder: Path) -> bool:
    """Whether a folder on the path would bring ParaView's Python another VTK."""
    return any((folder / name).exists() for name in SECOND_VTK)


def _svv_alone(environment: Path) -> Path:
    """A folder that holds ``svv`` and nothing that ParaView must not see: its own, or one with a link to it."""
    home = _home()
    if not (home.name.endswith("-packages") or holds_second_vtk(home)):
        return home
    folder = environment / "linked"
    link = folder / "svv"
    if not link.is_symlink() or link.resolve() != home / "svv":
        folder.mkdir(exist_ok=True)
        partial = folder / f".svv-{os.getpid()}"
        partial.symlink_to(home / "svv")
        partial.replace(link)
    return folder


def environ_for(paraview: ParaView, environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Environment variables with which a ParaView finds the plugin, svv, and the packages it works with.

    Raises:
        BadInput: those packages are not there yet.
    """
    environment = environment_folder(paraview, environ)
    if not (environment / STAMP).is_file():
        raise BadInput(
            f"There is no environment for ParaView {_dotted(paraview.version)} yet (Python {_dotted(paraview.python)}, "
            f"in {environment}); prepare it once with `make paraview` or `svv paraview --prepare`."
        )
    if not is_whole(environment):
        raise BadInput(
            f"Packages that ParaView shares were changed or removed since {environment} was prepared: "
            "prepare it again with `make paraview` or `svv paraview --prepare`."
        )
    plugins = [str(plugin_folder()), *filter(None, environ.get("PV_PLUGIN_PATH", "").split(os.pathsep))]
    ours = {
        **environ,
        "PV_PLUGIN_PATH": os.pathsep.join(dict.fromkeys(plugins)),
        "PYTHONPATH": os.pathsep.join(python_path(paraview, environment, environ)),
    }
    share_cores(ours)
    return ours


def needs_display(paraview: ParaView, program: str) -> bool:
    """Whether a program of a ParaView stops without an X display.

    From 6.0 on only the user interface does; before, all do (pvserver as well: it renders), except in the builds for
    machines without one, whose folder says so.
    """
    if not sys.platform.startswith("linux"):
        return False
    if program == "paraview":
        return True
    words = paraview.bin.parent.name.lower().split("-")  # ParaView-5.13.3-osmesa-MPI-Linux-Python3.10-x86_64
    return paraview.version < (6, 0) and not {"osmesa", "egl"} & set(words)


def start_display(size: str = "1280x1024x24") -> tuple[subprocess.Popen[bytes], str]:
    """A display in memory that nobody else uses, and that ends with the process that asked for it.

    The X server looks for a free number by itself, so any number of them may start at once. It keeps its state when
    the last client leaves (``-noreset``), as ParaView opens and closes windows.

    Returns:
        The X server, and the value of DISPLAY.

    Raises:
        BadInput: there is no Xvfb, or it does not start.
    """
    xvfb = shutil.which("Xvfb")
    if xvfb is None:
        raise BadInput(
            "There is no display, and no Xvfb to draw without one: set DISPLAY, "
            "or install Xvfb (Debian, Ubuntu: sudo apt-get install xvfb)."
        )
    libc = ctypes.CDLL(None)

    def end_with_parent() -> None:
        libc.prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG: even a parent that is killed leaves no X server behind

    reading, writing = os.pipe()
    server = subprocess.Popen(
        [xvfb, "-displayfd", str(writing), "-screen", "0", size, "-noreset", "-nolisten", "tcp", "+extension", "GLX"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=[writing],
        preexec_fn=end_with_parent,
        start_new_session=True,  # Ctrl-C goes to the program, which still needs its display to end
    )
    os.close(writing)
    with os.fdopen(reading) as pipe:
        number = pipe.readline().strip()
    if not number:
        server.wait()
        raise BadInput("Xvfb does not start: try it by hand, or set DISPLAY.")
    return server, f":{number}"


def run(program: str, arguments: Sequence[str], folder: str | Path | None = None) -> NoReturn:
    """Become one of ParaView's programs.

    Args:
        program: One of PROGRAMS.
        arguments: Its arguments, handed on as they are.
        folder: Where ParaView is unpacked; see :func:`find`.

    Raises:
        BadInput: no ParaView, one that is too old or not prepared, or no display to be had.
    """
    paraview = find(folder)
    path = paraview.program(program)
    environ = environ_for(paraview)
    if needs_display(paraview, program) and not environ.get("DISPLAY"):
        _, environ["DISPLAY"] = start_display()
    sys.stdout.flush()
    sys.stderr.flush()
    os.execve(path, [str(path), *arguments], environ)


def _home() -> Path:
    """The folder that holds the package svv."""
    return Path(__file__).resolve().parents[2]


def _dotted(version: tuple[int, int]) -> str:
    return ".".join(str(part) for part in version)
