"""Make ParaView panel properties from the dataclasses of :mod:`svv.options`, and a dataclass from a panel's values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar, get_origin

from svv.options.described import Described, described
from svv.pv.panel.properties import Property, choice, integer, number, numbers, shown_where, switch, text
from svv.pv.panel_values import Values, by_name

Options = TypeVar("Options")


def properties_of(
    options: object, prefix: str = "", advanced: bool = False, skip: tuple[str, ...] = ()
) -> list[Property]:
    """Return a property for each field that panels show, but skipped ones; the field's docstring becomes its help.

    The options have the panel's defaults; the names of the properties get a prefix, such as ``Region0``.
    """
    found: list[Property] = []
    switches: set[str] = set()
    for field in _shown(type(options)):
        if field.name in skip:
            continue
        box = field.setting.switch
        made = _property(field, getattr(options, field.name), prefix, advanced or field.setting.advanced)
        if box is None:
            found.append(made)
            continue
        if box.name not in switches:
            switches.add(box.name)
            found.append(switch(prefix + box.name, False, box.help, advanced or box.advanced))
        found += shown_where(prefix + box.name, 1, [made])
    return found


def options_in(kind: type[Options], values: Values, prefix: str = "", **others: object) -> Options:
    """Return the options that a panel's values represent; fields without a property have their defaults, or others."""
    given = {f.name: _convert_property(f, values, prefix) for f in _shown(kind) if prefix + f.property_name in values}
    return kind(**{**given, **others})


def _shown(kind: type) -> Iterator[Described]:
    return (field for field in described(kind) if field.property_name)


def _property(field: Described, default: Any, prefix: str, advanced: bool) -> Property:
    """Return the property of one field."""
    name, setting, help = prefix + field.property_name, field.setting, field.sentence
    if setting.unset_says:
        help = f"{help} {setting.unset_says}"
    if default is None:
        default = setting.unset
    low, high = setting.slider or (setting.least, setting.most)
    if field.kind is bool:
        return switch(name, default, help, advanced)
    if field.choices:
        entries = (*field.choices, str(setting.unset)) if field.optional else field.choices
        return choice(name, _last_first(entries) if field.optional else entries, default, help, advanced)
    if field.kind is int:
        return integer(name, default, help, _whole(low), _whole(high), advanced)
    if field.kind is float:
        return number(name, default, help, low, high, advanced)
    if get_origin(field.kind) is tuple and setting.syntax == "colour":
        return numbers(name, default, help, "color_selector", advanced)
    if get_origin(field.kind) is tuple:
        return text(name, help + " Semicolons between several.", "; ".join(default), advanced)
    return text(name, help, default or "", advanced)


def _convert_property(field: Described, values: Values, prefix: str) -> object:
    """Return the field's value that corresponds to the property's value."""
    held, setting = by_name(values), field.setting
    value = held[prefix + field.property_name]
    if setting.switch is not None:
        return value if held[prefix + setting.switch.name] else None
    if (field.optional and value == setting.unset) or (field.optional and value == ""):
        return None
    if get_origin(field.kind) is tuple and isinstance(value, str):
        return tuple(word.strip() for word in value.split(";") if word.strip())
    return value


def _last_first(entries: tuple[str, ...]) -> tuple[str, ...]:
    return (entries[-1], *entries[:-1])


def _whole(value: float | None) -> int | None:
    return None if value is None else int(value)
