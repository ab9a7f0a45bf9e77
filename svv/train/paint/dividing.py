"""One picture for several regions: its strokes are divided into families, and each region is painted by one.

A style that several regions share becomes several styles: the same picture and hand, each with the area of its family.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from svv.errors import BadInput
from svv.fields.scene.region import label_of
from svv.fields.scene.scene import Scene
from svv.options.making import DivisionName, PaintOptions
from svv.styles.families import areas_of, divisions, names_of
from svv.train.paint.ink import Ink, StyleInput
from svv.train.paint.pairing import Glimpse, best_division, completed, glimpse_of, paired
from svv.train.paint.plan import Order, hand_of, ordered
from svv.train.paint.style_choice import leftovers

MORE = 2
"""How many more families than regions are looked for: regions choose, and the others join what they resemble."""

SCATTERED = 0.02
"""Cost of dividing by colours where a picture has areas: a stroke's neighbours are no longer the painter's."""


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
    """Divide the pictures that several regions share, unless the options say no.

    Args:
        scene: A scene with a palette network.
        inputs: The styles.
        options: How to paint; ``mapping`` may name parts of pictures.

    Returns:
        Styles and options in which no region shares a divided picture with another, and in which ``mapping`` names
        styles only.

    Raises:
        BadInput: As :func:`svv.train.pipeline.stylize_scene` does.
    """
    asked, words = _without_words(inputs, options)
    order = ordered(scene, inputs, asked)
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
        seen = [k for k in regions if scene.regions[k].seen_opacity > 0.0]
        named = {k: words[k] for k in regions if k in words}
        shared = len(seen) > 1 or named
        if options.divide == "no" or not shared or isinstance(order.styles[style], Ink):
            pairs |= dict.fromkeys(regions, len(found))
            found.append(inputs[style])
            continue
        glimpse = glimpse or glimpse_of(scene)
        given, told, said = _shared(scene, order, style, regions, glimpse, options.divide, named)
        pairs |= {region: len(found) + number for region, number in given[1].items()}
        found += given[0]
        shares |= told
        notes += said
    notes = [*leftovers(order.pairs, order.labels, {order.pairs[k] for k in shares}), *notes]
    if not shares:
        return Division(inputs, asked, {}, notes)
    return Division(found, replace(asked, mapping=pairs, keep=()), dict(sorted(shares.items())), notes)


def _without_words(inputs: Sequence[StyleInput], options: PaintOptions) -> tuple[PaintOptions, dict[int, str]]:
    """Return the options with the number of a style in place of each part of a picture, and the parts by region."""
    mapping = options.mapping
    if mapping is None or isinstance(mapping, str):
        return options, {}
    plain, words = {}, {}
    for region, value in mapping.items():
        if isinstance(value, int):
            plain[region] = value
            continue
        number, sign, word = value.rpartition(":")
        if not sign and len(inputs) > 1:
            raise BadInput(
                f"'{value}' could be a part of any of {len(inputs)} pictures: write --map "
                f"{region}=0:{value} for the first."
            )
        plain[region], words[region] = int(number) if sign else 0, word
    return replace(options, mapping=plain), words


def _shared(
    scene: Scene, order: Order, style: int, regions: Sequence[int], glimpse: Glimpse, how: str, named: Mapping[int, str]
) -> tuple[tuple[list[StyleInput], dict[int, int]], dict[int, dict[str, Any]], list[str]]:
    """Divide the picture of a style among regions; return its parts as styles, their pairs, what is told, and notes."""
    picture, mask, label = np.asarray(order.styles[style], np.float32), order.masks[style], order.labels[style]
    ways: tuple[DivisionName, ...] = ("areas", "colours") if how == "auto" else (how,)  # type: ignore[assignment]
    counts = [len(regions) + more for more in range(MORE + 1)]
    every = divisions(picture, hand_of(picture, mask), counts, ways)
    if all(len(families) == 1 for families in every):
        whole = dict.fromkeys(regions, 0)
        one = StyleInput(picture, label, mask)
        return ([one], whole), {}, [f"{label} has one colour only, so it was not divided among the regions."]
    own = glimpse.of(regions)
    extra = [SCATTERED * (way == "colours" and len(ways) > 1) for way in ways for _ in counts]
    families, pairs = best_division(every, own, extra)
    names = names_of(families)
    if named:
        fixed = {regions.index(k): _family(word, names, label) for k, word in named.items()}
        pairs = paired(own, families, fixed)
    used = sorted(set(pairs.values()))
    full = completed(families, pairs)
    areas = areas_of(picture, [full[f] for f in used], mask)
    parts = [StyleInput(picture, label, area, mask, divided=True) for area in areas]
    told = {
        region: {
            "style": label, "part": names[pairs[number]][0], "colours": full[pairs[number]].codes(),
            "share": round(full[pairs[number]].share, 3), "parts": [words[0] for words in names],
        }
        for number, region in enumerate(regions)
    }  # fmt: skip
    return (parts, {region: used.index(pairs[n]) for n, region in enumerate(regions)}), told, _notes(scene, label, told)


def _family(word: str, names: Sequence[Sequence[str]], label: str) -> int:
    """Return the number of the family that a word names."""
    fitting = [k for k, words in enumerate(names) if word.lower() == words[0]]
    fitting = fitting or [k for k, words in enumerate(names) if word.lower() in words]
    if len(fitting) != 1:
        listed = ", ".join(words[0] for words in names)
        what = "several parts" if fitting else "no part"
        raise BadInput(f"{label} has {what} called '{word}'; its parts are {listed}.")
    return fitting[0]


def _notes(scene: Scene, label: str, told: Mapping[int, Mapping[str, Any]]) -> list[str]:
    """Return the sentence that says which region has which part, and how to change it."""
    listed = ", ".join(f"{label_of(scene.regions, k)} has its {one['part']}" for k, one in told.items())
    left = [part for part in next(iter(told.values()))["parts"] if part not in {one["part"] for one in told.values()}]
    region, other = next(iter(told)), (left or [one["part"] for one in told.values()][1:])[0]
    also = f" (it also has {', '.join(left)})" if left else ""
    return [
        f"{label} is divided among the regions: {listed}{also}. --map {region}={other} changes that, --divide no gives "
        "every region the whole picture."
    ]
