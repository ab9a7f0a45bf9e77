"""One picture for several regions: its strokes are divided into families, as styles of their own for the regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from svv.errors import BadInput
from svv.fields.scene.region import label_of
from svv.fields.scene.scene import Scene
from svv.options.making import DivisionName, PaintOptions
from svv.styles.families import Family, areas_of, divisions, joined, names_of
from svv.train.paint.ink import Ink, StyleInput
from svv.train.paint.pairing import Glimpse, best_division, completed, difference_of, glimpse_of, paired
from svv.train.paint.plan import Mask, Order, hand_of, ordered
from svv.train.paint.style_choice import leftovers, style_pairs

MORE = 2
"""How many more families than regions are looked for: regions choose, and the others join what they resemble."""

SCATTERED = 0.02
"""Cost of dividing by colours where a picture has areas: a stroke's neighbours are no longer the painter's."""

SAME = 3.0
"""CIEDE2000 up to which two families are one: nobody could tell apart the regions that they paint."""


@dataclass(frozen=True)
class Division:
    """Styles after pictures were divided."""

    inputs: Sequence[StyleInput]
    options: PaintOptions
    """The options, which name the style of each region."""
    shares: Mapping[int, dict[str, Any]]
    """For each region that shares a picture: ``style``, the ``part`` that paints it by name, ``colours`` of that part
    from dark to light as hex codes, its ``share`` of the picture's strokes, and the names of all ``parts``."""
    notes: Sequence[str]
    """Remarks for the user."""


def divided(scene: Scene, inputs: Sequence[StyleInput], options: PaintOptions) -> Division:
    """Divide the pictures that several regions share, unless the options say no; raises BadInput as ``stylize_scene``.

    No region then shares a divided picture with another, and ``mapping`` names styles only. Hidden regions have the
    whole picture, unless ``mapping`` names a part for them. With ``go_on``, regions that keep their paint keep their
    parts of a picture of the same name.
    """
    asked, words = _without_words(len(scene.regions), inputs, options)
    order = ordered(scene, inputs, replace(asked, go_on=False))  # of a joined scene, only some may have paint
    notes: list[str] = []
    shares: dict[int, dict[str, Any]] = {}
    if options.divide == "no" and words:
        word = next(iter(words.values()))
        raise BadInput(
            f"'{word}' names a part of a picture, but pictures are not to be divided: leave out --divide no."
        )
    found: list[StyleInput] = []
    pairs: dict[int, int] = {}
    glimpse: Glimpse | None = None
    for style in sorted(set(order.pairs.values())):
        regions = sorted(region for region, number in order.pairs.items() if number == style)
        named = {k: words[k] for k in regions if k in words}
        kept = _find_unchanged_parts(scene, order, style, asked.go_on)
        own = [k for k in regions if scene.regions[k].seen_opacity > 0.0 or k in named]
        whole = isinstance(order.styles[style], Ink) or inputs[style].divided
        if named and whole:
            raise BadInput(f"{order.labels[style]} has no parts to name: leave out '{next(iter(named.values()))}'.")
        if options.divide == "no" or whole or not (named or len(own) + len(kept) > 1):
            own = []
        if rest := [k for k in regions if k not in own]:
            pairs |= dict.fromkeys(rest, len(found))
            found.append(inputs[style])
        if own:
            glimpse = glimpse or glimpse_of(scene)
            given, told, said = _shared(scene, order, style, own, glimpse, options.divide, named, kept)
            pairs |= {region: len(found) + number for region, number in given[1].items()}
            found += given[0]
            shares |= told
            notes += said
    notes = [*leftovers(order.pairs, order.labels, {order.pairs[k] for k in shares}), *notes]
    if not shares:
        return Division(inputs, asked, {}, notes)
    return Division(found, replace(asked, mapping=pairs, keep=()), dict(sorted(shares.items())), notes)


def _without_words(
    regions: int, inputs: Sequence[StyleInput], options: PaintOptions
) -> tuple[PaintOptions, dict[int, str]]:
    """Return the options with styles' numbers in place of parts' names, and these names by region.

    Where only parts are named, the other regions get styles in turn, as without a mapping.
    """
    mapping = options.mapping
    if mapping is None or isinstance(mapping, str):
        return options, {}
    plain: dict[int, int] = {}
    words: dict[int, str] = {}
    for region, value in mapping.items():
        if not isinstance(value, str):
            plain[region] = value
            continue
        number, sign, word = (text.strip() for text in value.rpartition(":"))
        if sign and not (number.isascii() and number.isdigit()):
            raise BadInput(f"'{value}' names no part: begin with the picture's number, such as {region}=0:{word}.")
        if not sign and len(inputs) > 1:
            raise BadInput(
                f"'{value}' could be a part of any of {len(inputs)} pictures: write --map "
                f"{region}=0:{value} for the first."
            )
        plain[region], words[region] = int(number) if sign else 0, word
    if words and len(words) == len(plain) and not options.go_on:
        plain = style_pairs(regions, len(inputs), None, options.keep) | plain
    return replace(options, mapping=plain), words


def _find_unchanged_parts(scene: Scene, order: Order, style: int, go_on: bool) -> dict[int, str]:
    """Return the regions that keep their paint, and their parts of a picture of this style's name."""
    if not go_on:
        return {}
    recorded = scene.made.get("stylized", {}).get("divided", {})
    return {
        int(k): one["part"]
        for k, one in recorded.items()
        if int(k) not in order.pairs and one["style"] == order.labels[style] and int(k) < len(scene.regions)
    }


