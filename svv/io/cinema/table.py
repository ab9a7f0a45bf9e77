"""The table of a Cinema database: one row an image, from ``data.csv`` or from Ascent's ``info.json``."""

from __future__ import annotations

import csv
import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from svv.core.json_values import list_in, object_in, parsed, text_in
from svv.errors import BadInput
from svv.io.files.atomic import is_file
from svv.io.files.keyed_results import digest
from svv.io.views.transforms import MOST_MISSING, leaves

TABLE, INFO = "data.csv", "info.json"
"""Files by which a database is recognised."""

ANGLES = ("phi", "theta")
"""Columns with the direction of a view, in degrees."""

IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".h5", ".hdf5")
"""Suffixes of images, lower case."""

LAYERS = ("file_depth", "file_region", "file_layer", "file_normal", "file_value")
"""Beginnings of the names of columns whose files are not pictures of the whole scene, lower case."""

OPACITY_FUNCTION = ("otf", "opacity_transfer_function")
"""Names of the column that counts the opacity functions of ParaView's Cinema-Volumetric extractor, lower case."""


MOST_ROWS = 1_000_000
"""Most images of a database."""

_NAMED = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True)
class Table:
    """Rows of a database: parameters as text, by column, and one picture each."""

    folder: Path
    columns: dict[str, list[str]]
    """Text by the name of the column; columns of files are not among them."""
    files: list[str]
    """The picture of each row, relative to the folder."""
    all_files: frozenset[str]
    """Every file that the table names, including layers."""
    ascent: bool = False
    """Whether phi and theta have the meaning of Ascent rather than ParaView's."""
    chosen: tuple[tuple[str, str], ...] = ()
    """Parameters for which one of several values was chosen."""

    def __len__(self) -> int:
        return len(self.files)

    def key(self) -> str:
        """Return a text that changes with the table and its images."""
        stats = [
            (name, stat.st_size, stat.st_mtime_ns)
            for name in self.files
            if name and is_file(self.folder / name)
            for stat in [(self.folder / name).stat()]
        ]
        return digest(self.columns, stats)

    def column(self, *names: str) -> list[str] | None:
        """Return the first column that has one of the names, in any case; None if there is none."""
        found = {name.lower(): values for name, values in self.columns.items()}
        return next((found[name] for name in names if name in found), None)

    def take(self, rows: Sequence[int]) -> Table:
        """Return the table with some of its rows."""
        columns = {name: [values[k] for k in rows] for name, values in self.columns.items()}
        return replace(self, columns=columns, files=[self.files[k] for k in rows])


def is_database(path: str | Path) -> bool:
    """Return whether a folder, or the ``data.csv`` or ``info.json`` in it, is a Cinema database."""
    path = Path(path)
    if path.is_file():
        return path.name == TABLE or (path.name == INFO and _pattern(path) is not None)
    return (path / TABLE).is_file() or _pattern(path / INFO) is not None


def read_table(path: str | Path) -> Table:
    """Read the table of a database; raises BadInput if the folder is none, or its table cannot be read."""
    folder = Path(path)
    folder = folder.parent if folder.is_file() else folder
    info = folder / INFO
    if (folder / TABLE).is_file():
        # Ascent writes both; only info.json tells its angles from ParaView's.
        return replace(_of_csv(folder), ascent=_pattern(info) is not None)
    if _pattern(info) is not None:
        return _of_info(folder)
    raise BadInput(f"{folder} is not a Cinema database: it has neither {TABLE} nor Ascent's {INFO}.")


def check_files(table: Table) -> tuple[Table, str | None]:
    """Return the rows whose images are there, and a sentence on the others; BadInput if most lack one, or a row."""
    there = [k for k, name in enumerate(table.files) if name and is_file(table.folder / name)]
    said, missing = None, [k for k in range(len(table)) if k not in set(there)]
    if missing:
        first = table.files[missing[0]] or f"that of row {missing[0] + 1}, which names no file"
        lacks = f"{_count(len(missing), 'row')} of {len(table)} {'has' if len(missing) == 1 else 'have'} no image"
        said = f"{lacks} and {'is' if len(missing) == 1 else 'are'} left out, the first is {first}."
        if len(missing) > MOST_MISSING * len(table):
            raise BadInput(
                f"{table.folder} is incomplete: {lacks}, the first is {first}; write the database again, or delete "
                "those rows."
            )
    named = {(table.folder / name).resolve() for name in table.all_files}
    suffixes = {path.suffix.lower() for path in named}
    extra = sorted(
        path
        for folder in {path.parent for path in named}
        if folder.is_dir()  # rows that were not selected may name what does not exist
        for path in folder.iterdir()
        if path.suffix.lower() in suffixes and path.suffix.lower() in IMAGES and path not in named
    )
    if extra:
        raise BadInput(
            f"{table.folder} has {_count(len(extra), 'image')} that no row of its table names, the first is "
            f"{extra[0].name}; the table may be cut off: write the database again, or delete the images."
        )
    return (table.take(there) if missing else table), said


