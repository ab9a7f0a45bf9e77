"""Edits of a scene; one request holds all that a command or a panel asks for at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal

from svv.options.described import Setting, Switch

Colour = tuple[float, float, float]
RecolourName = Literal["hsb", "oklab"]
DistinctName = Literal["colours", "lightness"]
SectionName = Literal["learned", "flat", "hatched"]

PAINT_LIGHT = 0.6
"""Fraction of the light's contrast that shows on paint, unless an edit changes it."""

OUTLINE_WIDTH = 2.0
"""Default width of outlines, in pixels of an 800 x 800 image."""
OUTLINE_COLOUR: Colour = (0.06, 0.05, 0.05)
"""Default colour of outlines, nearly black: sRGB in [0, 1]."""

LEARNED: SectionName = "learned"
"""Default way to show the faces of cuts: as the scene learned what is there."""
WIDEST_LINE = 16.0
"""Largest width of the line around sections, in pixels of an 800 x 800 image."""
SHADOW = 0.7
"""How far shadows darken where only their light or their softness is given."""

SPLIT_LEVEL = 0.5
"""Default fraction of a region's mean opacity from which its cells are connected when it is split."""

RECOLOUR = Switch("Recolour", "Give the region another colour.")
REFLECT = Switch("Reflect", "Set how the region reflects a light that can be moved.", advanced=True)


class Request:
    """A dataclass of changes; fields that are None change nothing."""

    def __bool__(self) -> bool:
        return any(getattr(self, f.name) is not None for f in fields(self))  # type: ignore[arg-type]

    def given(self) -> dict[str, Any]:
        """Return the requested changes, by name."""
        every = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        return {name: value for name, value in every.items() if value is not None}


@dataclass(frozen=True)
class RegionEdit(Request):
    """Changes of one region."""

    colour: Annotated[
        Colour | None, Setting(metavar="'#rrggbb'", syntax="colour", switch=RECOLOUR, unset=(1.0, 0.5, 0.0))
    ] = None
    """The region's new colour."""
    recolour_in: Annotated[RecolourName | None, Setting(unset="as it is", advanced=True)] = None
    """How shades follow the new colour: hsb as in the paper; oklab keeps perceived differences of lightness."""
    opacity: Annotated[float | None, Setting(least=0, slider=(0.0, 4.0), unset=1.0)] = None
    """Factor on the region's opacity; 1 is as trained."""
    lighting: Annotated[float | None, Setting(least=0, slider=(0.0, 2.0), unset=1.0)] = None
    """Factor on the region's shading; 0 is flat, 1 is as trained."""
    ambient: Annotated[float | None, Setting(least=0, slider=(0.0, 1.0), switch=REFLECT, unset=0.1)] = None
    """Ambient reflection; needs lighting phong."""
    diffuse: Annotated[float | None, Setting(least=0, slider=(0.0, 2.0), switch=REFLECT, unset=0.9)] = None
    """Diffuse reflection; needs lighting phong."""
    specular: Annotated[float | None, Setting(least=0, slider=(0.0, 2.0), switch=REFLECT, unset=0.2)] = None
    """Specular reflection; needs lighting phong."""
    shininess: Annotated[float | None, Setting(least=1, slider=(1.0, 128.0), switch=REFLECT, unset=30.0)] = None
    """Exponent of the specular highlight; needs lighting phong."""
    matcap: Annotated[
        str | None, Setting(command=False, panel="MatCap", unset="", unset_says="Empty leaves it as it is.")
    ] = None
    """A lit sphere whose colours the region takes: clay, wax, bronze, jade, porcelain, chalk, toon, x-ray, pearl,
    velvet, the file of a square picture, or none."""
    name: Annotated[str | None, Setting(command=False, unset="", unset_says="Empty leaves it as it is.")] = None
    """The region's name in legends, pages and messages, such as bone."""


@dataclass(frozen=True)
class LightEdit(Request):
    """The light of a scene that was trained with the lighting phong."""

    light: Annotated[dict[str, Any] | None, Setting(metavar="headlight|AZ,EL|X,Y,Z", syntax="light", panel="")] = None
    """The light: degrees right of and above the camera, or a vector in the world; needs lighting phong."""
    intensity: Annotated[float | None, Setting(least=0, panel="LightIntensity", slider=(0.0, 4.0), unset=1.0)] = None
    """Factor on the light's brightness; needs lighting phong."""


