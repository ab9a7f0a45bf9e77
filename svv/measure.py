"""Measure the time and peak memory of a piece of work, and give memory back to other programs."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Cost:
    """Cost of a piece of work, filled in when it is done: wall-clock time, all threads' processor time, and memory.

    The peak is that of the process's resident memory during the work, as reported by the operating system.
    """

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_rss_bytes: int = 0


@contextmanager
def measured() -> Iterator[Cost]:
    """Measure the cost of the body; the figures are set when it ends."""
    cost = Cost()
    with suppress(OSError):  # systems other than Linux cannot reset it, and report the peak since the process began
        Path("/proc/self/clear_refs").write_text("5")
    start, cpu = time.monotonic(), time.process_time()
    try:
        yield cost
    finally:
        cost.seconds, cost.cpu_seconds = time.monotonic() - start, time.process_time() - cpu
        cost.peak_rss_bytes = _peak()


def usable_cpus() -> int:
    """Return the number of CPUs that this process may use, a share of them if torchrun started several processes."""
    cpus = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    processes = os.environ.get("LOCAL_WORLD_SIZE", "")
    return max(1, cpus // int(processes)) if processes.isdecimal() and int(processes) else cpus


def give_memory_back() -> None:
    """Free cycles of objects, and return freed memory to the operating system."""
    gc.collect()
    trim_memory()


def trim_memory() -> None:
    """Return freed memory to the operating system; glibc would otherwise keep it for later."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def _peak() -> int:
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