def select(table: Table, wanted: dict[str, str]) -> tuple[Table, list[str]]:
    """Choose one value of every parameter but the angles: the ``wanted`` one, or the first of the table.

    Returns the rows that have the values, and a sentence for each choice that was made here. Raises BadInput if there
    is no such column or value.
    """
    notes, names = [], {name.lower(): name for name in table.columns}
    for name in wanted:
        if name.lower() not in names:
            known = ", ".join(n for n in table.columns if n.lower() not in ANGLES)
            raise BadInput(f"{table.folder} has no column '{name}' to select from, only {known or 'angles'}.")
    asked = {name.lower(): value for name, value in wanted.items()}
    order = sorted(names, key=lambda lower: lower not in asked)  # asked for first, so that the rest can follow
    for lower in order:
        if (lower in ANGLES and lower not in asked) or lower == "id" or lower.startswith(("cam", "file")):
            continue
        values = list(dict.fromkeys(table.columns[names[lower]]))
        if lower in asked:
            found = next((v for v in values if _same(v, asked[lower])), "")
            if not any(_same(v, asked[lower]) for v in values):
                raise BadInput(
                    f"{table.folder} has no {names[lower]} '{asked[lower]}'; it has {_listed(values)}: choose one."
                )
        else:
            found = values[0]
            if len(values) > 1:
                notes.append(
                    f"{names[lower]} is {found}, the first of {len(values)}; "
                    f"choose another with --select {names[lower]}=VALUE: {_listed(values)}."
                )
        if len(values) > 1:
            keep = [k for k, value in enumerate(table.columns[names[lower]]) if value == found]
            table = replace(table.take(keep), chosen=(*table.chosen, (names[lower], found)))
    return table, notes


def _of_csv(folder: Path) -> Table:
    path = folder / TABLE
    try:
        # "utf-8-sig" drops the mark that Windows programs put first; csv itself takes any line end.
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file, skipinitialspace=True) if any(cell.strip() for cell in row)]
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path} is not a table of comma-separated values ({error}).") from error
    if len(rows) < 2:
        raise BadInput(f"{path} has no rows: the program that wrote it was stopped, or wrote nothing.")
    header = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(header):
            raise BadInput(f"{path} has {len(row)} values in row {number}, but {len(header)} columns; write it again.")
    if len({name.lower() for name in header}) < len(header):
        raise BadInput(f"{path} has two columns of the same name; rename one.")
    cells = [[cell.strip() for cell in column] for column in zip(*rows[1:], strict=True)]
    files = {name: column for name, column in zip(header, cells) if name.lower().startswith("file")}
    pictures = [name for name in files if not name.lower().startswith(LAYERS)]
    shown = [n for n in pictures if (kind := _kind(files[n])) in IMAGES or (not kind and n.lower() == "file")]
    if not shown:
        raise BadInput(f"{path} has no column of images: Spec D calls it FILE or FILE_png.")
    _check_inside(path, (name for column in files.values() for name in column))
    # Like pycinema, which shows the last column of files.
    chosen = next((name for name in shown if name.lower() == "file"), shown[-1])
    return Table(
        folder,
        {name: column for name, column in zip(header, cells) if name not in files},
        files[chosen],
        frozenset(name for column in files.values() for name in column if name),
    )


def _kind(files: list[str]) -> str:
    return Path(next(filter(None, files), "")).suffix.lower()


def _pattern(path: Path) -> str | None:
    """Return the pattern of the file names in Ascent's ``info.json``; None if it is no such file."""
    try:
        content = parsed(path.read_bytes())
        pattern = content["name_pattern"]
        return pattern if isinstance(pattern, str) and "{phi}_{theta}_" in pattern else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _of_info(folder: Path) -> Table:
    path = folder / INFO
    content = object_in(parsed(path.read_bytes()), str(path))
    pattern = text_in(content["name_pattern"], f"{path}: name_pattern")
    arguments = object_in(content.get("arguments", {}), f"{path}: arguments")
    values: dict[str, list[str]] = {}
    for name, argument in arguments.items():
        own = object_in(argument, f"{path}: {name}").get("values")
        many = own if isinstance(own, list) else [own]  # Conduit writes one value as a plain one
        values[name] = [text_in(v, f"{path}: {name}") for v in list_in(many, len(many), f"{path}: {name}")]
    if math.prod(len(value) for value in values.values()) > MOST_ROWS:
        raise BadInput(f"{path} lists more than {MOST_ROWS} images; write the database again.")
    rows = list(itertools.product(*values.values()))
    if not rows or any("{" + name + "}" not in pattern for name in ANGLES):
        raise BadInput(f"{path} lists no views; write the database again.")
    columns = dict(zip(values, ([row[k] for row in rows] for k in range(len(values)))))
    unknown = set(_NAMED.findall(pattern)) - set(values)
    if unknown:
        raise BadInput(f"{path}: name_pattern names something that is not among its arguments ({min(unknown)}).")
    files = [_filled(pattern, dict(zip(values, row))) for row in rows]
    _check_inside(path, files)
    return Table(folder, columns, files, frozenset(files), ascent=True)


def _filled(pattern: str, values: Mapping[str, str]) -> str:
    """Replace names in braces by values. (``str.format`` would also look up attributes and pad to any width.)"""
    return _NAMED.sub(lambda found: values[found[1]], pattern)


def _check_inside(path: Path, files: Iterable[str]) -> None:
    """Raise BadInput if a file is not in the folder of the table."""
    outside = next((name for name in files if leaves(name) or "\0" in name or not _can_be_written(name)), None)
    if outside is not None:
        raise BadInput(f"{path} names the file {outside}, which is not in its folder: copy the database again.")


def _can_be_written(name: str) -> bool:
    try:
        return bool(name.encode()) or not name
    except UnicodeEncodeError:  # half a character, which JSON can hold
        return False


def _same(one: str, other: str) -> bool:
    try:
        return one == other or float(one) == float(other)
    except ValueError:
        return False


def _listed(values: Sequence[str]) -> str:
    return ", ".join(values[:8]) + (" ..." if len(values) > 8 else "")


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + "s" * (number != 1)
