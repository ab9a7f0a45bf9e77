"""Options that several commands take together: a dataclass of them in the place of each command's own list."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, get_type_hints


def spread(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command as typer is to see it: a parameter that is a dataclass is its fields, in their order and place.

    A field's annotation says what the option is. Left out, it is as in the parameter's default, where it has one, or
    else the field's own. The command itself gets the dataclass, made of what was given.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    known = get_type_hints(command, include_extras=True)
    for name, parameter in inspect.signature(command).parameters.items():
        kind = known[name]
        if not is_dataclass(kind):
            parameters.append(parameter.replace(annotation=kind))
            continue
        groups[name] = kind
        options = get_type_hints(kind, include_extras=True)
        for field in fields(kind):
            own = inspect.Parameter.empty if field.default is MISSING else field.default
            default = getattr(parameter.default, field.name, own)
            parameters.append(parameter.replace(name=field.name, annotation=options[field.name], default=default))

    @functools.wraps(command)
    def run(**given: Any) -> Any:
        for name, kind in groups.items():
            given[name] = kind(**{field.name: given.pop(field.name) for field in fields(kind)})
        return command(**given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run
