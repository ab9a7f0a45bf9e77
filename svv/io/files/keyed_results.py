"""Results that are computed once and identified by a key: a hash of everything that they depend on (:func:`key_of`).

A key is made from content, settings and the version, never from sums, sizes or paths. Results are kept as JSON records
that contain it (:func:`write_record`) or in folders with one (:func:`make_keyed_folder`); with another key, they are
computed again.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from svv._version import __version__
from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.io.files.atomic import make_folder, to_json, write_json

GENERATION = 24
"""Incremented when the same input and settings give another result although the version has not changed."""

DIGITS = 20
"""Number of hexadecimal digits of a hash."""

FILES = 64
"""Maximum number of files whose hashes are remembered."""

BLOCK = 1 << 20
"""Number of bytes of a file that are read at a time."""

_files: dict[tuple[str, int, int], str] = {}


def digest(*parts: object) -> str:
    """Return a hash of plain values, arrays and files: :data:`DIGITS` hexadecimal digits.

    Plain are numbers, text, None, and lists, tuples and mappings of them. The hash also covers the shape, type and
    values of arrays, the values of bytes, and, for a ``Path``, the content of its file. Raises BadInput if a file
    cannot be read.
    """
    return _hex(json.dumps(json.loads(to_json(_named(parts))), sort_keys=True).encode())


def key_of(*parts: object) -> str:
    """Return the :func:`digest` of these values and of the version."""
    return digest(__version__, GENERATION, *parts)


def digest_of_file(path: str | Path) -> str:
    """Return a hash of a file's content, remembered until the file changes; for a folder, of its files and their names.

    Raises BadInput if it cannot be read.
    """
    if Path(path).is_dir():
        return digest({file.name: file for file in sorted(Path(path).iterdir()) if file.is_file()})
    try:
        status = Path(path).stat()
        place = str(Path(path).absolute()), status.st_size, status.st_mtime_ns
        if place not in _files:
            if len(_files) >= FILES:
                _files.clear()
            content = hashlib.blake2b(digest_size=DIGITS // 2)
            with Path(path).open("rb") as file:
                while block := file.read(BLOCK):
                    content.update(block)
            _files[place] = content.hexdigest()
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    return _files[place]


def read_record(path: Path, key: str) -> dict[str, Any] | None:
    """Return the record that :func:`write_record` wrote with this key; None if it is missing or damaged."""
    record = _record_in(path)
    return record if record.get("key") == key else None


def write_record(path: Path, key: str, record: Mapping[str, object]) -> None:
    """Write a JSON record with its key, whole or not at all; raises BadInput if that fails."""
    write_json(path, {**record, "key": key})


def make_keyed_folder(folder: Path, key: str) -> Path:
    """Return a folder for results with this key, empty if it had another.

    Raises BadInput if others' files are in it.
    """
    note = folder / "key.json"
    told = _record_in(note)  # other programs have files of that name, too
    is_ours = told.keys() == {"key"} and isinstance(told["key"], str)
    if folder.exists() and not is_ours and any(folder.iterdir()):
        raise BadInput(f"{folder} contains other files; choose another folder with --out.")
    if note.exists() and read_record(note, key) is None:
        shutil.rmtree(folder)
    make_folder(folder)
    if not note.exists():
        write_record(note, key, {})
    return folder


def _record_in(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file; an empty one if there is none, or it cannot be used."""
    try:
        record = parsed(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def _named(value: object) -> object:
    """Replace arrays, bytes and files by named hashes, whose names distinguish them from text that looks the same."""
    if isinstance(value, np.ndarray):
        return {"array": [str(value.dtype), value.shape, _hex(np.ascontiguousarray(value).data)]}
    if isinstance(value, bytes):
        return {"bytes": _hex(value)}
    if isinstance(value, Path):
        return {"file": digest_of_file(value)}
    if isinstance(value, Mapping):
        return {str(name): _named(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_named(item) for item in value]
    return value


def _hex(content: bytes | memoryview) -> str:
    return hashlib.blake2b(content, digest_size=DIGITS // 2).hexdigest()
