"""The file of results, one row a figure, from which the tables of the documentation's measurements are made.

``svv bench --results FILE COMMAND ...`` appends what the command measured; ``docs/tables.py`` reads the newest rows.
"""

from __future__ import annotations

import csv
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from contextvars import ContextVar
from dataclasses import astuple, dataclass, fields
from datetime import date
from pathlib import Path

from svv.errors import BadInput

FILE: ContextVar[Path | None] = ContextVar("FILE", default=None)
"""The file to which the running command appends what it measures; None if it does not."""

ALL = "svv"
"""What a figure depends on unless its command knows better: the whole package."""


@dataclass(frozen=True)
class Figure:
    """A figure as a command gives it."""

    table: str
    """Page and table, such as ``stability/fast``."""
    row: str
    """Key of the row; several key cells are separated by `` | ``, such as ``head | balanced``."""
    column: str
    value: str
    """As it is shown, with as many digits as mean something; several figures of one kind are separated by commas."""
    unit: str = ""

    @property
    def what(self) -> tuple[str, str, str]:
        """Table, row and column: what is measured, whose newest figure counts."""
        return self.table, self.row, self.column


@dataclass(frozen=True)
class Result(Figure):
    """A figure with its origin: a row of the file."""

    date: str = ""
    """Year-month-day."""
    commit: str = ""
    """Revision of the code that was measured; empty outside a checkout."""
    machine: str = ""
    command: str = ""
    paths: str = ALL
    """Files and folders that the figure measures, from the repository's root, separated by spaces."""

    @property
    def origin(self) -> tuple[str, str, str, str]:
        """Date, commit, machine and command."""
        return self.date, self.commit, self.machine, self.command


COLUMNS = tuple(field.name for field in fields(Result))
"""Columns of the file."""


def read(file: Path) -> list[Result]:
    """Read a file of results.

    Raises:
        BadInput: It cannot be read, has other columns, or a row lacks what, a value or a date.
    """
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.reader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"The results in {file} cannot be read: {error}.") from error
    if not rows or tuple(rows[0]) != COLUMNS:
        raise BadInput(f"{file} is no file of results: its first line has to be {','.join(COLUMNS)}.")
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(COLUMNS) or not all(row[:4]) or not _is_date(row[COLUMNS.index("date")]):
            raise BadInput(f"Row {number} of {file} needs a table, a row, a column, a value and a date.")
    return [Result(*row) for row in rows[1:]]


def newest(results: Iterable[Result]) -> list[Result]:
    """Return the newest figure of everything measured, in the order in which it was measured first."""
    found: dict[tuple[str, str, str], Result] = {}
    for one in results:
        if one.what not in found or one.date >= found[one.what].date:
            found[one.what] = one
    return list(found.values())


def record(figures: Iterable[Figure], paths: str = ALL) -> None:
    """Append figures to the file of ``svv bench --results``, if there is one, with date, commit, machine and command.

    Example:
        >>> record([Figure("speed/images", "head", "CPU", "0.57", "s")])  # without --results, nothing happens
    """
    if (file := FILE.get()) is not None:
        append(file, figures, command_line(sys.argv), paths)


def append(file: Path, figures: Iterable[Figure], command: str, paths: str = ALL) -> None:
    """Append figures measured just now, by the code of this checkout, to a file, which is made if it is missing.

    Raises:
        BadInput: The file is no file of results, or cannot be written.
    """
    if file.exists():
        read(file)
    origin = (date.today().isoformat(), commit(), machine(), command, paths)
    try:
        with file.open("a", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            if stream.tell() == 0:
                writer.writerow(COLUMNS)
            writer.writerows((*astuple(figure), *origin) for figure in figures)
    except OSError as error:
        raise BadInput(f"The results cannot be appended to {file}: {error}.") from error


def cells(
    table: str, rows: Iterable[tuple[str, Sequence[float | str | None]]], columns: Sequence[tuple[str, str, str]]
) -> list[Figure]:
    """Return the figures of a table.

    Args:
        table: Page and table.
        rows: Key and values of each row; None is left out.
        columns: Name, unit and format of each column, such as ``("PSNR", "dB", ".2f")``.

    Example:
        >>> cells("chart/runs", [("head | fast", [38.641, None])], [("PSNR", "dB", ".2f"), ("a view", "s", ".2f")])
        [Figure(table='chart/runs', row='head | fast', column='PSNR', value='38.64', unit='dB')]
    """
    return [
        Figure(table, key, name, value if isinstance(value, str) else format(value, form), unit)
        for key, values in rows
        for value, (name, unit, form) in zip(values, columns, strict=True)
        if value is not None
    ]


def command_line(words: Sequence[str]) -> str:
    """Return a command as one would write it again, without the program's folder and without ``--results``.

    Example:
        >>> command_line(["/usr/bin/svv", "bench", "--results", "r.csv", "chart", "my views", "--out", "c"])
        "svv bench chart 'my views' --out c"
    """
    rest = list(words[1:])
    if "--results" in rest:
        at = rest.index("--results")
        del rest[at : at + 2]
    return shlex.join([Path(words[0]).name, *(word for word in rest if not word.startswith("--results="))])


def machine() -> str:
    """Return the processor, the number of cores that this process may use, and GPUs if there are any."""
    import torch

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    cards = [torch.cuda.get_device_name(number) for number in range(torch.cuda.device_count())]
    return ", ".join([f"{processor()}, {cores} core{'s' * (cores > 1)}", *cards])


def processor() -> str:
    """Return the processor's name as the system gives it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def commit() -> str:
    """Return the abbreviated revision of the checkout, with ``+`` if it was changed; empty outside a checkout."""
    found = git("rev-parse", "--short=7", "HEAD")
    return "" if found is None else found + "+" * bool(git("status", "--porcelain", "--", "svv", "bench"))


def changed(paths: str, ask: Callable[..., str | None] | None = None) -> str | None:
    """Return the date of the last commit that touched any of some paths; None if that is not known.

    A checkout with a shortened history knows nothing: its oldest commit seems to have changed everything.
    """
    ask = ask or git
    if ask("rev-parse", "--is-shallow-repository") != "false":
        return None
    return ask("log", "-1", "--format=%cs", "--", *paths.split()) or None


def git(*words: str) -> str | None:
    """Return what git says of the checkout that this module lies in; None without git or outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    try:
        done = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 and (root / "svv").is_dir() else None


def _is_date(text: str) -> bool:
    try:
        return date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False
