"""Results of comparisons of styles: a table as Markdown, CSV and JSON, and contact sheets."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.io.files.atomic import atomic_path, write_json
from svv.io.pictures.output import to_bytes, write_png
from svv.render.pictures import cropped, error_picture, fitted, over_white, read_png, sheet
from svv_bench.results import Figure
from svv_bench.styles.paper import PAPER
from svv_bench.styles.path import OrbitPath, Protocol

Row = dict[str, Any]

SHOWN = ("flip", "rmse", "flip_part", "rmse_part")
"""Figures of consistency that the table shows."""

JUDGED = ("neighbours", "adain", "lines", "patches 1/1", "patches 1/2", "colour", "contrast", "changed")
"""Figures of similarity to the style that the table shows; the CSV file has all."""


def consistency_columns(protocol: Protocol) -> list[str]:
    """Return the names of the consistency figures that the table shows, in order."""
    return [f"{flow} {n} {name}" for flow in protocol.flows for n in protocol.intervals for name in SHOWN]


def both_protocols(rows: Sequence[Row], protocol: Protocol) -> str:
    """Format MSE and LPIPS of each mode by svv's protocol and, for estimated flows, by the paper's beside it."""
    columns = {
        f"{flow} {n} {name}": f"{'' if name in PAPER else 'svv '}{name}, {flow} {n}"
        for flow in protocol.flows
        for name in ("mse", "lpips", *(PAPER if flow != "depth" else ()))
        for n in protocol.intervals
    }
    shown = [{"mode": row["mode"], **{title: row.get(name) for name, title in columns.items()}} for row in rows]
    return markdown(shown, "mode", list(columns.values()))


def averaged(rows: Sequence[Row], by: str) -> list[Row]:
    """Return a row for each value of ``by`` with the means of all numbers."""
    result = []
    for value in dict.fromkeys(r[by] for r in rows):
        own = [r for r in rows if r[by] == value]
        names = [k for k in dict.fromkeys(key for r in own for key in r) if k != by]
        numbers = {k: [r[k] for r in own if isinstance(r.get(k), int | float)] for k in names}
        result.append({by: value, **{k: float(np.mean(v)) for k, v in numbers.items() if v}})
    return result


def markdown(rows: Sequence[Row], first: str, columns: Sequence[str]) -> str:
    """Format a table with a line per row; values that were not measured are dashes."""
    lines = [f"| {first} | " + " | ".join(columns) + " |", "|---" * (1 + len(columns)) + "|"]
    for row in rows:
        lines.append(f"| {row[first]} | " + " | ".join(_text(row.get(name)) for name in columns) + " |")
    return "\n".join(lines)


def figures(table: str, rows: Sequence[Row], first: str, columns: Sequence[str]) -> list[Figure]:
    """Return the figures of the same table, for the file of results; what was not measured is left out."""
    return [
        Figure(table, str(row[first]), name, _text(row[name]))
        for row in rows
        for name in columns
        if row.get(name) is not None
    ]


def victories(rows: Sequence[Row], winner: str, rivals: Sequence[str], columns: Sequence[str]) -> str:
    """Count in how many cases a mode's figure is below a rival's, as a Markdown table."""
    cases = {(r["scene"], r["style"]): {} for r in rows}  # type: dict[tuple[str, str], dict[str, Row]]
    for r in rows:
        cases[r["scene"], r["style"]][r["mode"]] = r
    lines = [f"| cases in which {winner} is below | " + " | ".join(columns) + " |", "|---" * (1 + len(columns)) + "|"]
    for rival in rivals:
        both = [c for c in cases.values() if winner in c and rival in c]
        if not both:
            continue
        counts = []
        for name in columns:
            known = [c for c in both if c[winner].get(name) is not None and c[rival].get(name) is not None]
            counts.append(f"{sum(c[winner][name] < c[rival][name] for c in known)}/{len(known)}")
        lines.append(f"| {rival} | " + " | ".join(counts) + " |")
    return "\n".join(lines)


def write_tables(out: Path, name: str, rows: Sequence[Row], text: str) -> list[Path]:
    """Write ``NAME.md`` with a text, ``NAME.csv`` and ``NAME.json`` with all rows; return the files."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(dict.fromkeys(key for r in rows for key in r)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    files = [out / f"{name}.{suffix}" for suffix in ("md", "csv", "json")]
    for file, content in zip(files, (text, stream.getvalue())):
        with atomic_path(file) as temporary:
            temporary.write_text(content, encoding="utf-8")
    write_json(files[2], list(rows))
    return files


def contact_sheet(
    file: Path, path: OrbitPath, folders: dict[str, Path], style: NDArray[np.floating] | None,
    captions: Mapping[str, str] | None = None,
) -> None:  # fmt: skip
    """Draw frames of several modes side by side.

    Two rows show the frames of the pair with the largest interval in the middle of the path. The third shows where they
    differ after warping, from white (not at all, or not compared) to dark red.

    Args:
        file: A PNG file.
        path: The orbit, for the warp by depth.
        folders: Folder of each mode's frames, by its label.
        style: The style picture, shown in a separate column; None leaves it out.
        captions: A line of figures by label, where available.
    """
    interval = max(path.protocol.intervals)
    pairs = [(a, b) for n, a, b in path.protocol.pairs if n == interval]
    first, second = min(pairs, key=lambda pair: abs(sum(pair) - path.protocol.orbit + 1))
    warp = path.warp("depth", first, second)
    columns = []
    for folder in folders.values():
        frames = [read_png(folder / f"{frame:04d}.png") for frame in (first, second)]
        one, two = (frame[..., :3] for frame in frames)
        moved = to_bytes(np.where(warp.mask[..., None], warp.moved(one), two / 255.0))
        columns.append((*map(over_white, frames), error_picture(two, moved, 2.0)))
    rows = cropped([list(row) for row in zip(*columns)])
    labels = list(folders)
    if style is not None:
        rows = [[_inside(style if k == 0 else None, row[0]), *row] for k, row in enumerate(rows)]
        labels = ["style", *labels]
    lines = None if captions is None else [captions.get(label, "") for label in labels]
    write_png(file, sheet(rows, labels, captions=lines))


def _inside(style: NDArray[np.floating] | None, like: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a white picture as large as another, with the style picture fitted into it if there is one."""
    canvas = np.full_like(like, 255)
    if style is not None:
        side = min(like.shape[:2])
        canvas[:side, :side] = fitted(np.asarray(style, np.float32), side)
    return canvas


def _text(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        if 0 < abs(value) < 0.01:  # mean squares
            return f"{value:.2g}"
        return f"{value:.1f}" if abs(value) >= 10 else f"{value:.4f}"
    return str(value)
