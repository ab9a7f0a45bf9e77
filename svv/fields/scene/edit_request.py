"""One request of a command or a panel, applied to a scene as one step of its history."""

from __future__ import annotations

from typing import TYPE_CHECKING

from svv.errors import Progress, silent
from svv.options.editing import SPLIT_LEVEL, SceneEdit

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene


def with_edit(scene: Scene, edit: SceneEdit, progress: Progress = silent) -> Scene:
    """Return the scene with everything in the request applied, as one step that can be undone; BadInput as its edits.

    Resets are applied first, then a split, visibility, cuts, regions, light, shadows, occlusion, paint, sections and
    outlines.
    """
    result, seen = scene, edit.visibility
    if seen.reset is not None:
        result = result.reset(*seen.reset)
    if edit.part.split_at is not None:
        level = SPLIT_LEVEL if edit.part.split_level is None else edit.part.split_level
        result = result.split_at(edit.part.split_at, level, progress)
    if seen.isolate is not None:
        result = result.isolated(*seen.isolate)
    if seen.hide is not None:
        result = result.hidden(*seen.hide)
    if seen.show is not None:
        result = result.shown(*seen.show)
    if edit.cuts.uncut:
        result = result.uncut()
    if edit.cuts.cut:
        result = result.cut(*edit.cuts.cut)
    for region, change in edit.regions.items():
        if change:
            result = result.edited(region, **change.given())
    if edit.light:
        lamp = result.lamp
        kept = {"azimuth": lamp.azimuth, "elevation": lamp.elevation, "direction": lamp.direction}
        place = kept if edit.light.light is None else edit.light.light
        result = result.with_light(**(place | {"intensity": edit.light.intensity}))
    if edit.shadow:
        cast = edit.shadow
        result = result.with_shadow(cast.shadow, cast.shadow_light, cast.shadow_softness)
    if edit.occlusion.occlusion is not None:
        result = result.with_occlusion(edit.occlusion.occlusion, *edit.of)
    if edit.paint.strength is not None:
        result = result.with_strength(edit.paint.strength, *edit.of)
    if edit.paint.paint_light is not None:
        result = result.with_paint_light(edit.paint.paint_light, *edit.of)
    if edit.paint.stroke_opacity is not None:
        result = result.with_stroke_opacity(edit.paint.stroke_opacity, *edit.of)
    if edit.paint.of_strokes:
        result = result.with_strokes(*edit.of, **edit.paint.of_strokes)
    if edit.sections:
        result = result.with_section(edit.sections.section, *edit.of, line=edit.sections.section_line)
    if edit.outline:
        ink = edit.outline
        result = result.with_outline(ink.outline, *edit.outlined, width=ink.outline_width, colour=ink.outline_colour)
    return result.as_one_step(scene)
