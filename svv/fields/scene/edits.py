"""Edits of a scene's regions, which train nothing; :class:`svv.fields.scene.scene.Scene` has them as methods.

Each function returns a new scene that shares the networks and can undo the edit. Every field of a
:class:`svv.fields.scene.region.Region` is an edit except :data:`svv.fields.scene.history.IDENTITY`: a new kind of edit
is a new field there; undo, reset and the scene file handle it without further changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from svv.core.colour.hex_codes import to_hex
from svv.core.colour.light import Lamp, validate_coefficients
from svv.core.geometry.cuts import Cut
from svv.core.images.outlines import Pen
from svv.errors import BadInput, Progress
from svv.fields.scene.history import MOST_CUTS, Edits, History, Step, edits_of, named_alone, restyled, with_edits
from svv.fields.scene.matcap_pictures import describe_matcap, validate_matcap
from svv.fields.scene.parts import counted
from svv.fields.scene.region import Region, validate_name, validate_space
from svv.fields.scene.stroke_edits import describe_stroke_edits, validate_stroke_edits
from svv.options.editing import OUTLINE_COLOUR, OUTLINE_WIDTH, SHADOW, WIDEST_LINE, RecolourName, SectionName

if TYPE_CHECKING:
    from svv.fields.scene.model import Model, S


def edited(
    scene: S,
    region: int,
    colour: Sequence[float] | None = None,
    opacity: float | None = None,
    lighting: float | None = None,
    name: str | None = None,
    recolour_in: RecolourName | None = None,
    matcap: str | None = None,
    **reflects: float | None,
) -> S:
    """Return a scene with one region's colour, opacity, lighting or name changed (photorealistic style editing).

    Args:
        scene: The scene.
        region: Number of the region.
        colour: New palette colour of the region, RGB in [0, 1]; its shades change with it.
        opacity: Factor on the extinction, >= 0; 1 is as trained.
        lighting: Factor on the lighting, >= 0; 1 is as trained, 0 shows the flat material.
        name: What the region shows, such as ``bone``; empty takes its name away.
        recolour_in: Space in which its shades follow its colour, ``hsb`` or ``oklab``.
        matcap: Name of a MatCap, file of a square picture of a lit sphere, or ``none``.
        reflects: Under an explicit light, ``ambient``, ``diffuse`` and ``specular``, fractions of the light, >= 0, and
            ``shininess``, the highlight's exponent, >= 1.

    Raises:
        BadInput: Something does not exist or is out of range, or the region or its light cannot be changed so.
    """
    check_regions(scene, region)
    changes, said = Edits(), list[str]()
    if colour is not None:
        if len(colour) != 3 or not all(0.0 <= c <= 1.0 for c in colour):
            raise BadInput(f"{tuple(colour)} is not a colour: give red, green and blue between 0 and 1.")
        if scene.regions[region].style is not None:
            raise BadInput(
                f"Region {region} is styled: its colours come from the style '{scene.regions[region].style}', not "
                "from the palette, so only its opacity and lighting can be edited; leave it unpainted to "
                f"recolour it (svv stylize --keep {region})."
            )
        r, g, b = (float(c) for c in colour)
        changes["edited_colour"] = (r, g, b)
        said.append(f"colour {to_hex((r, g, b))}")
    for what, factor in {"opacity": opacity, "lighting": lighting}.items():
        if factor is not None:
            if not (np.isfinite(factor) and factor >= 0):
                raise BadInput(f"The {what} factor must be a number of at least 0, not {factor}.")
            changes[what] = float(factor)
            said.append(f"{what} {factor:g}")
    if matcap is not None:
        check_has_normals(scene)
    validators = (validate_space, recolour_in), (validate_name, name), (validate_matcap, matcap)
    for what, (validate, text) in zip(("recolour_in", "name", "matcap"), validators, strict=True):
        if text is not None:
            changes[what] = validate(text)
            said.append(f"{what.replace('_', ' ')} {describe_matcap(changes[what])}")
    if given := validate_coefficients(reflects):
        _check_light([scene.every_layer[scene.regions[region].layer]])
        changes |= given
        said += [f"{what} {value:g}" for what, value in given.items()]
    return changed(scene, f"region {region}: {', '.join(said)}", {region: changes})


def with_light(
    scene: S,
    azimuth: float = 0.0,
    elevation: float = 0.0,
    direction: Sequence[float] | None = None,
    intensity: float | None = None,
) -> S:
    """Return a scene with the light moved; without arguments it becomes a headlight of the same brightness again.

    ``azimuth`` and ``elevation``: degrees to the right, in [-180, 180], and above the camera, in [-90, 90], which the
    light follows; ``direction``: world direction that the light comes from instead, x, y and z; ``intensity``: factor
    on its brightness, >= 0; 1 is the light of the views, and it is unchanged by default. Raises BadInput if the
    lighting comes from a network, the scene has no light, or a number is out of range.
    """
    _check_light(scene.every_layer)
    if direction is not None and (azimuth or elevation):
        raise BadInput("Give the light either angles relative to the camera or a direction in the world, not both.")
    fixed: Any = None if direction is None else tuple(direction)  # Lamp checks that they are three
    bright = scene.lamp.intensity if intensity is None else intensity
    place = {"azimuth": float(azimuth), "elevation": float(elevation), "direction": fixed}
    lamp = replace(scene.lamp, **place, intensity=float(bright))
    return after(scene, replace(lamp, shadow=0.0).describe(), scene.regions, lamp)


def with_shadow(
    scene: S,
    amount: float | None = None,
    light: Sequence[float] | None = None,
    softness: float | None = None,
) -> S:
    """Return a scene that casts shadows, or casts others; what is None does not change.

    Args:
        scene: The scene.
        amount: How far they darken, in [0, 1]; 0 casts none. Unchanged by default, or 0.7 where it is 0.
        light: Where they come from: degrees to the right of the camera, in [-180, 180], and above it, in [-90, 90],
            which they follow; or a world direction x, y and z. Empty for the light that :meth:`svv.Scene.with_light`
            moved, and the upper left of the camera where none was moved, as at first.
        softness: Opening angle of the light in degrees, in [0, 60]; 0 gives sharp edges. Initially 6.

    Raises:
        BadInput: Something is out of range, or the extinction is in a hash grid.
    """
    for layer in scene.every_layer:
        check_has_extinction(layer, "shadow")
    check_regions(scene, 0)
    changes: dict[str, Any] = {"shadow": (scene.lamp.shadow or SHADOW) if amount is None else float(amount)}
    if light is not None:
        changes["shadow_light"] = tuple(float(v) for v in light) or None
    if softness is not None:
        changes["shadow_softness"] = float(softness)
    lamp = replace(scene.lamp, **changes)
    return after(scene, lamp.describe_shadow() if lamp.shadow else "no shadows", scene.regions, lamp)


def hidden(scene: S, *regions: int) -> S:
    """Return a scene in which these regions are hidden; their opacities are kept for when they are shown again.

    Raises BadInput if no region is named, or a region does not exist; so do :func:`shown` and :func:`isolated`.
    """
    check_regions(scene, *regions)
    return changed(scene, f"hide {_listed(regions)}", {region: {"hidden": True} for region in regions})


def shown(scene: S, *regions: int) -> S:
    """Return a scene in which these regions, by default all, are visible again, as opaque as they were."""
    check_regions(scene, *(chosen := regions or range(len(scene.regions))))
    return changed(scene, f"show {_listed(regions) or 'all'}", {region: {"hidden": False} for region in chosen})


def isolated(scene: S, *regions: int) -> S:
    """Return a scene in which only these regions are visible; all opacities are kept."""
    check_regions(scene, *regions)
    rest = {k: {"hidden": k not in regions} for k in range(len(scene.regions))}
    return changed(scene, f"isolate {_listed(regions)}", rest)


def split_at(scene: S, point: Sequence[float], level: float, progress: Progress) -> S:
    """Return a scene of one transfer function, split at a point; see :meth:`svv.Scene.split_at`."""
    from svv.fields.scene.splitting import piece_at

    region, parts, share = piece_at(scene, point, level, progress)
    # Styles of parts that were undone must not become those of the new part.
    others = tuple(replace(other, styles=other.styles[: len(scene.regions)]) for other in scene.others)
    return replace(with_part(scene, region, share), parts=parts, others=others)


def with_part(scene: S, region: int, share: float) -> S:
    """Return the scene with one more region, a part of this one; ``share``: fraction of the region's opacity."""
    whole = scene.regions[region]
    part = replace(whole, part_of=region, share=share * whole.share, name=None)
    return replace(after(scene, f"split region {region}", (*scene.regions, part)), unsplit=())


