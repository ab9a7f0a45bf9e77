"""Words for colours, as people use them (the basic colour terms of Berlin & Kay 1969, and teal)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import lab_to_rgb
from svv.core.colour.colour_vision import oklab

HUES = (
    (15.0, "pink"), (45.0, "red"), (75.0, "orange"), (118.0, "yellow"), (165.0, "green"), (220.0, "teal"),
    (285.0, "blue"), (330.0, "purple"), (360.0, "pink"),
)  # fmt: skip
"""Largest angle of hue in Oklab, in degrees, and its name."""

GREY = 9.0
"""Chroma below which a colour is grey, or black or white."""

BLACK, WHITE = 28.0, 90.0
"""Lightness up to which grey is black, and from which it is white."""

DARK, PALE = 38.0, 74.0
"""Lightness up to which a colour is dark, and from which it is pale."""


def colour_name(lab: NDArray[np.floating]) -> str:
    """Return the name of a colour, CIELAB (3,).

    >>> [colour_name(np.array(lab)) for lab in ([32.0, 79.0, -108.0], [85.0, 2.0, 70.0], [30.0, 12.0, 25.0])]
    ['dark-blue', 'yellow', 'brown']
    """
    light, chroma = float(lab[0]), float(np.hypot(lab[1], lab[2]))
    _, a, b = oklab(lab_to_rgb(np.asarray(lab, np.float64))).tolist()
    hue = float(np.degrees(np.arctan2(b, a))) % 360.0  # CIELAB's hue of blue is that of purple
    if chroma < GREY:
        return "black" if light <= BLACK else "white" if light >= WHITE else "grey"
    name = next(word for most, word in HUES if hue <= most)
    if name in ("orange", "yellow", "red") and light < 55.0 and chroma < 50.0:
        return "brown"
    if name == "pink" and light < 55.0 and chroma >= 30.0:
        name = "red"
    shade = "dark-" if light <= DARK else "pale-" if light >= PALE and name != "yellow" else ""
    return shade + name
