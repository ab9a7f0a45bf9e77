"""Files that are either written whole or not at all.

A run that is stopped, or a disk that fills up, must never leave half a scene under the name of a good one:
every writer of the project fills a temporary file in the same folder and moves it into place at the end.
"""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from svv.errors import BadInput

_REASONS = {
    errno.ENOSPC: "the disk is full; free some space or choose another place",
    errno.EDQUOT: "your disk quota is used up; free some space or choose another place",
    errno.EFBIG: "it exceeds the system's limit for file sizes; choose another place or raise the limit",
    errno.EROFS: "the disk is read-only; choose another place",
    errno.EACCES: "you do not have permission to write there; choose another place",
    errno.EPERM: "you do not have permission to write there; choose another place",
    errno.ENOENT: "its folder does not exist; create it or choose another place",
    errno.ENOTDIR: "a part of its path is a file, not a folder; choose another place",
    errno.ENAMETOOLONG: "its name is too long for the disk; choose a shorter one",
}


def cannot_write(path: str | Path, error: OSError) -> BadInput:
    """Return the error to raise for a file that the system could not write, with a reason and a remedy."""
    reason = _REASONS.get(error.errno or 0, error.strerror or str(error))
    return BadInput(f"Cannot write {path}: {reason}.")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path next to ``path``, with the same suffix; on success, the file is renamed to ``path``.

    If the body raises an exception (including the cancellation of a run), the temporary file is removed and ``path``
    stays unchanged.

    Raises:
        BadInput: The folder is missing or not writable, the disk is full or read-only, or ``path`` is a folder.
    """
    target = Path(path)
    temporary = _claim(target)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())  # the data must be on disk before the file gets its name
        os.replace(temporary, target)
    except OSError as error:
        # An error about another file, such as an input read in the body, does not concern this file.
        if error.filename is not None and Path(os.fsdecode(error.filename)) not in (temporary, target):
            raise
        raise cannot_write(target, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: str | Path) -> None:
    """Check before long work that its result can be written to ``path``.

    Raises:
        BadInput: It cannot be written, see :func:`atomic_path`.
    """
    _claim(Path(path)).unlink()


def is_file(path: Path) -> bool:
    """Return whether there is such a file; a name that no file can have, or a loop of links, is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def make_folder(path: str | Path) -> Path:
    """Create a folder for results, with its parents, if it does not exist.

    Raises:
        BadInput: The folder cannot be created, or a file has the same name.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise BadInput(f"Cannot write into {folder}: it is a file, not a folder; choose another name.") from error
    except OSError as error:
        raise cannot_write(folder, error) from error
    return folder


def to_json(data: object, indent: int | None = None) -> str:
    """Return JSON text that every reader accepts: NumPy values become plain ones, NaN and infinities become null."""
    return json.dumps(_plain(data), indent=indent, allow_nan=False)


def write_json(path: str | Path, data: object) -> None:
    """Write ``data`` as indented JSON, whole or not at all.

    Raises:
        BadInput: The file cannot be written, see :func:`atomic_path`.
    """
    text = to_json(data, indent=2) + "\n"
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _claim(target: Path) -> Path:
    """Create an empty temporary file next to the target."""
    if target.is_dir():
        raise BadInput(f"Cannot write {target}: it is a folder; give the name of a file.")
    # Hidden, and with the target's suffix, from which picture and movie writers choose their format.
    temporary = target.with_name(f".{target.stem[:100]}-{secrets.token_hex(6)}{target.suffix}")
    try:
        temporary.open("xb").close()
    except OSError as error:
        raise cannot_write(target, error) from error
    return temporary


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
