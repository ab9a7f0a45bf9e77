"""What a look consists of; see :mod:`.look`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from svv.core.colour.light import Lamp
from svv.core.geometry.cameras import Camera
from svv.fields.scene.region import Region
from svv.io.pictures.picture_data import mask_in, picture_in
from svv.train.paint.ink import StyleInput

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Laid:
    """How the paint of a region is laid; the words are those of :class:`svv.options.making.PaintOptions`."""

    manner: str = "auto"
    hand: str = "auto"
    stroke_size: float = 1.0


@dataclass(frozen=True)
class LookRegion:
    """How one region looks, and what it is known by."""

    edits: Mapping[str, Any] = field(default_factory=dict)
    """Its edits by field (:class:`svv.fields.scene.region.Region`); its name, if it has one, is among them."""
    colour: Colour | None = None
    """Palette colour of the region that it was saved from, RGB in [0, 1]; None for a look of no scene."""
    values: tuple[float, float] | None = None
    """Smallest and largest scalar value of that region; None where they are not known."""
    style: str | None = None
    """Name of its style among the look's; None if it is not painted."""
    laid: Laid = Laid()
    """How its paint is laid."""

    @property
    def name(self) -> str | None:
        """What the region shows; None where nobody named it."""
        return self.edits.get("name")

    @property
    def shown_colour(self) -> Colour | None:
        """The colour that it has, edited or not."""
        return self.edits.get("edited_colour") or self.colour

    def label(self, number: int) -> str:
        """Return its name, or its number in the look."""
        return self.name or f"region {number} of the look"


@dataclass(frozen=True)
class LookContent:
    """The values of a look."""

    regions: tuple[LookRegion, ...]
    styles: Mapping[str, StyleInput] = field(default_factory=dict)
    """The styles of its regions by name: pictures with masks, or inks."""
    lamp: Lamp | None = None
    """Its light; None if it came from a scene whose light cannot be moved."""
    camera: Camera | None = None
    """Its camera, in sides of the box from the box's middle (:meth:`camera_for`); None for a look of no side."""
    figure: Mapping[str, Any] = field(default_factory=dict)
    """Settings of figures (:class:`svv.options.figures.FigureOptions`) that differ from the defaults."""
    title: str = ""
    """One line about it."""

    def camera_for(self, scene: Scene) -> Camera | None:
        """Return the look's camera in the world of a scene; None if it has none."""
        return None if self.camera is None else moved(self.camera, scene, to_box=False)


def moved(camera: Camera, scene: Scene, to_box: bool) -> Camera:
    """Return a camera in sides of the scene's box from its middle, or such a camera in the world."""
    box = scene.box
    middle, side = np.asarray(box.bounds, np.float64).mean(0), float(box.size)
    matrix = np.array(camera.camera_to_world)
    matrix[:3, 3] = (matrix[:3, 3] - middle) / side if to_box else matrix[:3, 3] * side + middle
    span = camera.span_x
    return replace(
        camera, camera_to_world=matrix, span_x=None if span is None else span / side if to_box else span * side
    )


def style_in(told: Mapping[str, object], key: str, before: str, name: str) -> StyleInput:
    """Return the style of a picture, its mask, and a part of it within that mask, which are data URIs if there.

    Messages of BadInput begin with ``before`` and call the style ``name``.
    """
    picture = picture_in(told.get("picture"), f"{before} picture of the style '{name}'")
    mask, part = (
        None if told.get(kind) is None else mask_in(told[kind], picture.shape, f"{before} {kind} of the style '{name}'")
        for kind in ("mask", "part")
    )
    return StyleInput(picture, key, mask) if part is None else StyleInput(picture, key, part, mask, divided=True)


def whole_of(style: StyleInput) -> StyleInput:
    """Return the picture of which a style is a part, with the name that it has without the part's."""
    return StyleInput(style.style, (style.name or "").rpartition(" (")[0] or style.name, style.measured)


def region_with(region: Region, look: LookRegion) -> dict[str, Any]:
    """Return the edits with which a region of a scene looks as one of a look; its own name stays if that has none."""
    edits = dict(look.edits)
    colour = edits.pop("edited_colour", None) or look.colour
    if colour is not None and colour != region.colour:
        edits["edited_colour"] = colour
    if "name" not in edits and region.name is not None:
        edits["name"] = region.name
    return edits
