"""Kept machine code is loaded without numba's compiler, and is compiled as ever where none is kept."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import svv
from svv.core.compiled import njit

KERNEL = """
import json, sys
import numpy as np
from svv.core.compiled import njit

@njit(cache=True)
def total(numbers):
    room = np.zeros(2, numbers.dtype)
    for i in range(len(numbers)):
        room[0] += 2 * numbers[i]
    return room[0]

@njit
def unkept(number):
    return number + 1

if __name__ == "__main__":
    import kernel
    of_reals = float(kernel.total(np.arange(4.0)))
    compiler = "numba.cpython.listobj" in sys.modules
    of_integers = int(kernel.total(np.arange(4)))
    stats = getattr(kernel.total, "stats", None)
    hits = None if stats is None else sum(stats.cache_hits.values())
    print(json.dumps([of_reals, compiler, of_integers, hits, kernel.unkept(1)]))
"""


def run(folder: Path, **environment: str) -> list[object]:
    """What the program above prints."""
    paths = os.pathsep.join([str(folder), str(Path(svv.__file__).parents[1])])
    done = subprocess.run(
        [sys.executable, str(folder / "kernel.py")],
        env={**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(folder / "kept"), **environment},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found: list[object] = json.loads(done.stdout)
    return found


def test_kept_code_is_loaded_without_the_compiler(tmp_path: Path) -> None:
    kernel = tmp_path / "kernel.py"
    kernel.write_text(KERNEL)
    assert run(tmp_path) == [12.0, True, 12, 0, 2]
    assert run(tmp_path) == [12.0, False, 12, 2, 2]
    for number in (tmp_path / "kept").rglob("*.2.nbc"):  # the code for integers is lost: the rest is loaded, then this
        number.unlink()
    assert run(tmp_path) == [12.0, False, 12, 1, 2]
    assert run(tmp_path, NUMBA_DISABLE_JIT="1") == [12.0, False, 12, None, 2]
    kernel.write_text(KERNEL.replace("2 * numbers[i]", "3 * numbers[i]"))
    assert run(tmp_path)[0] == 18.0  # a changed source is compiled again


@pytest.mark.parametrize("system", ["nt", "posix"])
def test_a_file_that_another_process_writes_counts_as_none_on_windows(
    system: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with numba's own class; elsewhere, a file that may not be read is an error."""

    def write_elsewhere(*_: object) -> None:
        raise PermissionError(errno.EACCES, "used by another process")

    kernel = njit(cache=True)(lambda number: number + 1)
    monkeypatch.setattr(kernel._cache, "_load_overload", write_elsewhere)
    monkeypatch.setattr("numba.core.caching.os", SimpleNamespace(name=system))
    if system == "nt":
        assert kernel._cache.load_overload((), kernel.targetctx) is None
    else:
        with pytest.raises(PermissionError):
            kernel._cache.load_overload((), kernel.targetctx)


def test_no_kept_kernel_hashes() -> None:
    """Its code would end the process, as the secret is not there; see :func:`svv.core.compiled.njit`."""
    kept = [path for path in Path(svv.__file__).parent.rglob("*.nbc") if b"_numba_hashsecret_" in path.read_bytes()]
    assert kept == []
