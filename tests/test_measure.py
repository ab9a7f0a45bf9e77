"""svv's consideration for other programs on the same machine."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from svv.measure import SPINS, prefer_openmp, share_cores


@pytest.mark.parametrize("chosen", [{"OMP_WAIT_POLICY": "active"}, {"GOMP_SPINCOUNT": "5"}])
def test_what_the_user_says_about_waiting_stays(chosen: dict[str, str]) -> None:
    environ = dict(chosen)
    share_cores(environ)
    assert environ == chosen


@pytest.mark.parametrize(("chosen", "first"), [({}, "omp"), ({"NUMBA_THREADING_LAYER_PRIORITY": "tbb"}, "tbb")])
def test_numba_uses_openmp_unless_the_user_says_otherwise(chosen: dict[str, str], first: str) -> None:
    environ = {**os.environ, **chosen}
    prefer_openmp(environ)
    code = "import numba; print(numba.config.THREADING_LAYER_PRIORITY[0])"
    done = subprocess.run([sys.executable, "-c", code], env=environ, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [first]


def test_the_command_says_how_to_wait_before_torch_is_loaded() -> None:
    code = (
        "import os, sys\n"
        "for name in ('OMP_WAIT_POLICY', 'GOMP_SPINCOUNT'): os.environ.pop(name, None)\n"
        "from svv.cli import app as cli\n"
        "cli.end_with = lambda run, name: print('torch' in sys.modules, os.environ['GOMP_SPINCOUNT'])\n"
        "cli.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", SPINS]
