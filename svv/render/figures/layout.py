"""Where the parts of a figure stand. Lengths are in mm, from the upper left corner of the figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from svv.errors import BadInput
from svv.options.figures import FigureOptions
from svv.render.figures.lettering import Lettering
from svv.render.figures.swatches import Entry

EDGE, GAP = 1.0, 2.5
"""Room at the edge of the figure, and between its parts."""

SWATCH = 0.85
"""Diameter of a swatch, as a fraction of two lines."""

BESIDE = 1.3
"""Room between a swatch and its text, and between lines of the legend."""

WIDEST_LEGEND = 0.34
"""Largest part of the figure's width that a legend on the right takes."""

LEAST_PANEL, MOST_HEIGHT = 12.0, 400.0
"""Least width of a panel, and most height of a figure."""


@dataclass(frozen=True)
class Box:
    """A rectangle."""

    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True)
class Line:
    """A line of a legend in its place: a swatch, and lines of text beside it; or a remark, without a swatch."""

    entry: Entry | None
    box: Box
    name: list[str]
    values: list[str]


@dataclass(frozen=True)
class Layout:
    """A figure's size, and the places of its panels and of the lines of its legends."""

    width: float
    height: float
    panels: list[Box]
    legend: list[Line]


def swatch_diameter(lettering: Lettering) -> float:
    """Return the diameter of a swatch."""
    return SWATCH * 2.0 * lettering.line


def least_width(lettering: Lettering) -> float:
    """Return the least width of a legend: a swatch and a short word."""
    return swatch_diameter(lettering) + BESIDE + 4 * lettering.line


def laid_out(
    options: FigureOptions,
    lettering: Lettering,
    aspect: float,
    legends: Sequence[Sequence[Entry]],
    head: bool,
    count: int,
    remarks: Sequence[str] = (),
) -> Layout:
    """Lay out a figure of ``count`` panels of one aspect, height over width.

    There is one legend for all panels, or one for each, empty for none, with a remark below it, '' for none; with
    ``head``, there is a line of text above each panel. Raises BadInput if the legend does not fit, or the figure is too
    small for its panels or too high.
    """
    across = columns_for(count, options.across)
    single = len(legends) == 1 and len(legends[0]) > 0
    where, most = options.legend, WIDEST_LEGEND * options.mm
    remarks = remarks or [""] * len(legends)
    beside_fits = where == "right" or (where == "auto" and most >= least_width(lettering))
    right = Legend(lettering, legends[0], most, remark=remarks[0]) if single and beside_fits else None
    beside = 0.0 if right is None else right.width + GAP
    panel = (options.mm - 2 * EDGE - beside - (across - 1) * GAP) / across
    down = -(-count // across)
    if where == "auto":
        fits = right is not None and panel >= LEAST_PANEL and right.height <= max(down * panel * aspect, 20.0)
        where = "right" if fits else "below"
    if where != "right" or right is None:
        panel, beside = (options.mm - 2 * EDGE - (across - 1) * GAP) / across, 0.0
    if panel < LEAST_PANEL:
        text = " beside the legend" if beside else ""
        raise BadInput(
            f"A figure {options.mm:g} mm wide leaves {max(panel, 0.0):.1f} mm for each of {across} panels{text}, less "
            f"than {LEAST_PANEL:g}: make it wider, put fewer across, or the legend below."
        )
    top, height = (lettering.line + 0.8 if head else 0.0), panel * aspect
    several = zip(legends, remarks, strict=True) if len(legends) > 1 else ()
    below = [Legend(lettering, entries, panel, True, remark) for entries, remark in several]
    rows = [max((own.height for own in below[r * across : (r + 1) * across]), default=0.0) for r in range(down)]
    boxes, y = [], EDGE
    for number in range(count):
        row, column = divmod(number, across)
        if column == 0 and row:
            y += top + height + GAP + (rows[row - 1] + GAP if rows[row - 1] else 0.0)
        boxes.append(Box(EDGE + column * (panel + GAP), y + top, panel, height))
    y = boxes[-1].top + height
    lines: list[Line] = []
    if below:
        for box, own in zip(boxes, below, strict=True):
            lines += own.lines(box.left, box.top + height + GAP)
        y += rows[-1] + GAP if rows[-1] else 0.0
    elif right is not None and where == "right":
        free = max(0.0, y - EDGE - right.height)
        lines = right.lines(options.mm - EDGE - right.width, EDGE + 0.5 * free)
        y = max(y, EDGE + right.height)
    elif single and where == "below":
        own = Legend(lettering, legends[0], options.mm - 2 * EDGE, True, remarks[0])
        lines = own.lines(EDGE, y + GAP)
        y += GAP + own.height
    if y + EDGE > MOST_HEIGHT:
        raise BadInput(
            f"The figure would be {y + EDGE:.0f} mm high, more than {MOST_HEIGHT:g}: put more panels across, make it "
            "narrower, or leave the legend out."
        )
    return Layout(options.mm, y + EDGE, boxes, lines)


def columns_for(count: int, across: int | None) -> int:
    """Return how many panels stand beside each other.

    >>> [columns_for(n, None) for n in (1, 3, 4, 5, 7)]
    [1, 3, 2, 3, 3]
    """
    if across is not None:
        return min(across, count)
    return count if count <= 3 else next(n for n in range(2, count + 1) if n * n >= count)


class Legend:
    """Lines of a legend, below each other or, with ``flow``, in equal columns that fill a width, and a remark below."""

    def __init__(
        self, lettering: Lettering, entries: Sequence[Entry], most: float, flow: bool = False, remark: str = ""
    ) -> None:
        """Measure the lines; raises BadInput if ``most`` mm are too few for a swatch and a word."""
        self.diameter = swatch_diameter(lettering)
        self.line = lettering.line
        room = most - self.diameter - BESIDE
        if entries and most < least_width(lettering):
            raise BadInput(
                f"The legend needs more than the {most:.0f} mm that the figure leaves for it: make the figure wider, "
                "the text smaller, or leave the legend out."
            )
        self.entries = [(e, lettering.wrapped(e.name, room), lettering.wrapped(e.values, room)) for e in entries]
        words = [line for _, name, values in self.entries for line in (*name, *values)]
        self.column = self.diameter + BESIDE + max((lettering.width(word) for word in words), default=0.0)
        fit = max(1, int((most + GAP) // (self.column + GAP))) if flow else 1
        rows = -(-len(self.entries) // fit)
        self.across = -(-len(self.entries) // rows) if rows else 1  # as few columns as those rows need
        self.width = self.across * (self.column + GAP) - GAP
        heights = [max(self.diameter, (len(name) + len(values)) * self.line) for _, name, values in self.entries]
        self.rows = [max(heights[n : n + self.across]) for n in range(0, len(heights), self.across)]
        self.remark = lettering.wrapped(remark, most if flow else self.width)
        self.rows += [len(self.remark) * self.line] if self.remark else []
        self.height = sum(self.rows) + BESIDE * max(0, len(self.rows) - 1)

    def lines(self, left: float, top: float) -> list[Line]:
        """Return the lines, the first of which begins at a place."""
        found = []
        for number, (entry, name, values) in enumerate(self.entries):
            row, column = divmod(number, self.across)
            y = top + sum(self.rows[:row]) + BESIDE * row
            box = Box(left + column * (self.column + GAP), y, self.column, self.rows[row])
            found.append(Line(entry, box, name, values))
        if self.remark:
            y = top + self.height - self.rows[-1]
            found.append(Line(None, Box(left, y, self.width, self.rows[-1]), self.remark, []))
        return found
