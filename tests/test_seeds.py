"""A seed gives the same scene on the same machine, bit by bit, and as good a one with other numbers of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

THREADS = (
    "import os, torch; torch.set_num_threads(int(os.environ['OMP_NUM_THREADS']))  # more than there are cores, too"
)

SCORED = f"""
{THREADS}
import json
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from tests.balls import SHORT, balls_views
views = balls_views()
scene, report = train_scene(views, SHORT, seed=5)
print(json.dumps([report["threads"], evaluate_scene(scene, views, "pcn").psnr]))
"""

COMPILED = """
import hashlib, numpy
from svv.kernels.numba.lattice import encode, encode_backward
random = numpy.random.default_rng(0)
x, g = random.random((3000, 3), numpy.float32), random.standard_normal((3000, 1)).astype(numpy.float32)
whole = numpy.arange(8 * 8, dtype=numpy.int64) * 8 << 32 | 0xFF  # all vertices of a lattice of 8 x 8 x 8 are stored
lattice = numpy.array([[8, 8, 8]]), numpy.array([7.0], numpy.float32), numpy.array([0, 510]), whole
table, used, out = g[:512].copy(), numpy.zeros(512, numpy.uint8), numpy.zeros((3000, 1), numpy.float32)
encode(x, *lattice, table, (0.0,), out)
encode_backward(x, g, *lattice, (0.0,), table, used)
print(hashlib.sha256(out.tobytes() + table.tobytes()).hexdigest(), sum(encode.stats.cache_hits.values()))
"""

PLACED = f"""
{THREADS}
import hashlib, numpy, sys
from svv.core.geometry.cameras import sphere_cameras
from svv.train.pipeline import train_scene
from tests.test_training import SIZE, TINY, views_of
from_numpy = torch.from_numpy
def moved(array):
    if not array.size or not array.flags.c_contiguous:
        return from_numpy(array)
    room = numpy.empty(array.nbytes + 128, numpy.uint8)
    first = -room.ctypes.data % 64 + int(sys.argv[1])
    there = room[first:first + array.nbytes].view(array.dtype).reshape(array.shape)
    there[...] = array
    return from_numpy(there)
torch.from_numpy = moved
views = views_of(sphere_cameras(42, (0.0, 0.0, 0.0), 4.0, numpy.radians(30), SIZE))
scene, _ = train_scene(views, TINY)
content = hashlib.sha256()
for name, array in sorted(scene.to_arrays(packed=False)[1].items()):
    content.update(name.encode() + array.tobytes())
print(content.hexdigest())
"""


def told(program: str, *arguments: str, threads: int = 2, **environ: str) -> str:
    """What a program prints that uses the number of threads."""
    set_to = {name: str(threads) for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
    environ = {**os.environ, "OMP_WAIT_POLICY": "passive", **set_to, **environ}
    return subprocess.run(
        [sys.executable, "-c", program, *arguments], env=environ,
        check=True, capture_output=True, text=True, cwd=Path(__file__).resolve().parents[1],
    ).stdout  # fmt: skip


@cache
def trained(threads: int) -> tuple[int, float]:
    """Number of threads and PSNR of a scene trained in a process of its own."""
    count, score = json.loads(told(SCORED, threads=threads))
    return count, score


@pytest.mark.slow
def test_a_seed_gives_the_same_bits() -> None:
    """Wherever NumPy places its arrays, and whatever was in the memory that the C library hands out."""

    def content(shift: int, fill: int) -> Any:
        return told(PLACED, str(shift), threads=1, MALLOC_PERTURB_=str(fill), MALLOC_MMAP_MAX_="0")

    assert content(0, 85) == content(16, 170)


@pytest.mark.slow
def test_kernels_from_the_cache_give_the_bits_of_those_just_compiled(tmp_path: Path) -> None:
    """Numba optimises what it keeps once more: sums in another order would make a first run unlike all later ones."""
    (first, new), (second, kept) = (told(COMPILED, NUMBA_CACHE_DIR=str(tmp_path)).split() for _ in range(2))
    assert (new, kept) == ("0", "1")
    assert first == second


def test_no_kernel_may_reorder_sums() -> None:
    """The profile's own loop is one that measures the machine."""
    root = Path(__file__).resolve().parents[1]
    sources = (path for folder in ("svv", "bench") for path in (root / folder).rglob("*.py"))
    assert {s.name for s in sources if "fastmath=True" in s.read_text(encoding="utf-8")} == {"ceilings.py"}


@pytest.mark.parametrize("threads", [1, 4])
@pytest.mark.slow
def test_other_numbers_of_threads_give_as_good_a_scene(threads: int) -> None:
    """Sums are rounded in another order, which training amplifies, but not to the better or worse."""
    assert trained(threads)[0] == threads
    assert abs(trained(threads)[1] - trained(2)[1]) < 0.05
