"""How torch and triton are loaded: with an LLVM of their own, and with threads that do not spin."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

WINDOW_THEN_TRITON = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=[32, 32])
plotter.add_mesh(pyvista.Sphere())
plotter.screenshot(return_img=True)
if "libLLVM" not in open("/proc/self/maps").read():
    raise SystemExit(77)  # a GPU draws here
import svv
svv.Camera
import torch
torch.optim.Adam([torch.zeros(1, requires_grad=True)])
import triton
print("alive")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only the linker of Linux gives a library the symbols of another")
@pytest.mark.skipif(find_spec("triton") is None, reason="triton is not installed")
def test_a_window_does_not_end_the_training_after_it(tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    done = subprocess.run(
        [sys.executable, "-c", WINDOW_THEN_TRITON], capture_output=True, text=True, cwd=Path(__file__).parents[1]
    )
    if done.returncode == 77:
        pytest.skip("Mesa does not draw with LLVM here")
    assert done.returncode == 0, f"ended with {done.returncode}:\n{done.stderr}"
    assert done.stdout.endswith("alive\n")


@pytest.mark.parametrize("asked", [None, pytest.param("ACTIVE", marks=pytest.mark.slow)])
def test_threads_of_torch_do_not_spin_unless_the_user_says_so(asked: str | None) -> None:
    environ = {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "GOMP_", "KMP_"))}
    environ |= {"OMP_DISPLAY_ENV": "true", **({} if asked is None else {"OMP_WAIT_POLICY": asked})}
    command = [sys.executable, "-c", "import svv, torch; torch.zeros(1 << 20).sum()"]
    done = subprocess.run(command, capture_output=True, text=True, env=environ, check=True)
    told = re.findall(r"OMP_WAIT_POLICY\s*=\s*'?(\w+)", done.stderr)
    assert told, "OpenMP says nothing about itself"
    assert set(told) == {asked or "PASSIVE"}
