"""Edits of a scene's regions, and the history that undoes them. Nothing is trained: an edit is a few numbers.

An edit is every field of a :class:`svv.fields.scene.Region` but those that say what the region is (:data:`IDENTITY`),
so a new kind of edit is a new field there, and undo, reset and the scene's file know it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from svv.core.colour import to_hex
from svv.errors import BadInput

if TYPE_CHECKING:
    from typing_extensions import Self

    from svv.fields.scene import Region

IDENTITY = ("colour", "share", "style", "values", "ranges")
"""Fields of a region that are no edits: they come from training."""

STEPS = 50
"""Edits that can be undone at most; older ones are forgotten."""

Edits = dict[str, Any]
"""The edits of one region by field, those alone that are not as trained."""


def edits_of(region: Region) -> Edits:
    """A region's edits."""
    found = ((f.name, f.default, getattr(region, f.name)) for f in fields(region) if f.name not in IDENTITY)
    return {name: value for name, default, value in found if value != default}


def with_edits(region: Region, edits: Edits) -> Region:
    """A region with these edits and no others; raises TypeError for what is no edit."""
    plain = {f.name: f.default for f in fields(region) if f.name not in IDENTITY}
    if unknown := sorted(set(edits) - set(plain)):
        raise TypeError(f"'{unknown[0]}' is no edit of a region")
    return replace(region, **{**plain, **edits})


@dataclass(frozen=True)
class Step:
    """One edit that can be undone, or done again."""

    what: str
    """What was done, in a few words."""
    edits: tuple[Edits, ...]
    """The edits of every region before it; of a step that was undone, after it."""


@dataclass(frozen=True)
class History:
    """What was done to a scene's regions, the last step last, and what was undone, the next to redo last."""

    past: tuple[Step, ...] = ()
    future: tuple[Step, ...] = ()

    def after(self, what: str, before: Sequence[Region]) -> History:
        """The history with one more step, from ``before`` on; what was undone cannot be redone any more."""
        return History((*self.past, Step(what, tuple(map(edits_of, before))))[-STEPS:])

    def to_json(self) -> dict[str, Any]:
        """Plain values for the scene's header."""
        return {name: [vars(step) for step in getattr(self, name)] for name in ("past", "future")}

    @classmethod
    def from_json(cls, content: dict[str, Any], regions: Sequence[Region]) -> History:
        """The inverse of :meth:`to_json`; raises KeyError, TypeError or ValueError where it fits other regions."""

        def step(values: dict[str, Any]) -> Step:
            edits = [{k: tuple(v) if isinstance(v, list) else v for k, v in e.items()} for e in values["edits"]]
            told = [edits_of(with_edits(region, e)) for region, e in zip(regions, edits, strict=True)]
            return Step(str(values["what"]), tuple(told))

        return cls(*(tuple(step(values) for values in content[name])[-STEPS:] for name in ("past", "future")))


