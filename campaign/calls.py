"""Calls of the file system by Python code, seen before they happen, in one folder: to fail one, or to record all.

Only Python's calls are seen. What libraries write themselves (the movie encoder, VTK, OpenVDB) goes by another way; a
full disk and a limit on the size of files show what happens there (``tests/test_failing_io.py``).
"""

from __future__ import annotations

import builtins
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

Seen = Callable[[str, str], None]
"""Called with the kind of the call (``open``, ``write``, ``fsync`` ...) and its path; what it raises is its result."""

KINDS = ("read", "open", "write", "fsync", "rename", "mkdir", "unlink", "rmdir")
"""Kinds of calls; ``read`` is the opening of a file for reading, ``open`` that for writing."""


@contextmanager
def watched(folder: str, seen: Seen) -> Iterator[None]:
    """Show each call that concerns a path below ``folder`` to ``seen``, just before it happens."""
    root = os.path.realpath(folder)

    def told(kind: str, path: Any, dir_fd: int | None = None) -> None:
        if isinstance(path, int):
            place = os.readlink(f"/proc/self/fd/{path}")
        else:
            above = os.getcwd() if dir_fd is None else os.readlink(f"/proc/self/fd/{dir_fd}")
            place = os.path.normpath(os.path.join(above, os.fsdecode(path)))
        if place == root or place.startswith(root + os.sep):
            seen(kind, place)

    def before(kind: str, call: Callable[..., Any], which: int = 0) -> Callable[..., Any]:
        def run(*given: Any, **named: Any) -> Any:
            told(kind, given[which], named.get("dir_fd"))
            return call(*given, **named)

        return run

    def os_open(path: Any, flags: int, mode: int = 0o777, *, dir_fd: int | None = None) -> int:
        told("open" if flags & (os.O_WRONLY | os.O_RDWR) else "read", path, dir_fd)
        return real_open(path, flags, mode, dir_fd=dir_fd)

    class Raw(io.FileIO):
        def write(self, data: Any) -> Any:
            told("write", self.fileno())
            return super().write(data)

    def opened(file: Any, mode: str = "r", buffering: int = -1, encoding: Any = None, errors: Any = None,
               newline: Any = None, closefd: bool = True, opener: Any = None) -> Any:  # fmt: skip
        writes = bool(set(mode) & set("wax+"))
        if not isinstance(file, int):
            told("open" if writes else "read", file)
        if not writes or isinstance(file, int):
            return real(file, mode, buffering, encoding, errors, newline, closefd, opener)
        raw = Raw(file, mode.replace("b", "").replace("t", ""), closefd, opener)
        if buffering == 0:
            return raw
        buffer = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return buffer if "b" in mode else io.TextIOWrapper(buffer, encoding, errors, newline)

    real, real_open = io.open, os.open
    with mock.patch.multiple(
        os,
        open=os_open, fsync=before("fsync", os.fsync), replace=before("rename", os.replace, 1),
        rename=before("rename", os.rename, 1), mkdir=before("mkdir", os.mkdir), unlink=before("unlink", os.unlink),
        remove=before("unlink", os.remove), rmdir=before("rmdir", os.rmdir), pwrite=before("write", os.pwrite),
    ), mock.patch.object(io, "open", opened), mock.patch.object(builtins, "open", opened):  # fmt: skip
        yield
