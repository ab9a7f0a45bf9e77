"""Dataclasses of :mod:`svv.options` from JSON, strictly, and their JSON Schema; both come from the same fields.

A field has the type, range and sentence that :mod:`svv.options.described` knows. Several dataclasses in one field are
told apart by the key :data:`KIND`, which holds their ``name``.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Collection, Mapping
from dataclasses import is_dataclass
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from svv.core.json_values import list_in, number_in, object_in, switch_in, text_in, whole_in
from svv.errors import BadInput
from svv.options.described import Described, Setting, described

T = TypeVar("T")

KIND = "move"
"""Key of an object that tells which of several dataclasses it is."""

HEX = "^#[0-9a-fA-F]{6}$"
"""A colour as text."""

UNIONS = (Union, types.UnionType)

PLAIN: dict[object, tuple[Callable[[object, str], Any], str]] = {
    bool: (switch_in, "boolean"),
    float: (number_in, "number"),
    int: (whole_in, "integer"),
    str: (text_in, "string"),
}
"""Types of values: how each is read, and what the schema calls it."""


def read_as(kind: type[T], content: object, name: str, without: Collection[str] = ()) -> T:
    """Return the dataclass that a JSON object holds; ``name`` says in errors where it stands, '' for a whole file.

    Raises BadInput for unknown and missing keys, other types, numbers that are not finite or out of range, and what the
    dataclass refuses itself. ``without``: fields that a file cannot have.
    """
    told = object_in(content, name or "it")
    known = {field.name: field for field in described(kind) if field.name not in without}
    if unknown := sorted(set(told) - set(known)):
        raise BadInput(f"{name or 'it'} has no {unknown[0]}; it may have {', '.join(known)}.")
    given: dict[str, Any] = {}
    for field in known.values():
        if field.name in told:
            given[field.name] = _value(field, told[field.name], f"{name}.{field.name}".lstrip("."), without)
        elif field.default is inspect.Parameter.empty:
            raise BadInput(f"{name or 'it'} needs {field.name}.")
    try:
        return kind(**given)
    except BadInput as error:
        raise BadInput(f"{name}: {error}" if name else str(error)) from None


def _value(field: Described, value: object, name: str, without: Collection[str]) -> Any:
    if value is None and field.optional:
        return None
    if field.setting.syntax == "colour" and isinstance(value, str):
        return _colour(value, name)
    found = _read(field.kind, value, name, without)
    setting = field.setting
    for number in found if isinstance(found, tuple) else (found,):
        if isinstance(number, float | int) and not isinstance(number, bool):
            if field.setting.syntax == "colour" and not 0.0 <= number <= 1.0:
                raise BadInput(f"{name} must have numbers from 0 to 1, or be '#rrggbb'.")
            if setting.least is not None and number < setting.least:
                raise BadInput(f"{name} must be at least {setting.least:g}, not {number:g}.")
            if setting.most is not None and number > setting.most:
                raise BadInput(f"{name} must be at most {setting.most:g}, not {number:g}.")
    return found


def _colour(text: str, name: str) -> tuple[float, ...]:
    digits = text.removeprefix("#")
    if len(text) != 7 or len(digits) != 6 or not all(digit in "0123456789abcdefABCDEF" for digit in digits):
        raise BadInput(f"{name} must be a colour such as '#ff8800', not '{text}'.")
    return tuple(int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4))


def _read(kind: Any, value: object, name: str, without: Collection[str]) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in UNIONS:
        if not is_dataclass(parts[0]):
            return PLAIN[str if isinstance(value, str) else int][0](value, name)
        told = object_in(value, name)
        kinds = {one.name: one for one in parts}
        which = told.get(KIND)
        if not isinstance(which, str) or which not in kinds:
            raise BadInput(f"{name}.{KIND} must be one of {', '.join(kinds)}.")
        return read_as(kinds[which], {k: v for k, v in told.items() if k != KIND}, name, without)
    if origin is Literal:
        if value not in parts:
            raise BadInput(f"{name} must be one of {', '.join(parts)}.")
        return value
    if origin is dict:
        return {str(k): _read(parts[1], v, f"{name}.{k}", without) for k, v in object_in(value, name).items()}
    if origin is tuple:
        if len(parts) == 2 and parts[1] is Ellipsis:
            if not isinstance(value, list):
                raise BadInput(f"{name} must be a list.")
            return tuple(_read(parts[0], one, f"{name}[{k}]", without) for k, one in enumerate(value))
        told_list = list_in(value, len(parts), name)
        return tuple(_read(one, v, name, without) for one, v in zip(parts, told_list, strict=True))
    if is_dataclass(kind):
        return read_as(kind, value, name, without)  # type: ignore[arg-type]
    found = PLAIN[kind][0](value, name)
    return float(found) if kind is float else found


def to_plain(value: object) -> Any:
    """Return plain values for JSON of a dataclass, without fields that have their defaults; inverts :func:`read_as`."""
    if is_dataclass(value) and not isinstance(value, type):
        tag = getattr(type(value), "name", None)
        told = {KIND: tag} if isinstance(tag, str) else {}
        fields = ((field, getattr(value, field.name)) for field in described(type(value)))
        return told | {field.name: to_plain(own) for field, own in fields if own != field.default}
    if isinstance(value, Mapping):
        return {str(k): to_plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [to_plain(one) for one in value]
    return value


def schema_of(kind: type, without: Collection[str] = ()) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a dataclass as :func:`read_as` reads it, with its sentences."""
    found: dict[str, dict[str, Any]] = {}
    _define(kind, found, without)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": kind.__name__,
        "$ref": f"#/$defs/{kind.__name__}",
        "$defs": found,
    }


