"""ParaView's user interface, servers and MPI ranks start with the plugin."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from svv.pv.launch import programs

ROOT = Path(__file__).resolve().parents[2]
REPORT = """
import sys, paraview.simple as simple
heavy = [name for name in ("torch", "numba", "scipy", "skimage", "svv.train", "svv.fields") if name in sys.modules]
plugin = hasattr(simple, "StyleRFTrain")
"""


def test_the_user_interface_starts_with_the_plugin_and_nothing_heavy(gui: Callable, tmp_path: Path) -> None:
    running = gui(f"{REPORT}done((plugin, heavy))")
    assert running.first == "(True, [])"
    picture = running.screenshot(tmp_path / "screen.png")
    colours = subprocess.run(["identify", "-format", "%k", picture], capture_output=True, text=True, check=True).stdout
    assert int(colours) > 100  # a window with panels and icons, not an empty screen
    assert "rror" not in running.log(), running.log()


@pytest.mark.slow
def test_the_user_interface_tells_of_a_script_that_fails(gui: Callable) -> None:
    with pytest.raises(AssertionError, match="ZeroDivisionError"):
        gui("1 / 0")


@pytest.mark.slow
def test_a_client_meets_a_server_with_the_plugin(pvpython: Callable, pvserver: int) -> None:
    done = pvpython(
        "import sys\n"
        "from paraview.simple import *\n"
        "from paraview import servermanager\n"
        "Connect('127.0.0.1', int(sys.argv[1]))\n"
        "print(servermanager.ActiveConnection.IsRemote(), Sphere().CellData is not None)",
        pvserver,
    )
    assert done.stdout.split() == ["True", "True"]


def test_two_ranks_start_each_on_a_display_of_its_own_where_they_need_one(
    paraview: programs.ParaView, mpiexec: Callable, environ: dict[str, str], tmp_path: Path
) -> None:
    mpiexec(  # what ranks print may meet on one line, so each writes a file
        "import os, pathlib, sys\n"
        "from vtkmodules.vtkParallelCore import vtkMultiProcessController as C\n"
        "c = C.GetGlobalController()\n"
        "rank = f'{c.GetLocalProcessId()} of {c.GetNumberOfProcesses()}'\n"
        "pathlib.Path(sys.argv[1], rank).write_text(os.environ['DISPLAY'])",
        tmp_path,
        program=[sys.executable, "-m", "svv", "pvbatch", "--symmetric"],
        environ={"DISPLAY": "", "PYTHONPATH": str(ROOT)},
    )
    displays = {file.name: file.read_text() for file in tmp_path.iterdir()}
    assert displays.keys() == {"0 of 2", "1 of 2"}
    if programs.needs_display(paraview, "pvbatch"):
        assert len({*displays.values(), environ["DISPLAY"]}) == 3
    else:
        assert set(displays.values()) == {""}


@pytest.mark.slow
def test_two_ranks_work_with_the_plugin(mpiexec: Callable) -> None:
    done = mpiexec(f"{REPORT}print(plugin, heavy)")
    assert "True []" in done.stdout
