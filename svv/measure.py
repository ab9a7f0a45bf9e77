"""Measure the time and peak memory of a piece of work, and leave memory and CPUs to other programs."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import sys
import time
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Cost:
    """Cost of a piece of work, filled in when it is done.

    Args:
        seconds: Wall-clock time.
        peak_rss_bytes: Peak resident memory of the process during the work, as reported by the operating system.
    """

    seconds: float = 0.0
    peak_rss_bytes: int = 0


@contextmanager
def measured() -> Iterator[Cost]:
    """Measure the cost of the body; the figures are set when it ends."""
    cost = Cost()
    _forget_peak()
    start = time.monotonic()
    try:
        yield cost
    finally:
        cost.seconds = time.monotonic() - start
        cost.peak_rss_bytes = _peak()


SPINS = "10000"
"""Iterations for which a waiting thread spins before it sleeps: about as long as waking it takes."""

LAYERS = "omp tbb workqueue"
"""Numba's threading layers in the order in which they are tried."""


def share_cores(environ: MutableMapping[str, str]) -> None:
    """Let threads that wait for each other sleep after about ten microseconds. Call it before torch is loaded.

    Otherwise GNU OpenMP, which torch and numba use, spins for milliseconds at full load. If another program also needs
    the CPU, a thread then often waits for one that its own spinning keeps from running: beside one busy process,
    a training step on two CPU cores took 55 ms and now takes 32 ms; alone it takes 17 ms either way. The user's own
    settings are kept.
    """
    if "OMP_WAIT_POLICY" not in environ:
        environ.setdefault("GOMP_SPINCOUNT", SPINS)


def use_huge_pages(environ: MutableMapping[str, str]) -> None:
    """Let torch ask for pages of 2 MiB for its large tensors. Call it before torch is loaded.

    Samples are looked up all over tables of many megabytes, so with pages of 4 KiB most look-ups also miss the
    processor's table of pages, and each temporary array takes thousands of page faults. Linux gives huge pages to those
    that ask (``madvise``, as in Ubuntu) or to all programs (``always``); NumPy asks without being told. The user's own
    setting is kept.
    """
    environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")


def prefer_openmp(environ: MutableMapping[str, str]) -> None:
    """Let numba use OpenMP, as torch does, where it is there. Call it before numba is loaded.

    ParaView 6.1 brings TBB, which numba would prefer, and with which the first of several ranks never ends. The user's
    own setting is kept.
    """
    environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", LAYERS)


def usable_cpus() -> int:
    """Return the number of CPUs that this process may use, a share of them if torchrun started several processes."""
    cpus = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    processes = os.environ.get("LOCAL_WORLD_SIZE", "")
    return max(1, cpus // int(processes)) if processes.isdecimal() and int(processes) else cpus


def give_memory_back() -> None:
    """Return freed memory to the operating system; glibc would otherwise keep it for later."""
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def _forget_peak() -> None:
    """Reset the peak; systems other than Linux cannot, and report the peak since the process began."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def _peak() -> int:
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
