"""Decide which region gets which style, and in which manner it is painted."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.io.files.keyed_results import digest
from svv.measure import usable_cpus
from svv.options.making import LEAST_STROKE, MOST_STROKE, AskedHandName, MannerName, PaintOptions
from svv.styles.hand import Hand, measure_hand
from svv.train.paint.ink import Ink, Style, StyleInput
from svv.train.paint.manner import manner_of, technique_of
from svv.train.paint.style_choice import pairs_by_colour, style_pairs, validate_masks

HANDS = 16
"""Number of measured hands that are remembered."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Order:
    """A checked assignment of styles to regions."""

    styles: Sequence[Style]
    """Pictures and inks."""
    labels: Sequence[str]
    """Name of each style."""
    masks: Sequence[Mask | None]
    """Part of each picture to learn from; None for all of it."""
    pairs: Mapping[int, int]
    """Number of the style of each region that gets one."""
    inks: Mapping[int, Ink]
    """Ink of each region that is drawn in ink."""
    size: float
    """Scale of the strokes."""
    regions: tuple[Region, ...]
    """The scene's regions with the strength of their styles."""
    named: Mapping[int, str]
    """Name of the style of each region that has one in the end."""
    name: str
    """Name of the variant."""
    go_on: bool
    """Whether to start from the scene's own paint."""
    notes: Sequence[str]
    """Remarks about the choice for the user."""
    hands: Mapping[int, Hand] = field(default_factory=dict)
    """Hand of the picture of each region that is painted by strokes."""
    inputs: Sequence[StyleInput] = ()
    """The styles as they were given."""

    def manner(self, region: int) -> str:
        """Return how a region's paint is laid: ``ink``, ``strokes`` or ``pieces``."""
        return "ink" if region in self.inks else "strokes" if region in self.hands else "pieces"

    def painted(self, scene: Scene, colours: UnrestrictedField) -> Scene:
        """Return the scene with these colours as the variant."""
        history = scene.history.rebased(scene.regions, self.regions)
        return replace(scene, regions=self.regions, history=history).painted(colours, self.named, {}, self.name)


def ordered(scene: Scene, inputs: Sequence[StyleInput], options: PaintOptions) -> Order:
    """Assign styles to regions; raises BadInput as :func:`svv.train.pipeline.stylize_scene` does."""
    stroke_size, strength, go_on, mapping = options.stroke_size, options.strength, options.go_on, options.mapping
    name, styles, keep = scene.free_name(options.variant), [given.style for given in inputs], options.keep
    if go_on and options.variant is None and scene.variant is not None:
        name = scene.variant
    masks, notes = validate_masks(inputs)
    by_hand: Mapping[int, int | str] | None
    by_hand = (pairs_by_colour(scene.regions, styles, masks, keep) or None) if mapping == "colour" else mapping
    pairs = style_pairs(len(scene.regions), len(styles), by_hand, keep)
    labels = [s.style.name if isinstance(s.style, Ink) else s.name or f"style {k}" for k, s in enumerate(inputs)]
    if not LEAST_STROKE <= stroke_size <= MOST_STROKE:
        raise BadInput(f"The stroke size must lie between {LEAST_STROKE} and {MOST_STROKE:g}, not {stroke_size:g}.")
    if not 0.0 < strength <= 1.0:
        raise BadInput(
            f"The strength must be more than 0 and at most 1, not {strength:g}: at 0 the style would be invisible."
        )
    if go_on and scene.styled is None:
        raise BadInput("The scene holds no styled network to continue with: leave out --continue.")
    own = {k: r.style for k, r in enumerate(scene.regions) if go_on and r.style is not None}
    regions = tuple(
        replace(r, strength=float(strength)) if k in pairs else r if k in own else replace(r, strength=1.0)
        for k, r in enumerate(scene.regions)
    )
    inks = {k: replace(s, size=stroke_size) for k, v in pairs.items() if isinstance(s := styles[v], Ink)}
    named = {**own, **{k: labels[v] for k, v in pairs.items()}}
    return Order(styles, labels, masks, pairs, inks, stroke_size, regions, named, name, go_on, notes, inputs=inputs)


def with_hands(order: Order, manner: MannerName, named: AskedHandName = "auto") -> Order:
    """Return the order with the hand of each region that is painted by strokes, and notes about the choice.

    ``auto`` decides by the picture; another technique asks for strokes. Raises BadInput for one together with pieces.
    """
    if named != "auto":
        if manner == "pieces":
            raise BadInput(f"Pieces of a picture have its own hand: leave out --manner pieces, or --hand {named}.")
        manner = "strokes"
    if manner == "pieces":
        return order
    found: dict[int, Hand] = {}
    notes = list(order.notes)
    numbers = sorted({style for region, style in order.pairs.items() if region not in order.inks})
    pictures = [np.asarray(order.styles[number], np.float32) for number in numbers]
    parts = [order.inputs[number] for number in numbers]
    within = [own.measured if own.divided else order.masks[n] for n, own in zip(numbers, parts, strict=True)]
    with ThreadPoolExecutor(usable_cpus()) as pool:
        hands = list(pool.map(hand_of, pictures, within))
    for number, own, hand in zip(numbers, parts, hands, strict=True):
        chosen, reason = manner_of(hand)
        technique, why = technique_of(hand) if named == "auto" else (named, "")
        shown = named == "auto" and technique != "oil" and "strokes" in (manner, chosen)
        if shown:
            notes.append(
                f"{order.labels[number]} is painted by strokes, as {technique}: {why}. --hand chooses otherwise."
            )
        elif manner == "auto":
            notes.append(f"{order.labels[number]} is painted by {chosen}: {reason}. --manner chooses otherwise.")
        if "strokes" not in (manner, chosen):
            continue
        mask = order.masks[number]
        hand = replace(hand if mask is None or not own.divided else hand.within(mask), technique=technique)
        found |= {region: hand for region, style in order.pairs.items() if style == number}
    return replace(order, hands=found, notes=list(dict.fromkeys(notes)))  # parts of a picture share its notes


_hands: OrderedDict[str, Hand] = OrderedDict()
"""The last measured hands: whoever looks for the right stroke size paints with the same pictures again and again."""


def hand_of(picture: NDArray[np.float32], mask: NDArray[np.bool_] | None) -> Hand:
    """Return the hand of a picture, measured the first time it is needed."""
    key = digest(picture, mask)
    found = _hands.get(key)
    if found is None:
        _hands[key] = found = measure_hand(picture, mask)
        while len(_hands) > HANDS:
            _hands.popitem(last=False)
    return found
