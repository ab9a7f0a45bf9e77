"""Live with several filters, and where the client or the server that learns is killed."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from svv.io.pictures.output import write_png
from svv.styles.gallery.textures import style_picture
from tests.ending import has_ended
from tests.paraview.live_script import LIVE


@pytest.fixture
def live(pvpython: Callable, tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a script after the beginning in ``live_script``; its further arguments come after the folder."""
    for name, texture in (("brush", "brush strokes"), ("other", "stippling")):
        write_png(tmp_path / f"{name}.png", style_picture(texture))
    return lambda script, *more, check=True: pvpython(LIVE + script, tmp_path, *more, own=True, check=check)


@pytest.mark.slow
def test_two_filters_learn_at_once(live: Callable) -> None:
    live("""
one = make(**FEW)
other = make(style="other", **{**FEW, "Views": 10})
for filter in (one, other):
    filter.UpdatePipeline()
    assert status(filter).startswith("Learning"), status(filter)
assert len(workers()) == 2
both = lambda test: lambda told: test(told) and test(look(other))
until(one, both(lambda told: sketched(told) or is_done(told)))
until(one, both(sharp))
pictures = [image(filter)[1]["RGBA"] for filter in (one, other)]
assert all(picture[:, 3].any() for picture in pictures) and (pictures[0] != pictures[1]).any()
last.clear()
Delete(one)
del one, filter
assert len(workers()) == 1, "the other filter has lost its process, or the deleted one has kept its own"
Delete(other)
del other
assert workers() == []
""")


REMOTE = """
import signal
port, server = map(int, sys.argv[2:4])
Connect("127.0.0.1", port)
wavelet, display = shown()
filter = make(**LONG)
filter.UpdatePipeline()
until(filter, lambda told: "base NeRF" in told and sketched(told))
children = []
for file in glob.glob("/proc/[0-9]*/cmdline"):
    if "svv.pv.live." in open(file).read():
        pid = file.split("/")[2]
        if open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()[1] == str(server):
            children.append(int(pid))
assert len(children) == 2 and workers() == [], children
os.write(1, f"CHILDREN {' '.join(map(str, children))}\\n".encode())  # what pvpython prints waits in C++ until it ends
"""


def children_in(said: str) -> list[int]:
    """The processes that the server had started."""
    (line,) = (line for line in said.splitlines() if line.startswith("CHILDREN"))
    return [int(word) for word in line.split()[1:]]


@pytest.mark.slow
def test_a_killed_client_leaves_nothing_that_learns_at_its_server(
    live: Callable, start_pvserver: Callable[..., int], servers: list[subprocess.Popen[str]]
) -> None:
    port = start_pvserver()
    done = live(f"{REMOTE}os.kill(os.getpid(), signal.SIGKILL)", port, servers[0].pid, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert all(has_ended(pid) for pid in children_in(done.stdout))


@pytest.mark.slow
def test_a_killed_server_takes_its_learning_along_and_leaves_the_client(
    live: Callable, start_pvserver: Callable[..., int], servers: list[subprocess.Popen[str]]
) -> None:
    port = start_pvserver()
    script = f"{REMOTE}os.kill(server, signal.SIGKILL)\ntime.sleep(1)\nsharpening._look()\nprint('ALIVE', flush=True)\n"
    done = live(script, port, servers[0].pid, check=False)
    assert "ALIVE" in done.stdout, done.stdout + done.stderr
    assert all(has_ended(pid) for pid in children_in(done.stdout))