@dataclass(frozen=True)
class ShadowEdit(Request):
    """Shadows that the scene casts on itself."""

    shadow: Annotated[float | None, Setting(least=0, most=1, advanced=True, unset=0.0)] = None
    """How far cast shadows darken: 0 not at all, 1 fully; 0.7 if only another option of shadows is given."""
    shadow_light: Annotated[
        tuple[float, ...] | None, Setting(metavar="AZ,EL|X,Y,Z|own", syntax="light of shadows", panel="")
    ] = None
    """Where shadows come from: degrees right of and above the camera, or a vector in the world; own is the scene's
    moved light, or the camera's upper left."""
    shadow_softness: Annotated[float | None, Setting(least=0, most=60, metavar="DEGREES", advanced=True, unset=6.0)] = (
        None
    )
    """Opening angle of the light that casts shadows, from 0 to 60 degrees: more makes edges softer; 6 by default."""


@dataclass(frozen=True)
class OcclusionEdit(Request):
    """Ambient occlusion of the region, or of all regions."""

    occlusion: Annotated[float | None, Setting(least=0, most=1, advanced=True, unset=0.0)] = None
    """Darken cavities and contacts, which little light reaches: 0 not at all, 1 fully."""


@dataclass(frozen=True)
class PaintEdit(Request):
    """Appearance of the paint of the region, or of all regions."""

    strength: Annotated[float | None, Setting(least=0, most=1, unset=1.0)] = None
    """How strongly the painting shows: 0 gives the palette's colours, 1 the paint."""
    paint_light: Annotated[float | None, Setting(least=0, most=1, unset=PAINT_LIGHT)] = None
    """How strongly paint is shaded: 0 not at all, 1 as much as the palette's colours."""
    stroke_opacity: Annotated[float | None, Setting(least=-1, most=1, unset=0.0)] = None
    """How much opacity follows strokes: above 0, dark and vivid ones are more opaque; below 0, light ones, for dark
    backgrounds."""
    stroke_relief: Annotated[float | None, Setting(least=0, most=4, unset=1.0)] = None
    """Factor on the relief of brush strokes: 0 is flat paint, 1 as painted."""
    stroke_width: Annotated[float | None, Setting(slider=(0.5, 2.0), unset=1.0)] = None
    """Factor on the width of brush strokes, from 0.5 to 2; `svv stylize --stroke-size` lays others."""
    stroke_light: Annotated[
        tuple[float, ...] | None, Setting(metavar="AZ,EL|X,Y,Z|own", syntax="light on strokes", panel="")
    ] = None
    """Light on the relief of strokes: degrees right of and above the volume's front, or a vector in the world; own is
    the painting's."""
    stroke_palette: Annotated[
        tuple[Colour, ...] | None,
        Setting(metavar="IMG|gallery:NAME|'#rrggbb,...'|own", syntax="palette of strokes", panel=""),
    ] = None
    """Give strokes the colours of another picture, or these colours, keeping light and dark; own is the painting's."""

    @property
    def of_strokes(self) -> dict[str, Any]:
        """The requested changes of strokes, as arguments of :meth:`svv.fields.scene.scene.Scene.with_strokes`."""
        named = {name: getattr(self, f"stroke_{name}") for name in ("relief", "width", "light", "palette")}
        return {name: value for name, value in named.items() if value is not None}


@dataclass(frozen=True)
class OutlineEdit(Request):
    """Ink along the silhouettes and creases of the region, or of all regions."""

    outline: Annotated[float | None, Setting(least=0, most=1, unset=0.0)] = None
    """Strength of ink outlines along silhouettes and creases: 0 none, 1 full."""
    outline_width: Annotated[float | None, Setting(metavar="PX", slider=(0.5, 16.0), unset=OUTLINE_WIDTH)] = None
    """Width of outlines in pixels of an 800 x 800 image."""
    outline_colour: Annotated[
        Colour | None, Setting(metavar="'#rrggbb'", syntax="colour", advanced=True, unset=OUTLINE_COLOUR)
    ] = None
    """Colour of outlines."""