def _with_amount(scene: S, field: str, amount: float, regions: Sequence[int], said: str, least: float = 0.0) -> S:
    """Return the scene with one number, from ``least`` to 1, of these regions, or of all if none is named."""
    if not least <= amount <= 1.0:
        raise BadInput(f"{said} must lie between {least:g} and 1, not {amount}.")
    if regions:
        check_regions(scene, *regions)
    short = "light on paint" if field == "paint_light" else field.replace("_", " ")
    every = regions or range(len(scene.regions))
    return changed(scene, f"{short} {amount:g}", {k: {field: float(amount)} for k in every})


def with_strength(scene: S, strength: float, *regions: int) -> S:
    """Return a scene with the styles of these regions, by default all, at a strength of 0 (palette colours) to 1.

    Raises BadInput if the strength is outside [0, 1], or a region does not exist.
    """
    return _with_amount(scene, "strength", strength, regions, "The strength of a style")


def with_paint_light(scene: S, amount: float, *regions: int) -> S:
    """Return a scene with more or less light on the paint of these regions, by default of all that are painted.

    Its mean brightness stays, because a fraction ``amount`` of the light's deviation from its mean is shown. Raises
    BadInput if the amount is outside [0, 1], or a region does not exist.
    """
    return _with_amount(scene, "paint_light", amount, regions, "The light on paint")


