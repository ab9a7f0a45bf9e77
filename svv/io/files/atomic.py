"""Files that are either written whole or not at all, whenever a run is stopped, the disk fills up or the power fails.

Every writer of the project fills a temporary file in the same folder and moves it into place at the end. Data are on
disk before they get their name, and names before the writer goes on.
"""

from __future__ import annotations

import errno
import json
import math
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from svv.errors import BadInput
from svv.io.files.locks import create_held, hidden, hold_folder, removed_after

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

PARTLY = re.compile(r"\d+ requested and \d+ written")
"""What NumPy says, without the system's reason, if the disk has no room for a whole array."""


def cannot_write(path: str | Path, error: OSError) -> BadInput:
    """Return the error to raise for a file that the system could not write, with a reason and a remedy."""
    reason = _REASONS.get(error.errno or 0, error.strerror or str(error))
    if error.errno is None and PARTLY.fullmatch(reason):
        reason = f"only a part of it could be written; {_REASONS[errno.ENOSPC].partition('; ')[2]}"
    return BadInput(f"Cannot write {path}: {reason}.")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path next to ``path``, with the same suffix; on success, the file is renamed to ``path``.

    If the body raises an exception (including the cancellation of a run), the temporary file is removed and ``path``
    stays unchanged. The next writer of ``path`` removes what a killed process left. After a power failure, ``path`` is
    the old file or the new one; when this returns, it is the new one. Raises BadInput if the folder is missing or not
    writable, the disk is full or read-only, or ``path`` is a folder.
    """
    target = Path(path)
    temporary, held = _claim(target)
    try:
        yield temporary
        sync(temporary)  # the data must be on disk before the file gets its name
        os.replace(temporary, target)
        sync_folder(target.parent)
    except OSError as error:
        # An error about another file, such as an input read in the body, does not concern this file.
        about = {temporary, target, target.parent}
        if error.filename is not None and Path(os.fsdecode(error.filename)) not in about:
            raise
        raise cannot_write(target, error) from error
    finally:
        with suppress(OSError):  # it has its name, or it stays, hidden, until the next writer removes it
            temporary.unlink()
        os.close(held)


@contextmanager
def partial_folder(path: Path) -> Iterator[Path]:
    """Yield an empty hidden folder next to ``path``, which is removed at the end; the body moves its files into place.

    Raises BadInput if the folder that contains it is missing or not writable.
    """
    folder = path.with_name(hidden(path.name, "-partial", ""))
    held = None
    try:
        if folder.is_dir() and (held := hold_folder(folder)) is not None:  # a killed process left it
            shutil.rmtree(folder, ignore_errors=True)
            os.close(held)
        try:
            folder.mkdir()
        except FileExistsError:  # another process writes the same
            folder = folder.with_name(f"{folder.name}-{secrets.token_hex(6)}")
            folder.mkdir()
        held = hold_folder(folder)
    except OSError as error:
        raise cannot_write(path, error) from error
    with removed_after(folder, held):
        yield folder


def sync(path: Path) -> None:
    """Wait until the content of a file is on disk; raises OSError if the system could not write it."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on disk, where the system knows how: otherwise a power failure undoes them.

    Raises OSError if the system could not write them.
    """
    if os.name == "nt":  # Windows opens no folders
        return
    try:
        held = os.open(folder, os.O_RDONLY)
    except PermissionError:  # one may write into a folder that one may not list
        return
    try:
        os.fsync(held)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a file system on which folders are not synced
            raise OSError(error.errno, error.strerror, str(folder)) from error
    finally:
        os.close(held)


def check_writable(path: str | Path) -> None:
    """Check before long work that its result can be written; raises BadInput otherwise, as :func:`atomic_path`."""
    temporary, held = _claim(Path(path))
    with suppress(OSError):
        temporary.unlink()
    os.close(held)


def is_file(path: Path) -> bool:
    """Return whether there is such a file; a name that no file can have, or a loop of links, is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def make_folder(path: str | Path) -> Path:
    """Create a folder for results, with its parents, if there is none; raises BadInput if it cannot be created."""
    folder = Path(path)
    try:
        missing = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        for place in missing:
            sync_folder(place.parent)
    except FileExistsError as error:
        raise BadInput(f"Cannot write into {folder}: it is a file, not a folder; choose another name.") from error
    except OSError as error:
        raise cannot_write(folder, error) from error
    return folder


def to_json(data: object, indent: int | None = None) -> str:
    """Return JSON text that every reader accepts: NumPy values become plain ones, NaN and infinities become null."""
    return json.dumps(_plain(data), indent=indent, allow_nan=False)


def write_json(path: str | Path, data: object) -> None:
    """Write ``data`` as indented JSON, whole or not at all; raises BadInput as :func:`atomic_path`."""
    text = to_json(data, indent=2) + "\n"
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _claim(target: Path) -> tuple[Path, int]:
    """Create an empty temporary file next to the target; return its path and what holds it until it is closed."""
    if target.is_dir():
        raise BadInput(f"Cannot write {target}: it is a folder; give the name of a file.")
    # Hidden, and with the target's suffix, from which picture and movie writers choose their format. Two processes may
    # write the same file at once: the second one's has a name of its own.
    for word in ("partial", secrets.token_hex(6)):
        temporary = target.with_name(hidden(target.stem, f"-{word}", target.suffix))
        try:
            held = create_held(temporary)
        except OSError as error:
            raise cannot_write(target, error) from error
        if held is not None:
            return temporary, held
    raise BadInput(f"Cannot write {target}: other programs write it at the same time; choose another name.")


def _plain(value: object) -> object:
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
