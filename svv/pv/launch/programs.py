"""Start ParaView's programs with the StyleRF plugin and with an environment that contains no second VTK.

This module needs only Python's standard library, because it runs before ParaView. The program replaces the current
process: exit code and signals are its own, and ``mpiexec`` may start one per rank.
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

from svv.core.json_values import parsed
from svv.environment import prefer_openmp, share_cores, use_huge_pages
from svv.errors import BadInput

PROGRAMS = ("paraview", "pvpython", "pvbatch", "pvserver")
OLDEST = (5, 11)
STAMP = "svv-environment.json"
"""File in a prepared environment that records what it was made from."""

SECOND_VTK = ("vtk", "vtk.py", "vtkmodules", "pyvista", "matplotlib")
"""Modules that must not precede ParaView's own: VTK from PyPI crashes its process, and the others use VTK."""

PYTHON = "SVV_PYTHON"
"""Environment variable with the Python that started ParaView, which has packages that ParaView's must not have."""

STRICT = "SVV_STRICT"
"""Environment variable: 1 makes errors of filters exceptions of the scripts that run them, 0 does not."""

SCRIPTED = ("pvpython", "pvbatch")
"""Programs that run scripts."""

INSTALL_HINT = (
    "install ParaView 5.11 or newer (Debian, Ubuntu: sudo apt-get install paraview python3-paraview xvfb; "
    "Fedora: sudo dnf install paraview; without root: conda create -n paraview -c conda-forge paraview, or an archive "
    "from https://www.paraview.org/download/), or name the folder of an unpacked one with --paraview DIR"
)


@dataclass(frozen=True)
class ParaView:
    """An installed ParaView."""

    bin: Path
    """Folder of its programs."""
    version: tuple[int, int]
    python: tuple[int, int]
    """Version of its Python, such as (3, 11)."""

    def program(self, name: str) -> Path:
        """Return the path of one of its programs; raise BadInput if this ParaView does not contain it."""
        path = self.bin / name
        if not path.is_file():
            raise BadInput(f"The ParaView in {self.bin} has no {name}; {INSTALL_HINT}.")
        return path


def find(folder: str | Path | None = None, environ: Mapping[str, str] = os.environ) -> ParaView:
    """Find the user's ParaView: in a folder (or its ``bin``), that of SVV_PARAVIEW, or on the PATH; or BadInput."""
    named = folder or environ.get("SVV_PARAVIEW")
    if named:
        folders = [Path(named).expanduser() / sub for sub in ("bin", "", "Contents/bin", "Contents/MacOS")]
        found = next((place / "pvpython" for place in folders if (place / "pvpython").is_file()), None)
        if found is None:
            raise BadInput(f"There is no ParaView in {named}: name the folder that contains bin/pvpython.")
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
    """Return the versions of ParaView and its Python; asking takes seconds, so the answer is cached per program."""
    kept = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "svv" / "paraview.json"
    program = pvpython.resolve()
    key = f"{program} {program.stat().st_mtime_ns}"
    try:
        known = parsed(kept.read_text())
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
        pass  # ask again next time
    return version, python


def environment_folder(paraview: ParaView, environ: Mapping[str, str] = os.environ) -> Path:
    """Return the folder for a ParaView's packages, which may not exist yet: one for each version of Python.

    SVV_ENVIRONMENT names its parent, by default ``.venv-paraview`` in a checkout, or a folder of the user's data.
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
    """Return whether the packages to which an environment links are there, in the versions that folders' names say."""
    with os.scandir(environment) as entries:
        return all(os.path.exists(entry.path) for entry in entries if entry.is_symlink())


def plugin_folder() -> Path:
    """Return the folder of ``StyleRF.py``: in a checkout, next to ``svv``, or with pip's data files; or BadInput."""
    # The last one is seen from PREFIX/lib/python3.X/site-packages.
    for place in (_home() / "plugin", _home(), _home() / "../../../share/svv/plugin"):
        if (place / "StyleRF.py").is_file():
            return place.resolve()
    raise BadInput("The plugin StyleRF.py was not found near the package svv: install svv again.")