def with_stroke_opacity(scene: S, amount: float, *regions: int) -> S:
    """Return a scene in which the opacity of these regions' paint, by default of all, follows its strokes.

    Nothing becomes more opaque (:mod:`svv.fields.scene.stroke_opacity`): above 0 pale paint becomes clearer, below 0
    dark paint. Regions without paint or of one colour stay. BadInput for amounts outside [-1, 1], or if a region does
    not exist.
    """
    return _with_amount(scene, "stroke_opacity", amount, regions, "The opacity of strokes", least=-1.0)


def with_occlusion(scene: S, amount: float, *regions: int) -> S:
    """Return a scene in which cavities of these regions, by default of all, are darkened by an amount up to 1.

    Raises BadInput if the amount is outside [0, 1], a region does not exist, or the extinction is in a hash grid.
    """
    for layer in scene.every_layer:
        check_has_extinction(layer, "ambient occlusion")
    return _with_amount(scene, "occlusion", amount, regions, "The ambient occlusion")


def with_strokes(
    scene: S,
    *regions: int,
    relief: float | None = None,
    width: float | None = None,
    light: Sequence[float] | None = None,
    palette: Sequence[Sequence[float]] | None = None,
) -> S:
    """Return a scene with other strokes in these regions, by default in all that have any, without laying them.

    Args:
        scene: The scene.
        regions: Numbers of the regions.
        relief: Factor on the relief of thick paint, in [0, 4]. What is None does not change.
        width: Factor on the width of strokes, in [0.5, 2].
        light: World direction from which the relief is lit, x, y and z; empty for the painting's own.
        palette: Colours that strokes of the same tone get, RGB in [0, 1] (C, 3), for example of another picture
            (:func:`svv.styles.stroke_palette.palette_of`); empty for the painting's own.

    Raises:
        BadInput: A number, direction or colour is out of range, or a region does not exist or has no strokes.
    """
    edits = validate_stroke_edits(relief, width, light, palette)
    there = scene.regions_with_strokes
    if regions:
        check_regions(scene, *regions)
    for region in regions:
        if region not in there:
            raise BadInput(f"Region {region} has no strokes to edit: paint it with svv stylize --manner strokes.")
    if not there:
        raise BadInput("No region of this painting has strokes: paint it with svv stylize --manner strokes.")
    return changed(scene, describe_stroke_edits(edits), dict.fromkeys(regions or there, edits))


def with_outline(
    scene: S,
    strength: float | None = None,
    *regions: int,
    width: float | None = None,
    colour: Sequence[float] | None = None,
) -> S:
    """Return a scene with the silhouettes and creases of these regions, by default of all, drawn in ink.

    Args:
        scene: The scene.
        strength: Opacity of the ink, from 0 (invisible) to 1. Unchanged by default, or 1 where it is 0.
        regions: Numbers of the regions.
        width: Width of silhouettes in (0, 16], in pixels of an image whose shorter side has 800; it scales with the
            image, and creases are thinner. Unchanged by default.
        colour: RGB in [0, 1]. Unchanged by default; initially nearly black.

    Raises:
        BadInput: A strength, width or colour is out of range, or a region does not exist.
    """
    ink = None if colour is None else tuple(float(c) for c in colour)
    wide = OUTLINE_WIDTH if width is None else width
    Pen(1.0 if strength is None else strength, wide, ink or OUTLINE_COLOUR)
    check_regions(scene, *regions or range(len(scene.regions)))
    told = {"outline_width": width if width is None else float(width), "outline_colour": ink}
    given, changes = {name: value for name, value in told.items() if value is not None}, dict[int, Edits]()
    for k in regions or range(len(scene.regions)):
        seen = (scene.regions[k].outline or 1.0) if strength is None else float(strength)
        changes[k] = {"outline": seen, **given}
    said = [f"outline{'' if strength is None else f' {strength:g}'}"]
    said += [] if width is None else [f"{width:g} px wide"]
    said += [] if ink is None else [f"of {to_hex(ink)}"]
    return changed(scene, ", ".join(said), changes)


