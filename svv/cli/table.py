"""Printing of names and values; see :mod:`svv.cli.app`."""

from __future__ import annotations

from collections.abc import Mapping


def print_table(content: Mapping[str, object], indent: str = "") -> None:
    """Print names and values to standard output; nested values are indented below their names."""
    wide = max((len(name) for name, value in content.items() if not _is_nested(value)), default=0)
    for name, value in content.items():
        if not _is_nested(value):
            print(f"{indent}{name:<{wide}}  {_text(value)}")
            continue
        print(f"{indent}{name}")
        if isinstance(value, dict):
            print_table(value, indent + "  ")
        elif isinstance(value, list | tuple):
            for index, item in enumerate(value):
                print(f"{indent}  {index}: {_text(item)}")


def _is_nested(value: object) -> bool:
    if isinstance(value, list | tuple):
        return any(isinstance(item, dict | str) for item in value) and any(" " in _text(item) for item in value)
    return isinstance(value, dict) and len(_text(value)) > 80


def _text(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return " ".join(_text(item) for item in value)
    return str(value)
