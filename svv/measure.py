"""What a piece of work cost: seconds and peak memory; and how to leave memory and CPUs to others."""

from __future__ import annotations

import ctypes
import gc
import resource
import sys
import time
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Cost:
    """Filled in when the work is done.

    Args:
        seconds: Wall-clock time.
        peak_rss_bytes: Largest resident memory of the process during the work, as the operating system counts it.
    """

    seconds: float = 0.0
    peak_rss_bytes: int = 0


@contextmanager
def measured() -> Iterator[Cost]:
    """Measure what the body costs; the numbers are there after it."""
    cost = Cost()
    _forget_peak()
    start = time.monotonic()
    try:
        yield cost
    finally:
        cost.seconds = time.monotonic() - start
        cost.peak_rss_bytes = _peak()


SPINS = "10000"
"""Rounds for which a thread waits for others without sleeping: about as long as it takes to wake it."""


def share_cores(environ: MutableMapping[str, str]) -> None:
    """Let threads that wait for each other sleep after some ten microseconds; before torch is loaded.

    GNU OpenMP, which torch and numba use, waits for milliseconds at full load otherwise. Where another program wants
    the CPU, too, a thread then often waits for one that is not running because of it: beside one busy process
    a step of training on two CPU cores took 55 ms, and takes 32 ms so; alone 17 ms either way. What the user has
    set stays.
    """
    if "OMP_WAIT_POLICY" not in environ:
        environ.setdefault("GOMP_SPINCOUNT", SPINS)


def give_memory_back() -> None:
    """Return what was freed to the operating system; the C library keeps it for later otherwise (glibc)."""
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def _forget_peak() -> None:
    """Let the peak start anew; where the system cannot (no Linux), it stays the peak since the process began."""
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