def _shared(
    scene: Scene,
    order: Order,
    style: int,
    own: Sequence[int],
    glimpse: Glimpse,
    how: str,
    named: Mapping[int, str],
    kept: Mapping[int, str],
) -> tuple[tuple[list[StyleInput], dict[int, int]], dict[int, dict[str, Any]], list[str]]:
    """Divide the picture of a style among regions; return its parts as styles, their pairs, what is told, and notes."""
    picture, mask, label = np.asarray(order.styles[style], np.float32), order.masks[style], order.labels[style]
    ways: tuple[DivisionName, ...] = ("areas", "colours") if how == "auto" else (how,)  # type: ignore[assignment]
    regions = [*own, *kept]
    counts = [len(regions) + more for more in range(MORE + 1)]
    every = [_distinct(families) for families in divisions(picture, hand_of(picture, mask), counts, ways)]
    extra = [SCATTERED * (way == "colours" and len(ways) > 1) for way in ways for _ in counts]
    # What is named is looked for in every division, so that a name does not depend on which of them fits best.
    fit = [
        number for number, families in enumerate(every)
        if all(len(_fitting(word, names_of(families))) == 1 for word in named.values())
    ] or range(len(every))  # fmt: skip
    every, extra = [every[n] for n in fit], [extra[n] for n in fit]
    if all(len(families) == 1 for families in every):
        for word in named.values():
            _family(word, names_of(every[0]), label)
        one = StyleInput(picture, label, mask)
        why = "has no areas that differ" if how == "areas" else "has one colour only"
        return ([one], dict.fromkeys(own, 0)), {}, [f"{label} {why}, so it was not divided among the regions."]
    seen = glimpse.of(regions)
    families, pairs = best_division(every, seen, extra)
    names = names_of(families)
    firsts = [words[0] for words in names]
    fixed = {regions.index(k): firsts.index(part) for k, part in kept.items() if part in firsts}
    fixed |= {regions.index(k): _family(word, names, label) for k, word in named.items()}
    if fixed:
        pairs = fixed if len(fixed) == len(regions) else paired(seen, families, fixed)
    used = sorted(set(pairs.values()))
    full = completed(families, pairs)
    areas = _filled(areas_of(picture, [full[f] for f in used], mask), [full[f] for f in used], mask)
    parts = [StyleInput(picture, label, area, mask, divided=True) for area in areas]
    told = {
        region: {
            "style": label, "part": firsts[pairs[number]], "colours": full[pairs[number]].codes(),
            "share": round(full[pairs[number]].share, 3), "parts": firsts,
        }
        for number, region in enumerate(own)
    }  # fmt: skip
    return (parts, {region: used.index(pairs[n]) for n, region in enumerate(own)}), told, _notes(scene, label, told)


def _distinct(families: Sequence[Family]) -> list[Family]:
    """Return families of which those that look the same are joined, the largest first."""
    found = list(families)
    while len(found) > 1:
        apart, a, b = min((difference_of(found[a], found[b]), a, b) for a, b in combinations(range(len(found)), 2))
        if apart >= SAME:
            break
        found = [joined([found[a], found[b]]), *(one for n, one in enumerate(found) if n not in (a, b))]
    return sorted(found, key=lambda one: -one.share)


def _filled(areas: Sequence[Mask], families: Sequence[Family], mask: Mask | None) -> list[Mask]:
    """Return the areas (H, W) of families; one that has no pixel gets those under its strokes, which others lose."""
    found = list(areas)
    for number, family in enumerate(families):
        if found[number].any():
            continue
        height, width = found[number].shape
        x, y = (family.hand.places[family.own] * max(height, width)).astype(np.int64).T
        own = np.zeros((height, width), bool)
        own[(height - 1 - y).clip(0, height - 1), x.clip(0, width - 1)] = True
        own &= True if mask is None else mask
        found = [own if n == number else area & ~own for n, area in enumerate(found)]
    return found


def _fitting(word: str, names: Sequence[Sequence[str]]) -> list[int]:
    """Return the numbers of the families that a word can name: by its first name, else by another one."""
    first = [k for k, words in enumerate(names) if word.lower() == words[0]]
    return first or [k for k, words in enumerate(names) if word.lower() in words]


def _family(word: str, names: Sequence[Sequence[str]], label: str) -> int:
    """Return the number of the family that a word names."""
    fitting = _fitting(word, names)
    if len(fitting) != 1:
        if fitting:
            listed = " or ".join(names[k][0] for k in fitting)
            raise BadInput(f"{label} has several parts called '{word}': name one of them, {listed}.")
        listed = ", ".join(words[0] for words in names)
        raise BadInput(f"{label} has no part called '{word}'; its parts are {listed}.")
    return fitting[0]


def _notes(scene: Scene, label: str, told: Mapping[int, Mapping[str, Any]]) -> list[str]:
    """Return the sentences that say which region has which part, and how to change it."""
    of: dict[str, list[int]] = {}
    for region, one in told.items():
        of.setdefault(one["part"], []).append(region)
    listed = ", ".join(f"{label_of(scene.regions, k)} has its {one['part']}" for k, one in told.items())
    left = [part for part in next(iter(told.values()))["parts"] if part not in of]
    also = f" (it also has {', '.join(left)})" if left else ""
    others = [*left, *list(of)[1:]]
    change = f"--map {next(iter(told))}={others[0]} changes that, " if others else ""
    found = [
        f"{label} is divided among the regions: {listed}{also}. {change}--divide no gives every region the whole "
        "picture."
    ]
    for part, regions in of.items():
        if len(regions) > 1:
            names = " and ".join(label_of(scene.regions, k) for k in regions)
            found.append(f"{names} have the same part of {label}, {part}, and may look alike.")
    return found
