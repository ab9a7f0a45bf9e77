"""The edits of a region as plain values, and the history of steps that undoes and redoes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

from svv.core.colour.light import Lamp
from svv.core.geometry.cuts import Cut
from svv.fields.scene.region import Region, paint_light_of
from svv.fields.scene.scene_validation import values_of

IDENTITY = ("colour", "share", "style", "values", "ranges", "mean_light", "glaze", "part_of", "layer")
"""Fields of a region that are not edits: they come from training, painting and splitting."""

MOST_UNDO_STEPS = 50
"""Maximum number of edits that can be undone; older ones are forgotten."""

MOST_CUTS = 16
"""Most cuts of a scene."""

Edits = dict[str, Any]
"""The edits of one region by field; only those that differ from the trained values."""


def edits_of(region: Region) -> Edits:
    """Return a region's edits."""
    plain = _plain(region)
    return {name: getattr(region, name) for name in plain if getattr(region, name) != plain[name]}


def with_edits(region: Region, edits: Edits) -> Region:
    """Return a region with these edits and no others; raises TypeError for a field that is not an edit."""
    plain = _plain(region)
    if unknown := sorted(set(edits) - set(plain)):
        raise TypeError(f"'{unknown[0]}' is not an edit of a region")
    return replace(region, **{**plain, **edits})


def named_alone(region: Region) -> Edits:
    """Return the region's name as the only one of its edits, which it keeps when all others are undone."""
    return {} if region.name is None else {"name": region.name}


def restyled(region: Region, style: str | None, glaze: float) -> Region:
    """Return a region with another style and the same edits.

    Light on paint takes the style's default unless edited, and opacity follows the strokes as ``glaze`` says.
    """
    return with_edits(replace(region, style=style, glaze=glaze), edits_of(region))


def _plain(region: Region) -> Edits:
    """Return the edit fields of a region that has not been edited."""
    plain = {f.name: f.default for f in fields(region) if f.name not in IDENTITY}
    return {**plain, "paint_light": paint_light_of(region.style), "stroke_opacity": region.glaze}


def cuts_in(content: object) -> tuple[Cut, ...]:
    """Return cuts from plain values; raises BadInput, TypeError or ValueError if they are none."""
    if not isinstance(content, list) or len(content) > MOST_CUTS:
        raise ValueError(f"cuts are a list of at most {MOST_CUTS}")
    return tuple(Cut(**values_of(Cut, one)) for one in content)


@dataclass(frozen=True)
class Step:
    """One edit that can be undone or redone."""

    what: str
    """Short description of the edit."""
    edits: tuple[Edits, ...]
    """The edits of every region before the step; for a step that was undone, after it. A step that split a region has
    the edits of one region less or more than the scene."""
    lamp: Lamp = field(default_factory=Lamp)
    """The light before the step; for a step that was undone, after it."""
    cuts: tuple[Cut, ...] = ()
    """The cuts before the step; for a step that was undone, after it."""


@dataclass(frozen=True)
class History:
    """Edits made to a scene's regions, the most recent last, and edits undone, the next one to redo last."""

    past: tuple[Step, ...] = ()
    future: tuple[Step, ...] = ()

    def after(self, step: Step) -> History:
        """Return the history with one more step; undone edits can no longer be redone."""
        return History((*self.past, step)[-MOST_UNDO_STEPS:])

    def rebased(self, before: Sequence[Region], after: Sequence[Region]) -> History:
        """Return the history with every edit that painting changed as it is ``after``: no step undoes a painting."""
        changes = []
        for old, new in zip(map(edits_of, before), map(edits_of, after), strict=True):
            changed = {name for name in (*old, *new) if (name in old, old.get(name)) != (name in new, new.get(name))}
            changes.append((changed, {name: value for name, value in new.items() if name in changed}))

        def step(step: Step) -> Step:
            edits = tuple(
                {**{name: value for name, value in own.items() if name not in changed}, **new}
                for own, (changed, new) in zip(step.edits, changes, strict=False)
            )
            return replace(step, edits=(*edits, *step.edits[len(edits) :]))

        return History(tuple(map(step, self.past)), tuple(map(step, self.future)))

    def to_json(self) -> dict[str, object]:
        """Return plain values for the scene's header."""
        named = {"past": self.past, "future": self.future}
        return {
            name: [{**vars(s), "lamp": s.lamp.to_json(), "cuts": list(map(vars, s.cuts))} for s in steps]
            for name, steps in named.items()
        }

    @classmethod
    def from_json(cls, content: dict[str, Any], regions: Sequence[Region]) -> History:
        """Invert :meth:`to_json`; raises KeyError, TypeError or ValueError if the content does not fit the regions.

        ``regions``: all of the scene, also those whose split was undone.
        """
        fewest = sum(region.part_of is None for region in regions)

        def step(values: dict[str, Any]) -> Step:
            edits = [values_of(Region, e) for e in values["edits"]]
            if len(edits) < fewest:
                raise ValueError(f"a step with the edits of {len(edits)} regions does not fit {fewest}")
            told = [edits_of(with_edits(region, e)) for region, e in zip(regions[: len(edits)], edits, strict=True)]
            lamp = Lamp(**values_of(Lamp, values.get("lamp", {})))
            return Step(str(values["what"]), tuple(told), lamp, cuts_in(values.get("cuts", [])))

        return cls(*(tuple(step(values) for values in content[name])[-MOST_UNDO_STEPS:] for name in ("past", "future")))
