"""The charts: accuracy against seconds per view, against bytes, and against training time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from svv.io.files.atomic import atomic_path
from svv_bench.chart.table import Row, front

COLOURS = {
    "lattice": "#0f5c8c",
    "hash": "#c2571a",
    "lattice, phong": "#2f7d3b",
    "lattice, auto": "#7a4a9e",
    "lattice, reference kernels": "#7ab6dc",
    "hash, reference kernels": "#eaa77f",
    "lattice, phong, reference kernels": "#93c99b",
    "lattice, auto, reference kernels": "#c3a5dc",
}
MARKERS = {"draft": "o", "fast": "s", "balanced": "D", "best": "*", "paper": "^"}
DASHES: dict[str, Any] = {
    "draft": (0, (1, 1.2)),
    "fast": "-",
    "balanced": (0, (5, 1.5)),
    "best": (0, (8, 2)),
    "paper": (0, (5, 1.5, 1, 1.5)),
}
PLACES = ((-9, 3), "right"), ((9, -9), "left")
"""Offsets of labels from their markers, in points, and alignments; used in turn to keep neighbours apart."""
DVR = "#555555"
DPI = 160
PANEL = 4.0, 3.1
"""Width and height of a panel, inches."""

STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#777777",
    "axes.grid": True,
    "grid.color": "#e6e9ed",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}

METRICS = {"psnr": "PSNR (dB)", "psnr_foreground": "foreground PSNR (dB)"}


@dataclass(frozen=True)
class Axis:
    """A quantity on the x-axis."""

    label: str
    value: Callable[[Row], float]
    text: Callable[[float], str]
    """Text of a tick from its value."""


def seconds(value: float) -> str:
    """Format a time: 50 ms, 0.25 s, 30 s, 5 min, 2 h."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if value >= 2 * length:
            return f"{value / length:.3g} {unit}"
    if value < 0.0995:
        return f"{value * 1e3:.2g} ms"
    return f"{value:.2g} s" if value < 9.95 else f"{value:.3g} s"


def megabytes(value: float) -> str:
    """Format a size in bytes: 12 MB."""
    return f"{value / 1e6:.3g} MB"


VIEW = Axis("time of a rendered view", lambda row: row.view_seconds, seconds)
SIZE = Axis("scene file", lambda row: float(row.scene_bytes), megabytes)
TRAINING = Axis("training time (all stages, as measured)", lambda row: row.train_seconds, seconds)


