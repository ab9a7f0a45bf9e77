"""Fields of a dataclass with everything that commands, panels and pages say about them."""

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
    """A check box that says whether the properties beside it count."""

    name: str
    help: str
    advanced: bool = False


@dataclass(frozen=True)
class Setting:
    """What a field's type, default and sentence do not say; ``Annotated[int, Setting(least=3)]``."""

    flag: str | None = None
    """Name of the command's option; by default the field's name: ``--stroke-size``."""
    least: float | None = None
    """Smallest value."""
    most: float | None = None
    """Largest value."""
    metavar: str | None = None
    """What stands for the value in the command's help."""
    syntax: str = ""
    """How the command reads text that is neither a number nor a word: a name in ``svv.cli.option_group.SYNTAX``."""
    panel: str | None = None
    """Name of the property in panels; by default the field's name: ``StrokeSize``. Empty: panels do not show it."""
    command: bool = True
    """Whether the command shows it."""
    advanced: bool = False
    """Whether panels show it only with their advanced properties."""
    slider: tuple[float | None, float | None] | None = None
    """Range in the panel, where the values themselves have no end or a slider would be too long."""
    unset: Any = None
    """The panel's value for None, which a property cannot be."""
    unset_says: str = ""
    """What the panel's help says about that value."""
    switch: Switch | None = None
    """The check box without which the value is None in the panel."""
    result: bool = True
    """Whether the result depends on it; what does not is no part of the result's key."""


@dataclass(frozen=True)
class Described:
    """One field."""

    name: str
    kind: Any
    """Its type, without None and annotations."""
    optional: bool
    """Whether it may be None."""
    default: Any
    setting: Setting
    sentence: str

    @property
    def choices(self) -> tuple[str, ...]:
        """The words of a ``Literal``."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    @property
    def property_name(self) -> str:
        """Its name in ParaView's panels, '' where they do not show it."""
        if self.setting.panel is not None:
            return self.setting.panel
        return self.name.title().replace("_", "")


def described(cls: Any) -> tuple[Described, ...]:
    """The fields of a dataclass in their order."""
    return _described(cls)


@cache
def _described(cls: Any) -> tuple[Described, ...]:
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
def sentences(cls: Any) -> dict[str, str]:
    """The docstring under each field of a class, on one line; '' for a field without one."""
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


def chosen(options: Any) -> dict[str, Any]:
    """What a result depends on, of the options that it was made with: name and value."""
    return {f.name: getattr(options, f.name) for f in described(type(options)) if f.setting.result}
