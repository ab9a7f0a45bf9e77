"""Hatching in figures: lines over the parts of a panel that are expected to be further off than a level.

Lengths on the page are in mm. Letters: h, w rows and columns of a picture, N lines.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from svv.core.colour.hex_codes import to_hex
from svv.render.figures.swatches import Entry

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from svv.render.figures.lettering import Lettering

SPACING = 1.1
"""Distance of lines."""

INK, HALO = 0.16, 0.5
"""Width of a line, and of the strip in the colour of the background around it, so that it is seen on any colour."""

PIXELS = 4.0
"""Pixels of the picture of expected errors per mm."""

SHORTEST = 0.5 * SPACING
"""Length of the shortest line: a shorter one is a speck."""

HATCHED = -1
"""Number of the legend's entry on hatching, which is no region."""

Picture = NDArray[np.floating]


def mean_around(errors: Picture, spacing: float) -> Picture:
    """Return the mean error around each pixel, about ``spacing`` pixels wide; NaN where nothing is visible. (h, w)

    Expected errors hold for parts of pictures (``docs/design/trust.md``), and a part narrower than the distance of
    lines cannot be hatched.
    """
    seen = np.isfinite(errors)
    share = gaussian_filter(seen.astype(np.float64), 0.5 * spacing)
    total = gaussian_filter(np.where(seen, errors, 0.0).astype(np.float64), 0.5 * spacing)
    return np.where(seen, total / np.maximum(share, 1e-9), np.nan)


def lines_over(mean: Picture, level: float, size: tuple[float, float]) -> NDArray[np.float64]:
    """Return lines at 45 degrees where a picture is over a level, from and to x, y from its lower left. (N, 2, 2)

    ``mean`` (h, w), NaN where nothing is visible; ``size``: width and height of the picture on the page.

    >>> lines_over(np.ones((8, 8)), 0.5, (4.0, 4.0)).shape[1:]
    (2, 2)
    """
    (height, width), (across, up) = mean.shape, size
    over = np.nan_to_num(mean, nan=0.0) > level
    found = []
    apart, step = SPACING * np.sqrt(2.0), 0.5 * across / width
    for start in np.arange(np.ceil(-up / apart), across // apart + 1.0) * apart:  # where a line crosses the lower edge
        x = np.arange(max(start, 0.0), min(across, start + up), step)
        if not len(x):
            continue
        y = x - start
        at = [(up - y) / up * height - 0.5, x / across * width - 0.5]
        on = map_coordinates(over.astype(np.uint8), at, order=0, mode="nearest") > 0
        ends = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
        for first, last in zip(ends[::2], ends[1::2] - 1, strict=True):
            if x[last] - x[first] >= SHORTEST / np.sqrt(2.0):
                found.append(((x[first], y[first]), (x[last], y[last])))
    return np.array(found, np.float64).reshape(-1, 2, 2)


def draw_lines(axes: Axes, lines: NDArray[np.float64], lettering: Lettering, behind: Sequence[float]) -> None:
    """Draw lines (N, 2, 2) into axes of mm, in the ink of the text on a strip of the background's colour."""
    from matplotlib.collections import LineCollection

    points = 72.0 / 25.4
    for width, colour in ((HALO, to_hex(behind)), (INK, lettering.ink)):
        axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=width * points, capstyle="butt"))


def hatched_disc(diameter: float) -> NDArray[np.float64]:
    """Return the lines of a hatched disc, from the lower left of the square around it. (N, 2, 2)"""
    side = max(8, round(PIXELS * 4.0 * diameter))
    at = (np.arange(side) + 0.5) / side - 0.5
    return lines_over((np.hypot(at[:, None], at[None]) < 0.5).astype(np.float64), 0.5, (diameter, diameter))


def entry_on(level: float) -> Entry:
    """Return the line of a legend that says what hatching means; its swatch is drawn as lines."""
    return Entry(HATCHED, "hatched", f"expected error over {100.0 * level:.3g} %", np.zeros((1, 1, 4), np.float32))
