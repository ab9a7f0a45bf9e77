"""Files of shots: JSON, whose keys are the fields of :class:`svv.options.shots.Shot`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.io.described_json import read_as, schema_of, to_plain
from svv.io.files.atomic import write_json
from svv.options.shots import UNFILMED, Shot


def read_shot(path: str | Path | Mapping[str, object]) -> Shot:
    """Read a shot from a file, or from the plain values that such a file holds.

    Raises BadInput, in one sentence, if the file is missing or is not JSON, or for a key that a shot does not have or
    has twice, a value of another type or out of its range, and key frames at one time or out of order.

    >>> svv.read_shot({"duration": 6, "moves": [{"move": "turntable"}]}).seconds
    6.0
    """
    if isinstance(path, Mapping):
        return shot_in(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    except UnicodeDecodeError as error:
        raise BadInput(f"{path} is not a JSON file: it is not text.") from error
    try:
        content = parsed(text)
        json.loads(text, object_pairs_hook=_without_doubles)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None
    except ValueError as error:
        raise BadInput(f"{path} is not a JSON file: {error}.") from error
    return shot_in(content, str(path))


def shot_in(content: object, name: str = "The shot") -> Shot:
    """Return the shot that plain values describe; raises BadInput as :func:`read_shot`."""
    try:
        return read_as(Shot, content, "", UNFILMED)
    except BadInput as error:
        raise BadInput(f"{name}: {error}") from None


def write_shot(path: str | Path, shot: Shot) -> None:
    """Write a shot, whole or not at all; raises BadInput if the file cannot be written.

    >>> shot = svv.read_shot({"keys": [{"time": 0}, {"time": 3, "camera": {"view": [60, 20]}}]})
    >>> svv.write_shot("shot.json", shot)
    >>> svv.read_shot("shot.json") == shot
    True
    """
    write_json(Path(path), to_plain(shot))


def shot_schema() -> dict[str, Any]:
    """Return the JSON Schema of a shot's file."""
    return schema_of(Shot, UNFILMED)


def _without_doubles(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Return an object's keys and values; raises BadInput for a key that it has twice."""
    found: dict[str, object] = {}
    for key, value in pairs:
        if key in found:
            raise BadInput(f"it has {key} twice in one object.")
        found[key] = value
    return found
