"""Functions fit on a screen. Their number of parameters is checked by ruff (PLR0913)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MOST = 60
"""Lines of a function without its docstring, unless a comment on its first line says why: ``# long: ...``."""

LONGEST = 700
"""Lines of a module."""


def giants(source: str) -> Iterator[str]:
    """Names of the functions that are longer without saying why."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            said = (ast.get_docstring(node, clean=False) or "").count("\n") + 1
            long = (node.end_lineno or 0) - node.lineno + 1 - said
            if long > MOST and "# long: " not in lines[node.lineno - 1]:
                yield f"{node.name}: {long} lines"


@pytest.mark.parametrize("folder", ["svv", "plugin", "paraview_scripts", "docs", "bench"])
def test_functions_fit_a_screen(folder: str) -> None:
    found = {
        str(path.relative_to(ROOT)): list(giants(path.read_text("utf-8"))) for path in (ROOT / folder).rglob("*.py")
    }
    assert not {path: names for path, names in found.items() if names}


def test_a_giant_is_found_unless_it_says_why() -> None:
    body = "\n".join("    x = 1" for _ in range(MOST))
    assert list(giants(f"def tall():\n    '''One line.'''\n{body}\n")) == ["tall: 61 lines"]
    assert not list(giants(f"def tall():  # long: one table\n    '''One line.'''\n{body}\n"))
    assert not list(giants("def small():\n    '''One\n" + "line\n" * 99 + "    '''\n"))


@pytest.mark.parametrize("folder", ["svv", "plugin", "paraview_scripts", "docs", "bench", "tests", "campaign"])
def test_modules_can_be_read_in_one_go(folder: str) -> None:
    lines = {path: len(path.read_text("utf-8").splitlines()) for path in (ROOT / folder).rglob("*.py")}
    assert lines
    assert not {str(path): count for path, count in lines.items() if count > LONGEST}
