"""Tables of the measurements: each page's are made from the newest rows of ``docs/measurements/results.csv``.

A page says where a table stands and what its first columns are called::

    <!-- table accuracy/fast: scene | network -->
    <!-- end -->

What lies between is written by :func:`write`. The pages that ``make docs`` builds also say which figures are older than
the code that they measure; the committed ones do not, since every commit would change them.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "bench"))

from svv_bench.results import Result, changed, newest, read  # noqa: E402

FOLDERS = ROOT / "docs" / "measurements", ROOT / "docs" / "design"
FILE = FOLDERS[0] / "results.csv"

PLACE = re.compile(r"<!-- table (\S+): ([^\n]*?) -->\n(.*?)<!-- end -->", re.DOTALL)
"""A table's name, the headings of its key columns, and what is there now."""

Old = Callable[[Result], str]
"""Date of the newest code that a figure measures, if that is newer than the figure; otherwise empty."""


def write(folders: Iterable[Path] = FOLDERS, file: Path = FILE) -> None:
    """Fill the tables of all pages of some folders; equal files stay."""
    results = newest(read(file))
    for page in sorted(page for folder in folders for page in folder.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (made := filled(text, results)) != text:
            page.write_text(made, encoding="utf-8")


def filled(page: str, results: Iterable[Result], old: Old = lambda _: "") -> str:
    """Return a page with its tables.

    Raises:
        KeyError: A table has no rows.
    """
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(result.table, []).append(result)

    def table(match: re.Match[str]) -> str:
        name, heads = match[1], match[2]
        made = markdown(found[name], heads.split(" | "), old)
        return f"<!-- table {name}: {heads} -->\n{made}\n<!-- end -->"

    return PLACE.sub(table, page)


def markdown(results: Sequence[Result], heads: Sequence[str], old: Old) -> str:
    """Return a table, and below it a line for each origin: when, of which version, where and how it was measured."""
    origins = list(dict.fromkeys(one.origin for one in results))
    columns = {column: _unit(results, column) for column in dict.fromkeys(one.column for one in results)}
    titles = [f"{column}, {unit}" if unit else column for column, unit in columns.items()]
    rows: dict[str, dict[str, Result]] = {}
    for one in results:
        rows.setdefault(one.row, {})[one.column] = one
    lines = [_line([*heads, *titles]), "|---" * (len(heads) + len(titles)) + "|"]
    before: list[str] = []
    for key, found in rows.items():
        keys = key.split(" | ")
        same = next((n for n, (a, b) in enumerate(zip(keys, before)) if a != b), 0)
        own = {one.origin for one in found.values()} if len(origins) > 1 else set()
        shown = [""] * same + keys[same:]
        if len(own) == 1:
            shown[-1] += _sign(origins.index(*own))
        signs = {o: _sign(origins.index(o)) if len(own) > 1 else "" for o in origins}
        values = (_cell(found.get(column), columns[column], signs) for column in columns)
        lines.append(_line([*shown, *values]))
        before = keys
    for number, origin in enumerate(origins):
        sign = _sign(number) + " " if len(origins) > 1 else ""
        lines += ["", sign + _said(origin) + _mark(filter(None, (old(r) for r in results if r.origin == origin)))]
    return "\n".join(lines)


def _sign(number: int) -> str:
    """Return a small raised number, counted from 1."""
    return str(number + 1).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _line(texts: Iterable[str]) -> str:
    return f"| {' | '.join(texts)} |"


def _unit(results: Iterable[Result], column: str) -> str:
    """Return the unit of a column; empty if its figures have several, which then stand in the cells."""
    units = {one.unit for one in results if one.column == column}
    return units.pop() if len(units) == 1 else ""


def _cell(one: Result | None, unit: str, signs: dict[tuple[str, str, str, str], str]) -> str:
    if one is None:
        return ""
    return one.value + (f" {one.unit}" if one.unit and not unit else "") + signs[one.origin]


def _said(origin: tuple[str, str, str, str]) -> str:
    when, commit, machine, command = origin
    words = [when, f"`{commit}`" if commit else "", machine]
    return f"*{', '.join(filter(None, words))}*" + (f": `{command}`" if command else "")


def _mark(dates: Iterable[str]) -> str:
    newest_code = max(dates, default="")
    return f" **Older than the code that it measures, which changed on {newest_code}.**" if newest_code else ""


LAST = cache(changed)
"""Each path's last change, asked of git once."""


def older(result: Result, ask: Callable[[str], str | None] = LAST) -> str:
    """Return when the code that a figure measures last changed, if that was later; otherwise, or if unknown, empty."""
    last = ask(result.paths)
    return last if last is not None and last > result.date else ""


def mark(_app: object, name: str, source: list[str]) -> None:
    """Mark what is old in a page before Sphinx reads it (event ``source-read``)."""
    if name.startswith(("measurements/", "design/")):
        source[0] = filled(source[0], newest(read(FILE)), older)
