"""What this machine can do at most, measured: streams of memory, products of matrices, and reads at random places."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import torch
from numba import njit, prange

from svv.bench.profile.work import Work
from svv.kernels.bfloat16 import cpu_has_bfloat16

STREAM_NUMBERS = 1 << 25
"""Numbers that are copied from one place to another: 128 MB, more than a cache of one's own."""

MATRIX_SIDE = 1024
"""Of the matrices that are multiplied."""

RANDOM_READS = 1 << 21
"""Random reads of a measurement."""

NEAR_NUMBERS, FAR_NUMBERS = 1 << 18, 1 << 24
"""Numbers of the tables that are read: 1 MB, which the caches of the cores hold, and 64 MB, which they do not."""

REPEATS = 7
"""Of every measurement; the best counts, for a ceiling is what would be reached undisturbed."""


@dataclass(frozen=True)
class Ceilings:
    """All threads together, a second."""

    bytes: float
    """Read and written one after the other in memory."""
    operations: float
    """Additions and multiplications of a float32 matrix product."""
    half_operations: float | None
    """Of a bfloat16 product; None where the CPU has no units for it."""
    gathers: float
    """Reads at random places of a table of 1 MB."""
    far_gathers: float
    """Reads at random places of a table of 64 MB."""

    def floor(self, work: Work) -> tuple[float, str]:
        """Seconds that a piece of work takes at least, and what bounds it: bytes, operations or reads."""
        parts = {
            "bytes": work.bytes / self.bytes,
            "operations": work.operations / self.operations + work.products / (self.half_operations or self.operations),
            "reads": work.gathers / self.gathers,
        }
        bound = max(parts, key=lambda name: parts[name])
        return parts[bound], bound

    def to_json(self) -> dict[str, float | None]:
        """Plain values."""
        return asdict(self)


def measure_ceilings() -> Ceilings:
    """Takes about two seconds and 0.3 GB."""
    a, b = torch.zeros(STREAM_NUMBERS), torch.ones(STREAM_NUMBERS)
    stream = 8 * STREAM_NUMBERS / _best(partial(a.copy_, b))
    rate = {}
    for kind in (torch.float32, torch.bfloat16):
        if kind == torch.float32 or cpu_has_bfloat16():
            x, y = torch.ones(MATRIX_SIDE, MATRIX_SIDE, dtype=kind), torch.ones(MATRIX_SIDE, MATRIX_SIDE, dtype=kind)
            rate[kind] = 2 * MATRIX_SIDE**3 / _best(partial(torch.matmul, x, y))
    rows = np.random.default_rng(0).integers(0, FAR_NUMBERS, RANDOM_READS, dtype=np.int64)
    sums = np.zeros(torch.get_num_threads(), np.float32)
    reads = {}
    for size in (NEAR_NUMBERS, FAR_NUMBERS):
        table, places = np.ones(size, np.float32), rows % size
        reads[size] = RANDOM_READS / _best(partial(_gather, table, places, sums))
    return Ceilings(stream, rate[torch.float32], rate.get(torch.bfloat16), reads[NEAR_NUMBERS], reads[FAR_NUMBERS])


def _best(work: Callable[[], object]) -> float:
    """Seconds of the fastest of a few goes; the first, which may compile, does not count."""
    work()
    seconds = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


@njit(parallel=True, fastmath=True, cache=True)
def _gather(table, rows, sums):  # type: ignore[no-untyped-def]
    """Sum of a table's numbers at ``rows``, a part for each thread."""
    parts = len(sums)
    for part in prange(parts):
        total = np.float32(0.0)
        for i in range(len(rows) * part // parts, len(rows) * (part + 1) // parts):
            total += table[rows[i]]
        sums[part] = total