class Editing:
    """The edits of a scene. Each makes a new scene, which shares the networks and remembers how to undo it."""

    regions: tuple[Region, ...]
    history: History

    def edited(
        self,
        region: int,
        colour: Sequence[float] | None = None,
        opacity: float | None = None,
        lighting: float | None = None,
    ) -> Self:
        """A scene with one region's colour, opacity or lighting changed (photorealistic style editing).

        Args:
            region: Which one.
            colour: RGB in [0, 1] that the region's palette colour becomes; its shades turn with it.
            opacity: Factor on the extinction, >= 0; 1 is as trained.
            lighting: Factor on the lighting, >= 0; 1 is as trained, 0 the flat material.

        Raises:
            BadInput: no such region, a colour outside [0, 1], a negative or infinite factor, or a new colour for a
                region that is styled.
        """
        self._check(region)
        changes: Edits = {}
        said = []
        if colour is not None:
            if len(colour) != 3 or not all(0.0 <= c <= 1.0 for c in colour):
                raise BadInput(f"The colour {tuple(colour)} is none: give red, green and blue between 0 and 1.")
            if self.regions[region].style is not None:
                raise BadInput(
                    f"Region {region} is styled: its colours come from the style '{self.regions[region].style}', not "
                    "from the palette, so only its opacity and lighting can be edited; stylize again with --keep "
                    f"{region} to recolour it."
                )
            r, g, b = (float(c) for c in colour)
            changes["edited_colour"] = (r, g, b)
            said.append(f"colour {to_hex((r, g, b))}")
        for name, factor in (("opacity", opacity), ("lighting", lighting)):
            if factor is not None:
                if not (np.isfinite(factor) and factor >= 0):
                    raise BadInput(f"The {name} factor must be a number of at least 0, not {factor}.")
                changes[name] = float(factor)
                said.append(f"{name} {factor:g}")
        return self._changed(f"region {region}: {', '.join(said)}", {region: changes})

    def hidden(self, *regions: int) -> Self:
        """A scene in which these regions are not seen; their opacities are kept for when they are shown again.

        Raises:
            BadInput: no region is named, or one that there is not.
        """
        self._check(*regions)
        return self._changed(f"hide {_list(regions)}", {region: {"hidden": True} for region in regions})

    def shown(self, *regions: int) -> Self:
        """A scene in which these regions, by default all, are seen again, as opaque as they were.

        Raises:
            BadInput: there is no such region.
        """
        chosen = regions or tuple(range(len(self.regions)))
        self._check(*chosen)
        return self._changed(f"show {_list(regions) or 'all'}", {region: {"hidden": False} for region in chosen})

    def isolated(self, *regions: int) -> Self:
        """A scene in which these regions alone are seen; the opacities of all are kept.

        Raises:
            BadInput: no region is named, or one that there is not.
        """
        self._check(*regions)
        hidden = {k: {"hidden": k not in regions} for k in range(len(self.regions))}
        return self._changed(f"isolate {_list(regions)}", hidden)

    def with_strength(self, strength: float, *regions: int) -> Self:
        """A scene whose styles are shown as strongly as said, from 0 (the palette's colours) to 1, by default all.

        Raises:
            BadInput: a strength outside of [0, 1], or a region that there is not.
        """
        if not 0.0 <= strength <= 1.0:
            raise BadInput(f"The strength of a style must lie between 0 and 1, not {strength}.")
        if regions:
            self._check(*regions)
        changes = {region: {"strength": float(strength)} for region in regions or range(len(self.regions))}
        return self._changed(f"strength {strength:g}", changes)

    def reset(self, *regions: int) -> Self:
        """A scene with these regions, by default all, as they were trained and painted. It can be undone.

        Raises:
            BadInput: there is no such region.
        """
        chosen = regions or tuple(range(len(self.regions)))
        self._check(*chosen)
        after = tuple(with_edits(r, {}) if k in chosen else r for k, r in enumerate(self.regions))
        return self._after(f"reset {_list(regions) or 'all'}", after)

    def undone(self) -> Self:
        """The scene before the last edit.

        Raises:
            BadInput: nothing was edited, or all of it is undone.
        """
        if not self.history.past:
            raise BadInput("There is nothing to undo: the scene's history holds no edit.")
        *past, step = self.history.past
        redo = Step(step.what, tuple(map(edits_of, self.regions)))
        return self._at(step, History(tuple(past), (*self.history.future, redo)))

    def redone(self) -> Self:
        """The scene with the edit that was undone last.

        Raises:
            BadInput: nothing was undone since the last edit.
        """
        if not self.history.future:
            raise BadInput("There is nothing to redo: no edit was undone since the last one.")
        *future, step = self.history.future
        undo = Step(step.what, tuple(map(edits_of, self.regions)))
        return self._at(step, History((*self.history.past, undo), tuple(future)))

    def as_one_step(self, before: Editing) -> Self:
        """The scene with all its edits since ``before``, an earlier state of it, as one step of the history."""
        known = {id(step) for step in before.history.past}
        steps = [step.what for step in self.history.past if id(step) not in known]
        if len(steps) < 2:
            return self
        if self.regions == before.regions:
            return self._replaced(history=before.history)
        return self._replaced(history=before.history.after("; ".join(steps), before.regions))

    def with_edits_of(self, other: Editing) -> Self:
        """This scene with the edits, and their history, of another that has the same regions.

        Which regions are styled, and how strongly, stays.
        """
        regions = (
            replace(theirs, style=own.style, strength=own.strength)
            for own, theirs in zip(self.regions, other.regions, strict=True)
        )
        return self._replaced(regions=tuple(regions), history=other.history)

    def _check(self, *regions: int) -> None:
        if not self.regions:
            raise BadInput("The scene has no regions, as it holds no palette network; train it again.")
        if not regions:
            raise BadInput(f"Name at least one region, of 0 to {len(self.regions) - 1}.")
        for region in regions:
            if not 0 <= region < len(self.regions):
                raise BadInput(f"There is no region {region}: the scene has the regions 0 to {len(self.regions) - 1}.")

    def _changed(self, what: str, changes: dict[int, Edits]) -> Self:
        return self._after(what, tuple(replace(r, **changes.get(k, {})) for k, r in enumerate(self.regions)))

    def _after(self, what: str, regions: tuple[Region, ...]) -> Self:
        """The scene with other regions, and one more step in its history unless they are the same."""
        if regions == self.regions:
            return self
        return self._replaced(regions=regions, history=self.history.after(what, self.regions))

    def _at(self, step: Step, history: History) -> Self:
        regions = (with_edits(r, e) for r, e in zip(self.regions, step.edits, strict=True))
        return self._replaced(regions=tuple(regions), history=history)

    def _replaced(self, **changes: Any) -> Self:
        return replace(cast(Any, self), **changes)


def _list(regions: Sequence[int]) -> str:
    return ", ".join(map(str, regions))
