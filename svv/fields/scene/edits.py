"""Edits of a scene's regions. Editing trains nothing: an edit is a few numbers.

Every field of a :class:`svv.fields.scene.region.Region` is an edit except those that identify the region
(:data:`svv.fields.scene.history.IDENTITY`). A new kind of edit is therefore a new field there; undo, reset and the
scene file handle it without further changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from svv.core.colour.colour import to_hex
from svv.core.colour.light import Lamp, checked_coefficients
from svv.core.images.outlines import Pen
from svv.errors import BadInput, Progress, silent
from svv.fields.radiance.matcaps import check_has_normals, checked_matcap, said_of
from svv.fields.scene.history import Edits, History, Step, edits_of, named_alone, restyled, with_edits
from svv.fields.scene.model import Model
from svv.fields.scene.parts import counted
from svv.fields.scene.region import Region, checked_name, checked_space
from svv.fields.scene.splitting import piece_at
from svv.fields.strokes.stroke_edits import checked_edits, said
from svv.options.editing import OUTLINE_COLOUR, OUTLINE_WIDTH, SPLIT_LEVEL, RecolourName

if TYPE_CHECKING:
    from typing_extensions import Self


@dataclass(frozen=True)
class EditedModel(Model):
    """A model and its edits. Each edit returns a new model that shares the networks and can undo the edit."""

    history: History = field(default_factory=History)
    """The steps that can be undone and redone."""

    def edited(
        self,
        region: int,
        colour: Sequence[float] | None = None,
        opacity: float | None = None,
        lighting: float | None = None,
        name: str | None = None,
        recolour_in: RecolourName | None = None,
        matcap: str | None = None,
        **reflects: float | None,
    ) -> Self:
        """Return a scene with one region's colour, opacity, lighting or name changed (photorealistic style editing).

        Args:
            region: Number of the region.
            colour: New palette colour of the region, RGB in [0, 1]; its shades change with it.
            opacity: Factor on the extinction, >= 0; 1 is as trained.
            lighting: Factor on the lighting, >= 0; 1 is as trained, 0 shows the flat material.
            recolour_in: Space in which its shades follow its colour, ``hsb`` or ``oklab``.
            name: What the region shows, such as ``bone``; empty takes its name away.
            matcap: Name of a MatCap, file of a square picture of a lit sphere, or ``none``.
            reflects: Under an explicit light, ``ambient``, ``diffuse`` and ``specular``, fractions of the light, >= 0,
                and ``shininess``, the highlight's exponent, >= 1.

        Raises:
            BadInput: Something does not exist or is out of range, or the region or its light cannot be changed so.
        """
        self._check(region)
        changes, said = Edits(), list[str]()
        if colour is not None:
            if len(colour) != 3 or not all(0.0 <= c <= 1.0 for c in colour):
                raise BadInput(f"{tuple(colour)} is not a colour: give red, green and blue between 0 and 1.")
            if self.regions[region].style is not None:
                raise BadInput(
                    f"Region {region} is styled: its colours come from the style '{self.regions[region].style}', not "
                    "from the palette, so only its opacity and lighting can be edited; stylize again with --keep "
                    f"{region} to recolour it."
                )
            r, g, b = (float(c) for c in colour)
            changes["edited_colour"] = (r, g, b)
            said.append(f"colour {to_hex((r, g, b))}")
        for what, factor in (("opacity", opacity), ("lighting", lighting)):
            if factor is not None:
                if not (np.isfinite(factor) and factor >= 0):
                    raise BadInput(f"The {what} factor must be a number of at least 0, not {factor}.")
                changes[what] = float(factor)
                said.append(f"{what} {factor:g}")
        if matcap is not None:
            check_has_normals(self)
        texts = ("recolour_in", recolour_in, checked_space), ("name", name, checked_name)
        for what, text, checked in (*texts, ("matcap", matcap, checked_matcap)):
            if text is not None:
                changes[what] = checked(text)
                said.append(f"{what.replace('_', ' ')} {said_of(changes[what])}")
        if given := checked_coefficients(reflects):
            self._check_light()
            changes |= given
            said += [f"{what} {value:g}" for what, value in given.items()]
        return self._changed(f"region {region}: {', '.join(said)}", {region: changes})

    def with_light(
        self,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        direction: Sequence[float] | None = None,
        intensity: float | None = None,
    ) -> Self:
        """Return a scene with the light moved; without arguments it becomes a headlight of the same brightness again.

        Args:
            azimuth: Degrees to the right of the camera, which the light follows, in [-180, 180].
            elevation: Degrees above the camera, in [-90, 90].
            direction: World direction that the light comes from instead, x, y and z; it no longer follows the camera.
            intensity: Factor on its brightness, >= 0; 1 is the light of the views. Unchanged by default.

        Raises:
            BadInput: The lighting comes from a network, the scene has no light, or a number is out of range.
        """
        self._check_light()
        if direction is not None and (azimuth or elevation):
            raise BadInput("Give the light either angles relative to the camera or a direction in the world, not both.")
        fixed: Any = None if direction is None else tuple(direction)
        bright = self.lamp.intensity if intensity is None else intensity
        lamp = Lamp(float(azimuth), float(elevation), fixed, float(bright))
        return self._after(lamp.said(), self.regions, lamp)

    def hidden(self, *regions: int) -> Self:
        """Return a scene in which these regions are hidden; their opacities are kept for when they are shown again.

        Raises:
            BadInput: No region is named, or a region does not exist.
        """
        self._check(*regions)
        return self._changed(f"hide {_list(regions)}", {region: {"hidden": True} for region in regions})

    def shown(self, *regions: int) -> Self:
        """Return a scene in which these regions, by default all, are visible again, as opaque as they were.

        Raises:
            BadInput: There is no such region.
        """
        self._check(*(chosen := regions or tuple(range(len(self.regions)))))
        return self._changed(f"show {_list(regions) or 'all'}", {region: {"hidden": False} for region in chosen})

    def isolated(self, *regions: int) -> Self:
        """Return a scene in which only these regions are visible; all opacities are kept.

        Raises:
            BadInput: No region is named, or a region does not exist.
        """
        self._check(*regions)
        hidden = {k: {"hidden": k not in regions} for k in range(len(self.regions))}
        return self._changed(f"isolate {_list(regions)}", hidden)

    def split_at(self, point: Sequence[float], level: float = SPLIT_LEVEL, progress: Progress = silent) -> Self:
        """Return the scene with the connected part of a region at a point as a region of its own, the last one.

        It looks the same until one of the two is edited (:mod:`svv.fields.scene.splitting`).

        Args:
            point: World coordinates of a point in the part; :meth:`svv.fields.scene.scene.Scene.point_at` finds one.
            level: Fraction of the region's mean opacity from which its cells connect, in (0, 1].
            progress: Called several times a second.

        Raises:
            BadInput: Nothing is at the point, the region is in one piece, or the level is out of range.
        """
        region, parts, share = piece_at(self, point, level, progress)
        return replace(self.with_part(region, share), parts=parts)

    def with_part(self, region: int, share: float) -> Self:
        """Return the scene with one more region, a part of this one; ``share``: fraction of the region's opacity."""
        whole = self.regions[region]
        part = replace(whole, part_of=region, share=share * whole.share, name=None)
        return replace(self._after(f"split region {region}", (*self.regions, part)), unsplit=())

    def with_strength(self, strength: float, *regions: int) -> Self:
        """Return a scene with the styles of these regions, by default all, at a strength of 0 (palette colours) to 1.

        Raises BadInput if the strength is outside [0, 1], or a region does not exist.
        """
        return self._with_amount("strength", strength, regions, "The strength of a style")

    def with_paint_light(self, amount: float, *regions: int) -> Self:
        """Return a scene with more or less light on the paint of these regions, by default of all that are painted.

        Its mean brightness stays, because a fraction ``amount`` of the light's deviation from its mean is shown.

        Raises:
            BadInput: The amount is outside [0, 1], or a region does not exist.
        """
        return self._with_amount("paint_light", amount, regions, "The light on paint")

    def with_stroke_opacity(self, amount: float, *regions: int) -> Self:
        """Return a scene in which the opacity of these regions' paint, by default of all, follows its strokes.

        Mean opacities (:mod:`svv.fields.strokes.stroke_opacity`) and regions without paint or of one colour stay. Above
        0 dark strokes are more opaque and light ones less, below 0 the other way round.

        Raises:
            BadInput: The amount is outside [-1, 1], or a region does not exist.
        """
        return self._with_amount("stroke_opacity", amount, regions, "The opacity of strokes", least=-1.0)

    @property
    def regions_with_strokes(self) -> tuple[int, ...]:
        """Numbers of the regions that are painted by strokes."""
        return tuple(self.stroked)

    def with_strokes(
        self,
        *regions: int,
        relief: float | None = None,
        width: float | None = None,
        light: Sequence[float] | None = None,
        palette: Sequence[Sequence[float]] | None = None,
    ) -> Self:
        """Return a scene with other strokes in these regions, by default in all that have any, without laying them.

        Args:
            regions: Numbers of the regions.
            relief: Factor on the relief of thick paint, in [0, 4]. What is None does not change.
            width: Factor on the width of strokes, in [0.5, 2].
            light: World direction from which the relief is lit, x, y and z; empty for the painting's own.
            palette: Colours that strokes of the same tone get, RGB in [0, 1] (C, 3), for example of another picture
                (:func:`svv.styles.stroke_palette.palette_of`); empty for the painting's own.

        Raises:
            BadInput: A number, direction or colour is out of range, or a region does not exist or has no strokes.
        """
        edits = checked_edits(relief, width, light, palette)
        there = self.regions_with_strokes
        if regions:
            self._check(*regions)
        for region in regions:
            if region not in there:
                raise BadInput(f"Region {region} has no strokes to edit: paint it with svv stylize --manner strokes.")
        if not there:
            raise BadInput("No region of this painting has strokes: paint it with svv stylize --manner strokes.")
        return self._changed(said(edits), dict.fromkeys(regions or there, edits))

    def with_outline(
        self,
        strength: float | None = None,
        *regions: int,
        width: float | None = None,
        colour: Sequence[float] | None = None,
    ) -> Self:
        """Return a scene with the silhouettes and creases of these regions, by default of all, drawn in ink.

        Args:
            strength: Opacity of the ink, from 0 (invisible) to 1. Unchanged by default, or 1 where it is 0.
            regions: Numbers of the regions.
            width: Width of silhouettes in (0, 16], in pixels of an image whose shorter side has 800; it scales with
                the image, and creases are thinner. Unchanged by default.
            colour: RGB in [0, 1]. Unchanged by default; initially nearly black.

        Raises:
            BadInput: A strength, width or colour is out of range, or a region does not exist.
        """
        ink = None if colour is None else tuple(float(c) for c in colour)
        wide = OUTLINE_WIDTH if width is None else width
        Pen(1.0 if strength is None else strength, wide, cast(Any, ink or OUTLINE_COLOUR))
        self._check(*regions or range(len(self.regions)))
        told = {"outline_width": width if width is None else float(width), "outline_colour": ink}
        given, changes = {name: value for name, value in told.items() if value is not None}, dict[int, Edits]()
        for k in regions or range(len(self.regions)):
            seen = (self.regions[k].outline or 1.0) if strength is None else float(strength)
            changes[k] = {"outline": seen, **given}
        said = [f"outline{'' if strength is None else f' {strength:g}'}"]
        said += [] if width is None else [f"{width:g} px wide"]
        said += [] if ink is None else [f"of {to_hex(cast(Any, ink))}"]
        return self._changed(", ".join(said), changes)

    def reset(self, *regions: int) -> Self:
        """Return a scene with these regions, by default all and the light, as trained and painted, with their names.

        Raises:
            BadInput: There is no such region.
        """
        chosen = regions or tuple(range(len(self.regions)))
        self._check(*chosen)
        after = tuple(with_edits(r, named_alone(r)) if k in chosen else r for k, r in enumerate(self.regions))
        return self._after(f"reset {_list(regions) or 'all'}", after, self.lamp if regions else Lamp())

    def undone(self) -> Self:
        """Return the scene before the last edit.

        Raises:
            BadInput: Nothing was edited, or every edit is undone already.
        """
        if not self.history.past:
            raise BadInput("There is nothing to undo: the scene's history holds no edits.")
        *past, step = self.history.past
        return self._at(step, History(tuple(past), (*self.history.future, self.as_step(step.what))))

    def redone(self) -> Self:
        """Return the scene with the most recently undone edit applied again.

        Raises:
            BadInput: Nothing was undone since the last edit.
        """
        if not self.history.future:
            raise BadInput("There is nothing to redo: no edit was undone since the last one.")
        *future, step = self.history.future
        return self._at(step, History((*self.history.past, self.as_step(step.what)), tuple(future)))

    def as_step(self, what: str) -> Step:
        """Return the current edits as a step for the history."""
        return Step(what, tuple(map(edits_of, self.regions)), self.lamp)

    def as_one_step(self, before: EditedModel) -> Self:
        """Return the scene with all its edits since ``before``, an earlier state of it, as one step of the history."""
        known = {id(step) for step in before.history.past}
        steps = [step.what for step in self.history.past if id(step) not in known]
        if len(steps) < 2:
            return self
        if self.regions == before.regions and self.lamp == before.lamp:
            return replace(self, history=before.history)
        return replace(self, history=before.history.after(before.as_step("; ".join(steps))))

    def with_edits_of(self, other: EditedModel) -> Self:
        """Return this scene with the edits, and their history, of another scene that has the same regions.

        Which regions are styled, and how strongly, does not change.
        """
        regions = (
            replace(restyled(theirs, own.style), strength=own.strength, mean_light=own.mean_light)
            for own, theirs in zip(self.regions, other.regions, strict=True)
        )
        shown = replace(self, regions=tuple(regions), unsplit=other.unsplit, lamp=other.lamp, history=other.history)
        return shown.with_parts_of(other)

    def with_parts_of(self, other: EditedModel) -> Self:
        """Return this scene with the parts of another one."""
        return replace(self, parts=other.parts)

    def _check_light(self) -> None:
        if self.settings.lighting == "none":
            raise BadInput("This scene has no light to change: its views were drawn without shading.")
        if self.settings.lighting != "phong":
            raise BadInput(
                "The light of this scene cannot be moved, because a network learned it together with the surfaces: "
                "train it again with --lighting phong (in ParaView: Lighting of StyleRF Train) for a light that can."
            )

    def _check(self, *regions: int) -> None:
        if not self.regions:
            raise BadInput("The scene has no regions because it holds no palette network; train it again.")
        if not regions:
            raise BadInput(f"Name at least one region, from 0 to {len(self.regions) - 1}.")
        for region in regions:
            if not 0 <= region < len(self.regions):
                raise BadInput(f"There is no region {region}: the scene has the regions 0 to {len(self.regions) - 1}.")

    def _with_amount(self, field: str, amount: float, regions: Sequence[int], said: str, least: float = 0.0) -> Self:
        """Return the scene with one number, from ``least`` to 1, of these regions, or of all if none is named."""
        if not least <= amount <= 1.0:
            raise BadInput(f"{said} must lie between {least:g} and 1, not {amount}.")
        if regions:
            self._check(*regions)
        short = "light on paint" if field == "paint_light" else field.replace("_", " ")
        every = regions or range(len(self.regions))
        return self._changed(f"{short} {amount:g}", {k: {field: float(amount)} for k in every})

    def _changed(self, what: str, changes: dict[int, Edits]) -> Self:
        return self._after(what, tuple(replace(r, **changes.get(k, {})) for k, r in enumerate(self.regions)))

    def _after(self, what: str, regions: tuple[Region, ...], lamp: Lamp | None = None) -> Self:
        """Return the scene with other regions or light, and one more step in its history unless they are the same."""
        lamp = lamp or self.lamp
        if regions == self.regions and lamp == self.lamp:
            return self
        history = self.history.after(self.as_step(what))
        return replace(self, regions=regions, lamp=lamp, history=history)

    def _at(self, step: Step, history: History) -> Self:
        """Return the scene at a step. Regions that were not yet split there wait for the split to be redone."""
        every, count = self.every_region, len(step.edits)
        regions = tuple(with_edits(r, e) for r, e in zip(every[:count], step.edits, strict=True))
        return replace(self, regions=regions, unsplit=every[count:], lamp=step.lamp, history=history).counted()

    def counted(self) -> Self:
        """Return the scene with as many active parts as its regions are."""
        return replace(self, parts=counted(self.parts, self.regions, 0))


def _list(regions: Sequence[int]) -> str:
    return ", ".join(map(str, regions))
