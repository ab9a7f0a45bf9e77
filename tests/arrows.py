"""Which folder imports which: all modules are read; imports inside functions and names as text count."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

PACKAGES = {"svv": ROOT, "svv_bench": ROOT / "bench", "campaign": ROOT}
"""Where the import packages are; a module's path is given from there."""

FACADES = {"svv", "svv.pv", "svv.__main__", "svv_bench.cli"}
"""Modules that are folders of their own: they stand above their neighbours and hand on what lies in other folders."""

NAME = r"(?:svv|svv_bench|campaign)(?:\.\w+)+"
IN_TEXT = re.compile(rf"(?:from|import|-m) ({NAME})")

Sources = Mapping[Path, str]


def sources() -> dict[Path, str]:
    """Return the text of every module, by its path."""
    return {
        path.relative_to(above): path.read_text(encoding="utf-8")
        for name, above in PACKAGES.items()
        for path in sorted((above / name).rglob("*.py"))
    }


def named(path: Path) -> str:
    """Return the dotted name of a module: 'svv/core/colour/colour.py' is 'svv.core.colour.colour'."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def folder_of(path: Path) -> str:
    """Return the dotted name of the folder in which a module lies, '(facade)' behind that of a facade."""
    name = named(path)
    return f"{name} (facade)" if name in FACADES else ".".join(path.parts[:-1])


def imported(path: Path, source: str, text: bool = True) -> frozenset[str]:
    """Return dotted names that a module imports, relative ones made absolute, lazy ones and names as ``text`` included.

    'from svv.core.colour import light' is both 'svv.core.colour' and 'svv.core.colour.light': what it names may be a
    module. Of a name that is put together, such as f"svv.kernels.{name}", the certain part is returned: "svv.kernels.".
    """
    names, in_texts = _named_in(path, source)
    return names | in_texts if text else names


@cache
def _named_in(path: Path, source: str) -> tuple[frozenset[str], frozenset[str]]:
    """Return the names that a module imports, and those in its texts."""
    package = [*path.with_suffix("").parts[:-1]]
    names: set[str] = set()
    in_texts: set[str] = set()
    tree = ast.parse(source)
    told = {id(text) for node in ast.walk(tree) for text in _docstrings(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            names |= {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            in_texts |= {node.value} if re.fullmatch(NAME + r"\.?", node.value) else set()
            in_texts |= set(IN_TEXT.findall(node.value))
    return frozenset(names), frozenset(in_texts)


def _docstrings(node: ast.AST) -> Iterator[ast.expr]:
    """Yield texts that are statements: what they name is told to readers."""
    for part in getattr(node, "body", None) or () if not isinstance(node, (ast.Lambda, ast.IfExp)) else ():
        if isinstance(part, ast.Expr):
            yield part.value


def arrows(modules: Sources) -> dict[str, dict[str, list[str]]]:
    """Return the folders that each folder imports, with the modules that do: {folder: {other: [module, ...]}}.

    What a facade promises to type checkers, and in a table to those who ask, lies above and is no arrow.
    """
    places = {named(path): folder_of(path) for path in modules}
    found: dict[str, dict[str, list[str]]] = {folder: {} for folder in places.values()}
    for path, source in modules.items():
        own = folder_of(path)
        if own == "svv (facade)":
            source = without_interface(source)
        names = imported(path, source)
        parts = tuple(name for name in names if name.endswith("."))  # any module there may be meant
        for name in sorted({*names, *(place for place in places if place.startswith(parts))}):
            while name and name not in places:
                name = name.rpartition(".")[0]
            if name and places[name] != own:
                found[own].setdefault(places[name], []).append(named(path))
    return found


def without_interface(source: str) -> str:
    """Return the source of ``svv/__init__.py`` without the names that it promises and never imports itself.

    They lie in layers above and are imported when somebody asks for them; that nothing heavy is loaded before is
    tested in ``test_layers``.
    """
    tree = ast.parse(source)
    tree.body = [
        node
        for node in tree.body
        if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
        and not (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "PUBLIC")
    ]
    return ast.unparse(tree)


def circles(graph: Mapping[str, AbstractSet[str]]) -> list[list[str]]:
    """Return the sets of nodes that reach each other along arrows (strongly connected components of two or more)."""
    return [part for part in components(graph) if len(part) > 1]


def components(graph: Mapping[str, AbstractSet[str]]) -> list[list[str]]:
    """Return all strongly connected components, those that are reached before those that reach them (Tarjan 1972)."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        number[node] = low[node] = len(number)
        stack.append(node)
        for other in sorted(graph.get(node, ())):
            if other not in number:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], number[other])
        if low[node] == number[node]:
            start = stack.index(node)
            found.append(sorted(stack[start:]))
            del stack[start:]

    for node in sorted(graph):
        if node not in number:
            visit(node)
    return found
