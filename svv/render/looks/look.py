"""A look: what somebody chose for the regions of one scene, in a form that fits the regions of others.

It holds names, colours, opacities, light, styles with their pictures, edits of strokes, outlines, a camera and the
settings of figures. Places are relative to the volume's box, so that they fit volumes of any size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from svv.core.cameras import Camera
from svv.core.light import Lamp
from svv.errors import BadInput, Progress, silent
from svv.fields.history import edits_of
from svv.fields.kept_styles import KEPT
from svv.fields.region import Region
from svv.fields.scene import Scene
from svv.io.picture_data import mask_in, picture_in
from svv.options.described import chosen
from svv.options.figures import FigureOptions
from svv.train.ink import StyleInput, ink_named

if TYPE_CHECKING:
    from svv.render.looks.applying import Applied
    from svv.render.looks.matching import Matches

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
    """Its edits by field (:class:`svv.fields.region.Region`); its name, if it has one, is among them."""
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
class Look:
    """A look of scenes; :meth:`of` takes it from one, :meth:`applied` gives it to another."""

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

    @classmethod
    def of(
        cls,
        scene: Scene,
        camera: Camera | None = None,
        figure: FigureOptions | None = None,
        styles: Mapping[str, StyleInput] | None = None,
        title: str = "",
    ) -> Look:
        """Return the look of a scene.

        Args:
            scene: A scene with regions.
            camera: Camera to keep, in world units.
            figure: Settings of figures to keep.
            styles: Pictures of styles by name, for scenes that were painted before scenes kept them.
            title: One line about the look.

        Raises:
            BadInput: The scene has no regions, or the picture of one of its styles is neither in it nor given.

        Example:
            >>> svv.Look.of(svv.Scene.load("head.svv")).save("head.json")  # doctest: +SKIP
        """
        if not scene.regions:
            raise BadInput("The scene has no regions because it holds no palette network; train it again.")
        kept = scene.made.get("stylized", {}).get(KEPT, {"styles": {}, "laid": {}})
        regions, found = [], dict[str, StyleInput]()
        for number, region in enumerate(scene.regions):
            style, laid = None, Laid()
            if region.style is not None:
                how = kept["laid"].get(str(scene.roots[number]), {})
                laid = Laid(**{key: how[key] for key in ("manner", "hand", "stroke_size") if key in how})
                style = how.get("style", region.style)
                found[style] = _style_of(style, region.style, kept["styles"], styles or {})
            regions.append(LookRegion(edits_of(region), region.colour, region.values, style, laid))
        return cls(
            tuple(regions), found, scene.lamp if scene.settings.lighting == "phong" else None,
            None if camera is None else _moved(camera, scene, to_box=True), changed_settings(figure), title,
        )  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> Look:
        """Read a look from a file, or take ``gallery:NAME``; raises BadInput as :func:`svv.render.looks.file.read`."""
        from svv.render.looks.file import read

        return read(path)

    def save(self, path: str | Path) -> None:
        """Write the look to one JSON file, with its pictures inside; raises BadInput if it cannot be written."""
        from svv.render.looks.file import write

        write(self, path)

    def matched(self, scene: Scene, mapping: Mapping[int, int] | None = None) -> Matches:
        """Return which region of a scene gets the look of which of this one's; see :func:`.matching.matched`."""
        from svv.render.looks.matching import matched

        return matched(self, scene, mapping)

    def applied(
        self,
        scene: Scene,
        mapping: Mapping[int, int] | None = None,
        progress: Progress = silent,
        checkpoint: Path | None = None,
        **paint: Any,
    ) -> Applied:
        """Return a scene with this look; see :func:`.applying.applied`."""
        from svv.render.looks.applying import applied

        return applied(self, scene, mapping, progress, checkpoint, **paint)

    def camera_for(self, scene: Scene) -> Camera | None:
        """Return the look's camera in the world of a scene; None if it has none."""
        return None if self.camera is None else _moved(self.camera, scene, to_box=False)


def changed_settings(figure: FigureOptions | None) -> dict[str, Any]:
    """Return the settings of figures that differ from the defaults and do not depend on a scene, by name."""
    if figure is None:
        return {}
    plain, given = chosen(FigureOptions()), chosen(figure)
    return {name: value for name, value in given.items() if value != plain[name] and name != "network"}


def _style_of(key: str, name: str, kept: Mapping[str, Any], given: Mapping[str, StyleInput]) -> StyleInput:
    """Return a style: an ink, one that was given, or one that the scene keeps."""
    if (ink := ink_named(name)) is not None:
        return StyleInput(ink)
    if name in given:
        return replace(given[name], name=key)
    if "picture" not in kept.get(key, {}):
        raise BadInput(
            f"The scene does not hold the picture of its style '{name}': give it with --style FILE (in Python, "
            "styles), or paint the scene again."
        )
    picture = picture_in(kept[key]["picture"], f"The picture of the style '{name}'")
    mask = kept[key].get("mask")
    kind = f"The mask of the style '{name}'"
    return StyleInput(picture, key, None if mask is None else mask_in(mask, picture.shape, kind))


def _moved(camera: Camera, scene: Scene, to_box: bool) -> Camera:
    """Return a camera in sides of the scene's box from its middle, or such a camera in the world."""
    box = scene.occupancy.box
    middle, side = np.asarray(box.bounds, np.float64).mean(0), float(box.size)
    matrix = np.array(camera.camera_to_world)
    matrix[:3, 3] = (matrix[:3, 3] - middle) / side if to_box else matrix[:3, 3] * side + middle
    span = camera.span_x
    return replace(
        camera, camera_to_world=matrix, span_x=None if span is None else span / side if to_box else span * side
    )


def region_with(region: Region, look: LookRegion) -> dict[str, Any]:
    """Return the edits with which a region of a scene looks as one of a look; its own name stays if that has none."""
    edits = dict(look.edits)
    colour = edits.pop("edited_colour", None) or look.colour
    if colour is not None and colour != region.colour:
        edits["edited_colour"] = colour
    if "name" not in edits and region.name is not None:
        edits["name"] = region.name
    return edits
