"""A palette corrected by hand: colours added, merged, removed, set, and taken apart.

The palette that is found in views joins what is too similar in hue, and a transfer function's ranges are not always the
regions that somebody wants to edit. The paper's cure is to say so, and to train the palette colour network alone again.

Letters: P palette colours before, Q after, R ranges of the transfer function.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from svv.core.classified import ValueRange
from svv.core.colour import to_hex
from svv.core.palette import PaletteSettings
from svv.errors import BadInput

RGB = tuple[float, float, float]

ALIKE_DIFFERENCE = 2.5 / 255.0
"""Colours whose channels are no farther apart count as the same."""


@dataclass(frozen=True)
class Entry:
    """A colour of a palette, and what it stands for."""

    colour: RGB
    share: float = 0.0
    """Part of the visible light that is its own; a weight where colours are merged."""
    origin: tuple[int, ...] = ()
    """Colours of the palette before that it takes over, the one with the largest share first; none: it is new."""
    ranges: tuple[int, ...] = ()
    """Ranges of the transfer function that it shows, where they are known. Of a range that several colours share, the
    views decide which part is whose."""


@dataclass(frozen=True)
class Correction:
    """What is to be done to a palette. All numbers are those of the palette before."""

    merge: tuple[tuple[int, ...], ...] = ()
    """Colours that become one: their mean, weighted by their shares."""
    remove: tuple[int, ...] = ()
    """Colours that are none; what they showed goes to the neighbouring ranges, or where the views see it fit."""
    colours: Mapping[int, RGB] = field(default_factory=dict)
    """Colours to be set; that of a merged one may be set by any of its numbers."""
    split: tuple[int, ...] = ()
    """Colours of several known ranges, each of which gets a colour of its own."""
    add: tuple[RGB, ...] = ()
    """New colours. Where ranges are known, a new colour takes the range whose colour is the most like it from a colour
    that has others as well, or else shares it."""

    def __bool__(self) -> bool:
        return bool(self.merge or self.remove or self.colours or self.split or self.add)


def corrected(
    palette: Sequence[Entry], correction: Correction, ranges: Sequence[ValueRange] = ()
) -> tuple[tuple[Entry, ...], tuple[str, ...]]:
    """The palette after a correction.

    Args:
        palette: P colours.
        correction: What to do; in the order merge, remove, set, split, add.
        ranges: R ranges of the transfer function in ascending order, where they are known; else the palette is taken
            as it comes out.

    Returns:
        Q colours, in the order of the palette with new ones at the end, and a sentence for each thing that was done.

    Raises:
        BadInput: there is no such colour, a colour is merged with itself or named twice, the last colour is removed, a
            colour is added that is there, two become alike though nothing else tells them apart, a colour of one
            range is to be split, or there are too many.
    """
    if not correction:
        raise BadInput("Nothing to correct: merge, remove, set, split or add a colour.")
    _check(len(palette), correction, bool(ranges))
    done: list[str] = []
    place = {old: old for old in range(len(palette))}  # the colour that a number stands for: the first that it joined
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
        raise BadInput(f"The palette would have {len(result)} colours; {most} are the most.")
    _check_apart(result, bool(ranges))
    return tuple(result), tuple(done)


def _check(count: int, correction: Correction, known: bool) -> None:
    """Whether the numbers can be meant."""
    merged = [old for group in correction.merge for old in group]
    for old in (*merged, *correction.remove, *correction.colours, *correction.split):
        if not 0 <= old < count:
            raise BadInput(f"There is no region {old}: the scene has the regions 0 to {count - 1}.")
    for group in filter(None, correction.merge):
        if len(set(group)) < 2:
            raise BadInput(f"A region cannot be merged with itself: name another one beside {group[0]}.")
    for names, what in ((merged, "merged"), (correction.remove, "removed"), (correction.split, "split")):
        twice = [old for old in names if list(names).count(old) > 1]
        if twice:
            raise BadInput(f"Region {twice[0]} is {what} twice; name it once.")
    for old in correction.remove:
        if old in {*merged, *correction.colours, *correction.split}:
            raise BadInput(f"Region {old} is to be removed and changed at once; do one of the two.")
    for old in correction.split:
        if old in {*merged, *correction.colours}:
            raise BadInput(f"Region {old} is to be split and changed at once; do one after the other.")
        if not known:
            raise BadInput(
                f"Region {old} cannot be split: which ranges of the transfer function it shows is not known; "
                "add the colour of the part that you mean."
            )
    groups = [tuple(sorted(g)) for g in correction.merge]
    for group in groups:
        if sum(old in correction.colours for old in group) > 1:
            raise BadInput(f"Regions {_and(group)} become one, so one colour can be set for them.")


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
    """A colour for each range of one, in its colour."""
    if len(entry.ranges) < 2:
        raise BadInput(
            f"Region {old} cannot be split: it is one range of the transfer function; add the colour of the part that "
            "you mean."
        )
    done.append(f"region {old} split into its {len(entry.ranges)} ranges")
    return [Entry(ranges[r].colour, entry.share / len(entry.ranges), entry.origin, (r,)) for r in entry.ranges]


def _added(entries: list[Entry], colour: RGB, ranges: Sequence[ValueRange], done: list[str]) -> list[Entry]:
    """The palette with one more colour, which takes or shares the range that is the most like it."""
    for entry in entries:
        if _alike(entry.colour, colour):
            raise BadInput(f"The palette holds {to_hex(colour)} already: add another colour.")
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
    """Give ranges whose colour is gone to the colour of the nearest range in value."""
    there = {r: number for number, entry in enumerate(entries) for r in entry.ranges}
    for r in left:
        if there and r not in there:
            heir = there[min(there, key=lambda other: (abs(other - r), other))]
            entries[heir] = replace(entries[heir], ranges=tuple(sorted((*entries[heir].ranges, r))))
    return entries


def _check_apart(entries: list[Entry], known: bool) -> None:
    """Whether colours differ, or the ranges that they show do."""
    for number, entry in enumerate(entries):
        for other in entries[:number]:
            if _alike(entry.colour, other.colour) and not (known and set(entry.ranges).isdisjoint(other.ranges)):
                raise BadInput(f"Two colours would be {to_hex(entry.colour)}: merge them, or set another colour.")


def _alike(some: RGB, other: RGB) -> bool:
    return bool(np.abs(np.subtract(some, other)).max() <= ALIKE_DIFFERENCE)


def _and(numbers: Sequence[int]) -> str:
    return f"{', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
