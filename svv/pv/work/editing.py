"""Turn the panels of StyleRF Edit and StyleRF Palette into edits of a scene and a correction of its palette."""

from __future__ import annotations

from typing import TYPE_CHECKING

from svv.core.colour.correction import Correction, Point
from svv.errors import BadInput, Progress, silent
from svv.options.editing import (
    SPLIT_LEVEL,
    CutEdit,
    LightEdit,
    OcclusionEdit,
    OutlineEdit,
    PaintEdit,
    PartEdit,
    RegionEdit,
    SceneEdit,
    SectionEdit,
    ShadowEdit,
    VisibilityEdit,
)
from svv.pv.panel.cutting_shapes import cut_at
from svv.pv.panel.groups import ADDED, AS_IT_CAME, BESIDE, IN_WORLD, PALETTE, REGIONS
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values, colour_row, points_in, region_row

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene


def as_edited(scene: Scene, values: Values, progress: Progress = silent) -> tuple[Scene, tuple[str, ...]]:
    """Return a scene with the panel's edits, as one step of its history, and how its words were understood.

    Properties that a panel lacks change nothing. Raises BadInput for the reasons of :mod:`svv.fields.scene.edits`,
    words that are not understood or want a style, or if Undo is larger than the number of edits.
    """
    undo = values.get("Undo", 0)
    if undo > len(scene.history.past):
        raise BadInput(f"Cannot undo {undo} edits, because the scene came with {len(scene.history.past)}: reduce Undo.")
    for _ in range(undo):
        scene = scene.undone()
    from svv.fields.scene.edit_request import with_edit

    before = scene
    if values.get("AsTrained"):
        scene = scene.reset()
    if values["Variant"]:
        scene = scene.with_variant(values["Variant"])
    if values.get("ShowHidden"):
        scene = scene.shown()
    level = options_in(PartEdit, values).split_level
    for point in places_in(values.get("Parts", ""), "Parts"):
        scene = scene.split_at(point, SPLIT_LEVEL if level is None else level, progress)
    scene = with_edit(scene, edit_in(values))
    if not values["Say"].strip():
        return scene.as_one_step(before), ()
    from svv.job.words.say import say

    spoken = say(scene, values["Say"], progress, paints=False)
    return spoken.scene.as_one_step(before), spoken.understood


def edit_in(values: Values) -> SceneEdit:
    """Return all edits that the panel asks for; raise BadInput if a text does not name regions."""
    rows = [f"Region{region}" for region in range(REGIONS)]
    hide = tuple(region for region in range(REGIONS) if region_row(values, region)["Hide"])
    places: dict[str, dict[str, object] | None] = {
        AS_IT_CAME: None,
        BESIDE: {"azimuth": values["LightAzimuth"], "elevation": values["LightElevation"]},
        IN_WORLD: {"direction": values["LightDirection"]},
    }
    shadows_from = {
        AS_IT_CAME: None,
        BESIDE: (values["ShadowAzimuth"], values["ShadowElevation"]),
        IN_WORLD: tuple(values["ShadowDirection"]),
    }
    outline = options_in(OutlineEdit, values)
    shadow = options_in(ShadowEdit, values, shadow_light=shadows_from[values["ShadowFrom"]])
    return SceneEdit(
        {region: options_in(RegionEdit, values, name) for region, name in enumerate(rows)},
        options_in(LightEdit, values, light=places[values["LightFrom"]]),
        # Softness and place have no meaning without shadows.
        shadow if shadow.shadow is not None else ShadowEdit(),
        options_in(OcclusionEdit, values),
        options_in(PaintEdit, values, "", **_strokes_in(values)),
        # Width and colour have no meaning without an outline.
        outline if outline.outline is not None else OutlineEdit(),
        VisibilityEdit(
            isolate=tuple(whole_numbers_in(values["Isolate"], "Isolate")) if values["Isolate"].strip() else None,
            hide=hide or None,
        ),
        CutEdit(cuts_in(values) or None),
        options_in(SectionEdit, values),
        outlined=tuple(whole_numbers_in(values["OutlineRegions"], "Outline Regions")),
    )