@dataclass(frozen=True)
class PartEdit(Request):
    """A connected part of a region that becomes a region of its own."""

    split_at: Annotated[tuple[float, ...] | None, Setting(metavar="X,Y|X,Y,Z", syntax="pixel or point", panel="")] = (
        None
    )
    """Make the connected part that is visible there a region of its own, the last one. Two numbers are a pixel, from
    the left and the top, of `svv render`'s picture with the same --camera, --frame and --size; three are a point in the
    world."""
    split_level: Annotated[float | None, Setting(least=0, most=1, unset=SPLIT_LEVEL)] = None
    """How opaque matter must be to connect, as a fraction of the region's mean opacity; 0.5 by default. More separates
    more."""


@dataclass(frozen=True)
class VisibilityEdit(Request):
    """Which regions are shown, and which are restored to their trained state."""

    isolate: Annotated[tuple[int, ...] | None, Setting(metavar="K,...", syntax="regions", panel="")] = None
    """Show only these regions."""
    hide: Annotated[tuple[int, ...] | None, Setting(metavar="K,...", syntax="regions", panel="")] = None
    """Hide these regions and keep their opacity."""
    show: Annotated[tuple[int, ...] | None, Setting(metavar="K,...|all", syntax="regions or all", panel="")] = None
    """Show hidden regions again."""
    reset: Annotated[tuple[int, ...] | None, Setting(metavar="K,...|all", syntax="regions or all", panel="")] = None
    """Undo all edits of these regions."""


@dataclass(frozen=True)
class CutEdit(Request):
    """Shapes that cut the scene open."""

    cut: Annotated[tuple[str, ...] | None, Setting(metavar="SHAPE", panel="")] = None
    """Cut off what is inside a shape: 'x>50%', 'x>50%&y<12.5', plane:X,Y,Z:NX,NY,NZ, box:X,Y,Z:X,Y,Z, sphere:X,Y,Z:R or
    cylinder:X,Y,Z:U,V,W:R along U,V,W; of some regions only as '0,2=x>50%'; what is outside as
    'outside sphere:X,Y,Z:R'."""
    uncut: Annotated[bool | None, Setting(panel="")] = None
    """Take away all cuts first."""

    def __bool__(self) -> bool:
        return bool(self.cut or self.uncut)


@dataclass(frozen=True)
class SectionEdit(Request):
    """Faces of cuts in the region, or in all regions."""

    section: Annotated[SectionName | None, Setting(unset="as it is", advanced=True)] = None
    """Faces of cuts: learned as they are, flat in the region's unlit colour, or hatched as in a drawing."""
    section_line: Annotated[
        float | None, Setting(least=0, most=WIDEST_LINE, metavar="PX", advanced=True, unset=0.0)
    ] = None
    """Width of an ink line around the faces of cuts, in pixels of an image of 800 x 800; 0 draws none."""


@dataclass(frozen=True)
class SceneEdit:
    """All changes that one command or one panel requests: one step of a scene's history."""

    regions: Mapping[int, RegionEdit] = field(default_factory=dict)
    """Changes of each region, by its number."""
    light: LightEdit = LightEdit()
    shadow: ShadowEdit = ShadowEdit()
    occlusion: OcclusionEdit = OcclusionEdit()
    paint: PaintEdit = PaintEdit()
    outline: OutlineEdit = OutlineEdit()
    visibility: VisibilityEdit = VisibilityEdit()
    cuts: CutEdit = CutEdit()
    sections: SectionEdit = SectionEdit()
    part: PartEdit = PartEdit()
    """A part to split off first; ``split_at`` in world coordinates."""
    of: tuple[int, ...] = ()
    """Regions whose paint, occlusion or sections are changed; empty means all."""
    outlined: tuple[int, ...] = ()
    """Regions whose outlines are changed; empty means all."""

    def __bool__(self) -> bool:
        looks = self.light, self.shadow, self.occlusion, self.paint, self.outline
        return any((*self.regions.values(), *looks, self.visibility, self.cuts, self.sections, self.part))
