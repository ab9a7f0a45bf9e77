"""Where what can be made again is kept between runs, and never takes more than a bounded place."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from svv.errors import BadInput
from svv.io.atomic import cannot_write, make_folder

Content = TypeVar("Content")

BOUND = 2_000_000_000
"""Bytes that results take at most, unless ``SVV_CACHE_SIZE`` says otherwise: some hundred scenes."""

UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}

NAME = re.compile(r"[a-z]+-[0-9a-f]{20}-[0-9a-f]{20}-[\w.+]+")
"""Names of results: nothing else in the folder is touched, whoever it belongs to."""

LEFT_BEHIND = 24 * 3600.0
"""Seconds after which an unfinished file is of a run that was killed."""


def cache_folder() -> Path:
    """The program's folder in the user's cache: ``$XDG_CACHE_HOME/svv``, else ``~/.cache/svv``; it may not exist."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "svv"


def bytes_in(text: str) -> int:
    """A size such as '500M', '2G' or '1000000' in bytes.

    Raises:
        BadInput: it is none.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)B?", text.strip().upper())
    if found is None:
        raise BadInput(f"SVV_CACHE_SIZE must be a number of bytes such as 500M or 2G (0 keeps nothing), not '{text}'.")
    return int(float(found[1]) * UNITS[found[2]])


@dataclass(frozen=True)
class Entry:
    """A result that is kept."""

    path: Path
    """A file, or a folder."""
    bytes: int
    used: float
    """When it was last written or read, seconds since 1970."""


@dataclass(frozen=True)
class Cache:
    """A folder of results, of which those that were not used for longest give way to new ones.

    Several processes may use it at once. Nobody holds on to a file that is in it: what is gone is made again.
    """

    folder: Path
    bound: int
    """Bytes. A result that is larger by itself is kept until the next one comes."""

    @classmethod
    def of_user(cls) -> Cache:
        """The user's: in ``SVV_CACHE``, else in the folder ``scenes`` of :func:`cache_folder`.

        Raises:
            BadInput: ``SVV_CACHE_SIZE`` is no size.
        """
        folder = os.environ.get("SVV_CACHE") or cache_folder() / "scenes"
        size = os.environ.get("SVV_CACHE_SIZE")
        return cls(Path(folder).expanduser(), bytes_in(size) if size else BOUND)

    def entries(self) -> list[Entry]:
        """What is kept, the least recently used first."""
        found = []
        for path in self._paths():
            try:
                used = path.stat().st_mtime
                inside = path.rglob("*") if path.is_dir() else [path]
                found.append(Entry(path, sum(file.stat().st_size for file in inside if file.is_file()), used))
            except OSError:  # another process has just removed it
                continue
        return sorted((e for e in found if NAME.fullmatch(e.path.name)), key=lambda entry: (entry.used, entry.path))

    def holds(self, name: str) -> bool:
        """Whether there is something of that name."""
        return NAME.fullmatch(name) is not None and (self.folder / name).exists()

    def read(self, name: str, read: Callable[[Path], Content]) -> Content | None:
        """What is kept under a name, None where there is nothing. What is damaged is removed, to be made anew.

        Args:
            name: As :data:`NAME` has it; any other holds nothing.
            read: Reads it from its path; raises BadInput where it cannot.
        """
        if not self.holds(name):
            return None
        path = self.folder / name
        try:
            content = read(path)
        except (BadInput, OSError):  # damaged, or another process has just removed it
            _remove(path)
            return None
        try:
            os.utime(path)
        except OSError:  # of another user, or on a disk that is read-only: then it only seems older than it is
            pass
        return content

    def write(self, name: str, write: Callable[[Path], None]) -> str:
        """Keep a result, and let others go until all are within the bound.

        Args:
            name: As :data:`NAME` has it.
            write: Writes it to the path that it is given, as a file or a folder.

        Returns:
            '' if it is kept, else one sentence that says why not: the result itself is not lost by that.
        """
        assert NAME.fullmatch(name), name
        if self.bound == 0:
            return "SVV_CACHE_SIZE is 0, so nothing is kept for saved states."
        path, unfinished = self.folder / name, self.folder / f".{name}-{secrets.token_hex(6)}"
        try:
            make_folder(self.folder)
            write(unfinished)
            if path.is_dir():  # which a folder cannot take the place of
                _remove(path)
            os.utime(unfinished)
            os.replace(unfinished, path)
        except (BadInput, OSError) as error:
            said = error if isinstance(error, BadInput) else cannot_write(path, error)
            return f"It could not be kept for saved states: {said}"
        finally:
            _remove(unfinished)
        self._trim(path)
        return ""

    def clear(self) -> int:
        """Remove all results; returns how many bytes that frees."""
        freed = sum(entry.bytes for entry in self.entries())
        for path in self._paths():
            _remove(path)
        return freed

    def _trim(self, newest: Path) -> None:
        entries = self.entries()
        total = sum(entry.bytes for entry in entries)
        for entry in entries:
            if total <= self.bound:
                break
            if entry.path != newest:
                _remove(entry.path)
                total -= entry.bytes
        for path in self._paths():
            try:
                if path.name.startswith(".") and path.stat().st_mtime < time.time() - LEFT_BEHIND:
                    _remove(path)
            except OSError:  # another process has just removed it
                continue

    def _paths(self) -> list[Path]:
        """All that is ours: results, and unfinished files, which begin with a dot."""
        try:
            return [path for path in self.folder.iterdir() if NAME.match(path.name.removeprefix("."))]
        except OSError:  # there is no such folder yet
            return []


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
        return
    try:
        path.unlink(missing_ok=True)
    except OSError:  # of another user: it stays, and counts
        pass