def cut(scene: S, *cuts: Cut | str) -> S:
    """Return a scene cut open: what is inside a shape, or outside of it, is not shown; nothing is trained.

    Cuts are shapes in world units, or texts that :meth:`svv.Cut.parse` reads, such as ``"x>50%&y>50%"``. Raises
    BadInput if a text is no cut, a region does not exist, or there are too many.
    """
    bounds = scene.bounds
    new = [Cut.parse(one, bounds) if isinstance(one, str) else one for one in cuts]
    for one in new:
        check_regions(scene, *(one.regions or range(len(scene.regions))))
    every = (*scene.cuts, *(one for one in dict.fromkeys(new) if one not in scene.cuts))
    if len(every) > MOST_CUTS:
        raise BadInput(f"A scene has at most {MOST_CUTS} cuts, not {len(every)}: take some away with --uncut.")
    return after(scene, "; ".join(one.describe() for one in new), scene.regions, cuts=every)


def uncut(scene: S) -> S:
    """Return the scene without its cuts, as one edit."""
    return after(scene, "uncut", scene.regions, cuts=())


def with_section(scene: S, section: SectionName | None = None, *regions: int, line: float | None = None) -> S:
    """Return a scene in which the faces of cuts show these regions, by default all, in another way.

    Args:
        scene: The scene, cut open before or later.
        section: ``learned`` as it is, ``flat`` in the region's unlit colour, or ``hatched``. Unchanged by default.
        regions: Numbers of the regions.
        line: Width of an ink line around the faces, in pixels of an image of 800 x 800, in [0, 16]; 0 draws none.
            Unchanged by default.

    Raises:
        BadInput: There is no such way, the width is out of range, or a region does not exist.
    """
    if section is not None and section not in get_args(SectionName):
        raise BadInput(f"Sections cannot be '{section}': choose {', '.join(get_args(SectionName))}.")
    if line is not None and not 0.0 <= line <= WIDEST_LINE:
        raise BadInput(f"The line around sections is from 0 to {WIDEST_LINE:g} pixels wide, not {line:g}.")
    check_regions(scene, *(chosen := regions or range(len(scene.regions))))
    given = {"section": section, "section_line": None if line is None else float(line)}
    told = {name: value for name, value in given.items() if value is not None}
    said = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in told.items())
    return changed(scene, said, {k: dict(told) for k in chosen})


def reset(scene: S, *regions: int) -> S:
    """Return a scene with these regions, by default all and the light, as trained and painted, with their names.

    Raises BadInput if there is no such region.
    """
    chosen = regions or tuple(range(len(scene.regions)))
    check_regions(scene, *chosen)
    plain = tuple(with_edits(r, named_alone(r)) if k in chosen else r for k, r in enumerate(scene.regions))
    lamp, cuts = (scene.lamp, scene.cuts) if regions else (Lamp(), ())
    return after(scene, f"reset {_listed(regions) or 'all'}", plain, lamp, cuts)


def undone(scene: S) -> S:
    """Return the scene before the last edit; raises BadInput if there is none."""
    if not scene.history.past:
        raise BadInput("There is nothing to undo: the scene's history holds no edits.")
    *past, step = scene.history.past
    return _at(scene, step, History(tuple(past), (*scene.history.future, as_step(scene, step.what))))


def redone(scene: S) -> S:
    """Return the scene with the most recently undone edit applied again; raises BadInput if there is none."""
    if not scene.history.future:
        raise BadInput("There is nothing to redo: no edit was undone since the last one.")
    *future, step = scene.history.future
    return _at(scene, step, History((*scene.history.past, as_step(scene, step.what)), tuple(future)))


def as_step(scene: Model, what: str) -> Step:
    """Return the current edits as a step for the history."""
    return Step(what, tuple(map(edits_of, scene.regions)), scene.lamp, scene.cuts)


def as_one_step(scene: S, before: Model) -> S:
    """Return the scene with all its edits since ``before``, an earlier state of it, as one step of the history."""
    known = {id(step) for step in before.history.past}
    steps = [step.what for step in scene.history.past if id(step) not in known]
    if len(steps) < 2:
        return scene
    if (scene.regions, scene.lamp, scene.cuts) == (before.regions, before.lamp, before.cuts):
        return replace(scene, history=before.history)
    return replace(scene, history=before.history.after(as_step(before, "; ".join(steps))))


