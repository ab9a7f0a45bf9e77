"""What sentences tell the user to press, choose or run is there: names are looked up in panels, menus and commands."""

from __future__ import annotations

import ast
import importlib
import re
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import typer

import svv
from svv.cli.app import app
from svv.pv.display.display_table import COLOURS, OPACITIES, REPRESENTATION

ROOT = Path(__file__).resolve().parents[1]

PARAVIEW = {
    "Abort", "Apply", "Clip", "Color Map Editor", "Coloring", "Composite", "Coordinate System", "Cubic",
    "Find Data", "Headlight", "Hover Points On",
    "Lights", "Linear", "Navigable", "Output Messages", "Pipeline Browser", "Play", "Save Animation",
    "Scalar Opacity Unit Distance", "Smart", "Use 2D Transfer Function", "Volume Rendering Mode",
    "Volumetric Scattering Blending",
}  # fmt: skip
"""Names in ParaView's window: its buttons and panels, and what they offer."""

FILTERS = {"Calculator", "Extract Subset", "Resample To Image", "Table To Structured Grid"}
"""Filters of ParaView that sentences name; tests/paraview/test_named_filters.py looks for them there."""

OUTPUTS = {"Mask", "Doubt", "Value"}
"""Our filters' outputs, and arrays of these."""

WORDS = {
    "CPU", "CUDA", "Debian", "DIR", "DISPLAY", "Fedora", "GB", "GPU", "JSON", "Machado", "MatCap", "MatCaps",
    "NVIDIA GPU", "PATH", "PDF", "ParaView", "Python", "SVG", "SVV_CACHE_SIZE", "SVV_TORCH_INDEX", "TORCH", "Ubuntu",
    "VTK", "Xvfb",
    "NAME", "FILE", "NaN", "No", "RGBA", "There",
}  # fmt: skip
"""Other words with a capital: programs, formats, variables, people."""

SUBJECT = {
    "again", "alone", "are", "command", "did", "does", "has", "here", "is", "needs", "reads", "row", "runs", "that",
    "there", "to", "turns", "with", "writes", "wrote",
}  # fmt: skip
"""Words that follow 'svv' where it is the subject of a sentence, and no command."""

FOREIGN = {"--nproc-per-node", "--symmetric", "--hostname", "--server-port", "--hash"}
"""Options of other programs."""


