"""The examples in docstrings: every public name has one, and each prints what it says."""

from __future__ import annotations

import doctest
import importlib
import inspect
from pathlib import Path

import numpy as np
import pytest

import svv
from svv.fields.scene.scene import Scene
from svv.train.run.config import PRESETS
from tests.balls import SHORT, balls_views

PACKAGE = Path(svv.__file__).parent
MODULES = sorted(
    ".".join(("svv", *file.relative_to(PACKAGE).with_suffix("").parts))
    for file in PACKAGE.rglob("*.py")
    if ">>> " in file.read_text()
)
PARSER, FINDER = doctest.DocTestParser(), doctest.DocTestFinder(recurse=True)


def failures(test: doctest.DocTest) -> list[str]:
    """What is said of the examples that print something else than they say."""
    said: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(test, out=said.append)
    return said if runner.failures else []


@pytest.fixture
def in_a_folder(tmp_path: Path, broad_strokes: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Examples write files, and train as briefly as tests do."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PRESETS, "draft", SHORT)
    monkeypatch.setenv("PYVISTA_OFF_SCREEN", "true")
    return tmp_path


@pytest.mark.parametrize("name", sorted(svv.PUBLIC))
def test_every_public_name_has_an_example_that_is_true(name: str, balls: Scene, in_a_folder: Path) -> None:
    """In examples, ``scene`` is a trained scene of two balls, and ``views`` are those that it was trained on."""
    text = inspect.getdoc(getattr(svv, name)) or ""
    values = {"svv": svv, "np": np, "scene": balls, "views": balls_views()}
    test = PARSER.get_doctest(text, values, f"svv.{name}", None, None)
    assert [e for e in test.examples if doctest.SKIP not in e.options], f"svv.{name} has no example"
    assert failures(test) == []


def test_other_examples_are_true(in_a_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    public = {f"{one.__module__}.{one.__qualname__}" for one in (getattr(svv, name) for name in svv.PUBLIC)}
    assert MODULES
    wrong = []
    for module in MODULES:
        (in_a_folder / module).mkdir()
        monkeypatch.chdir(in_a_folder / module)
        for test in FINDER.find(importlib.import_module(module), extraglobs={"np": np}):
            if test.name not in public:
                wrong += failures(test)
    assert not wrong, "".join(wrong)
