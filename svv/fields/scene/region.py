"""A region of a scene and everything that edits can change about it."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from svv.errors import BadInput
from svv.options.editing import (
    LEARNED,
    OUTLINE_COLOUR,
    OUTLINE_WIDTH,
    PAINT_LIGHT,
    WIDEST_LINE,
    RecolourName,
    SectionName,
)
from svv.options.making import DRAWN

MOST_RELIEF = 4.0
"""Largest factor on the relief of strokes."""

STROKE_WIDTHS = (0.5, 2.0)
"""Bounds of the factor on the width of strokes: beyond them, their paths are too far apart or too close."""

LONGEST_NAME = 100
"""Largest number of characters in a region's name."""

UNSEEN = ("Cc", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories of what no name holds: control characters, halves of characters, and breaks of lines."""


TURNING = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
"""Characters that change the direction of the text behind them, also beyond a name's end; names need none of them."""


@dataclass(frozen=True)
class Region:
    """A region of the scene, and its edits.

    It consists of the samples whose largest palette weight is this colour's, or of a part of them that was split off
    (:mod:`svv.fields.scene.parts`).

    >>> region = scene.edited(0, name="core", opacity=0.5).regions[0]
    >>> region.name, region.opacity, region.hidden
    ('core', 0.5, False)
    """

    colour: tuple[float, float, float]
    """Palette colour, RGB in [0, 1]."""
    share: float
    """Fraction of the visible pixels' colour that this palette colour explains; the whole's includes its parts'."""
    opacity: float = 1.0
    """Factor on the extinction."""
    lighting: float = 1.0
    """Factor on the lighting: 0 shows the flat material."""
    edited_colour: tuple[float, float, float] | None = None
    """Colour that replaces ``colour``, RGB in [0, 1]; None where it was not edited."""
    style: str | None = None
    """Name of its style; None if the region is not painted and the palette network provides its colours."""
    strength: float = 1.0
    """Strength of the style: 0 shows the palette's colours, 1 the style's."""
    values: tuple[float, float] | None = None
    """Smallest and largest scalar value of the volume in the region; None where they are not known."""
    ranges: tuple[tuple[float, float], ...] = ()
    """Ranges of the transfer function that the region consists of, in scalar values."""
    hidden: bool = False
    """Whether it is left out of images, whatever its opacity."""
    ambient: float | None = None
    """Edited ambient coefficient under an explicit light, a fraction of the light; None keeps the learned one."""
    diffuse: float | None = None
    """Edited diffuse coefficient, a fraction of the light; None keeps the learned one."""
    specular: float | None = None
    """Edited specular coefficient, a fraction of the light; None keeps the learned one."""
    shininess: float | None = None
    """Edited exponent of the highlight, >= 1; None keeps the learned one."""
    paint_light: float = PAINT_LIGHT
    """Fraction of the light's contrast that is shown on its paint, in [0, 1]: 0 shows unlit paint."""
    mean_light: tuple[float, float] | None = None
    """Mean shade and mean specular light of the region, measured when the scene was painted."""
    stroke_opacity: float = 0.0
    """How far opacity follows the strokes, in [-1, 1]: above 0 dark strokes are more opaque, below 0 light ones."""
    glaze: float = 0.0
    """``stroke_opacity`` as painting gave it, above 0 for glazes on what is translucent."""

    stroke_relief: float = 1.0
    """Factor on the relief of its strokes, in [0, 4]: 0 shows flat paint."""
    stroke_width: float = 1.0
    """Factor on the width of its strokes, in [0.5, 2]; their paths stay."""
    stroke_light: tuple[float, float, float] | None = None
    """World direction from which the relief of its strokes is lit, a unit vector; None for the painting's own."""
    stroke_palette: tuple[tuple[float, float, float], ...] = ()
    """Colours that its strokes have instead, from dark to light, RGB in [0, 1]; empty for the painting's own."""

    layer: int = 0
    """Number of the transfer function that shows it, in a scene of several (:mod:`svv.fields.scene.joined`)."""

    occlusion: float = 0.0
    """How far places that little light reaches are darkened, in [0, 1] (:mod:`svv.fields.scene.occlusion`)."""

    part_of: int | None = None
    """Number of the region that it was split from; None for a region of the palette."""

    name: str | None = None
    """What it shows, such as 'bone', in any script; None where nobody named it."""
    recolour_in: str = "hsb"
    """Space in which the shades of its colour follow ``edited_colour``: ``hsb`` (the paper's) or ``oklab``."""

    matcap: str | None = None
    """Name of its MatCap, or its picture as text (:mod:`svv.fields.scene.matcaps`), which replaces its colours and
    light."""

    outline: float = 0.0
    """Opacity of the ink of its outlines, in [0, 1]; 0 draws none."""
    outline_width: float = OUTLINE_WIDTH
    """Width of the outlines, in pixels of an image of 800 x 800."""
    outline_colour: tuple[float, float, float] = OUTLINE_COLOUR
    """Colour of the outlines, RGB in [0, 1]."""

    section: str = LEARNED
    """How the faces of cuts show it (:mod:`svv.fields.scene.sections`): ``learned``, ``flat`` or ``hatched``."""
    section_line: float = 0.0
    """Width of the ink line around its sections, in pixels of an image of 800 x 800; 0 draws none."""

    def __post_init__(self) -> None:
        if not (0.0 <= self.stroke_relief <= MOST_RELIEF and STROKE_WIDTHS[0] <= self.stroke_width <= STROKE_WIDTHS[1]):
            raise ValueError("the relief or the width of strokes is out of range")
        if not 0.0 <= self.occlusion <= 1.0:
            raise ValueError("the occlusion is out of range")
        if self.recolour_in not in get_args(RecolourName):
            raise ValueError(f"'{self.recolour_in}' is no space to recolour in")
        if self.section not in get_args(SectionName):
            raise ValueError(f"'{self.section}' is no way to show sections")
        if not 0.0 <= self.section_line <= WIDEST_LINE:
            raise ValueError("the line around sections is out of range")

    @property
    def seen_opacity(self) -> float:
        """Factor on the extinction in images."""
        return 0.0 if self.hidden else self.opacity


def paint_light_of(style: str | None) -> float:
    """Return the default light on paint of this style: 0 for ink, whose strokes are the shading."""
    return 0.0 if style is not None and style.startswith(DRAWN) else PAINT_LIGHT


def label_of(regions: Sequence[Region], number: int) -> str:
    """Return what a region is called: its name, or its number, with the name of the region that it is part of.

    >>> label_of([Region((1.0, 0.0, 0.0), 1.0, name="bone"), Region((0.0, 1.0, 0.0), 0.0)], 1)
    'Region 1'
    """
    region = regions[number]
    if region.name is not None:
        return region.name
    whole = region.part_of
    while whole is not None:
        name, whole = regions[whole].name, regions[whole].part_of
        if name is not None:
            return f"Region {number}, part of {name}"
    return f"Region {number}"


def validate_name(name: str) -> str | None:
    """Return a region's name without blanks at its ends, None if nothing is left; raises as :func:`validate_line`."""
    return validate_line(name, "The name of a region") or None


def validate_line(line: str, what: str, longest: int = LONGEST_NAME) -> str:
    """Return a line of text without blanks at its ends; ``what`` it is begins the sentence of an error.

    Raises BadInput if it is too long, has characters that cannot be shown or that turn what follows, or shows nothing.
    """
    text = unicodedata.normalize("NFC", line).strip()
    if len(text) > longest:
        raise BadInput(f"{what} has at most {longest} characters, not {len(text)}: shorten it.")
    if hidden := [c for c in text if unicodedata.category(c) in UNSEEN or c in TURNING]:
        raise BadInput(
            f"{what} is one line of text, without the control character U+{ord(hidden[0]):04X}: leave it out."
        )
    if text and all(unicodedata.category(c)[0] in "CZM" for c in text):
        raise BadInput(f"{what} has no character that can be seen: write another, or leave it empty.")
    return text


def validate_space(name: str) -> str:
    """Return the name of a space to recolour in; raises BadInput for any other."""
    if name not in get_args(RecolourName):
        raise BadInput(f"Colours cannot be changed in '{name}': choose {' or '.join(get_args(RecolourName))}.")
    return name


def of_layer(regions: Sequence[Region], layer: int) -> tuple[Region, ...]:
    """Return a layer's regions as those of a scene of its own, numbered from 0.

    Raises ValueError if a region is part of a later one, or of one of another layer.
    """
    own: dict[int, Region] = {}
    numbers: dict[int, int] = {}
    for number, region in enumerate(regions):
        if region.layer != layer:
            continue
        if region.part_of is not None and region.part_of not in numbers:
            raise ValueError("the parts of regions are out of order")
        parent = None if region.part_of is None else numbers[region.part_of]
        numbers[number] = len(own)
        own[number] = replace(region, layer=0, part_of=parent)
    return tuple(own.values())


def swatches(divided: Mapping[str, Mapping[str, Any]], regions: Sequence[Region]) -> list[tuple[list[str], str]]:
    """Return three colours, as hex codes from dark to light, and a label for each region with a part of a picture.

    ``divided``: ``report["divided"]`` of :func:`svv.stylize_scene`.
    """
    return [
        (one["colours"], f"{label_of(regions, int(k))}: {one['part']} of {one['style']}")
        for k, one in divided.items()
        if int(k) < len(regions)
    ]