def text_of(node: ast.AST) -> str | None:
    """The text of a string, with {} for what is put in."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
    return None


@cache
def texts(folder: Path) -> tuple[tuple[str, str], ...]:
    """Every text of several words, with its place, but docstrings; those of filters are help in ParaView's window."""
    found: list[tuple[str, str]] = []
    for path in sorted(folder.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        skipped: set[ast.AST] = set()
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            filter_ = isinstance(node, ast.ClassDef) and node.name.startswith("StyleRF")
            if isinstance(body, list) and not filter_:
                skipped |= {inner.value for inner in body if isinstance(inner, ast.Expr)}
            if isinstance(node, ast.JoinedStr):
                skipped |= set(node.values)
        for node in ast.walk(tree):
            text = None if node in skipped else text_of(node)
            if text and " " in text.strip():
                found.append((f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}", " ".join(text.split())))
    return tuple(found)


# --- ParaView -------------------------------------------------------------------------------------------------------


@pytest.fixture
def classes(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The classes of the filters and readers."""
    pytest.importorskip("vtkmodules", reason="the reader of filters needs VTK: install svv[standalone]")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    found: list[Any] = importlib.import_module("generated")._decorated()
    return found


def labels_of(cls: Any) -> set[str]:
    """Labels of what a filter's panel shows, also among the advanced properties."""
    return {
        label
        for one in ElementTree.fromstring(f"<all>{''.join(cls.xml)}</all>").iter()
        if (label := one.get("label") or one.get("name")) and one.get("panel_visibility") != "never"
    }


CAPITAL = re.compile(r"(?<![.!?(\"}] )(?<!^)(?<![\w\"'`./<={}-])([A-Z]\w*(?: (?:[A-Z0-9]\w*))*)")
"""A name: words with a capital that do not begin a sentence."""


def unknown_names(text: str, known: set[str]) -> list[str]:
    """Names in a sentence that are none of the known ones, nor several of them in turn."""
    found = []
    for name in CAPITAL.findall(text):
        left = name
        while left and left not in known and f"Take {left}" not in known:  # the expression takes Take for a beginning
            left = left.rpartition(" ")[0]
        rest = name[len(left) :].strip()
        if not left or (rest and rest not in known and not re.fullmatch(r"[\d.]+\w*", rest)):
            found.append(name)
    return found


def test_names_in_the_window_are_there(classes: list[Any]) -> None:
    filters = {cls.proxy[1] for cls in classes}
    short = {name.removeprefix("StyleRF ") for name in filters}
    shown = {
        re.sub(r"([a-z])([A-Z])", r"\1 \2", name) for name in {**REPRESENTATION, **COLOURS, **OPACITIES}
    }  # the display's own properties
    known = {*filters, *short, *PARAVIEW, *FILTERS, *OUTPUTS, *WORDS, *shown}.union(
        *map(labels_of, classes), ["StyleRF"]
    )
    wrong = {}
    for place, text in texts(ROOT / "svv/pv"):
        sentence = len(text.split()) > 5 and text.endswith((".", "}")) and "/>" not in text
        names = unknown_names(text, known) if sentence else []
        if names:
            wrong[place] = names, text
    assert not wrong, "\n".join(f"{place}: {names} in {text!r}" for place, (names, text) in wrong.items())


def test_an_unknown_name_is_found() -> None:
    known = {"Apply", "Style Files", "StyleRF", "StyleRF Edit", "Take What Is Shown Now"}
    assert unknown_names("Choose a picture under Style Files, and press Apply.", known) == []
    assert unknown_names("Then press Take What Is Shown Then.", known) == ["Take What Is Shown Then"]
    assert unknown_names("Show it, and add StyleRF Edits.", known) == ["StyleRF Edits"]


def test_a_macro_is_named_with_where_it_is() -> None:
    """No ParaView knows them before they are imported."""
    files = {path.stem for path in (ROOT / "plugin/macros").glob("*.py")}
    for place, text in texts(ROOT / "svv"):
        if re.search(r"\bmacros?\b", text):
            assert "imported from plugin/macros" in text and any(name in text for name in files), (place, text)


def test_the_button_that_a_filter_names_is_in_its_panel(classes: list[Any]) -> None:
    """Where its long work is missing, a filter names the button that starts it."""
    named = [cls for cls in classes if "KeptAs" in cls.defaults]
    assert len(named) == 5
    for cls in named:
        assert cls.button in labels_of(cls), cls.__name__


def test_python_that_sentences_name_is_there(classes: list[Any]) -> None:
    buttons = {label.replace(" ", "") for cls in classes for label in labels_of(cls)}
    for place, text in texts(ROOT / "svv/pv"):
        for name in re.findall(r"([A-Z]\w+)\(\) of the filter", text):
            assert name in buttons, (place, text)
        for name in re.findall(r"`(svv(?:\.\w+)+)`", text):
            owner: Any = svv
            for part in name.split(".")[1:]:
                owner = getattr(owner, part, None) or importlib.import_module(f"{owner.__name__}.{part}")


# --- commands -------------------------------------------------------------------------------------------------------


@cache
def commands() -> dict[str, set[str]]:
    """Every command, a group's with the group, and its options."""
    found: dict[str, set[str]] = {}

    def add(name: str, command: Any) -> None:
        found[name] = {"--help"} | {option for one in command.params for option in (*one.opts, *one.secondary_opts)}
        for word in command.list_commands(None) if hasattr(command, "list_commands") else ():
            inner = command.get_command(None, word)
            if inner is not None:
                add(f"{name} {word}".strip(), inner)

    add("", typer.main.get_command(app))
    return found


def unknown_commands(text: str) -> list[str]:
    """Commands and options in a sentence that are not there; an option belongs to the command before it, if any."""
    if text.startswith(":root"):
        return []  # the style sheet of a page
    every = set().union(*commands().values()) | FOREIGN
    found, command = [], ""
    for match in re.finditer(r"(?<![\w./-])svv ([a-z][\w-]*)(?: ([a-z][\w-]*))?|(?<![\w-])(--[a-z][\w-]*)|[;:]", text):
        word, second, option = match.groups()
        if option:
            there = commands()[command] if command else every
            found += [] if option in there | FOREIGN else [f"{command} {option}".strip()]
        elif word and word in commands():
            command = f"{word} {second}" if f"{word} {second}" in commands() else word
        elif word and word not in SUBJECT:
            found.append(f"svv {word}")
        else:
            command = ""
    return found


def test_commands_and_options_are_there() -> None:
    wrong = {place: (names, text) for place, text in texts(ROOT / "svv") if (names := unknown_commands(text))}
    assert not wrong, "\n".join(f"{place}: {names} in {text!r}" for place, (names, text) in wrong.items())


def test_an_unknown_command_or_option_is_found() -> None:
    assert unknown_commands("Hide it with svv edit --opacity 1=0, or svv look list.") == []
    assert unknown_commands("svv paint it, or svv edit --opaque, or --nowhere.") == [
        "svv paint", "edit --opaque", "edit --nowhere",
    ]  # fmt: skip