def _define(kind: Any, found: dict[str, dict[str, Any]], without: Collection[str]) -> None:
    if kind.__name__ in found:
        return
    properties: dict[str, Any] = {}
    tag = getattr(kind, "name", None)
    own = found[kind.__name__] = {"type": "object", "additionalProperties": False, "properties": properties}
    own["description"] = inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].replace("\n", " ")
    fields = [field for field in described(kind) if field.name not in without]
    needed = [field.name for field in fields if field.default is inspect.Parameter.empty]
    if isinstance(tag, str):
        properties[KIND] = {"const": tag}
        needed.append(KIND)
    own |= {"required": needed} if needed else {}
    for field in fields:
        shape = _shape(field.kind, field.setting, found, without)
        shape = {"anyOf": [shape, {"type": "null"}]} if field.optional else shape
        properties[field.name] = {"description": field.sentence, **shape}
        if field.default is not inspect.Parameter.empty and field.default not in (None, ()):
            properties[field.name]["default"] = field.default


def _shape(kind: Any, setting: Setting, found: dict[str, dict[str, Any]], without: Collection[str]) -> dict[str, Any]:
    """Return the schema of one field's values."""
    origin, parts = get_origin(kind), get_args(kind)
    plain = Setting()
    if origin in UNIONS:
        if not is_dataclass(parts[0]):
            return {"type": ["integer", "string"]}
        return {"oneOf": [_shape(one, plain, found, without) for one in parts]}
    if origin is Literal:
        return {"enum": list(parts)}
    if origin is dict:
        return {"type": "object", "additionalProperties": _shape(parts[1], plain, found, without)}
    if setting.syntax == "colour":
        rgb = {"type": "array", "items": {"type": "number", "minimum": 0, "maximum": 1}, "minItems": 3, "maxItems": 3}
        return {"anyOf": [{"type": "string", "pattern": HEX}, rgb]}
    if origin is tuple:
        shape: dict[str, Any] = {"type": "array", "items": _shape(parts[0], plain, found, without)}
        return shape if parts[1] is Ellipsis else shape | {"minItems": len(parts), "maxItems": len(parts)}
    if kind not in PLAIN:
        _define(kind, found, without)
        return {"$ref": f"#/$defs/{kind.__name__}"}
    limits = {"minimum": setting.least, "maximum": setting.most}
    return {"type": PLAIN[kind][1]} | {name: limit for name, limit in limits.items() if limit is not None}