def panels(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Group rows that can be compared, with a title: one scene at one rendered size."""

    def key(row: Row) -> tuple[str, int]:
        return row.scene, row.render_size

    order = {name: number for number, name in enumerate(dict.fromkeys(row.scene for row in rows))}
    for (scene, size), group in groupby(sorted(rows, key=lambda row: (order[row.scene], row.render_size)), key):
        members = list(group)
        yield f"{scene}, {members[0].test_views} unseen views, {size} px", members


def trade_off(path: Path, rows: Sequence[Row], axis: Axis) -> None:
    """Draw accuracy against a cost: a marker per run, a line per encoding's Pareto front, rings on the overall front.

    If the volume is available and the cost is the time of a view, a vertical line marks the time of volume rendering.
    """

    def draw(axes: Axes, members: list[Row], metric: str) -> None:
        x, y = [axis.value(row) for row in members], [getattr(row, metric) for row in members]
        for encoding in dict.fromkeys(row.kind for row in members):
            of = [k for k, row in enumerate(members) if row.kind == encoding]
            best = [k for k, on in zip(of, front([x[k] for k in of], [y[k] for k in of])) if on]
            best.sort(key=lambda k: x[k])
            axes.plot([x[k] for k in best], [y[k] for k in best], color=COLOURS[encoding], linewidth=1.4, zorder=2)
        _markers(axes, members, x, y)
        _ring(axes, x, y, front(x, y), _labels(members))
        if axis is VIEW:
            _volume_rendering(axes, members)

    _write(path, rows, axis, draw, _legend(rows, "Pareto front of the encoding", volume=axis is VIEW))


def learning(path: Path, rows: Sequence[Row]) -> None:
    """Draw accuracy against training time: one curve per preset, encoding and size, through its time limits.

    Every point is a separate training run, shortened to its limit: the result for a user who sets that limit.
    """

    def draw(axes: Axes, members: list[Row], metric: str) -> None:
        x, y = [TRAINING.value(row) for row in members], [getattr(row, metric) for row in members]
        curves: dict[tuple[Any, ...], dict[float, list[int]]] = {}
        for k, row in enumerate(members):
            curve = curves.setdefault((row.kind, row.preset, row.train_size, row.device), {})
            curve.setdefault(row.time_limit or math.inf, []).append(k)
        for (encoding, preset, *_), limits in curves.items():
            points = [limits[limit] for limit in sorted(limits)]  # each: the seeds of one limit
            axes.plot(
                [sum(x[k] for k in seeds) / len(seeds) for seeds in points],
                [sum(y[k] for k in seeds) / len(seeds) for seeds in points],
                color=COLOURS[encoding], linestyle=DASHES[preset], linewidth=1.4, zorder=2,
            )  # fmt: skip
        _markers(axes, members, x, y)
        _ring(axes, x, y, front([row.training_cost for row in members], y), None)

    _write(path, rows, TRAINING, draw, _legend(rows, "one preset, other time limits", dashes=True))


def _markers(axes: Axes, members: list[Row], x: list[float], y: list[float]) -> None:
    for k, row in enumerate(members):
        colour = COLOURS[row.kind]
        axes.plot(
            x[k], y[k], marker=MARKERS[row.preset], markersize=5.5, linestyle="none", color=colour, zorder=3,
            markerfacecolor=colour if row.device == "cpu" else "white",
        )  # fmt: skip


def _ring(axes: Axes, x: list[float], y: list[float], best: list[bool], labels: list[str] | None) -> None:
    for number, k in enumerate(sorted((k for k, on in enumerate(best) if on), key=lambda k: x[k])):
        axes.plot(x[k], y[k], marker="o", markersize=11, color="black", markerfacecolor="none", zorder=4)
        if labels:
            # A front rises to the right, so there is room above left and below right of its points.
            place, side = PLACES[number % 2]
            axes.annotate(labels[k], (x[k], y[k]), place, textcoords="offset points", ha=side, fontsize=7.5)


def _labels(members: list[Row]) -> list[str]:
    """Return the time limit of each row and other differences, except preset and encoding, shown by its marker."""
    sizes, seeds = len({row.train_size for row in members}) > 1, len({row.seed for row in members}) > 1
    return [", ".join([f"{row.train_size} px"] * sizes + [row.limit] + [f"seed {row.seed}"] * seeds) for row in members]


def _volume_rendering(axes: Axes, members: list[Row]) -> None:
    times = sorted(row.dvr_seconds for row in members if row.dvr_seconds is not None)
    if times:
        middle = times[len(times) // 2]
        axes.axvspan(times[0], times[-1], color=DVR, alpha=0.13, linewidth=0, zorder=1)
        axes.axvline(middle, color=DVR, linewidth=1.4, linestyle=(0, (4, 2)), zorder=1)
        place = axes.get_xaxis_transform()
        axes.text(middle, 0.02, f" DVR {seconds(middle)}", color=DVR, transform=place, fontsize=8)


def _write(
    path: Path,
    rows: Sequence[Row],
    axis: Axis,
    draw: Callable[[Axes, list[Row], str], None],
    legend: list[Line2D],
) -> None:
    shown = list(panels(rows))
    with rc_context(STYLE):
        figure = Figure((PANEL[0] * len(shown), PANEL[1] * len(METRICS) + 0.8), dpi=DPI, layout="constrained")
        grid = figure.subplots(len(METRICS), len(shown), squeeze=False)
        for column, (title, members) in enumerate(shown):
            for line, (metric, name) in enumerate(METRICS.items()):
                axes = grid[line][column]
                axes.set_xscale("log")
                axes.margins(x=0.2, y=0.14)
                draw(axes, members, metric)
                axes.set_ylabel(name)
                _ticks(axes, axis)
                axes.yaxis.set_major_locator(MaxNLocator(6))
                if line == 0:
                    axes.set_title(title)
                else:
                    axes.set_xlabel(axis.label)
        canvas = FigureCanvasAgg(figure)
        _add_legend(figure, canvas.get_renderer(), legend, 2 if len(shown) == 1 else 4)
        with atomic_path(path) as temporary:
            canvas.print_png(str(temporary))


def _add_legend(figure: Figure, renderer: Any, handles: list[Line2D], columns: int) -> None:
    """Add a legend with that many columns, or as many as fit the figure's width."""
    while True:
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=columns)
        if columns == 1 or legend.get_window_extent(renderer).width <= figure.bbox.width:
            return
        legend.remove()
        columns -= 1


def _ticks(axes: Axes, axis: Axis) -> None:
    """Place numbers along a logarithmic axis, more of them if it is short."""
    low, high = axes.get_xlim()
    choices = ((6.0, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)), (80.0, (1.0, 2.0, 5.0)), (math.inf, (1.0,)))
    axes.xaxis.set_major_locator(LogLocator(subs=next(subs for most, subs in choices if high / low < most)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: axis.text(value)))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _legend(rows: Sequence[Row], line: str, volume: bool = False, dashes: bool = False) -> list[Line2D]:
    handles = []
    for encoding in dict.fromkeys(row.kind for row in rows):
        handles.append(Line2D([], [], color=COLOURS[encoding], linewidth=2.4, label=encoding))
    for preset in dict.fromkeys(row.preset for row in rows):
        style: Any = DASHES[preset] if dashes else "none"
        handles.append(Line2D([], [], color="#333333", marker=MARKERS[preset], linestyle=style, label=preset))
    handles.append(Line2D([], [], color="#333333", linewidth=1.4, label=f"line: {line}"))
    handles.append(
        Line2D([], [], color="black", marker="o", markersize=10, markerfacecolor="none", linestyle="none",
               label="Pareto front of all")
    )  # fmt: skip
    if any(row.device != "cpu" for row in rows):
        handles.append(
            Line2D([], [], color="#333333", marker="s", markerfacecolor="white", linestyle="none",
                   label="hollow: not on the CPU")
        )  # fmt: skip
    if volume and any(row.dvr_seconds is not None for row in rows):
        handles.append(Line2D([], [], color=DVR, linestyle=(0, (4, 2)), label="volume rendering (DVR), same views"))
    return handles
