"""Chart of time and memory over the size of the volume: ``python -m svv_bench.volume_size.chart FOLDER``.

It is a program of its own because ParaView's Python must not load matplotlib. It reads ``compare.json`` in the folder
and writes ``compare.pdf`` and ``compare.svg``, with text as text, and ``compare.png``, for a column of a paper.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from svv.ending import end_with
from svv.render.figures.files import write_figure
from svv.render.figures.lettering import OWN_FONT, Lettering
from svv_bench.volume_size.comparison import About, Row, how_measured, idle, measured_on

COLOURS = {"DVR": "#c81e1e", "bricks": "#1e8c3c", "PCN": "#1446be"}
NAMES = {"DVR": "VTK", "bricks": "bricks", "PCN": "PCN"}
MARKERS = "osD^v"
"""One for each size of image, in turn."""

WIDTH, PANEL, CAPTION_LINE = 84.0, 52.0, 2.6
"""Width of a paper's column, height of a panel, and of a line below the panels, mm."""

DPI, POINTS, SMALL = 300, 7.0, 6.0
"""Resolution of the PNG, and sizes of the text."""

ASIDE = {"DVR": 0.985, "bricks": 1.0, "PCN": 1.015}
"""Factor of the place of a side's marks along the axis of volumes, so that they do not hide each other."""

INK = "#333333"
"""Colour of the lines below the panels."""

LEAST_BYTES = 1e6
"""Smallest memory that the logarithmic axis shows."""

PANELS = (
    ("seconds for an image", "seconds_median", ("seconds_least", "seconds_most")),
    ("memory of its own, GB", "own_bytes", ("own_bytes", "own_bytes")),
)


def chart(rows: Sequence[Row], about: About) -> Figure:
    """Return the chart: lines through medians, bars from the smallest to the largest of the repeats."""
    said = " ".join((how_measured(about), idle(rows), measured_on(about)))
    lines = Lettering((OWN_FONT,), SMALL, INK).wrapped(said, 0.95 * WIDTH)
    below = CAPTION_LINE * len(lines) + 3.0
    height = 2 * PANEL + 4.0 + below
    figure = Figure(figsize=(WIDTH / 25.4, height / 25.4), dpi=DPI)
    figure.set_label("Seconds per image and memory of direct volume rendering and of the palette network, over the "
                     "size of the volume")  # fmt: skip
    images = sorted({row["image"] for row in rows})
    tall = (PANEL - 10.0) / height
    panels = [figure.add_axes((0.145, (below + 8.0 + k * PANEL) / height, 0.835, tall)) for k in (1, 0)]
    for axes, panel in zip(panels, PANELS, strict=True):
        _draw(axes, rows, images, *panel)
    handles = [Line2D([], [], color=COLOURS[side], label=NAMES[side]) for side in COLOURS if _of(rows, side)]
    handles += [
        Line2D([], [], color=_shade("#444444", k, len(images)), marker=_marker(k), ms=3.5, ls="", label=f"{n}²")
        for k, n in enumerate(images)
    ]  # fmt: skip
    figure.legend(handles=handles, loc="upper center", ncols=len(handles), frameon=False, fontsize=POINTS,
                  handlelength=1.2, columnspacing=1.0, handletextpad=0.4, borderaxespad=0.3)  # fmt: skip
    place = 0.02, (below - 2.0) / height
    figure.text(*place, "\n".join(lines), va="top", fontsize=SMALL, color=INK, linespacing=1.2, parse_math=False)
    return figure


def _draw(axes: Axes, rows: Sequence[Row], images: Sequence[int], title: str, key: str, ends: tuple[str, str]) -> None:
    scale = 1e9 if key == "own_bytes" else 1.0
    least = LEAST_BYTES / scale if key == "own_bytes" else 0.0
    for side, colour in COLOURS.items():
        for k, image in enumerate(images):
            mine = sorted((r for r in _of(rows, side) if r["image"] == image), key=lambda r: r["volume"])
            if not mine:
                continue
            middle, low, high = ([max(r[name] / scale, least) for r in mine] for name in (key, *ends))
            spread = [[m - a for m, a in zip(middle, low)], [b - m for m, b in zip(middle, high)]]
            axes.errorbar([r["volume"] * ASIDE[side] for r in mine], middle, yerr=spread, marker=_marker(k), ms=3.0,
                          lw=1.0, color=_shade(colour, k, len(images)), elinewidth=0.8, capsize=1.8)  # fmt: skip
    volumes = sorted({row["volume"] for row in rows})
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xlim(volumes[0] / 1.2, volumes[-1] * 1.2)
    axes.xaxis.set_major_locator(FixedLocator(volumes))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.margins(y=0.1)
    bottom, top = axes.get_ylim()
    if top < 20 * bottom:  # less than a decade: one label would not do
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("voxels along a side", labelpad=1.5)
    axes.set_ylabel(title, labelpad=2.0)


def _of(rows: Sequence[Row], side: str) -> list[Row]:
    return [row for row in rows if row["side"] == side]


def _marker(number: int) -> str:
    """Return the mark of an image's size."""
    return MARKERS[number % len(MARKERS)]


def _shade(colour: str, number: int, count: int) -> tuple[float, float, float]:
    """Return the colour of an image's size: the larger, the darker."""
    light = 0.5 * (count - 1 - number) / max(count - 1, 1)
    red, green, blue = (c + (1.0 - c) * light for c in to_rgb(colour))
    return red, green, blue


STYLE: Any = {
    "font.family": "DejaVu Sans", "font.size": POINTS, "axes.labelsize": POINTS, "xtick.labelsize": POINTS,
    "ytick.labelsize": POINTS, "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6,
    "axes.grid": True, "grid.color": "#e2e6ea", "grid.linewidth": 0.5, "axes.axisbelow": True, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "ytick.minor.width": 0.4, "xtick.major.pad": 2.0, "ytick.major.pad": 2.0,
}  # fmt: skip


def main() -> None:
    """Draw the chart of a folder."""
    folder = Path(sys.argv[1])
    content = json.loads((folder / "compare.json").read_text(encoding="utf-8"))
    with rc_context(STYLE):
        figure = chart(content["rows"], content["about"])
        for kind in ("pdf", "svg", "png"):
            write_figure(figure, folder / f"compare.{kind}")


if __name__ == "__main__":
    end_with(main, "svv")
