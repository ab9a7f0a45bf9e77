"""Every long command on a scene so small that it takes a second, run in forks of one process that is warm.

Importing and compiling take longer than these commands, so a campaign prepares itself once and forks for each run. That
is sound because the process has one thread: ``OMP_NUM_THREADS`` and ``NUMBA_NUM_THREADS`` are 1, numba has its own
thread pool (GNU OpenMP does not survive a fork), and PyTorch starts no threads for CPUs.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, replace
from pathlib import Path

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "NUMBA_THREADING_LAYER": "workqueue",
    "VTK_SMP_BACKEND_IN_USE": "Sequential",
    "SVV_OFFLINE": "1",
    "SVV_COMPILE_AHEAD": "0",  # each run would start it anew: the marker that it was done is in its empty home
}
"""Environment in which forks are sound; it must be set before anything heavy is imported."""

VIEWS = ("--n", "6", "--test", "2", "--size", "32", "--mapper", "cpu")
DRAFT = ("--preset", "draft")

COMMANDS: dict[str, tuple[str, ...]] = {
    "views": ("views", "v0.vti", "--tf", "tf.json", "--out", "out", *VIEWS),
    "train": ("train", "views", "--out", "out.svv", "--json", "out.json", *DRAFT),
    "palette": ("palette", "s.svv", "--views", "views", "--add", "#f2a319", *DRAFT, "--out", "out.svv"),
    "stylize": ("stylize", "s.svv", "--style", "style.png", *DRAFT, "--out", "out.svv"),
    "edit": ("edit", "s.svv", "--region", "0", "--colour", "#d02020", "--out", "out.svv"),
    "follow": ("follow", "values.svv", "v0.vti", "v1.vti", "v2.vti", "--out", "out.svv"),
    "join": ("join", "s.svv", "s2.svv", "--out", "out.svv"),
    "render": ("render", "s.svv", "--orbit", "12", "--size", "48", "--out", "out"),
    "movie": ("render", "s.svv", "--orbit", "12", "--size", "48", "--out", "out.mp4"),
    "page": ("export", "s.svv", "--out", "out.html"),
    "cinema": ("export", "s.svv", "--out", "out.cdb", "--phi", "4", "--theta", "2", "--size", "40"),
    "volume": ("export", "s.svv", "--out", "out.vti", "--resolution", "24"),
    "run": (
        "run", "v0.vti", "--tf", "tf.json", "--style", "style.png", "--out", "out", *VIEWS, *DRAFT,
        "--orbit", "4", "--orbit-size", "40",
    ),
    "import": ("import", "s.cdb", "--test", "2", "--out", "out"),
    "sketch": ("train", "views", "--sketch", "--out", "out.svv", *DRAFT),
    "opacities": ("opacities", "s.svv", "v0.vti", "--tf", "faint.json", "--out", "out.svv"),
    "look save": ("look", "save", "s.svv", "--out", "out.json"),
    "look": ("look", "apply", "look.json", "s.svv", *DRAFT, "--camera", "out.json", "--out", "out.svv"),
    "steps": ("follow", "values.svv", "v0.vti", "v1.vti", "v2.vti", "--out", "out"),
    "play": ("render", "series.svv", "--play", "--orbit", "12", "--size", "48", "--out", "out"),
    "played": ("render", "series.svv", "--play", "--size", "48", "--out", "out.mp4"),
    "figure": ("figure", "s.svv", "--width", "40", "--dpi", "72", "--out", "out.png"),
    "colours": ("check-colours", "s.svv", "--out", "out.png", "--json", "out.json"),
    "styles": ("styles", "woodcut", "mosaic", "--size", "32", "--out", "out"),
    "parts": ("style-mask", "style.png", "--regions", "2", "--out", "out"),
}  # fmt: skip
"""Name -> arguments of a command that writes ``out`` or ``out.*``; a second run of it replaces or completes that."""

TRAIN = ("train", "views", *DRAFT)
MADE: dict[str, tuple[str, ...]] = {
    "s.svv": TRAIN,
    "s2.svv": (*TRAIN, "--seed", "1"),
    "values.svv": (*TRAIN, "--encoding", "values"),
    "series.svv": ("follow", "values.svv", "v0.vti", "v1.vti", "v2.vti"),
    "s.cdb": ("export", "s.svv", "--phi", "8", "--theta", "3", "--size", "48", "--no-layers"),
    "look.json": ("look", "save", "s.svv", "--style", "style.png", "--view", "20,10"),
}
"""Name of an input -> arguments of the command that makes it, in this order, for the commands that need it."""

DRAWN = ("views", "render", "cinema", "volume", "edit")
"""Commands whose pictures and scenes are the same bits each time."""


def in_one_thread(module: str) -> None:
    """Run a module again, with the same arguments, in the environment in which forks are sound."""
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        os.execve(sys.executable, [sys.executable, "-m", module, *sys.argv[1:]], {**os.environ, **ONE_THREAD})


def be_small() -> None:
    """Give the preset *draft* few steps, so that commands take a second; the commands have no flag for all of it."""
    from svv.train.run import config

    draft = config.PRESETS["draft"]
    config.PRESETS["draft"] = replace(
        draft,
        reconstruct=replace(draft.reconstruct, iterations=60),
        recolour=replace(draft.recolour, iterations=30),
        stylize=replace(draft.stylize, style_size=112),
    )


def prepare(folder: Path, names: Sequence[str]) -> Path:
    """Write the inputs of commands to a folder, and run them once, so that their forks begin at once."""
    import numpy as np
    from PIL import Image

    from tests.stirred_volume import stirred_transfer_function
    from tests.volume_files import write_function, write_volume

    folder.mkdir(parents=True, exist_ok=True)
    for number in range(3):
        write_volume(folder / f"v{number}.vti", 20)
    write_function(folder / "tf.json")
    levels = np.random.default_rng(0).integers(0, 256, (32, 32, 3), np.uint8)
    Image.fromarray(levels).resize((64, 64)).save(folder / "style.png")
    needed = {word for name in names for word in COMMANDS[name]}
    here(("views", "v0.vti", "--tf", "tf.json", "--out", "views", *VIEWS), folder)
    function = stirred_transfer_function()
    fainter = tuple((x, 0.6 * opacity, *bend) for x, opacity, *bend in function.opacities)
    write_function(folder / "faint.json", replace(function, opacities=fainter))
    for made, arguments in MADE.items():
        if made in needed:
            here((*arguments, "--out", made), folder)
    for name in names:
        here(COMMANDS[name], fresh(folder, folder.with_name("warm")))
    return folder


def here(arguments: Sequence[str], folder: Path) -> None:
    """Run a command in this process, in a folder."""
    from svv.cli.app import app

    before = Path.cwd()
    os.chdir(folder)
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            app(list(arguments), prog_name="svv", standalone_mode=False)
    finally:
        os.chdir(before)


@dataclass(frozen=True)
class Run:
    """A command that runs in a fork."""

    process: int
    said: Path
    begun: float


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    """Exit code; minus the number of the signal that killed it."""
    said: str
    """Standard output and error."""
    seconds: float

    @property
    def sentence(self) -> str:
        """The last line."""
        return self.said.strip().splitlines()[-1] if self.said.strip() else ""


def forked(
    arguments: tuple[str, ...], folder: Path, before: Callable[[], object] | None = None, home: Path | None = None
) -> Run:
    """Start a command in a fork, in a folder, as the leader of a session of its own.

    Args:
        arguments: Its arguments.
        folder: Its working directory; what it prints goes to a file beside the folder.
        before: Called in the fork before the command.
        home: Home and cache of the command; by default beside the folder.
    """
    said, home = folder.with_name(f"{folder.name}.said"), home or folder.with_name(f"{folder.name}.home")
    home.mkdir(exist_ok=True)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Ctrl-C waits until the command has begun
    process = os.fork()
    if process:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        return Run(process, said, time.monotonic())
    code = 99
    try:
        os.setsid()
        file = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        os.dup2(file, 1)
        os.dup2(file, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        os.chdir(folder)
        os.environ |= {"HOME": str(home), "XDG_CACHE_HOME": str(home / ".cache")}
        from svv.cli.app import main

        sys.argv = ["svv", *arguments]
        if before is not None:
            before()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except KeyboardInterrupt:  # before the command could say so itself
        code = 130
    except BaseException:
        code = 70
        traceback.print_exc()
    finally:
        with suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def ended(run: Run, within: float = 120.0) -> Ended:
    """Wait for a command; one that does not end is killed, with code -999."""
    limit = time.monotonic() + within
    while True:
        process, status = os.waitpid(run.process, os.WNOHANG)
        if process:
            break
        if time.monotonic() > limit:
            os.kill(run.process, 9)
            os.waitpid(run.process, 0)
            return Ended(-999, run.said.read_text("utf-8", "replace"), within)
        time.sleep(0.002)
    seconds = time.monotonic() - run.begun
    return Ended(os.waitstatus_to_exitcode(status), run.said.read_text("utf-8", "replace"), seconds)


def left_running(session: int) -> list[int]:
    """Return the processes of a session, given by its leader."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, IndexError):
            if int(stat.read_text().rpartition(")")[2].split()[3]) == session:
                found.append(int(stat.parent.name))
    return found


