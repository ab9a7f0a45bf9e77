"""In ParaView, sentences name what panels show instead of options of commands."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import pytest

from svv.errors import BadInput
from svv.pv.failed import sentence_on
from svv.pv.panel_sentences import FILTERS, OTHERWISE, _fields, say_in_panel
from svv.pv.panel_values import label_of
from tests.test_named import ROOT, commands, labels_of, texts


@pytest.fixture
def panels(monkeypatch: pytest.MonkeyPatch) -> dict[str, set[str]]:
    """Labels by filter; those of a region without its number."""
    pytest.importorskip("vtkmodules", reason="the reader of filters needs VTK: install svv[standalone]")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    classes: list[Any] = importlib.import_module("generated")._decorated()
    return {cls.proxy[1]: {re.sub(r"^Region ?0 ?", "", label) for label in labels_of(cls)} for cls in classes}


@pytest.mark.parametrize("command", FILTERS)
def test_what_a_sentence_names_is_in_the_panel(command: str, panels: dict[str, set[str]]) -> None:
    shown = panels[FILTERS[command][0]]
    for flag, field in _fields(command).items():
        assert label_of(field.property_name) in shown, flag
        assert flag in commands()[command], flag
    for name, flag in OTHERWISE:
        if name == command:
            assert OTHERWISE[name, flag].partition(" '")[0] in shown
            assert flag in commands()[command]


@pytest.mark.parametrize(
    ("sentence", "here"),
    [
        ("Lay strokes with svv stylize --manner strokes.", "Lay strokes with Manner 'strokes' of StyleRF Stylize."),
        ("--hand oil changes that.", "Hand 'oil' changes that."),
        ("--stroke-opacity changes that (below 0).", "Stroke Opacity changes that (below 0)."),
        ("train it with --encoding values.", "train it with Encoding 'values'."),
        ("leave it unpainted (svv stylize --keep 2).", "leave it unpainted (Style 'as it is' of StyleRF Stylize)."),
        ("Several make one scene by svv join --out all.svv.", "Several make one scene by svv join --out all.svv."),
        ("pip --hash=sha256:1 says so", "pip --hash=sha256:1 says so"),
    ],
)
def test_options_become_properties(sentence: str, here: str) -> None:
    assert say_in_panel(sentence) == here


def test_errors_of_filters_name_their_panels() -> None:
    assert sentence_on(BadInput("leave out --continue.")) == "leave out Continue."


def test_nothing_else_in_a_sentence_changes() -> None:
    """Of all sentences there are, only options are replaced, with the command before and the value after."""
    for folder in ("fields", "train", "dvr", "io", "styles", "render", "job"):
        for place, text in texts(Path(ROOT / "svv" / folder)):
            here = say_in_panel(text)
            kept = re.findall(r"[A-Za-z]{3,}", re.sub(r"(?:`?svv [a-z]+ )?--[a-z][\w-]*(?: [\w=:,.#%-]+)?", "", text))
            assert all(word in here for word in kept), (place, text, here)