def with_edits_of(scene: S, other: Model) -> S:
    """Return the scene with the edits, and their history, of another scene that has the same regions.

    Which regions are styled, and how strongly, does not change.
    """
    regions = (
        replace(restyled(theirs, own.style, own.glaze), strength=own.strength, mean_light=own.mean_light)
        for own, theirs in zip(scene.regions, other.regions, strict=True)
    )
    shown = replace(scene, regions=tuple(regions), unsplit=other.unsplit, lamp=other.lamp, cuts=other.cuts)
    shown = replace(shown, history=other.history)
    layers = (replace(own, parts=layer.parts) for own, layer in zip(scene.layers, other.layers, strict=True))
    return replace(shown, parts=other.parts, layers=tuple(layers))


def without_undone_splits(scene: S) -> S:
    """Return the scene without the regions whose splits were undone; nothing that was undone can be redone then."""
    if not scene.unsplit:
        return scene
    first, *others = (s.parts and s.parts.without_undone() for s in (scene, *scene.layers))
    return replace(
        scene, unsplit=(), history=replace(scene.history, future=()), parts=first,
        layers=tuple(replace(layer, parts=parts) for layer, parts in zip(scene.layers, others, strict=True)),
        others=tuple(replace(other, styles=other.styles[: len(scene.regions)]) for other in scene.others),
    )  # fmt: skip


def check_regions(scene: Model, *regions: int) -> None:
    """Raise BadInput unless regions are named, and there are all of them."""
    if not scene.regions:
        raise BadInput("The scene has no regions because it holds no palette network; train it again.")
    if not regions:
        raise BadInput(f"Name at least one region, from 0 to {len(scene.regions) - 1}.")
    for region in regions:
        if not 0 <= region < len(scene.regions):
            raise BadInput(f"There is no region {region}: the scene has the regions 0 to {len(scene.regions) - 1}.")


def check_has_extinction(scene: Model, what: str) -> None:
    """Raise BadInput if ``what``, such as "ambient occlusion", cannot be computed for the scene."""
    if not scene.has_extinction:
        raise BadInput(
            f"This scene's {what} cannot be computed, because its extinction is in a hash grid: train it again with "
            "--encoding lattice."
        )


def check_has_normals(scene: Model) -> None:
    """Raise BadInput if the scene has no normals to look MatCaps up by."""
    if not scene.has_normals:
        raise BadInput(
            "This scene has no normals for a MatCap, because its extinction is in a hash grid: train it again with "
            "--encoding lattice."
        )


def changed(scene: S, what: str, changes: dict[int, Edits]) -> S:
    """Return the scene with changes of its regions, by their numbers, as one more step of its history."""
    return after(scene, what, tuple(replace(r, **changes.get(k, {})) for k, r in enumerate(scene.regions)))


def after(
    scene: S, what: str, regions: tuple[Region, ...], lamp: Lamp | None = None, cuts: tuple[Cut, ...] | None = None
) -> S:
    """Return the scene with other regions, light or cuts, and one more step in its history unless they are the same."""
    lamp, cuts = lamp or scene.lamp, scene.cuts if cuts is None else cuts
    if (regions, lamp, cuts) == (scene.regions, scene.lamp, scene.cuts):
        return scene
    history = scene.history.after(as_step(scene, what))
    return replace(scene, regions=regions, lamp=lamp, cuts=cuts, history=history)


def _at(scene: S, step: Step, history: History) -> S:
    """Return the scene at a step. Regions that were not yet split there wait for the split to be redone."""
    every, count = scene.every_region, len(step.edits)
    regions = tuple(with_edits(r, e) for r, e in zip(every[:count], step.edits, strict=True))
    layers = (replace(s, parts=counted(s.parts, regions, k)) for k, s in enumerate(scene.layers, start=1))
    return replace(
        scene, regions=regions, unsplit=every[count:], lamp=step.lamp, cuts=step.cuts, history=history,
        parts=counted(scene.parts, regions, 0), layers=tuple(layers),
    )  # fmt: skip


def _check_light(layers: Sequence[Model]) -> None:
    """Raise BadInput for layers of a scene of which none has a light that can be changed."""
    lightings = {layer.settings.lighting for layer in layers}
    if lightings == {"none"}:
        raise BadInput("This scene has no light to change: its views were drawn without shading.")
    if "phong" not in lightings:
        raise BadInput(
            "The light of this scene cannot be moved, because a network learned it together with the surfaces: "
            "train it again with svv train --lighting phong for a light that can."
        )


def _listed(regions: Sequence[int]) -> str:
    return ", ".join(map(str, regions))
