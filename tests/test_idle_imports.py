"""What torch and numba import without need is left out of the command's process, and nothing that is needed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from svv.idle_imports import DRIVERS, SETTINGS

NUMBA = """
import sys
measured = "coverage" in sys.modules
from svv.idle_imports import leave_out_idle_imports
leave_out_idle_imports()
import numba, numba.misc.coverage_support
assert numba.misc.coverage_support.coverage_available == measured
{then}
import coverage, yaml  # for whoever needs them
assert coverage.Coverage and yaml.safe_load
"""

TORCH = """
import sys
from svv.idle_imports import leave_out_idle_imports
leave_out_idle_imports()
import torch
print("cuda.bindings" in sys.modules, torch.cuda._utils._HAS_CUDA_BINDINGS)
"""


def run(program: str, folder: Path) -> str:
    paths = os.pathsep.join([*sys.path, os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env={**os.environ, "PYTHONPATH": paths}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_numba_comes_without_what_it_does_not_need(tmp_path: Path) -> None:
    run(NUMBA.format(then="assert not numba.core.config._HAVE_YAML and not numba.config.DEVELOPER_MODE"), tmp_path)


def test_coverage_that_measures_is_known_to_numba(tmp_path: Path) -> None:
    run("import coverage\n" + NUMBA.format(then=""), tmp_path)


def test_settings_in_a_file_are_still_read(tmp_path: Path) -> None:
    (tmp_path / SETTINGS).write_text("developer_mode: 1\n")
    run(NUMBA.format(then="assert numba.core.config._HAVE_YAML and numba.config.DEVELOPER_MODE == 1"), tmp_path)


def test_torch_comes_with_cuda_where_there_may_be_a_gpu(tmp_path: Path) -> None:
    gpu = any(map(os.path.exists, DRIVERS))
    left_out = "False False"
    as_usual = run(TORCH.replace("leave_out_idle_imports()", ""), tmp_path)
    assert run(TORCH, tmp_path).strip() == (as_usual.strip() if gpu else left_out)
    with_driver = "import svv.idle_imports as idle\nidle.DRIVERS = (idle.__file__,)\n"
    assert run(with_driver + TORCH, tmp_path) == as_usual
