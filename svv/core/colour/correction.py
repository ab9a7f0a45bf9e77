"""Manual correction of a palette: add, merge, remove, set and split colours, and retrain only the palette network.

A palette extracted from views joins colours of similar hue, and the ranges of a transfer function are not always the
regions that a user wants to edit. Letters: P palette colours before, Q after, R ranges of the transfer function.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from svv.core.colour.hex_codes import to_hex
from svv.core.colour.palette import PaletteSettings
from svv.core.volumes.classified import ValueRange
from svv.errors import BadInput

RGB = tuple[float, float, float]
Point = tuple[float, float, float]
"""A place in world units."""

ALIKE_DIFFERENCE = 2.5 / 255.0
"""Largest channel difference of colours that count as the same."""


@dataclass(frozen=True)
class Entry:
    """A colour of a palette and the parts of the scene that it represents."""

    colour: RGB
    """RGB in [0, 1]."""
    share: float = 0.0
    """Share of the visible light; the weight when colours are merged."""
    origin: tuple[int, ...] = ()
    """Numbers of the previous colours that it replaces, the largest share first; empty for a new colour."""
    ranges: tuple[int, ...] = ()
    """Ranges of the transfer function that it shows, if known. If several colours share a range, the views decide which
    part belongs to which."""


@dataclass(frozen=True)
class Correction:
    """Changes to a palette. All numbers refer to the palette before the correction.

    >>> corrected, _ = svv.correct_palette(scene, views, svv.Correction(merge=((0, 1),)), "draft")
    >>> len(scene.regions), len(corrected.regions)
    (2, 1)
    """

    merge: tuple[tuple[int, ...], ...] = ()
    """Groups of colours to merge into their mean, weighted by their shares."""
    remove: tuple[int, ...] = ()
    """Colours to remove. Colours of neighbouring ranges take their ranges; if ranges are unknown, the views decide."""
    colours: Mapping[int, RGB] = field(default_factory=dict)
    """New colours by number; a merged colour can be set under any of its numbers."""
    split: tuple[int, ...] = ()
    """Colours to split: each shows several known ranges, and each range gets its own colour."""
    add: tuple[RGB, ...] = ()
    """Colours to add. If ranges are known, a new colour takes the range of the most similar colour from its owner, or
    shares it if the owner has no other range."""

    points: tuple[tuple[Point, int], ...] = ()
    """Places in a scene learned from views alone, each with the region that is there: the connected piece around it
    becomes that region, or is divided where several places in it differ. The number after the last one is a new region.
    """
    same: tuple[tuple[Point, Point], ...] = ()
    """Pairs of places whose regions are one, and are merged."""

    def __bool__(self) -> bool:
        return self.of_colours or self.of_places

    @property
    def of_colours(self) -> bool:
        """Whether there are changes other than of places."""
        return bool(self.merge or self.remove or self.colours or self.split or self.add)

    @property
    def of_places(self) -> bool:
        """Whether places are pointed at."""
        return bool(self.points or self.same)


def corrected(
    palette: Sequence[Entry], correction: Correction, ranges: Sequence[ValueRange] = ()
) -> tuple[tuple[Entry, ...], tuple[str, ...]]:
    """Return a palette of P colours as corrected, Q colours with new ones at the end, and a description of each change.

    Changes are made in the order merge, remove, set, split, add. ``ranges``: those of the transfer function in
    ascending order; empty if they are unknown. Raises BadInput if a colour does not exist, is merged with itself or
    named twice; the last one is removed; an added one exists already; two become the same and no ranges distinguish
    them; one of a single range is split; or there are too many.
    """
    if not correction:
        raise BadInput("Nothing to correct: merge, remove, set, split or add a colour, or point at places.")
    _check(len(palette), correction, bool(ranges))
    done: list[str] = []
    place = {old: old for old in range(len(palette))}  # number -> the colour that it was merged into
    entries = {old: replace(entry, origin=(old,)) for old, entry in enumerate(palette)}
    for group in correction.merge:
        first = min(group)
        place |= dict.fromkeys(group, first)
        entries[first] = _merged([entries.pop(old) for old in sorted(group)])
        done.append(f"regions {_and(sorted(group))} merged into {to_hex(entries[first].colour)}")
    removed = [entries.pop(old) for old in correction.remove]
    if not entries and not correction.add:
        raise BadInput("The last region cannot be removed: keep one, or add another colour.")
    for old, entry in zip(correction.remove, removed, strict=True):
        done.append(f"region {old} ({to_hex(entry.colour)}) removed")
    for old, colour in correction.colours.items():
        entries[place[old]] = replace(entries[place[old]], colour=_rgb(colour))
        done.append(f"region {old} set to {to_hex(_rgb(colour))}")
    result = [part for old, entry in sorted(entries.items()) for part in
              (_split(old, entry, ranges, done) if old in correction.split else [entry])]  # fmt: skip
    for colour in correction.add:
        result = _added(result, _rgb(colour), ranges, done)
    result = _handed_on(result, [r for entry in removed for r in entry.ranges])
    most = PaletteSettings().max_colours
    if len(result) > most:
        raise BadInput(f"The palette would have {len(result)} colours; it can have at most {most}.")
    _check_apart(result, bool(ranges))
    return tuple(result), tuple(done)


def _check(count: int, correction: Correction, known: bool) -> None:
    """Raise BadInput if the numbers of a correction are invalid."""
    merged = [old for group in correction.merge for old in group]
    for old in (*merged, *correction.remove, *correction.colours, *correction.split):
        if not 0 <= old < count:
            raise BadInput(f"There is no region {old}: the scene has the regions 0 to {count - 1}.")
    for group in filter(None, correction.merge):
        if len(set(group)) < 2:
            raise BadInput(f"A region cannot be merged with itself: name another one besides {group[0]}.")
    for names, what in ((merged, "merged"), (correction.remove, "removed"), (correction.split, "split")):
        twice = [old for old in names if list(names).count(old) > 1]
        if twice:
            raise BadInput(f"Region {twice[0]} is {what} twice; name it once.")
    for old in correction.remove:
        if old in {*merged, *correction.colours, *correction.split}:
            raise BadInput(f"Region {old} cannot be removed and changed at the same time; do one of the two.")
    for old in correction.split:
        if old in {*merged, *correction.colours}:
            raise BadInput(f"Region {old} cannot be split and changed at the same time; do one after the other.")
        if not known:
            raise BadInput(
                f"Region {old} cannot be split because its ranges of the transfer function are unknown; "
                "add the colour of the part that you want to separate."
            )
    groups = [tuple(sorted(g)) for g in correction.merge]
    for group in groups:
        if sum(old in correction.colours for old in group) > 1:
            raise BadInput(f"Regions {_and(group)} become one region: set only one colour for them.")


def _rgb(colour: Sequence[float]) -> RGB:
    if len(colour) != 3 or not all(0.0 <= c <= 1.0 for c in colour):
        raise BadInput(f"{tuple(colour)} is not a colour: give red, green and blue between 0 and 1.")
    red, green, blue = (float(c) for c in colour)
    return red, green, blue


def _merged(parts: list[Entry]) -> Entry:
    weights = np.array([max(part.share, 1e-6) for part in parts])
    red, green, blue = np.average([part.colour for part in parts], 0, weights)
    largest = sorted(parts, key=lambda part: -part.share)
    ranges = tuple(sorted({r for part in parts for r in part.ranges}))
    origin = tuple(old for part in largest for old in part.origin)
    return Entry((float(red), float(green), float(blue)), float(weights.sum()), origin, ranges)


def _split(old: int, entry: Entry, ranges: Sequence[ValueRange], done: list[str]) -> list[Entry]:
    """Return one entry per range of an entry, in the colour of the range."""
    if len(entry.ranges) < 2:
        raise BadInput(
            f"Region {old} cannot be split because it is a single range of the transfer function; add the colour of "
            "the part that you want to separate."
        )
    done.append(f"region {old} split into its {len(entry.ranges)} ranges")
    return [Entry(ranges[r].colour, entry.share / len(entry.ranges), entry.origin, (r,)) for r in entry.ranges]


def _added(entries: list[Entry], colour: RGB, ranges: Sequence[ValueRange], done: list[str]) -> list[Entry]:
    """Add a colour to the palette; it takes or shares the range of the most similar colour."""
    for entry in entries:
        if _alike(entry.colour, colour):
            raise BadInput(f"The palette already contains {to_hex(colour)}: add another colour.")
    if not ranges:
        done.append(f"{to_hex(colour)} added")
        return [*entries, Entry(colour)]
    nearest = int(np.argmin([np.square(np.subtract(r.colour, colour)).sum() for r in ranges]))
    about = f"the range from {ranges[nearest].low:.4g} to {ranges[nearest].high:.4g}"
    owners = [entry for entry in entries if nearest in entry.ranges]
    if len(owners) == 1 and len(owners[0].ranges) > 1:
        rest = tuple(r for r in owners[0].ranges if r != nearest)
        entries = [replace(e, ranges=rest) if e is owners[0] else e for e in entries]
        done.append(f"{to_hex(colour)} added: it is {about}")
    else:
        done.append(f"{to_hex(colour)} added: it {'shares' if owners else 'is'} {about}")
    return [*entries, Entry(colour, ranges=(nearest,))]


def _handed_on(entries: list[Entry], left: list[int]) -> list[Entry]:
    """Give the ranges of removed colours to the colour of the nearest range in value."""
    there = {r: number for number, entry in enumerate(entries) for r in entry.ranges}
    for r in left:
        if there and r not in there:
            heir = there[min(there, key=lambda other: (abs(other - r), other))]
            entries[heir] = replace(entries[heir], ranges=tuple(sorted((*entries[heir].ranges, r))))
    return entries


def _check_apart(entries: list[Entry], known: bool) -> None:
    """Raise BadInput if two entries have the same colour and no ranges distinguish them."""
    for number, entry in enumerate(entries):
        for other in entries[:number]:
            if _alike(entry.colour, other.colour) and not (known and set(entry.ranges).isdisjoint(other.ranges)):
                raise BadInput(f"Two colours would be {to_hex(entry.colour)}: merge them, or set another colour.")


def _alike(some: RGB, other: RGB) -> bool:
    return bool(np.abs(np.subtract(some, other)).max() <= ALIKE_DIFFERENCE)


def _and(numbers: Sequence[int]) -> str:
    return f"{', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