def files_in(folder: Path) -> dict[str, bytes]:
    """Return the files in a folder, hidden ones included."""
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def fresh(inputs: Path, folder: Path) -> Path:
    """Replace a folder, its home and what was said by a copy of the inputs."""
    for path in (folder, folder.with_name(f"{folder.name}.home")):
        shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(inputs, folder)
    return folder


def cannot_open(folder: Path) -> list[str]:
    """Return the files with a final name in a folder that cannot be opened, with the reason."""
    wrong = []
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(folder).parts):
            try:
                open_one(path)
            except Exception as error:  # whatever a reader raises is a file that does not open
                wrong.append(f"{path.relative_to(folder)}: {type(error).__name__} {error}")
    return wrong


def open_one(path: Path) -> None:
    """Read a file to its end; raise any error if it is not whole."""
    from PIL import Image
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    from svv.fields.scene.scene import Scene
    from svv.io.scene_file import read_scene_file
    from svv.io.views.viewset import ViewSet
    from tests.movies import frames_of

    if path.suffix == ".svv":
        Scene.load(path)
    elif path.suffix == ".checkpoint":
        read_scene_file(path)
    elif path.suffix == ".json":
        json.loads(path.read_text("utf-8"))
        if path.name.startswith("transforms_"):
            ViewSet.read(path.parent, path.stem.removeprefix("transforms_"))
    elif path.suffix == ".png":
        with Image.open(path) as picture:
            picture.load()
    elif path.suffix == ".vti":
        reader = vtkXMLImageDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        assert reader.GetErrorCode() == 0
        assert reader.GetOutput().GetPointData().GetScalars() is not None
    elif path.suffix == ".mp4":
        assert len(frames_of(path))
    elif path.suffix == ".html":
        assert path.read_text("utf-8").rstrip().endswith("</html>")
    elif path.suffix == ".csv":
        assert path.read_text("utf-8").endswith("\n")
