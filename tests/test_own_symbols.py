"""A window drawn by Mesa and a torch that brings triton in one process: each with an LLVM of its own."""

from __future__ import annotations

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
