"""A look on a scene: its regions are painted where the look is, and get its edits, as one step of the history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from svv.core.colour.light import COEFFICIENTS, Lamp
from svv.errors import Progress, part, silent
from svv.fields.scene.history import with_edits
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.job.looks.look_content import Laid, LookContent, LookRegion, region_with
from svv.job.looks.matching import Matches, matched
from svv.options.making import PaintOptions
from svv.train.pipeline import stylize_scene


@dataclass(frozen=True)
class Applied:
    """The result of a look on a scene."""

    scene: Scene
    matches: Matches
    notes: tuple[str, ...]
    """Sentences about what could not be taken over, and about how regions were painted."""


def applied(
    look: LookContent,
    scene: Scene,
    mapping: Mapping[int, int] | None = None,
    progress: Progress = silent,
    checkpoint: Path | None = None,
    **paint: object,
) -> Applied:
    """Return a scene with a look; its device does the work.

    A region that a look's region matches (:func:`.matching.matched`, which also takes the ``mapping``) gets its colour,
    style and edits in place of its own; others stay. A look whose one picture paints all of its regions is divided anew
    among all regions of a scene that has other ones (:meth:`.matching.Matches.divided_anew`). The painting replaces the
    scene's painting of the same name; it is saved to the ``checkpoint`` regularly, and resumes from it. ``paint`` are
    fields of :class:`svv.options.making.PaintOptions` to change, such as ``preset`` or ``variant``. Raises BadInput if
    nothing matches, or the scene cannot be painted so.
    """
    matches = matched(look, scene, mapping)
    source = {match.region: look.regions[match.source] for match in matches.pairs}
    result, notes = _painted(look, scene, source, matches, progress, checkpoint, paint)
    phong = scene.settings.lighting == "phong"
    regions = list(result.regions)
    for number, theirs in source.items():
        regions[number] = _looking_like(regions[number], theirs, phong)
    lamp = result.lamp
    if phong and look.lamp is not None:
        lamp = look.lamp
    elif look.lamp is not None and look.lamp != Lamp():
        if scene.base.density is not None:
            lamp = replace(lamp, **look.lamp.casts)
        elif look.lamp.shadow > 0.0:
            notes.append("The shadows of the look were left out, because this scene's extinction is in a hash grid.")
        if replace(look.lamp, **Lamp().casts) != Lamp():
            notes.append("The light of the look was left out, because the light of this scene cannot be moved.")
    if tuple(regions) != result.regions or lamp != result.lamp:
        history = result.history.after(result.as_step("look" + (f" {look.title}" if look.title else "")))
        result = replace(result, regions=tuple(regions), lamp=lamp, history=history)
    progress(1.0, "look")
    return Applied(result, matches, tuple(dict.fromkeys(notes)))


def _looking_like(region: Region, theirs: LookRegion, phong: bool) -> Region:
    edits = region_with(region, theirs)
    if not phong:
        edits = {name: value for name, value in edits.items() if name not in COEFFICIENTS}
    if theirs.style is None and region.style is not None:
        edits["strength"] = 0.0  # the palette's colours, as in the look
    return with_edits(region, edits)


def _options(laid: Laid) -> PaintOptions:
    """Return the options with which paint is laid so."""
    return PaintOptions(
        manner="auto" if laid.manner not in ("strokes", "pieces") else laid.manner,  # type: ignore[arg-type]
        hand=laid.hand if laid.manner == "strokes" else "auto",  # type: ignore[arg-type]
        stroke_size=laid.stroke_size,
    )


def _drop_manner_hint(notes: Sequence[str]) -> list[str]:
    return [note for note in notes if not note.endswith("--manner chooses otherwise.")]


def _painted(
    look: LookContent,
    scene: Scene,
    source: Mapping[int, LookRegion],
    matches: Matches,
    progress: Progress,
    checkpoint: Path | None,
    paint: Mapping[str, object],
) -> tuple[Scene, list[str]]:
    """Return the scene with the paint of a look, a pass for each way to lay it, and the notes of the painting."""
    if (style := matches.divided_anew(look)) is not None:
        options: Any = _options(look.regions[0].laid)
        scene, report = stylize_scene(scene, [style], replace(options, **paint), progress, checkpoint)
        return scene, _drop_manner_hint(report["notes"])
    ways: dict[Laid, dict[int, str]] = {}
    for number, theirs in source.items():
        if theirs.style is not None:
            ways.setdefault(theirs.laid, {})[number] = theirs.style
    notes: list[str] = []
    for count, (laid, names) in enumerate(ways.items()):
        used = sorted(set(names.values()))
        mapping = {region: used.index(name) for region, name in names.items()}
        options = replace(_options(laid), mapping=mapping, divide="no", go_on=count > 0)
        asked: dict[str, Any] = {name: value for name, value in paint.items() if count == 0 or name != "variant"}
        saved = None if checkpoint is None else checkpoint.with_name(f"{checkpoint.name}.{count}")
        each = part(progress, count / len(ways), (count + 1) / len(ways))
        styles = [look.styles[name] for name in used]
        scene, report = stylize_scene(scene, styles, replace(options, **asked), each, saved)
        notes += _drop_manner_hint(report["notes"])
        if saved is not None:
            saved.unlink(missing_ok=True)
    return scene, notes
