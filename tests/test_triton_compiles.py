"""The Triton kernels compile to GPU machine code, which needs no GPU and finds errors that the interpreter accepts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import compiled_kernels
from tests.compiled_kernels import DESKTOP, EVERYWHERE, HOPPER, KERNELS, NETWORKS, SHARED, targets_of


@pytest.mark.slow
@pytest.mark.parametrize("others", [(HOPPER,), pytest.param((DESKTOP, *EVERYWHERE), marks=pytest.mark.slow)])
def test_every_kernel_compiles(others: tuple[int, ...], tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[1]
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    environment |= {"TRITON_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(root)}
    command = [sys.executable, compiled_kernels.__file__, *map(str, others)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    made = [line.split() for line in done.stdout.splitlines()]
    networks = [line for line in made if line[0].startswith("network")]
    assert [name for name, *_ in made] == [n for n, _ in [*KERNELS, *NETWORKS] for _ in targets_of(n, others)]
    assert all(int(shared) <= SHARED and int(products) > 0 for _, _, shared, products in networks)
