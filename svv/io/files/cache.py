"""A cache of limited size for results that can be computed again."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from svv.errors import BadInput
from svv.io.files.atomic import cannot_write, make_folder
from svv.io.files.locks import create_held, is_held

Content = TypeVar("Content")

BOUND = 2_000_000_000
"""Maximum size of all results in bytes unless ``SVV_CACHE_SIZE`` is set; enough for a few hundred scenes."""

UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
"""Bytes per unit of ``SVV_CACHE_SIZE``."""

NAME = re.compile(r"[a-z]+-[0-9a-f]{20}-[0-9a-f]{20}-[\w.+]+")
"""Pattern of the names of results; other files in the folder are never touched."""

WRITTEN = re.compile(r".*-[0-9a-f]{12}")
"""Pattern of the hidden names of results while they are written."""

CHECKPOINT = "-checkpoint"
"""End of the hidden name of a checkpoint: what a result can be finished from."""

LEFT_BEHIND = 24 * 3600.0
"""Seconds after which an unfinished file is taken to be left behind by a killed process."""


def cache_folder() -> Path:
    """Return the cache folder, ``$XDG_CACHE_HOME/svv`` or by default ``~/.cache/svv``; it may not exist."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "svv"


def bytes_in(text: str, name: str = "SVV_CACHE_SIZE") -> int:
    """Return a size such as '500M', '2G' or '1000000' in bytes; raises BadInput, with a variable's name, for others."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)B?", text.strip().upper())
    if found is None:
        raise BadInput(f"{name} must be a number of bytes such as 500M or 2G (0 keeps nothing), not '{text}'.")
    return int(float(found[1]) * UNITS[found[2]])


@dataclass(frozen=True)
class Entry:
    """A result in the cache."""

    path: Path
    """File or folder of the result."""
    bytes: int
    """Size in bytes."""
    used: float
    """Time of the last write or read, in seconds since 1970."""
    held: bool = False
    """Whether a process that is running works on it."""

    @property
    def unfinished(self) -> bool:
        """Whether it is a checkpoint, or a file or folder that is not complete."""
        return self.path.name.startswith(".")


@dataclass(frozen=True)
class Cache:
    """A folder of results, of which the least recently used are removed to make room for new ones.

    Several processes may use it at once. No process relies on a file in it: missing results are computed again.
    """

    folder: Path
    """Folder of the results; it may not exist."""
    bound: int
    """Maximum size in bytes, unfinished files included. The newest result and what is at work are never removed."""
    pattern: re.Pattern[str] = NAME
    """Pattern of the names of results."""

    @classmethod
    def of_user(cls) -> Cache:
        """Return the user's cache: ``SVV_CACHE``, or by default the folder ``scenes`` in :func:`cache_folder`.

        Raises BadInput if ``SVV_CACHE_SIZE`` is not a size.
        """
        folder = os.environ.get("SVV_CACHE") or cache_folder() / "scenes"
        size = os.environ.get("SVV_CACHE_SIZE")
        return cls(Path(folder).expanduser(), bytes_in(size) if size else BOUND)

    def entries(self) -> list[Entry]:
        """Return the results in the cache, the least recently used first."""
        return [entry for entry in self._all() if self.pattern.fullmatch(entry.path.name)]

    def unfinished(self) -> list[Entry]:
        """Return checkpoints and what is not complete, the least recently used first."""
        return [entry for entry in self._all() if entry.unfinished]

    def _all(self) -> list[Entry]:
        """Return all results and unfinished files, whose names start with a dot."""
        try:
            there = [path for path in self.folder.iterdir() if self.pattern.match(path.name.lstrip("."))]
        except OSError:  # the folder does not exist yet
            return []
        return sorted(entries_of(there), key=lambda entry: (entry.used, entry.path))

    def hold_checkpoint(self, name: str) -> tuple[Path, int | None]:
        """Return the file of the checkpoint for a result, and a descriptor that keeps it from removal until closed.

        Several processes may use it; the descriptor is None if another one holds it. Raises BadInput if the folder
        cannot be written to.
        """
        path = make_folder(self.folder) / f".{name}{CHECKPOINT}"
        try:
            return path, create_held(_lock_of(path))
        except OSError as error:
            raise cannot_write(path, error) from error

    def remove_checkpoint(self, name: str) -> None:
        """Remove the checkpoint for a result, which is there now, or of no use."""
        path = self.folder / f".{name}{CHECKPOINT}"
        for file in (path, _lock_of(path)):
            remove(file)

    def holds(self, name: str) -> bool:
        """Return whether the cache contains a result of this name."""
        return self.pattern.fullmatch(name) is not None and (self.folder / name).exists()

    def read(self, name: str, read: Callable[[Path], Content]) -> Content | None:
        """Return what ``read`` makes of a result, None if there is none; a damaged one (BadInput) is removed."""
        if not self.holds(name):
            return None
        path = self.folder / name
        try:
            content = read(path)
        except (BadInput, OSError):  # damaged, or another process has just removed it
            remove(path)
            return None
        with suppress(OSError):  # of another user, or on a read-only disk, it will merely appear older than it is
            os.utime(path)
        return content

    def write(self, name: str, write: Callable[[Path], None]) -> str:
        """Add a result, and remove others until the total size is within the bound.

        ``write`` writes it, a file or a folder, to the path that it is given. Returns '', or why the result could not
        be kept, in a sentence.
        """
        assert self.pattern.fullmatch(name), name
        if self.bound == 0:
            return "SVV_CACHE_SIZE is 0, so nothing is kept for saved states."
        path, unfinished = self.folder / name, self.folder / f".{name}-{secrets.token_hex(6)}"
        try:
            make_folder(self.folder)
            write(unfinished)
            if path.is_dir():  # a folder cannot replace another one
                remove(path)
            os.utime(unfinished)
            os.replace(unfinished, path)
        except (BadInput, OSError) as error:
            said = error if isinstance(error, BadInput) else cannot_write(path, error)
            return f"It could not be kept for saved states: {said}"
        finally:
            remove(unfinished)
        self.trim(path)
        return ""

    def remove(self, name: str) -> None:
        """Remove the result of this name, if there is one."""
        if self.holds(name):
            remove(self.folder / name)

    def clear(self) -> int:
        """Remove all results, and what is unfinished and not at work; return the number of bytes freed."""
        return cleared(self._all())

    def trim(self, newest: Path | None = None) -> None:
        """Remove what was used longest ago, finished or not, down to the bound, but never the result ``newest``."""
        everything = self._all()
        total, yesterday = sum(entry.bytes for entry in everything), time.time() - LEFT_BEHIND
        for entry in everything:
            if entry.held or entry.path == newest:
                continue
            old = entry.unfinished and entry.used < yesterday
            # What another process is writing is not held, but will soon be complete.
            resumable = not entry.unfinished or WRITTEN.fullmatch(entry.path.name) is None
            if old or (total > self.bound and resumable):
                remove(entry.path)
                total -= entry.bytes


def entries_of(paths: Iterable[Path]) -> list[Entry]:
    """Return files and folders with their sizes; what has just been removed is left out."""
    found = []
    for path in paths:
        try:
            used = path.lstat().st_mtime
            inside = path.rglob("*") if path.is_dir() else [path]
            size = sum(file.stat().st_size for file in inside if file.is_file())
        except OSError:  # another process has just removed it
            continue
        found.append(Entry(path, size, used, any(map(is_held, (path, path / "lock", _lock_of(path))))))
    return found


def cleared(entries: Iterable[Entry]) -> int:
    """Remove what no process works on, and return the number of bytes freed."""
    freed = 0
    for entry in entries:
        if not entry.held:
            remove(entry.path)
            freed += 0 if entry.path.exists() else entry.bytes
    return freed


def _lock_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.lock")


def remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it, unless it belongs to another user."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):  # of another user: it stays, and its size counts
        path.unlink(missing_ok=True)
