"""The figures and texts of `svv bench chart`: the Pareto front, the axes, and the choice of runs to compare."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from svv_bench.chart import figures
from svv_bench.chart.table import Row, front

Numbers = list[tuple[float, float]]
POINTS = st.lists(st.tuples(st.integers(0, 6).map(float), st.integers(0, 6).map(float)), max_size=24)
"""Few different numbers, so that ties are common."""


# --- the Pareto front ----------------------------------------------------------------------------------------------


def beats(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Costs at most as much, gains at least as much, and one of both better."""
    return a[0] <= b[0] and a[1] >= b[1] and a != b


@given(POINTS)
def test_on_the_front_is_what_nothing_beats(points: Numbers) -> None:
    on = front([x for x, _ in points], [y for _, y in points])
    assert on == [not any(beats(other, point) for other in points) for point in points]


@given(POINTS, st.randoms())
def test_the_front_knows_no_order_and_is_its_own_front(points: Numbers, random: Any) -> None:
    def members(of: Numbers) -> Numbers:
        return sorted(p for p, on in zip(of, front([x for x, _ in of], [y for _, y in of])) if on)

    shuffled = list(points)
    random.shuffle(shuffled)
    assert members(shuffled) == members(points) == members(members(points))


def test_what_is_not_known_is_on_no_front() -> None:
    assert front([1.0, math.nan, 0.5], [3.0, 99.0, math.nan]) == [True, False, False]


# --- rows and figures ----------------------------------------------------------------------------------------------


def some_rows() -> list[Row]:
    """Runs of two scenes, one of them with volume rendering's time, on two devices."""
    base = Row("head", "draft", "lattice", "network", "network", 200, 200, 15.0, "cpu", "numba", 0, "pcn", 30.0,
               22.0, 0.9, 8, 14.0, 25.0, 0.2, 1.0, 9.0, 1.0, 0.0, 3.0, 0.1, 0.5, 0.4, 0.6, 0.9, 0.08, 0.07, 0.09, 0.15,
               6.2, "cpu", 2_000_000, 10, 10, 10, 0.3, 2, False, "a")  # fmt: skip
    slow = replace(base, preset="fast", encoding="hash", psnr=31.0, view_seconds=2.0, train_seconds=60.0, seed=1)
    alone = replace(base, scene="vortex", dvr_seconds=None, dvr_ratio=None, psnr_foreground=math.nan, time_limit=None)
    lights = [replace(base, lighting=lighting, psnr=29.0 - k) for k, lighting in enumerate(("phong", "auto"))]
    return [base, slow, alone, replace(base, train_size=400, device="cuda", preset="paper"), *lights]


@pytest.mark.parametrize(
    "draw",
    [
        lambda path, rows: figures.trade_off(path, rows, figures.VIEW),
        lambda path, rows: figures.trade_off(path, rows, figures.SIZE),
        figures.learning,
    ],
)
def test_charts_are_drawn_in_the_colours_of_their_encodings(draw: Callable[..., None], tmp_path: Path) -> None:
    rows = some_rows()
    draw(tmp_path / "chart.png", [*rows, *(replace(row, kernels="reference") for row in rows)])
    with Image.open(tmp_path / "chart.png") as image:
        shown = np.asarray(image.convert("RGB"))
    for colour in figures.COLOURS.values():
        assert (shown == [int(colour[k : k + 2], 16) for k in (1, 3, 5)]).all(axis=-1).any()
    draw(tmp_path / "one.png", some_rows()[:1])  # one point is a chart too


def test_labels_of_neighbours_do_not_overlap() -> None:
    figure = Figure((4.0, 3.0))
    canvas, axes = FigureCanvasAgg(figure), figure.subplots()
    axes.set(xlim=(0.0, 10.0), ylim=(20.0, 40.0))
    figures._ring(axes, [5.0, 4.6, 5.4], [30.2, 30.0, 38.0], [True, True, True], ["10 s", "40 s", "full"])
    renderer = canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in axes.texts]
    assert len(boxes) == 3
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def test_a_legend_is_as_narrow_as_its_figure() -> None:
    handles = [Line2D([], [], label="a word " * length) for length in (1, 8, 2, 6, 3, 7)]
    for columns, width in ((1, 3.0), (2, 10.0), (3, 24.0)):
        figure = Figure((width, 3.0))
        renderer = FigureCanvasAgg(figure).get_renderer()
        figures._add_legend(figure, renderer, handles, 3)
        (legend,) = figure.legends
        assert legend._ncols == columns  # type: ignore[attr-defined]
        assert columns == 1 or legend.get_window_extent(renderer).width <= figure.bbox.width


def test_numbers_along_the_axes_are_short() -> None:
    shown = {0.0071: "7.1 ms", 0.05: "50 ms", 0.2: "0.2 s", 1.5: "1.5 s", 60.0: "60 s", 300.0: "5 min", 9000.0: "2.5 h"}
    assert {value: figures.seconds(value) for value in shown} == shown
    assert figures.megabytes(2.2e6) == "2.2 MB"


def test_runs_that_reached_one_limit_cost_the_same() -> None:
    row = replace(some_rows()[0], time_limit=30.0)
    reached = [replace(row, train_seconds=seconds).training_cost for seconds in (28.5, 30.0, 31.4)]
    assert reached == [30.0] * 3
    assert replace(row, train_seconds=17.0).training_cost == 17.0  # the whole schedule took less
    assert replace(row, time_limit=None, train_seconds=90.0).training_cost == 90.0


def test_rows_are_compared_where_they_may_be() -> None:
    rows = some_rows()
    rows.append(replace(rows[0], render_size=800))
    groups = dict(figures.panels(rows))
    assert [len(members) for members in groups.values()] == [5, 1, 1]
    for members in groups.values():
        assert len({(row.scene, row.render_size) for row in members}) == 1
