"""Locks on files, which the system releases when a process ends, however it ends.

Where there are no such locks (Windows, some network folders), nothing is locked, and two commands with one output
overwrite each other's results. The package filelock locks where the file may stay (:mod:`svv.bricks.pyramid`); it has
no locks on folders, on files that are renamed, or that can only be asked about.
"""

from __future__ import annotations

import os
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from svv.errors import BadInput

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

NAME_BYTES = 150
"""Maximum length of the part of a hidden name that comes from another name: disks allow 255 bytes in all."""


def hidden(name: str, before: str, after: str) -> str:
    """Return a hidden name made from another one, which is shortened where it would be too long."""
    content = os.fsencode(name)
    if len(content) > NAME_BYTES:
        name = content[:NAME_BYTES].decode(sys.getfilesystemencoding(), "ignore")
    return f".{name}{before}{after}"


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Hold the name of a result, a file or a folder, so that no other command writes to it in the meantime.

    The lock is a hidden file beside the result. One that a killed process leaves there locks nothing, and the next
    command removes it. Without a folder, or if it cannot be written to, there is no lock: whatever writes there reports
    it. Raises BadInput if another command holds it.
    """
    place = Path(os.path.realpath(path))
    lock = place.with_name(hidden(place.name, "", ".lock"))
    held = None
    while held is None:
        try:
            file = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except OSError:
            yield
            return
        if _lock(file) is False:
            os.close(file)
            raise BadInput(
                f"Another svv command is writing to {path}: wait until it ends, or choose another name with --out."
            )
        held = _if_named(file, lock)  # otherwise, its last holder has just removed it
    try:
        yield
    finally:
        if fcntl is None:
            os.close(held)  # Windows removes no open file
        with suppress(OSError):
            lock.unlink()
        if fcntl is not None:
            os.close(held)


def create_held(path: Path) -> int | None:
    """Create an empty file and hold it until its descriptor is closed; a file that a killed process left is replaced.

    Returns the descriptor, or None if another process or thread holds the file, or if that cannot be told. Raises
    OSError if the file cannot be created.
    """
    _remove_left_behind(path)
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        return None
    if fcntl is None:  # Windows renames no open file
        os.close(file)
        return os.open(os.devnull, os.O_RDONLY)
    _lock(file)
    return _if_named(file, path)


def is_held(path: Path) -> bool:
    """Return whether a process holds a file or folder; where there are no locks, none does.

    >>> is_held(Path("nowhere"))
    False
    """
    try:
        file = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError:  # it is not there, or belongs to another user
        return False
    try:
        return _lock(file, shared=True) is False  # shared: two that ask at once do not see each other
    finally:
        os.close(file)


def hold_folder(path: Path) -> int | None:
    """Hold a folder until the descriptor is closed; None if another process holds it, or if that cannot be told."""
    if fcntl is None:
        return None
    file = os.open(path, os.O_RDONLY)
    if _lock(file) is not True:
        os.close(file)
        return None
    return file


@contextmanager
def removed_after(folder: Path, held: int | None) -> Iterator[Path]:
    """Yield a folder, which is removed after the work, and let go of by whom :func:`hold_folder` made hold it."""
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if held is not None:
            os.close(held)


def _remove_left_behind(path: Path) -> None:
    """Remove a file that no process holds."""
    try:
        file = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError:  # there is none, or it belongs to another user
        return
    try:
        if stat.S_ISREG(os.fstat(file).st_mode) and _lock(file) and _is_named(file, path):
            path.unlink()
    finally:
        os.close(file)


def _lock(file: int, shared: bool = False) -> bool | None:
    """Lock an open file; False if another process holds it, None if files cannot be locked here."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a network folder without locks
        return None
    return True


def _if_named(file: int, path: Path) -> int | None:
    """Return a descriptor whose file still has this name; otherwise close it."""
    if _is_named(file, path):
        return file
    os.close(file)
    return None


def _is_named(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), os.lstat(path))
    except FileNotFoundError:
        return False
