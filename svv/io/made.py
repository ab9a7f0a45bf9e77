"""What is made once and known by its key: a hash of all that it depends on.

A key is made of content, never of sums, sizes or places: of the bytes of arrays and files, of settings and other plain
values, and of the version (:func:`key_of`). What is measured also depends on the code that is measured
(:func:`key_of_measure`). Results are kept as JSON records beside their key (:func:`write_record`) or in folders that
hold one (:func:`kept`); whatever has another key is made again.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from svv._version import __version__
from svv.errors import BadInput
from svv.io.atomic import make_folder, to_json, write_json

GENERATION = 1
"""Raised with every change after which the same input and settings give another result, if the version stays."""

DIGITS = 20
"""Of a hash, hexadecimal."""

FILES = 64
"""Files whose hashes are remembered."""

BLOCK = 1 << 20
"""Bytes of a file that are read at a time."""

CALCULATES = ("core", "dvr", "fields", "io", "kernels", "render", "styles", "train")
"""Layers on which what is measured depends."""

_files: dict[tuple[str, int, int], str] = {}


def digest(*parts: object) -> str:
    """A hash of plain values, and of the content of what they hold: :data:`DIGITS` hexadecimal digits.

    Args:
        parts: Numbers, text, None, and lists, tuples and mappings of them, in which arrays count with their shape,
            type and values, bytes with their values, and a ``Path`` with the content of its file.

    Raises:
        BadInput: a file cannot be read.
    """
    return _hex(json.dumps(json.loads(to_json(_named(parts))), sort_keys=True).encode())


def key_of(*parts: object) -> str:
    """:func:`digest` of these and of the version."""
    return digest(__version__, GENERATION, *parts)


def digest_of_file(path: str | Path) -> str:
    """A hash of a file's content, found once until the file is another; of a folder that of its files and names.

    Raises:
        BadInput: it cannot be read.
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


def key_of_measure(*parts: object) -> str:
    """:func:`key_of` of these and of the code that is measured."""
    return key_of(code(), *parts)


@cache
def code() -> str:
    """A hash of the package's code that calculates: of what is measured with it, as the version seldom changes."""
    root = Path(__file__).resolve().parents[1]
    files = sorted(path for layer in CALCULATES for path in (root / layer).rglob("*.py"))
    return digest({path.relative_to(root).as_posix(): path for path in files})


def read_record(path: Path, key: str) -> dict[str, Any] | None:
    """The record that :func:`write_record` wrote under this key; None where there is none, or it is damaged."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None  # nothing that can be relied on: it is made again
    return record if isinstance(record, dict) and record.get("key") == key else None


def write_record(path: Path, key: str, record: Mapping[str, Any]) -> None:
    """Write a JSON record with its key, whole or not at all.

    Raises:
        BadInput: the file cannot be written.
    """
    write_json(path, {**record, "key": key})


def kept(folder: Path, key: str) -> Path:
    """A folder whose content is of that key: made where it is missing, emptied where it is of another.

    Raises:
        BadInput: it holds something that we did not make, or cannot be made.
    """
    note = folder / "key.json"
    if folder.exists() and not note.exists() and any(folder.iterdir()):
        raise BadInput(f"{folder} holds something else; choose another folder with --out.")
    if note.exists() and read_record(note, key) is None:
        shutil.rmtree(folder)
    make_folder(folder)
    if not note.exists():
        write_record(note, key, {})
    return folder


def _named(value: object) -> object:
    """Plain values, with hashes in the place of what has content; names tell them from text that looks alike."""
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
