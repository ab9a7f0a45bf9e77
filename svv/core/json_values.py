"""Values of JSON files, checked where they are read: each has a name, by which the error tells it."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from svv.errors import BadInput

Json = Mapping[str, object]
"""A JSON object."""

LARGEST = sys.float_info.max
"""Largest number that counts as finite: whole numbers in a file may be larger."""


def object_in(value: object, name: str) -> Json:
    """A JSON object; raises BadInput where it is none."""
    if not isinstance(value, Mapping):
        raise BadInput(f"{name} must be an object.")
    return value


def needed(content: Json, key: str, name: str) -> object:
    """The value of a key of the object called ``name``; raises BadInput where it is missing."""
    if key not in content:
        raise BadInput(f"{name} needs {key}.")
    return content[key]


def number_in(value: object, name: str) -> float:
    """A finite number, whole or not, as it is; raises BadInput where it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise BadInput(f"{name} must be a finite number.")
    return value


def whole_in(value: object, name: str) -> int:
    """A whole number; raises BadInput where it is none."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise BadInput(f"{name} must be a whole number.")
    return value


def text_in(value: object, name: str) -> str:
    """Text; raises BadInput where it is none."""
    if not isinstance(value, str):
        raise BadInput(f"{name} must be text.")
    return value


def switch_in(value: object, name: str) -> bool:
    """True or false; raises BadInput where it is neither."""
    if not isinstance(value, bool):
        raise BadInput(f"{name} must be true or false.")
    return value


def list_in(value: object, count: int, name: str) -> list[object]:
    """A list of so many values; raises BadInput where it is none."""
    if not isinstance(value, list | tuple) or len(value) != count:
        raise BadInput(f"{name} must be a list of {count} values.")
    return list(value)


def numbers_in(value: object, name: str) -> tuple[float, ...]:
    """Finite numbers, however many; raises BadInput where they are none."""
    if not isinstance(value, list | tuple):
        raise BadInput(f"{name} must be a list of numbers.")
    return tuple(number_in(item, f"{name}, {k}") for k, item in enumerate(value))


def pair_in(value: object, name: str) -> tuple[float, float]:
    """Two finite numbers; raises BadInput where they are none."""
    first, second = (number_in(item, f"{name}, {k}") for k, item in enumerate(list_in(value, 2, name)))
    return first, second


def vector_in(value: object, name: str) -> tuple[float, float, float]:
    """Three finite numbers; raises BadInput where they are none."""
    x, y, z = (number_in(item, f"{name}, {k}") for k, item in enumerate(list_in(value, 3, name)))
    return x, y, z
