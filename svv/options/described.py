"""Fields of a dataclass with everything that commands, panels and the documentation say about them."""

from __future__ import annotations

import ast
import inspect
import textwrap
import types
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints


@dataclass(frozen=True)
class Switch:
    """A check box that enables the properties beside it."""

    name: str
    help: str
    advanced: bool = False


@dataclass(frozen=True)
class Setting:
    """What a field's type, default and sentence do not express; ``Annotated[int, Setting(least=3)]``."""

    flag: str | None = None
    """Name of the command's option; by default derived from the field's name: ``--stroke-size``."""
    least: float | None = None
    """Smallest value."""
    most: float | None = None
    """Largest value."""
    metavar: str | None = None
    """Placeholder for the value in the command's help."""
    syntax: str = ""
    """How the command parses text that is neither a number nor a word: a name in ``svv.cli.option_group.SYNTAX``."""
    panel: str | None = None
    """Name of the property in panels, by default derived from the field's: ``StrokeSize``. Empty: not in panels."""
    command: bool = True
    """Whether the command has an option for the field."""
    advanced: bool = False
    """Whether panels show the field only among their advanced properties."""
    slider: tuple[float | None, float | None] | None = None
    """Range of the panel's slider, for values without a limit or with too wide a range."""
    unset: object = None
    """The panel's value that stands for None, which a property cannot hold."""
    unset_says: str = ""
    """Explanation of ``unset`` in the panel's help."""
    switch: Switch | None = None
    """The check box that enables the property; while it is off, the value is None."""
    result: bool = True
    """Whether the result depends on the field, which is then part of the result's key."""


@dataclass(frozen=True)
class Described:
    """One field of a dataclass, with all that describes it."""

    name: str
    kind: Any
    """Type of the field, without None and annotations."""
    optional: bool
    """Whether the value may be None."""
    default: object
    setting: Setting
    sentence: str

    @property
    def choices(self) -> tuple[str, ...]:
        """The words of a ``Literal``."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    @property
    def property_name(self) -> str:
        """Name of the property in ParaView's panels; '' if they do not show it."""
        if self.setting.panel is not None:
            return self.setting.panel
        return self.name.title().replace("_", "")


def described(cls: type) -> tuple[Described, ...]:
    """Describe the fields of a dataclass, in order."""
    return _described(cls)


@cache
def _described(cls: type) -> tuple[Described, ...]:
    hints, text = get_type_hints(cls, include_extras=True), sentences(cls)
    found = []
    for field in fields(cls):
        kind, setting = hints[field.name], Setting()
        if get_origin(kind) is Annotated:
            kind, *notes = get_args(kind)
            setting = next((note for note in notes if isinstance(note, Setting)), setting)
        members = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else ()
        optional = type(None) in members
        if optional:
            kind = Union[tuple(member for member in members if member is not type(None))]  # noqa: UP007
        default = field.default if field.default is not MISSING else inspect.Parameter.empty
        found.append(Described(field.name, kind, optional, default, setting, text[field.name]))
    return tuple(found)


@cache
def sentences(cls: type) -> dict[str, str]:
    """Return the docstring below each field of a class, on one line; '' for a field without one."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        body: Sequence[ast.stmt] = getattr(node, "body", [])
        for line, after in zip(body, [*body[1:], None]):
            if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name):
                text = after.value if isinstance(after, ast.Expr) else None
                said = text.value if isinstance(text, ast.Constant) and isinstance(text.value, str) else ""
                found[line.target.id] = " ".join(said.split())
    return found


def chosen(options: object) -> dict[str, object]:
    """Return the options that the result depends on, by name."""
    return {f.name: getattr(options, f.name) for f in described(type(options)) if f.setting.result}