def cuts_in(values: Values) -> tuple[str, ...]:
    """Return the texts of a panel's cuts; raise BadInput for a surface without inside, or a text of no regions."""
    cuts = tuple(text.strip() for text in values["Cuts"].split(";") if text.strip())
    if not values["CutOpen"]:
        return cuts
    regions = whole_numbers_in(values["CutRegions"], "Cut Regions")
    return (*cuts, cut_at(values["CutOpenBy"], values["InvertCut"], regions))


def _strokes_in(values: Values) -> dict[str, object]:
    """Return the edits of strokes that are no single number; raises BadInput if the palette cannot be read."""
    found: dict[str, object] = {}
    if values["MoveStrokeLight"]:
        found["stroke_light"] = tuple(values["StrokeLight"])
    if values["StrokePalette"].strip():
        from svv.styles.stroke_palette import palette_named

        found["stroke_palette"] = palette_named(values["StrokePalette"].strip())
    return found


def describe_edits(scene: Scene) -> str:
    """Return one line for the panel: the edits that can be undone, and the paintings."""
    past = scene.history.past
    lines = [f"{len(scene.regions)} regions"]
    lines += [f"region {k} is {r.name}" for k, r in enumerate(scene.regions) if r.name is not None]
    lines += [f"region {k} is part of region {r.part_of}" for k, r in enumerate(scene.regions) if r.part_of is not None]
    if past:
        lines.append(f"last edit: {past[-1].what} ({len(past)} to undo)")
    lines += [cut.describe() for cut in scene.cuts]
    if scene.settings.lighting == "phong":
        lines.append(scene.lamp.describe())
    elif scene.lamp.shadow > 0.0:
        lines.append(scene.lamp.describe_shadow())
    if scene.variants:
        lines.append(f"paintings: {', '.join(scene.variants)}, shown: {scene.variant}")
    return "; ".join(lines) + "."


def whole_numbers_in(text: str, name: str) -> list[int]:
    """Parse '0, 2' as whole numbers; raise BadInput for anything else."""
    try:
        return [int(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise BadInput(f"{name} must be whole numbers separated by commas, not '{text}'.") from None


def places_in(text: str, name: str) -> list[Point]:
    """Parse '0.1,0.2,0.3; 1,2,3' as points in space; raise BadInput for anything else."""
    found = points_in(text, 3, f"{name} must be points in space, such as 0.1,0.2,0.3; 1,2,3")
    return [(x, y, z) for x, y, z in found]


def correction_in(values: Values) -> Correction:
    """Return the correction that the panel asks for, false if empty; raise BadInput if a text does not name regions."""
    groups = filter(str.strip, values["Merge"].split(";"))
    rows = [region_row(values, k) for k in range(PALETTE)]
    colours = [colour_row(values, k) for k in range(ADDED)]
    return Correction(
        tuple(tuple(whole_numbers_in(group, "Merge")) for group in groups),
        tuple(k for k, row in enumerate(rows) if row["Remove"]),
        {k: row["Colour"] for k, row in enumerate(rows) if row["SetColour"]},
        tuple(k for k, row in enumerate(rows) if row["Split"]),
        tuple(colour["Value"] for colour in colours if colour["Add"]),
        *pointed_in(values["Points"]),
    )


def pointed_in(text: str) -> tuple[tuple[tuple[Point, int], ...], tuple[tuple[Point, Point], ...]]:
    """Return the places of '1,2,3=0; 1,2,3=4,5,6' that have a region, and pairs that have the same; or BadInput."""
    points: list[tuple[Point, int]] = []
    same: list[tuple[Point, Point]] = []
    for one in filter(str.strip, text.split(";")):
        place, _, said = one.partition("=")
        found = places_in(place, "Points")
        if found and said.strip().isascii() and said.strip().isdigit():
            points.append((found[0], int(said)))
            continue
        others = places_in(said, "Points")
        if not found or not others:
            raise BadInput(
                f"'{one.strip()}' does not point at a place: write x,y,z=region or x,y,z=x,y,z; semicolons separate."
            )
        same.append((found[0], others[0]))
    return tuple(points), tuple(same)


def check_pointed(scene: Scene, text: str) -> None:
    """Check places of the property Points for a scene before more follow; raise BadInput, also if it is joined."""
    from svv.train.palette.pointed import check_places

    scene.check_alone("Palette correction")
    check_places(scene, *pointed_in(text))
