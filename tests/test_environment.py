"""svv's consideration for other programs on the same machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from svv.environment import prefer_openmp, share_cores, use_huge_pages
from tests.nightly import nightly


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


WAYS = [({}, True), ({"THP_MEM_ALLOC_ENABLE": "0"}, False)]


@pytest.mark.skipif(not Path("/sys/kernel/mm/transparent_hugepage").is_dir(), reason="no huge pages in this kernel")
@pytest.mark.parametrize(("chosen", "asked"), nightly(WAYS, WAYS[0]))
def test_torch_asks_for_huge_pages_unless_the_user_says_otherwise(chosen: dict[str, str], asked: bool) -> None:
    environ = {name: value for name, value in os.environ.items() if name != "THP_MEM_ALLOC_ENABLE"} | chosen
    use_huge_pages(environ)
    code = (
        "import torch\n"
        "large = torch.zeros(4 << 20)\n"
        "within, there = False, large.data_ptr() + large.nbytes // 2\n"
        "for line in open('/proc/self/smaps'):\n"
        "    first, *rest = line.split()\n"
        "    if '-' in first:\n"
        "        low, high = (int(number, 16) for number in first.split('-'))\n"
        "        within = low <= there < high\n"
        "    elif within and first == 'VmFlags:':\n"
        "        print('hg' in rest)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], env=environ, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(asked)]


def test_whoever_imports_svv_before_torch_has_considerate_threads_and_large_pages() -> None:
    names = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "THP_MEM_ALLOC_ENABLE")
    environ = {name: value for name, value in os.environ.items() if name not in names}
    code = f"import os, sys, svv; print('torch' in sys.modules, *map(os.environ.get, {names}))"
    done = subprocess.run([sys.executable, "-c", code], env=environ, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "PASSIVE", "None", "1"]
