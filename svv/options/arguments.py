"""Script arguments (argparse) derived from the dataclasses of :mod:`svv.options`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TypeVar, get_origin

from svv.options.described import described

Options = TypeVar("Options")


def add_arguments(parser: argparse.ArgumentParser, options: object, flags: Mapping[str, str]) -> None:
    """Add arguments for the fields of a dataclass that ``flags`` name with their flags: ``{"n": "--views"}``.

    ``options`` holds the script's defaults, such as ``TrainOptions(preset="fast")``.
    """
    for field in described(type(options)):
        if field.name not in flags:
            continue
        default = getattr(options, field.name)
        if field.kind is bool and not default:
            said = field.sentence.rstrip(".").replace("%", "%%")
            parser.add_argument(flags[field.name], dest=field.name, action="store_true", help=said)
            continue
        said = field.sentence.rstrip(".") + ("" if default is None else f" ({default})")
        kind = str if field.choices or get_origin(field.kind) is tuple else field.kind
        parser.add_argument(
            flags[field.name],
            dest=field.name,
            type=kind,
            default=default,
            choices=field.choices or None,
            metavar=None if field.choices else field.setting.metavar or "N",
            help=said.replace("%", "%%"),
        )


def options_of(kind: type[Options], given: argparse.Namespace, **others: object) -> Options:
    """Build the dataclass from parsed arguments; other fields have their defaults, or their values in ``others``."""
    named = {field.name: getattr(given, field.name) for field in described(kind) if hasattr(given, field.name)}
    return kind(**{**named, **others})
