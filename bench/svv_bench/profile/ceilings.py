"""Measured limits of this machine: memory streams, matrix products, and random reads."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import torch
from numba import njit, prange

from svv.kernels.numba.bfloat16 import cpu_has_bfloat16
from svv_bench.profile.work import Work

STREAM_NUMBERS = 1 << 25
"""Number of float32 values that are copied: 128 MB, more than caches usually hold."""

MATRIX_SIDE = 1024
"""Side of the matrices that are multiplied."""

RANDOM_READS = 1 << 21
"""Number of random reads per measurement."""

NEAR_NUMBERS, FAR_NUMBERS = 1 << 18, 1 << 24
"""Float32 values of the tables that are read: 1 MB, which fits the cores' caches, and 64 MB, which does not."""

REPEATS = 7
"""Repetitions of every measurement; the best counts because a ceiling is the rate without disturbance."""


@dataclass(frozen=True)
class Ceilings:
    """Highest rates of all threads together, per second."""

    bytes: float
    """Bytes read and written sequentially in memory."""
    operations: float
    """Additions and multiplications of a float32 matrix product."""
    half_operations: float | None
    """Additions and multiplications of a bfloat16 product; None if the CPU has no units for it."""
    gathers: float
    """Random reads from a table of 1 MB."""
    far_gathers: float
    """Random reads from a table of 64 MB."""

    def floor(self, work: Work) -> tuple[float, str]:
        """Return the least time of some work in seconds, and its bound: bytes, operations or reads."""
        parts = {
            "bytes": work.bytes / self.bytes,
            "operations": work.operations / self.operations + work.products / (self.half_operations or self.operations),
            "reads": work.gathers / self.gathers,
        }
        bound = max(parts, key=lambda name: parts[name])
        return parts[bound], bound

    def to_json(self) -> dict[str, float | None]:
        """Return plain values."""
        return asdict(self)


def measure_ceilings() -> Ceilings:
    """Measure the ceilings; this takes about two seconds and 0.3 GB."""
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
    """Return the seconds of the fastest of several runs; the first, which may compile, does not count."""
    work()
    seconds = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


@njit(parallel=True, fastmath=True, cache=True)
def _gather(table, rows, sums):  # type: ignore[no-untyped-def]
    """Sum a table's values at ``rows``, with one partial sum per thread."""
    parts = len(sums)
    for part in prange(parts):
        total = np.float32(0.0)
        for i in range(len(rows) * part // parts, len(rows) * (part + 1) // parts):
            total += table[rows[i]]
        sums[part] = total
