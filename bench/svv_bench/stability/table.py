"""The summary of the runs of ``svv bench stability``: a table, a heat map, CSV and JSON."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from svv.io.files.atomic import atomic_path, write_json
from svv_bench.charts import need_matplotlib
from svv_bench.results import Figure, cells
from svv_bench.stability.cases import CASES, EASIEST
from svv_bench.stability.measures import (
    FOREGROUND_DROP,
    LEAST_OVERLAP,
    MOST_COLOUR,
    MOST_LOST,
    MOST_SPREAD,
    MOST_STYLE,
    failures,
    foreground_lost,
)
from svv_bench.stability.runs import Record

FILES = ("stability.csv", "stability.json", "stability.md", "stability.png")

RULES = (
    f"**blurred**: more than {FOREGROUND_DROP:g} dB of foreground PSNR lost, against the easy case's mean with the "
    "same preset, or, if that is less, against the volume's own DVR with 16 rays a pixel",
    "**N regions for M**: the palette's number of colours is not the transfer function's number of visible ranges",
    f"**wrong regions**: mean intersection over union of the region maps with the truth below {LEAST_OVERLAP:g}",
    f"**wrong colours**: mean CIEDE2000 of the palette to the transfer function's colours above {MOST_COLOUR:g}",
    f"**off its style**: CIEDE2000 between the mean colours of painted regions and of their style above {MOST_STYLE:g}",
    f"**lost in the file**: saving costs more than {MOST_LOST:g} dB of foreground PSNR",
    f"**unsteady**: standard deviation of the foreground PSNR over the seeds above {MOST_SPREAD:g} dB",
    "**not refused**, **not finite**, **out of gamut**, **crash**: as the words say",
)
"""Criteria of failure; all apply to single runs except the spread."""


@dataclass(frozen=True)
class Row:
    """Results of a case with a preset over all seeds; values that were not measured are None."""

    case: str
    preset: str
    runs: int
    foreground: float | None
    spread: float | None
    """Standard deviation of the foreground PSNR over the seeds, in dB."""
    lost: float | None
    """Mean loss of foreground PSNR (:func:`svv_bench.stability.measures.foreground_lost`), in dB."""
    overlap: float | None
    colour: float | None
    """CIEDE2000 of the palette to the transfer function's colours."""
    style: float | None
    """CIEDE2000 between painted regions and their style."""
    seconds: float
    failed: dict[str, int]
    """Failure -> number of runs in which it occurred."""

    @property
    def shown_colour(self) -> float | None:
        """``style`` if regions were painted, otherwise ``colour``."""
        return self.colour if self.style is None else self.style

    @property
    def failed_runs(self) -> int:
        """Number of runs with the most frequent failure."""
        return max(self.failed.values(), default=0)


def summary(records: Sequence[Record]) -> list[Row]:
    """Return one row per case and preset, with cases in the order of the list."""
    presets = list(dict.fromkeys(r["preset"] for r in records))
    groups = {
        (case, name): [r for r in records if (r["case"], r["preset"]) == (case, name)]
        for case in CASES
        for name in presets
    }
    easy = {name: _mean(groups[EASIEST, name], "psnr_foreground") for name in presets}
    return [_row(case, name, runs, easy[name]) for (case, name), runs in groups.items() if runs]


def _row(case: str, name: str, runs: Sequence[Record], easy: float | None) -> Row:
    values = _values(runs, "psnr_foreground")
    foreground = float(np.mean(values)) if values else None
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    lost = [v for v in (foreground_lost(r["measures"], easy) for r in runs) if v is not None]
    failed = Counter(word for r in runs for word in failures(r["measures"], easy))
    if spread is not None and spread > MOST_SPREAD:
        failed["unsteady"] = len(runs)
    return Row(
        case, name, len(runs), foreground, spread,
        float(np.mean(lost)) if lost else None,
        _mean(runs, "overlap"), _mean(runs, "colour_error"), _mean(runs, "style_error"),
        float(np.mean([r["seconds"] for r in runs])), dict(failed),
    )  # fmt: skip


def _values(runs: Sequence[Record], key: str) -> list[float]:
    return [float(v) for v in (r["measures"].get(key) for r in runs) if v is not None]


def _mean(runs: Sequence[Record], key: str) -> float | None:
    values = _values(runs, key)
    return float(np.mean(values)) if values else None


def figures(rows: Sequence[Row]) -> list[Figure]:
    """Return the table's figures, for the file of results: a table for each preset."""
    columns = (("seeds", "", "d"), ("foreground", "dB", ".1f"), ("lost", "dB", ".1f"), ("regions", "", ".2f"))
    found: list[Figure] = []
    for row in rows:
        failed = ", ".join(f"{word} ({count}/{row.runs})" for word, count in row.failed.items()) or "none"
        foreground = row.foreground if row.spread is None else f"{row.foreground:.1f} ± {row.spread:.1f}"
        values = (row.runs, foreground, row.lost, row.overlap, row.shown_colour, failed)
        more = (("colours", "", ".1f"), ("failures", "", ""))
        found += cells(f"stability/{row.preset}", [(CASES[row.case].title, values)], (*columns, *more))
    return found


def write_summary(out: Path, records: Sequence[Record]) -> list[Row]:
    """Write ``FILES`` into an existing folder.

    Raises:
        BadInput: A file cannot be written, or matplotlib is missing.
    """
    rows = summary(records)
    text = _csv(records)
    with atomic_path(out / "stability.csv") as temporary:
        temporary.write_text(text, encoding="utf-8")
    write_json(out / "stability.json", {"runs": list(records), "summary": [vars(row) for row in rows]})
    with atomic_path(out / "stability.md") as temporary:
        temporary.write_text(markdown(rows), encoding="utf-8")
    heat_map(out / "stability.png", rows)
    return rows


