"""A region of a scene, with all that edits change of it."""

from __future__ import annotations

from dataclasses import dataclass

from svv.options.editing import OUTLINE_COLOUR, OUTLINE_WIDTH, PAINT_LIGHT


@dataclass(frozen=True)
class Region:
    """A region of the scene: the samples whose largest palette weight is this colour's, and its edits."""

    colour: tuple[float, float, float]
    """Palette colour, RGB in [0, 1]."""
    share: float
    """Part of the visible pixels' colour that this palette colour explains."""
    opacity: float = 1.0
    """Factor on the extinction."""
    lighting: float = 1.0
    """Factor on the lighting: 0 shows the flat material."""
    edited_colour: tuple[float, float, float] | None = None
    """What ``colour`` was changed to."""
    style: str | None = None
    """Name of the style that the UCN gave it; None where the PCN holds its colour."""
    strength: float = 1.0
    """How much of the style is shown: 0 the palette's colours, 1 the style's."""
    values: tuple[float, float] | None = None
    """The volume's scalar values that it shows, from the smallest to the largest, where they are known,"""
    ranges: tuple[tuple[float, float], ...] = ()
    """and the ranges of the transfer function that it is made of."""
    hidden: bool = False
    """Whether it is left out of images, whatever its opacity."""
    ambient: float | None = None
    """Of an explicit light: what the learned coefficient was changed to, as the next three,"""
    diffuse: float | None = None
    """which are parts of the light,"""
    specular: float | None = None
    """highlights' too,"""
    shininess: float | None = None
    """and the exponent of the highlight."""
    paint_light: float = PAINT_LIGHT
    """How much of the light is seen on its paint, in [0, 1]: 0 nothing, 1 all by which it differs from its mean,"""
    mean_light: tuple[float, float] | None = None
    """the shade and specular that it has in the mean, found when the scene was painted."""
    stroke_opacity: float = 0.0
    """How much its opacity follows its strokes, in [-1, 1]: above 0 dark ones are more opaque, below 0 light ones."""

    outline: float = 0.0
    """How much ink its outlines have, in [0, 1]: 0 none,"""
    outline_width: float = OUTLINE_WIDTH
    """how wide they are, in pixels of an image of 800 x 800,"""
    outline_colour: tuple[float, float, float] = OUTLINE_COLOUR
    """and their colour, RGB in [0, 1]."""

    @property
    def seen_opacity(self) -> float:
        """Factor on the extinction in images."""
        return 0.0 if self.hidden else self.opacity
