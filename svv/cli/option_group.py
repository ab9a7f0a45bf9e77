"""Commands whose options come from dataclasses, in :mod:`svv.options` or in the command's own module.

A command has a parameter of the dataclass's type. :func:`spread` shows typer the fields instead and passes the command
an instance made from the options given.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import is_dataclass
from enum import Enum
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer

from svv.cli import options
from svv.options.described import Described, described

SYNTAX: dict[str, Callable[[str, str], object]] = {
    "colour": lambda text, _: options.parse_colour(text),
    "dims": lambda text, _: options.parse_dims(text),
    "light": lambda text, _: options.parse_light(text),
    "light of shadows": options.parse_shadow_light,
    "light on strokes": options.parse_stroke_light,
    "mapping": lambda text, _: options.parse_mapping(text),
    "pairs": options.parse_pairs,
    "palette of strokes": lambda text, _: options.parse_stroke_palette(text),
    "pixel or point": options.parse_place,
    "point": options.parse_point,
    "regions": options.parse_whole,
    "regions or all": lambda text, flag: () if text == "all" else options.parse_whole(text, flag),
    "size": lambda text, _: options.parse_size(text),
    "spacing": options.parse_numbers,
}
"""Parser of each syntax, by name; it takes the text and the option's name."""


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command as typer is to see it: fields replace dataclasses, whose own default wins over theirs."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, type] = {}
    kinds: dict[str, type] = get_type_hints(command, include_extras=True)
    for name, parameter in inspect.signature(command).parameters.items():
        kind = kinds[name]
        if not is_dataclass(kind):
            parameters.append(parameter.replace(annotation=kind, kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        groups[name] = kind
        given = get_type_hints(kind, include_extras=True)
        for field in _options_of(kind):
            default = getattr(parameter.default, field.name, field.default)
            parameters.append(
                inspect.Parameter(
                    field.name,
                    inspect.Parameter.KEYWORD_ONLY,
                    annotation=_as_typer_has_it(given[field.name], field),
                    default=_shown(field, default),
                )
            )

    @functools.wraps(command)
    def run(**given: object) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{f.name: _convert_option(f, given.pop(f.name)) for f in _options_of(kind)})
        command(**given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def flag_of(field: Described) -> str:
    """Return the name of a field's option, such as ``--stroke-size``."""
    return field.setting.flag or f"--{field.name.replace('_', '-')}"


def _options_of(kind: type) -> list[Described]:
    return [field for field in described(kind) if field.setting.command]


def _as_typer_has_it(given: object, field: Described) -> object:
    """Return a field's annotation for typer, from its own; one that already has a typer option is left unchanged."""
    if any(hasattr(note, "param_decls") for note in get_args(given)):
        return given
    kind: Any = field.kind
    if field.setting.syntax:
        kind = str
    elif field.choices:
        kind = words(field.name, field.choices)
    elif get_origin(kind) is tuple:
        (one, _) = get_args(kind)
        one = words(field.name, get_args(one)) if get_origin(one) is Literal else one
        kind = list[one]  # type: ignore[valid-type]
    several = get_origin(field.kind) is tuple and not field.setting.syntax
    optional = field.optional or several or field.setting.syntax
    option = typer.Option(
        flag_of(field),
        help=field.sentence + (" May be repeated." if several else ""),
        metavar=field.setting.metavar,
        min=field.setting.least if kind in (int, float) else None,
        max=field.setting.most if kind in (int, float) else None,
    )
    return Annotated[kind | None if optional else kind, option]


@cache
def words(name: str, choices: tuple[str, ...]) -> Any:
    """Return an enumeration with which typer offers a choice of words."""
    return Enum(name.title().replace("_", ""), {word.replace("-", "_"): word for word in choices}, type=str)


def _shown(field: Described, default: object) -> object:
    """Return a default in the form that typer takes."""
    if default is inspect.Parameter.empty or default is None or default == ():
        return inspect.Parameter.empty if default is inspect.Parameter.empty else None
    return words(field.name, field.choices)(default) if field.choices else default


def _convert_option(field: Described, given: Any) -> object:
    """Convert the value of an option to the value of its field."""
    if isinstance(given, Enum) and field.choices:
        return given.value
    if field.setting.syntax:
        return None if given is None else SYNTAX[field.setting.syntax](given, flag_of(field))
    if get_origin(field.kind) is tuple:
        return tuple(one.value if isinstance(one, Enum) else one for one in given or ())
    return given
