"""How much memory this process may use, according to the files and limits in which the system says so."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from svv.errors import BadInput

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

LEAST = 2_000_000_000
"""Least address space in bytes with which the libraries work: with less, NumPy's algebra waits for memory for ever."""


def memory_there(root: Path = Path("/")) -> int:
    """Return the bytes of memory that this process may use: the computer's, or less if a limit says so.

    Limits are those of the address space (``ulimit -v``) and of the control groups in which containers and schedulers
    put a process, of both versions; ``proc`` and ``sys`` lie in ``root``.
    """
    there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 8 << 30
    return min([there, *address_space(), *_of_groups(root)])


def check_address_space() -> None:
    """Raise BadInput if the address space is limited to less than the libraries need."""
    for limit in address_space():
        if limit < LEAST:
            raise BadInput(
                f"The address space is limited to {limit / 1e9:.1f} GB, and svv needs {LEAST / 1e9:.0f} GB for its "
                "libraries: raise the limit (ulimit -v), or limit the memory with a control group instead."
            )


def address_space() -> list[int]:
    """Return the limit of the address space in bytes, if there is one."""
    if resource is None:
        return []
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return [] if limit == resource.RLIM_INFINITY else [limit]


def _of_groups(root: Path) -> list[int]:
    """Return the limits of the groups that contain this process, from the innermost out."""
    limits = []
    with suppress(OSError):  # a system without control groups
        for line in (root / "proc/self/cgroup").read_text("utf-8").splitlines():
            _, kinds, place = line.split(":", 2)
            if kinds not in ("", "memory") and "memory" not in kinds.split(","):
                continue
            base = root / "sys/fs/cgroup" / ("memory" if kinds else "")
            name = "memory.limit_in_bytes" if kinds else "memory.max"
            inner = base / place.lstrip("/")
            # In a container, its own group is mounted as the outermost, whatever its place is called outside.
            for folder in [inner, *(p for p in inner.parents if p.is_relative_to(base)), base]:
                with suppress(OSError, ValueError):  # no such group here, or "max"
                    limits.append(int((folder / name).read_text("ascii")))
    return limits
