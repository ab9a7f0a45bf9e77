"""Styles that do not need a picture from the user: the gallery's painters and the inks, by name.

Commands and panels list these before anything is painted, so this module imports nothing heavy.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Painter:
    """A function that paints a picture from a random generator and a side in pixels; imported on the first call."""

    module: str
    function: str

    def __call__(self, generator: np.random.Generator, side: int) -> NDArray[np.floating]:
        """Paint the picture: (side, side, 3) float32, sRGB in [0, 1]."""
        return getattr(import_module(f"svv.styles.gallery.{self.module}"), self.function)(generator, side)


GALLERY: dict[str, tuple[Painter, str]] = {
    "stipple": (Painter("drawings", "stipple"), "dots of a pen, ultramarine on white"),
    "cross-hatching": (Painter("drawings", "cross_hatching"), "pen lines in sepia on tan paper, heightened with white"),
    "woodcut": (Painter("prints", "woodcut"), "black block, vermilion and indigo on cream"),
    "watercolour": (Painter("paintings", "watercolour"), "glazes of blue, green and rose on white paper"),
    "impasto": (Painter("paintings", "impasto"), "thick oil paint, sunflower yellow on turquoise and green"),
    "pastel": (Painter("drawings", "pastel"), "soft chalks on dark rough paper, lilac, rose and teal"),
    "mosaic": (Painter("prints", "mosaic"), "small stones, gold, lapis and terracotta"),
    "ink-wash": (Painter("drawings", "ink_wash"), "sumi-e, greys of one ink on rice paper, a red seal"),
    "screen-print": (Painter("prints", "screen_print"), "flat inks and halftone dots, pink, cyan, yellow and black"),
    "charcoal": (Painter("drawings", "charcoal"), "black chalk on rough grey paper, rubbed and drawn over"),
    "oil": (Painter("textures", "brush_strokes"), "brush strokes in eddies, night blue, ochre and vermilion"),
    "pointillism": (Painter("textures", "stippling"), "dots of unmixed colour on warm paper"),
}
"""Name -> painter of the picture, and a description of it."""


@dataclass(frozen=True)
class Layer:
    """One set of parallel lines in an ink drawing."""

    across: float
    """Angle from the direction in which the surface bends least, in radians."""
    apart: float
    """Distance between the centres of neighbouring lines, in units of the stroke size."""
    tone: float
    """Darkness from which the lines are drawn, in [0, 1]; lighter parts of the surface have none of them."""
    thin: float
    """Width of the lines at that tone, in units of the stroke size."""
    thick: float
    """Width of the lines in the darkest places, in units of the stroke size."""
    between: bool = False
    """Whether the lines lie between those of the previous layer and share their direction."""


INKS: dict[str, tuple[Layer, ...]] = {
    "stippling": (),
    "hatching": (Layer(0.0, 8.4, 0.12, 1.2, 2.8), Layer(0.0, 4.2, 0.36, 1.1, 2.8, True)),
    "cross-hatching": (
        Layer(0.0, 10.0, 0.12, 1.3, 2.2),
        Layer(0.0, 5.0, 0.34, 1.2, 2.2, True),
        Layer(1.15, 10.0, 0.54, 1.3, 2.2),
        Layer(1.15, 5.0, 0.68, 1.2, 2.2, True),
    ),
}
"""Name -> layers of lines; an ink without layers consists of dots."""
