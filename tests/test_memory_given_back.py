"""Memory that a program gives back: pages of libraries that were only read, and large arrays."""

from __future__ import annotations

import platform
import subprocess
import sys

import numpy as np
import pytest
import torch

from svv.fields.radiance import encodings
from svv.fields.radiance.encodings import SparseLattice
from svv.measure import ONLY_READ

LINUX = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc is told, and only Linux says how much")

MAPPING = "{range} {may} 00001000 fe:00 {inode} {file}\nSize: 8 kB\nRss: 8 kB\nAnonymous: {own} kB\nKSM: 0 kB\n"
MAPPING += "Swap: {swap} kB\nSwapPss: {swap} kB\nVmFlags: rd mr\n"

LIBRARY = "/opt/my libs/liba.so.2"


def mapping(may: str = "r-xp", file: str = LIBRARY, own: int = 0, inode: int = 7, swap: int = 0) -> str:
    """Return a mapping as the system describes it."""
    return MAPPING.format(range="7f00a000-7f00c000", may=may, file=file, own=own, inode=inode, swap=swap)


@pytest.mark.parametrize("kept", [
    mapping("rw-p"), mapping("r--s"), mapping("rwxp"), mapping(own=4), mapping("r--p", own=8), mapping("---p"),
    mapping("r--p", swap=4),
    mapping(file="", inode=0), mapping(file="[heap]", inode=0), mapping(file="/tmp/values.npy"),
    mapping(file="/tmp/a.sobering"),
])  # fmt: skip
def test_only_libraries_whose_pages_are_those_of_the_file_are_let_go(kept: str) -> None:
    for may in ("r-xp", "r--p"):
        for text in (kept + mapping(may) + kept, mapping(may) + kept):
            assert ONLY_READ.findall(text.encode()) == [(b"7f00a000", b"7f00c000")]
    assert ONLY_READ.findall((kept + kept).encode()) == []


def run(code: str) -> list[float]:
    """Return the numbers that a process of its own prints."""
    reads = (
        "from pathlib import Path\n"
        "def resident(kind):\n"
        "    lines = Path('/proc/self/status').read_text().splitlines()\n"
        "    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(kind))\n"
    )
    done = subprocess.run([sys.executable, "-c", reads + code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


@LINUX
def test_libraries_let_go_leave_memory_and_still_work() -> None:
    before, after, own, left, same = run(
        "import torch\n"
        "from svv.measure import let_go_of_libraries\n"
        "x = torch.arange(40000.0).reshape(200, 200).sin()\n"
        "expected, before, own = x @ x, resident('RssFile'), resident('RssAnon')\n"
        "let_go_of_libraries()\n"
        "after, left = resident('RssFile'), resident('RssAnon')\n"
        "print(before, after, own, left, int(torch.equal(x @ x, expected)))\n"
    )
    assert after < 0.5 * before
    assert abs(left - own) < 8.0  # nothing of its own is lost
    assert same == 1.0


@LINUX
def test_large_arrays_leave_memory_although_others_lie_behind_them() -> None:
    kept, given_back = (
        run(
            "import ctypes\n"
            "import numpy as np\n"
            "from svv.measure import keep_little\n"
            f"{call}\n"
            "largest = np.ones(30 << 20, np.uint8)\n"
            "del largest\n"  # glibc takes it for a size that often comes
            "arrays = [np.ones(3 << 20, np.uint8) for _ in range(40)]\n"
            "before = resident('RssAnon')\n"
            "del arrays[::2]\n"
            "print(before - resident('RssAnon'))\n"
        )[0]
        for call in ("", "keep_little()")
    )
    assert given_back > 55.0
    assert kept < 30.0  # or the call would not be needed


def test_largest_values_in_cells_are_the_same_some_cells_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    occupied = (np.random.default_rng(1).random((9, 7, 8)) < 0.4).astype(np.uint8)
    lattice = SparseLattice(occupied, 8, (16,), 1).requires_grad_(False)
    lattice.table.copy_(torch.randn(lattice.table.shape, generator=torch.Generator().manual_seed(2)))
    corner = torch.from_numpy(occupied).nonzero()
    whole = lattice.largest_in_cells(corner, 8)
    monkeypatch.setattr(encodings, "VERTICES_AT_A_TIME", 5)
    some = lattice.largest_in_cells(corner, 8)
    assert whole is not None
    assert some is not None
    assert len(whole) > 50
    assert torch.equal(whole, some)
