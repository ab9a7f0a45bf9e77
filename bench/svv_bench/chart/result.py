"""The results of a chart's runs as a page; see :mod:`svv.job.page`."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from pathlib import Path

from svv.errors import Progress, silent
from svv.job.page import Page, Picture, Table, write_page
from svv_bench.chart import figures
from svv_bench.chart.figures import megabytes, panels
from svv_bench.chart.job import Chart
from svv_bench.chart.table import Row, front, write_all
from svv_bench.results import Figure, cells, record

PROTOCOL = (
    "Views that were not trained on, truth and prediction over white, prediction clamped; PSNR, foreground PSNR (true "
    "alpha above 0) and SSIM are means over the views. Training seconds include all stages, but neither compiling nor "
    "reading. Seconds per view are the median over the views after a warm-up, followed by least and most; volume "
    "rendering (DVR) draws each view right before the network does, in the same process. Memory is the peak resident "
    "memory of a process that does nothing else."
)

COLUMNS = (
    "Scene", "Preset", "Encoding", "Light", "Limit", "Views", "Image", "Seed", "Training", "PSNR", "Foreground", "SSIM",
    "A view", "least to most", "x DVR", "Scene file", "Peak, training", "Peak, rendering", "Best in",
)  # fmt: skip


def make_chart(chart: Chart, progress: Progress = silent) -> Path:
    """Finish a chart, and write its table, figures and page.

    If it is stopped or fails halfway, the results up to then are written nevertheless.

    Returns:
        The page ``chart.html``.
    """
    try:
        chart.do(progress)
    finally:
        rows = chart.rows()
        if rows:
            write_result(chart, rows)
            record(measured(rows))
    return chart.out / "chart.html"


def measured(rows: Sequence[Row]) -> list[Figure]:
    """Return the figures of all runs, for the file of results."""
    columns = (
        ("training", "s", ".0f"), ("CPU", "s", ".0f"), ("PSNR", "dB", ".1f"), ("foreground", "dB", ".1f"),
        ("a view", "s", ".2f"), ("x DVR", "", ".1f"), ("file", "MB", ".1f"),
    )  # fmt: skip
    return cells(
        "accuracy/presets",
        [
            (
                f"{r.scene} | `{r.preset}`, {r.kind} | {r.limit}",
                (r.train_seconds, r.train_cpu_seconds, r.psnr, r.psnr_foreground, r.view_seconds, r.dvr_ratio,
                 r.scene_bytes / 1e6),
            )
            for r in rows
        ],
        columns,
    )  # fmt: skip


def write_result(chart: Chart, rows: Sequence[Row]) -> None:
    """Write ``runs.csv``, ``runs.json``, three PNG files and ``chart.html``."""
    write_all(chart.out, rows, PROTOCOL)
    figures.trade_off(chart.out / "accuracy-seconds.png", rows, figures.VIEW)
    figures.trade_off(chart.out / "accuracy-bytes.png", rows, figures.SIZE)
    figures.learning(chart.out / "accuracy-training.png", rows)
    write_chart_page(chart, rows)


def write_chart_page(chart: Chart, rows: Sequence[Row]) -> None:
    """Write ``chart.html``."""
    out, left = chart.out, sum(not chart.is_done(step) for step in chart.steps)
    text = "Every point is a separate training run, measured on views that it was not trained on."
    if left:
        text += f" Some runs are not finished: {left} steps are left."
    figures = [
        Picture("Accuracy against the time of a view", _ringed("as fast"), out / "accuracy-seconds.png", True),
        Picture("Accuracy against the size of the scene file", _ringed("as small"), out / "accuracy-bytes.png", True),
        Picture(
            "Accuracy against training time",
            "Each point is a run whose schedule was shortened to its time limit: the result for a user who sets that "
            "limit. It is not an intermediate state of one run, in which the learning rates would still be high.",
            out / "accuracy-training.png",
            True,
        ),
    ]
    page = Page("Speed and size against accuracy", text, numbers(rows), None, [*figures, table(rows)], facts(rows))
    write_page(out / "chart.html", page)


def _ringed(what: str) -> str:
    return (
        f"Ringed runs are on the Pareto front: no other run is {what} and at least as accurate, and better in one of "
        "the two. Lines are the fronts of single encodings; labels are time limits of training."
    )


def numbers(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Return the most accurate run of each scene, and the time of its views relative to volume rendering."""
    cards = []
    for title, members in panels(rows):
        best = max(members, key=lambda row: row.psnr)
        name = title.split(",")[0]
        cards.append((f"{best.psnr:.1f} dB", f"{name}: {best.preset}, {best.kind}, {best.limit}"))
        if best.dvr_ratio is not None:
            cards.append((f"{best.dvr_ratio:.1f} x", f"DVR's time for its views, {name}"))
    return cards


def table(rows: Sequence[Row]) -> Table:
    """Return the table of all rows, with dashes for unknown values."""
    best = {id(row): " ".join(fronts_of(row, members)) for _, members in panels(rows) for row in members}
    cells = [
        [
            row.scene, row.preset, row.kind, row.light, row.limit, f"{row.train_size} px",
            f"{row.render_size} px", str(row.seed), f"{row.train_seconds:.0f} s", f"{row.psnr:.2f}",
            f"{row.psnr_foreground:.2f}", f"{row.ssim:.4f}", f"{row.view_seconds:.2f} s",
            f"{row.view_seconds_least:.2f} to {row.view_seconds_most:.2f}",
            "-" if row.dvr_ratio is None else f"{row.dvr_ratio:.1f}", megabytes(row.scene_bytes),
            f"{row.train_peak_bytes / 1e9:.2f} GB", f"{row.render_peak_bytes / 1e9:.2f} GB", best[id(row)],
        ]
        for row in rows
    ]  # fmt: skip
    text = f"{PROTOCOL} Best in: costs for which the run is on the Pareto front of PSNR."
    return Table("All runs", text, COLUMNS, cells)


def fronts_of(row: Row, members: Sequence[Row]) -> list[str]:
    """Return the costs for which a row is on the Pareto front of the rows that it can be compared with."""
    costs = {
        "view": [m.view_seconds for m in members],
        "bytes": [float(m.scene_bytes) for m in members],
        "training": [m.training_cost for m in members],
    }
    at, gain = next(k for k, m in enumerate(members) if m is row), [m.psnr for m in members]
    return [name for name, cost in costs.items() if front(cost, gain)[at]]


def facts(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Return the circumstances of the runs."""
    loads = [row.load_average for row in rows]
    shares = [row.train_cpu_seconds / row.train_seconds for row in rows]
    found = [
        ("Runs", str(len({row.run for row in rows}))),
        ("Network", ", ".join(sorted({row.network for row in rows}))),
        ("Devices", ", ".join(sorted({row.device for row in rows}))),
        ("Machine", f"{platform.machine()}, {os.cpu_count()} CPUs, {rows[0].threads} threads"),
        ("Load average when runs began", f"{min(loads):.1f} to {max(loads):.1f}; above 0 if the machine was shared"),
        ("CPUs used", f"{min(shares):.2f} to {max(shares):.2f} on average while training"),
        ("Files", "runs.csv and runs.json contain every figure, runs/ the scene files"),
    ]
    if any(row.resumed for row in rows):
        names = ", ".join(sorted({row.run for row in rows if row.resumed}))
        found.append(("Stopped and resumed", names))
    mappers = sorted({row.dvr_mapper for row in rows if row.dvr_mapper})
    if mappers:
        found.append(("Volume rendering", f"VTK's ray caster: {', '.join(mappers)}; the GPU's draws each view twice"))
    return found
