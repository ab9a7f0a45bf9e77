"""What a long run leaves behind, measured inside ParaView's process: memory, handles, threads and temporary files."""

from __future__ import annotations

import ctypes
import gc
import json
import os
import sys
import time
from pathlib import Path
from typing import TextIO


class _Malloc(ctypes.Structure):
    """``struct mallinfo2`` of glibc 2.33 and later."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
    ]


class Gauge:
    """Writes samples, one line of JSON each.

    Args:
        file: File for the samples.
        folders: Folders in which temporary files would be left.
    """

    def __init__(self, file: TextIO, folders: list[Path]) -> None:
        self._file, self._folders = file, folders
        self._libc = ctypes.CDLL(None)
        self._libc.mallinfo2.restype = _Malloc
        self._start = time.monotonic()

    def sample(self, phase: str, done: int) -> None:
        """Write what is in use after a number of operations, once all that is free has been given back."""
        gc.collect()
        self._libc.malloc_trim(0)
        malloc = self._libc.mallinfo2()
        said = {
            "phase": phase,
            "done": done,
            "seconds": time.monotonic() - self._start,
            "resident": int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"),
            "malloc": malloc.uordblks + malloc.hblkhd,  # bytes in use; without Python's own arenas of small objects
            "python": sys.getallocatedblocks(),
            "handles": len(os.listdir("/proc/self/fd")) - 1,  # less the one that reads the folder
            "threads": len(os.listdir("/proc/self/task")),
            "files": sum(1 for folder in self._folders for path in folder.rglob("*") if path.is_file()),
        }
        self._file.write(json.dumps(said) + "\n")
        self._file.flush()
