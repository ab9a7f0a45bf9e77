"""Sentences of the layers below, which name commands and their options, as a panel says them."""

from __future__ import annotations

import re
from functools import cache

from svv.options.described import Described, described
from svv.options.editing import (
    LightEdit,
    OcclusionEdit,
    OutlineEdit,
    PaintEdit,
    PartEdit,
    RegionEdit,
    SectionEdit,
    ShadowEdit,
)
from svv.options.figures import FigureOptions
from svv.options.making import PaintOptions, PaletteOptions, RenderOptions, TrainOptions, ViewOptions
from svv.pv.panel_values import label_of

FILTERS: dict[str, tuple[str, tuple[type, ...]]] = {
    "views": ("StyleRF Views", (ViewOptions,)),
    "train": ("StyleRF Train", (TrainOptions, PaletteOptions)),
    "stylize": ("StyleRF Stylize", (PaintOptions,)),
    "edit": (
        "StyleRF Edit",
        (RegionEdit, LightEdit, ShadowEdit, OcclusionEdit, PaintEdit, OutlineEdit, SectionEdit, PartEdit),
    ),
    "render": ("StyleRF Render", (RenderOptions,)),
    "figure": ("StyleRF Figure", (FigureOptions,)),
}
"""Commands whose options a filter's panel has, with the filter and the dataclasses of the options."""

OTHERWISE = {
    ("stylize", "--continue"): "Continue",
    ("stylize", "--map"): "Mapping",
    ("stylize", "--keep"): "Style 'as it is'",
    ("edit", "--undo"): "Undo",
    ("edit", "--show"): "Hide",
    ("edit", "--hide"): "Hide",
    ("edit", "--reset"): "As Trained",
}
"""What stands in a panel for options of another form."""

OPTION = re.compile(
    r"(?:`?svv (?P<command>[a-z]+) )?(?<![\w-])(?P<flag>--[a-z][\w-]*)(?: (?P<value>[\w=:,.#%-]*\w))?`?"
)


def say_in_panel(sentence: str) -> str:
    """Return a sentence with the names of the panels for options of commands; what no panel has stays as it is.

    >>> say_in_panel("No region has strokes: paint it with svv stylize --manner strokes.")
    "No region has strokes: paint it with Manner 'strokes' of StyleRF Stylize."
    >>> say_in_panel("--map 0=sky changes that, --divide no gives every region the whole picture.")
    "Mapping '0=sky' changes that, Divide 'no' gives every region the whole picture."
    >>> say_in_panel("Several transfer functions make one scene by svv join.")
    'Several transfer functions make one scene by svv join.'
    """
    return OPTION.sub(_named, sentence)


def _named(match: re.Match[str]) -> str:
    command, flag, value = match["command"], match["flag"], match["value"]
    for name in [command] if command else FILTERS:
        owner = f" of {FILTERS[name][0]}" if command in FILTERS else ""
        if (name, flag) in OTHERWISE:
            pairs = f" {value!r}" if value and "=" in value else ""
            taken = bool(pairs) or bool(value and re.fullmatch(r"\d[\d,]*|all", value))
            return f"{OTHERWISE[name, flag]}{pairs}{owner}{_rest('' if taken else value)}"
        field = _fields(name).get(flag)
        if field is not None:
            given = bool(value) and field.kind is not bool and _is_value(value, field)
            return (
                f"{label_of(field.property_name)}{f' {value!r}' if given else ''}{owner}{_rest('' if given else value)}"
            )
    return match[0]


def _rest(value: str | None) -> str:
    """What followed an option and is no value of it."""
    return f" {value}" if value else ""


def _is_value(word: str, field: Described) -> bool:
    """Whether a word after an option is its value, and not the sentence's next word."""
    return word in field.choices or bool(re.search(r"[\d=:#]", word))


@cache
def _fields(command: str) -> dict[str, Described]:
    """The fields that a command's panel shows, by option."""
    return {
        field.setting.flag or f"--{field.name.replace('_', '-')}": field
        for kind in FILTERS.get(command, ("", ()))[1]
        for field in described(kind)
        if field.property_name
    }
