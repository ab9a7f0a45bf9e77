"""What commands load before they work: most need neither torch nor numba, and a render none of their compilers."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from svv.cli.app import COMMANDS, Commands, app
from tests.cube import cube_scene

HEAVY = ("torch", "numba", "scipy", "skimage", "matplotlib", "pyvista", "vtkmodules")

PROGRAM = """
import contextlib, io, json, sys
from svv.cli.app import main
found = {}
for arguments in json.loads(sys.argv[1]):
    sys.argv = ["svv", *arguments]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        try:
            main()
        except SystemExit as end:
            code = end.code
    if loaded := [name for name in %r if name in sys.modules]:
        sys.exit(f"{arguments} loads {loaded}")
    found[" ".join(arguments)] = [code, said.getvalue()]
print(json.dumps(found))
"""


def run(commands: Sequence[Sequence[str]], folder: Path) -> dict[str, list[object]]:
    """The exit code, and what is said on standard error, of each command: one after the other, in one process."""
    arguments = [sys.executable, "-c", PROGRAM % (HEAVY,), json.dumps(commands)]
    done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found: dict[str, list[object]] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("start")
    cube_scene().save(folder / "a.svv")
    return folder


def test_no_help_loads_anything_heavy(folder: Path) -> None:
    from typer.main import get_command

    names = [[name] for name in (*COMMANDS, "paraview", "pvpython", "pvbatch", "pvserver")]
    group = get_command(app)
    assert isinstance(group, Commands)
    for name in (*COMMANDS, "bench"):
        inner = getattr(group.get_command(None, name), "commands", {})
        names += [[name, one] for one in inner]
    assert ["look", "save"] in names and ["train"] in names
    found = run([[*name, "--help"] for name in names], folder)
    assert {code for code, _ in found.values()} <= {0, None}


def test_commands_that_need_no_networks_load_none(folder: Path) -> None:
    light = [
        "--version", "info a.svv", "info a.svv --json a.json", "styles", "cache", "shot --schema",
        "shot --move turntable --out turn.json", "shot turn.json", "look list", "look show gallery:museum",
        "look save a.svv --view 30,20 --about A --out look.json", "look show look.json",
        "edit a.svv --region 0 --colour #d02020 --name 1=bone --out b.svv", "edit b.svv --undo --out c.svv",
        "edit a.svv --isolate 0 --cut x>50% --section hatched --outline 1 --out d.svv",
        "edit b.svv --say hide+bone --out f.svv", "edit a.svv --shadow 0.5 --occlusion 0.5 --matcap 0=jade --out e.svv",
    ]  # fmt: skip
    found = run([[word.replace("+", " ") for word in line.split()] for line in light], folder)
    assert {code for code, _ in found.values()} <= {0, None}, found


def test_a_wrong_scene_is_told_of_before_anything_heavy_is_loaded(folder: Path) -> None:
    wrong = [
        "render no.svv --out a.png", "render a.svv --view 1 --out a.png", "probe no.svv --at 1,1", "probe a.svv --at 1",
        "export no.svv --out a.html", "edit no.svv --undo --out b.svv", "look save no.svv --out a.json",
        "edit a.svv --region 9 --opacity 1 --out b.svv", "look apply gallery:museum no.svv --dry-run", "info no.svv",
    ]  # fmt: skip
    found = run([line.split() for line in wrong], folder)
    assert {code for code, _ in found.values()} == {2}, found
    assert all("no.svv" in str(said) for line, (_, said) in found.items() if "no.svv" in line), found


RENDER = """
import sys
from svv.cli import app
app.leave = lambda code: print(code, *sys.modules)
sys.argv = ["svv", "render", "a.svv", "--size", "48", "--out", "a.png"]
app.program()
"""


def test_a_render_loads_no_compiler(folder: Path) -> None:
    """The second one, which finds its kernels compiled."""
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", RENDER], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    code, *modules = done.stdout.splitlines()[-1].split()
    assert code == "0" and {"torch", "numba", "svv.kernels.numba.kernels"} <= set(modules)
    idle = {"scipy.linalg", "numba.np.arraymath", "numba.cpython.listobj", "torch._dynamo"}
    assert not idle & set(modules)


def test_cycles_of_objects_are_looked_for_as_usual_once_work_is_shown() -> None:
    program = (
        "import gc; from svv.progress import collect_again, collect_later, shown\n"
        "usual = gc.get_threshold(); collect_again(); assert gc.get_freeze_count() == 0\n"
        "collect_later(); collect_later(); assert gc.get_threshold() > usual\n"
        "with shown('Working', quiet=True): assert gc.get_threshold() == usual and gc.get_freeze_count()\n"
        "gc.disable(); collect_later(); assert gc.get_threshold() == usual and not gc.isenabled()"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
