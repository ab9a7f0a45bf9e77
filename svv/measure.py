"""Measure the time and peak memory of a piece of work, and give memory back to other programs."""

from __future__ import annotations

import ctypes
import gc
import os
import re
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

MAPPINGS = Path("/proc/self/smaps")

IN_COMMAND: list[bool] = []
"""Not empty in a process that is a command of svv and nothing else."""

ONLY_READ = re.compile(
    rb"^([0-9a-f]+)-([0-9a-f]+) r-[-x]p \S+ \S+ [1-9]\d* +/.*\.so\b.*\n(?:(?!Anonymous:)\w+:.*\n)*Anonymous: +0 kB\n"
    rb"(?:(?!Swap:)\w+:.*\n)*Swap: +0 kB\n",
    re.MULTILINE,
)
"""A library's mapping that cannot be written to and holds no page unlike its file, in memory or swapped out, which
would be lost."""

MADV_DONTNEED, M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = 4, -1, -3

OWN_PAGES, KEPT_AT_END = 2 << 20, 16 << 20
"""Bytes from which an array has pages of its own, and that may stay free at the end of all others."""


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


def keep_little() -> None:
    """Let the C library keep little of freed memory: large arrays go back to the operating system at once.

    Otherwise glibc takes arrays of up to 32 MiB from memory in which others lie between them, and their holes add up.
    """
    change = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if change is not None:
        change(M_MMAP_THRESHOLD, OWN_PAGES)
        change(M_TRIM_THRESHOLD, KEPT_AT_END)


def use_little_memory() -> None:
    """Prepare a command for work that takes much memory, after its imports and before its data."""
    keep_little()
    let_go_of_libraries()
    IN_COMMAND.append(True)


def let_go_in_commands() -> None:
    """Let go of libraries again, if this process is such a command: a program may have threads that unload some."""
    if IN_COMMAND:
        let_go_of_libraries()


def let_go_of_libraries() -> None:
    """Take those pages of shared libraries out of this process's memory that were only read.

    Loading PyTorch's touches 270 MB of them, half of these in the libraries of CUDA even where there is no GPU, and
    little of that is needed again: what is comes back from the system's cache of files when it is touched. No other
    thread may unload a library meanwhile.
    """
    advise = getattr(ctypes.CDLL(None), "madvise", None) if sys.platform == "linux" else None
    if advise is None or not MAPPINGS.exists():
        return
    advise.argtypes = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    for start, end in ONLY_READ.findall(MAPPINGS.read_bytes()):
        first = int(start, 16)
        advise(first, int(end, 16) - first, MADV_DONTNEED)  # refused if locked in memory: then it stays


def _peak() -> int:
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