def _csv(records: Sequence[Record]) -> str:
    easy = {r.preset: r.foreground for r in summary(records) if r.case == EASIEST}
    flat = [
        {
            **{key: r[key] for key in ("case", "preset", "seed", "seconds", "peak_rss_bytes")},
            **r["settings"],
            **{f"{stage}.{key}": value for stage, values in r["changed"].items() for key, value in values.items()},
            **r["measures"],
            "failures": "; ".join(failures(r["measures"], easy.get(r["preset"]))),
        }
        for r in records
    ]
    text = io.StringIO()
    names = list(dict.fromkeys(key for record in flat for key in record))
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return text.getvalue()


def markdown(rows: Sequence[Row]) -> str:
    """Format the table and the rules as Markdown."""
    presets = list(dict.fromkeys(row.preset for row in rows))
    found = {(row.case, row.preset): row for row in rows}
    heads = ("seeds", "foreground, dB", "lost, dB", "regions", "colours", "failures")
    lines = [
        "| case | " + " | ".join(f"{name}: {head}" for name in presets for head in heads) + " |",
        "|---" * (1 + len(presets) * len(heads)) + "|",
    ]
    for case in dict.fromkeys(row.case for row in rows):
        cells = [text for name in presets for text in _cells(found.get((case, name)))]
        lines.append(f"| {CASES[case].title} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", *(f"- {rule}" for rule in RULES), ""])


def _cells(row: Row | None) -> list[str]:
    if row is None:
        return [""] * 6
    spread = "" if row.spread is None else f" ± {row.spread:.1f}"
    return [
        str(row.runs),
        "-" if row.foreground is None else f"{row.foreground:.1f}{spread}",
        "-" if row.lost is None else f"{row.lost:.1f}",
        "-" if row.overlap is None else f"{row.overlap:.2f}",
        "-" if row.shown_colour is None else f"{row.shown_colour:.1f}",
        ", ".join(f"{word} ({count}/{row.runs})" for word, count in row.failed.items()) or "none",
    ]


Column = tuple[str, Callable[[Row], float | None], Callable[[Row], float | None], str]

COLUMNS: tuple[Column, ...] = (
    ("foreground\nPSNR, dB", lambda row: row.foreground, lambda row: _part(row.lost, FOREGROUND_DROP), "{:.1f}"),
    ("spread\ndB", lambda row: row.spread, lambda row: _part(row.spread, MOST_SPREAD), "{:.1f}"),
    ("regions\nIoU", lambda row: row.overlap,
     lambda row: None if row.overlap is None else (1 - row.overlap) / (1 - LEAST_OVERLAP), "{:.2f}"),
    ("colours\nCIEDE2000", lambda row: row.shown_colour,
     lambda row: _part(row.shown_colour, MOST_COLOUR if row.style is None else MOST_STYLE), "{:.1f}"),
    ("failed\nruns", lambda row: row.failed_runs / row.runs, lambda row: row.failed_runs / row.runs, "{:.0%}"),
)  # fmt: skip
"""Heading, number shown, the number relative to its limit of failure (1 and above: the darkest colour), and format."""


def _part(value: float | None, worst: float) -> float | None:
    return None if value is None else value / worst


def heat_map(path: Path, rows: Sequence[Row]) -> None:
    """Draw a heat map: one row per case, one column per preset and measure. The darkest cells are failures.

    Raises:
        BadInput: matplotlib is missing, or the file cannot be written.
    """
    need_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    presets = list(dict.fromkeys(row.preset for row in rows))
    cases = list(dict.fromkeys(row.case for row in rows))
    found = {(row.case, row.preset): row for row in rows}
    columns = [(name, column) for name in presets for column in COLUMNS]
    cells = np.full((len(cases), len(columns)), np.nan)
    figure = Figure(figsize=(3.2 + 0.85 * len(columns), 1.4 + 0.32 * len(cases)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for y, case in enumerate(cases):
        for x, (name, (_, number_of, badness_of, form)) in enumerate(columns):
            row = found.get((case, name))
            number = None if row is None else number_of(row)
            if row is None or number is None:
                continue
            badness = badness_of(row)
            if badness is not None:
                cells[y, x] = np.clip(badness, 0.0, 1.0)
            ink = "white" if cells[y, x] > 0.7 else "black"
            axes.text(x, y, form.format(number), ha="center", va="center", color=ink, fontsize=8)
    axes.imshow(np.ma.masked_invalid(cells), cmap="YlOrRd", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_facecolor("0.93")
    axes.set_xticks(range(len(columns)), [heading for _, (heading, *_) in columns], fontsize=7)
    axes.set_yticks(range(len(cases)), [CASES[case].title for case in cases], fontsize=8)
    axes.tick_params(length=0, top=True, bottom=False, labeltop=True, labelbottom=False)
    for k, name in enumerate(presets):
        axes.text((k + 0.5) * len(COLUMNS) - 0.5, len(cases) - 0.2, f"preset {name}", ha="center", va="top",
                  fontsize=10, fontweight="bold")  # fmt: skip
        if k:
            axes.axvline(k * len(COLUMNS) - 0.5, color="black", linewidth=2)
    with atomic_path(path) as temporary:
        figure.savefig(temporary)
