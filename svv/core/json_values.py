"""Checks for values read from JSON files. Each value has a name, which error messages use."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from svv.errors import BadInput

T = TypeVar("T")

Json = Mapping[str, object]
"""A JSON object."""

LARGEST = sys.float_info.max
"""Largest number that counts as finite; integers in a file may be larger."""


def parsed(text: str | bytes) -> Any:
    """Return the value of a JSON text, without the byte-order mark that programs for Windows write before it.

    Raises ValueError if it is not JSON, is nested too deeply for Python, or has an integer beyond the range of floats.
    """
    try:
        return json.loads(text.lstrip("\ufeff") if isinstance(text, str) else text, parse_int=_integer)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _integer(digits: str) -> int:
    number = int(digits)
    if abs(number) > LARGEST:
        raise ValueError("a number in it is too large")
    return number


def object_in(value: object, name: str) -> Json:
    """Return a JSON object; raise BadInput if the value is not one."""
    if not isinstance(value, Mapping):
        raise BadInput(f"{name} must be an object.")
    return value


def needed(content: Json, key: str, name: str) -> object:
    """Return the value of a key of the object called ``name``; raise BadInput if it is missing."""
    if key not in content:
        raise BadInput(f"{name} needs {key}.")
    return content[key]


def number_in(value: object, name: str) -> float:
    """Return a finite number, int or float, unchanged; raise BadInput if the value is not one."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise BadInput(f"{name} must be a finite number.")
    return value


def whole_in(value: object, name: str) -> int:
    """Return an integer; raise BadInput if the value is not one."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise BadInput(f"{name} must be a whole number.")
    return value


def text_in(value: object, name: str) -> str:
    """Return a string; raise BadInput if the value is not one."""
    if not isinstance(value, str):
        raise BadInput(f"{name} must be text.")
    return value


def switch_in(value: object, name: str) -> bool:
    """Return a Boolean; raise BadInput if the value is not one."""
    if not isinstance(value, bool):
        raise BadInput(f"{name} must be true or false.")
    return value


def list_in(value: object, count: int, name: str) -> list[object]:
    """Return a list of ``count`` values; raise BadInput if the value is not one."""
    if not isinstance(value, list | tuple) or len(value) != count:
        raise BadInput(f"{name} must be a list of {count} values.")
    return list(value)


def each_in(value: object, read: Callable[[object, str], T], name: str) -> tuple[T, ...]:
    """Return any number of values as ``read`` gives each; raise BadInput if the value is not a list."""
    return tuple(read(v, name) for v in list_in(value, len(value) if isinstance(value, list | tuple) else 0, name))


def numbers_in(value: object, name: str) -> tuple[float, ...]:
    """Return any number of finite numbers; raise BadInput if the value is not a list of them."""
    if not isinstance(value, list | tuple):
        raise BadInput(f"{name} must be a list of numbers.")
    return tuple(number_in(item, f"{name}, {k}") for k, item in enumerate(value))


def pair_in(value: object, name: str) -> tuple[float, float]:
    """Return two finite numbers; raise BadInput if the value is not a list of them."""
    first, second = (number_in(item, f"{name}, {k}") for k, item in enumerate(list_in(value, 2, name)))
    return first, second


def vector_in(value: object, name: str) -> tuple[float, float, float]:
    """Return three finite numbers; raise BadInput if the value is not a list of them."""
    x, y, z = (number_in(item, f"{name}, {k}") for k, item in enumerate(list_in(value, 3, name)))
    return x, y, z
