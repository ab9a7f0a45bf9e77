"""A client, a server or a rank that dies while a scene is trained: the others notice, and no half a file stays."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.paraview.filter_script import VOLUME
from tests.paraview.forked import LONG

Servers = list[subprocess.Popen[str]]

TRAIN = (
    VOLUME
    + """
import signal
port, folder, victim = sys.argv[1:]
Connect("127.0.0.1", int(port))
volume, display = shown()
train = small(StyleRFTrain(Input=volume, Preset="paper", TimeLimit=3600.0, SceneFile=folder + "/scene.svv"))
handler = sm.ActiveConnection.Session.GetProgressHandler()

def kill(*_):
    if "base" in (handler.GetLastProgressText() or ""):  # it draws views before
        os.kill(int(victim) or os.getpid(), signal.SIGKILL)

handler.AddObserver("ProgressEvent", kill)
train.UpdatePipeline()
print("ALIVE", len(GetSources()))
"""
)


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """The folder of the scene's file."""
    (tmp_path / "kept").mkdir()
    return tmp_path / "kept"


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_server_whose_client_dies_stops_its_training(
    pvpython: Callable, start_pvserver: Callable[..., int], servers: Servers, kept: Path, ranks: int
) -> None:
    done = pvpython(TRAIN, start_pvserver(ranks=ranks), kept, 0, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    servers[0].wait(LONG)  # an hour, if it went on
    assert not (kept / "scene.svv").exists()


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_client_outlives_a_server_or_one_of_its_ranks(
    pvpython: Callable, start_pvserver: Callable[..., int], servers: Servers, kept: Path, ranks: int
) -> None:
    port, pid = start_pvserver(ranks=ranks), servers[0].pid
    if ranks > 1:  # mpiexec ends the others
        children = " ".join(path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/children"))
        pid = int(children.split()[-1])
    done = pvpython(TRAIN, port, kept, pid)  # ParaView's own filters do not end the client, either
    assert "ALIVE 2" in done.stdout, done.stdout
    servers[0].wait(LONG)
    assert not (kept / "scene.svv").exists()