def python_path(paraview: ParaView, environment: Path, environ: Mapping[str, str] = os.environ) -> list[str]:
    """Return the folders that precede ParaView's own modules on its Python path.

    They are, in order: the compatibility shim (if needed), svv, the packages it needs, and the user's PYTHONPATH
    without folders that contain another VTK.
    """
    folders = [_svv_alone(environment), environment]
    if paraview.version < (5, 12) and paraview.python >= (3, 11):
        folders.insert(0, plugin_folder() / "compat")
    theirs = [Path(entry) for entry in environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    folders += [folder for folder in theirs if not holds_second_vtk(folder)]
    return list(dict.fromkeys(str(folder) for folder in folders))


def holds_second_vtk(folder: Path) -> bool:
    """Return whether a folder on the path would give ParaView's Python a second VTK."""
    return any((folder / name).exists() for name in SECOND_VTK)


def _svv_alone(environment: Path) -> Path:
    """Return a folder with ``svv`` and without modules that ParaView must not see: its own, or one with links.

    What measures svv, if it is installed, is linked, too: some of it runs in ParaView.
    """
    home = _home()
    if not (home.name.endswith("-packages") or holds_second_vtk(home)):
        return home
    folder = environment / "linked"
    for name in ("svv", "svv_bench"):
        link = folder / name
        if (home / name).is_dir() and not (link.is_symlink() and link.resolve() == home / name):
            folder.mkdir(exist_ok=True)
            partial = folder / f".{name}-{os.getpid()}"
            partial.symlink_to(home / name)
            partial.replace(link)
    return folder


def environ_for(paraview: ParaView, environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return variables with which a ParaView finds plugin, svv and its packages; BadInput if some are not there."""
    environment = environment_folder(paraview, environ)
    if not (environment / STAMP).is_file():
        raise BadInput(
            f"There is no environment for ParaView {_dotted(paraview.version)} yet (Python {_dotted(paraview.python)}, "
            f"in {environment}): prepare it once with `make paraview` or `svv paraview --prepare`."
        )
    if not is_whole(environment):
        raise BadInput(
            f"Packages that ParaView shares have been changed or removed since {environment} was prepared: "
            "prepare it again with `make paraview` or `svv paraview --prepare`."
        )
    plugins = [str(plugin_folder()), *filter(None, environ.get("PV_PLUGIN_PATH", "").split(os.pathsep))]
    ours = {
        **environ,
        PYTHON: sys.executable,
        "PV_PLUGIN_PATH": os.pathsep.join(dict.fromkeys(plugins)),
        "PYTHONPATH": os.pathsep.join(python_path(paraview, environment, environ)),
    }
    share_cores(ours)
    use_huge_pages(ours)
    prefer_openmp(ours)
    return ours


def needs_display(paraview: ParaView, program: str) -> bool:
    """Return whether a program needs an X display: since 6.0 only the window; before, all but headless builds."""
    if not sys.platform.startswith("linux"):
        return False
    if program == "paraview":
        return True
    words = paraview.bin.parent.name.lower().split("-")  # ParaView-5.13.3-osmesa-MPI-Linux-Python3.10-x86_64
    return paraview.version < (6, 0) and not {"osmesa", "egl"} & set(words)


def start_display(size: str = "1280x1024x24") -> tuple[subprocess.Popen[bytes], str]:
    """Start a private X display in memory, which ends with this process; return its process and the value for DISPLAY.

    The X server chooses a free number itself, so several can start at the same time. It keeps its state when the last
    client disconnects (``-noreset``), because ParaView opens and closes windows. Raises BadInput without Xvfb.
    """
    xvfb = shutil.which("Xvfb")
    if xvfb is None:
        raise BadInput(
            "There is neither a display nor Xvfb to provide one: set DISPLAY, "
            "or install Xvfb (Debian, Ubuntu: sudo apt-get install xvfb)."
        )
    libc = ctypes.CDLL(None)

    def end_with_parent() -> None:
        libc.prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG: the X server ends even if its parent is killed

    reading, writing = os.pipe()
    server = subprocess.Popen(
        [xvfb, "-displayfd", str(writing), "-screen", "0", size, "-noreset", "-nolisten", "tcp", "+extension", "GLX"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=[writing],
        preexec_fn=end_with_parent,
        start_new_session=True,  # Ctrl-C must reach only the program, which needs its display until it ends
    )
    os.close(writing)
    with os.fdopen(reading) as pipe:
        number = pipe.readline().strip()
    if not number:
        server.wait()
        raise BadInput("Xvfb does not start: run it by hand to see why, or set DISPLAY.")
    return server, f":{number}"


def run(program: str, arguments: Sequence[str], folder: str | Path | None = None) -> NoReturn:
    """Replace the current process with one of PROGRAMS, of :func:`find`, and its arguments; or raise BadInput."""
    paraview = find(folder)
    path = paraview.program(program)
    environ = environ_for(paraview)
    if program in SCRIPTED:
        environ.setdefault(STRICT, "1")
    if needs_display(paraview, program) and not environ.get("DISPLAY"):
        _, environ["DISPLAY"] = start_display()
    sys.stdout.flush()
    sys.stderr.flush()
    os.execve(path, [str(path), *arguments], environ)


def pvpython_here() -> list[str]:
    """Return the beginning of a command that runs Python text in the ParaView that runs now."""
    from paraview.modules.vtkRemotingCore import vtkProcessModule

    module = vtkProcessModule.GetProcessModule()
    beside = None if module is None else Path(module.GetSelfDir()) / "pvpython"
    program = beside if beside is not None and beside.is_file() else find().program("pvpython")
    return [str(program), "-c"]


def _home() -> Path:
    """Return the folder that contains the package svv."""
    return Path(__file__).resolve().parents[3]


def _dotted(version: tuple[int, int]) -> str:
    return ".".join(str(part) for part in version)
