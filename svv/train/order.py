"""Decide which region gets which style, and paint the scene stage by stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from svv.errors import BadInput, Progress, part
from svv.fields.networks import UnrestrictedField
from svv.fields.region import Region
from svv.fields.scene import Scene
from svv.measure import give_memory_back
from svv.options.making import AskedHandName, MannerName, PaintOptions
from svv.styles.features import FeatureNetwork, PatchFeatures
from svv.styles.hand import Hand, measure_hand
from svv.train.checkpoint import Checkpoint
from svv.train.config import StylizeSettings
from svv.train.contrast import match_contrast
from svv.train.ink import PAPER, Ink, Style, StyleInput
from svv.train.loop import Loop, Running
from svv.train.manner import manner_of, technique_of
from svv.train.painting import VIEWS, Start
from svv.train.previews import Previews, Show
from svv.train.start import is_laid, run_stage, started, targets_of
from svv.train.style_choice import checked_masks, leftovers, mean_colour, pairs_by_colour, style_pairs
from svv.train.style_loss import StyleLossSettings, StyleTarget
from svv.train.stylize import Stylization

LEAST_STROKE, MOST_STROKE = 0.25, 4.0
"""Range of the stroke size: within it, a stroke is larger than a pixel of the render and smaller than most regions."""

LEAST_VIEWS = 12
"""Least number of views that determine where strokes are visible."""

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

    def painted(self, scene: Scene, colours: UnrestrictedField) -> Scene:
        """Return the scene with these colours as the variant.

        Where strokes are glazes, opacity follows them, unless it already does in a way that somebody chose.
        """
        glazes = {} if colours.brushed is None else colours.brushed.glazes
        regions = tuple(
            replace(r, stroke_opacity=glazes[k]) if k in glazes and r.stroke_opacity == 0.0 else r
            for k, r in enumerate(self.regions)
        )
        return replace(scene, regions=regions).painted(colours, self.named, {}, self.name)


def ordered(scene: Scene, inputs: Sequence[StyleInput], options: PaintOptions) -> Order:
    """Assign styles to regions; raises BadInput as :func:`svv.train.pipeline.stylize_scene` does."""
    stroke_size, strength, go_on, mapping = options.stroke_size, options.strength, options.go_on, options.mapping
    name, styles, keep = scene.free_name(options.variant), [given.style for given in inputs], options.keep
    if go_on and options.variant is None and scene.variant is not None:
        name = scene.variant
    masks, notes = checked_masks(inputs)
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
    notes = [*notes, *leftovers(pairs, labels)]
    return Order(styles, labels, masks, pairs, inks, stroke_size, regions, named, name, go_on, notes)


def with_hands(order: Order, manner: MannerName, laid: bool, named: AskedHandName = "auto") -> Order:
    """Return the order with the hand of each region that is to be painted by strokes, and notes about the choice.

    Args:
        order: Styles of the regions.
        manner: How to paint; ``auto`` decides by :func:`svv.train.manner.manner_of`.
        laid: Whether paint can be laid at all (:func:`svv.train.start.is_laid`).
        named: Technique of the strokes; ``auto`` decides by :func:`svv.train.manner.technique_of`, and any other asks
            for strokes.

    Raises:
        BadInput: Strokes are asked for where paint cannot be laid, or a technique of strokes together with pieces.
    """
    if named != "auto":
        if manner == "pieces":
            raise BadInput(f"Pieces of a picture have its own hand: leave out --manner pieces, or --hand {named}.")
        manner = "strokes"
    if not laid and manner == "strokes":
        raise BadInput("Strokes need paint on a lattice: train and stylize the scene with a preset other than 'paper'.")
    if not laid or manner == "pieces":
        return order
    found: dict[int, Hand] = {}
    notes = list(order.notes)
    for number in sorted({style for region, style in order.pairs.items() if region not in order.inks}):
        hand = measure_hand(np.asarray(order.styles[number], np.float32), order.masks[number])
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
        hand = replace(hand, technique=technique)
        found |= {region: hand for region, style in order.pairs.items() if style == number}
    return replace(order, hands=found, notes=notes)


class Painting:
    """Stage 3 of one scene: start, matching and contrast; ``seconds`` holds the duration of each."""

    def __init__(
        self,
        scene: Scene,
        order: Order,
        settings: StylizeSettings,
        weights: StyleLossSettings,
        network: FeatureNetwork | None,
        seed: int,
        saved: Checkpoint | None,
        preview: Show | None,
    ) -> None:
        """Prepare the painting.

        Args:
            scene: A scene with a palette colour network.
            order: Styles of the regions.
            settings: Settings of stage 3.
            weights: Weights and sizes of the style loss.
            network: Network whose features are matched; None if nothing is painted by pieces.
            seed: Seed of all random choices.
            saved: Checkpoint to resume from and to save to.
            preview: Called with the painting while it is made.
        """
        self.scene, self.order, self.settings, self.weights = scene, order, settings, weights
        self.network, self.seed, self.saved = network, seed, saved
        self.previews = None if preview is None else Previews(preview, partial(order.painted, scene))
        self.seconds: dict[str, float] = {"stylize": 0.0}
        self.notes: list[str] = []
        """What there is to say about how it went."""
        self.refined: list[int] = []
        """Regions that start from their present paint."""

    def run(self, progress: Progress) -> UnrestrictedField:
        """Paint the scene and return its colours."""
        scene, order, settings = self.scene, self.order, self.settings
        targets = self._targets()
        self.refined = [k for k in targets if order.go_on and scene.regions[k].style is not None]
        as_colours = is_laid(scene, settings) and self.weights.seeded
        # Patches know no shapes: they would turn the strokes already laid into specks (docs/measurements/painting.md).
        plain = as_colours and not self.refined and isinstance(self.network, PatchFeatures)
        laid, end = plain or not targets, 0.9 if as_colours and targets and self.weights.contrast else 1.0
        start = Start(
            self._transferred(targets), targets, order.inks, self.order.hands, order.size,
            max(LEAST_VIEWS, min(VIEWS, settings.style_views // 2)), scene.styled if order.go_on else None,
        )  # fmt: skip
        running = Running(self.seed, None, part(progress, 0.0, end if laid else 0.3), self.saved, self.notes)
        field = started(scene, start, settings, running, self.seconds, self.previews)
        if not laid:
            self._match(field, targets, part(progress, 0.3, end))
            give_memory_back()  # a third of a gigabyte of samples and moments: the next step computes its own samples
        if end < 1.0:
            match_contrast(scene, field, targets, settings, part(progress, end, 1.0))
        return field

    def _targets(self) -> dict[int, StyleTarget]:
        """Return the style target of each region that is painted by pieces."""
        if self.network is None:
            return {}
        order = self.order
        pictures = {k: order.styles[v] for k, v in order.pairs.items() if k not in order.inks and k not in order.hands}
        masks = {k: order.masks[order.pairs[k]] for k in pictures}
        network = self.network.to(self.scene.device)
        return targets_of(self.scene, network, pictures, masks, self.weights, self.settings, self.seed)

    def _transferred(self, targets: Mapping[int, StyleTarget]) -> Tensor:
        """Return the regions' colours with the mean colours of styles, and of paper where ink is drawn. (regions, 3)"""
        assert self.scene.palette_network is not None
        colours = self.scene.palette_network.colours.detach()[self.scene.roots]
        for region, target in targets.items() if self.settings.colour_transfer else ():
            colours[region] = target.statistics[0]
        for region in self.order.inks:
            colours[region] = colours.new_tensor(PAPER)
        for region in self.order.hands:  # where no stroke reaches: the mean of the picture
            style = self.order.pairs[region]
            colours[region] = colours.new_tensor(mean_colour(self.order.styles[style], self.order.masks[style]))
        return colours

    def _match(self, field: UnrestrictedField, targets: dict[int, StyleTarget], progress: Progress) -> None:
        """Match features, which joins the pieces, or makes strokes where none were laid."""
        work = Stylization(self.scene, field, targets, self.settings, part(progress, 0.0, 0.08), self.refined)
        watch = None if self.previews is None else partial(self.previews.look, field)
        loop = Loop(
            self.settings.style_iterations, None, part(progress, 0.08, 1.0), "stylization",
            watch=watch, network=field, notes=self.notes,
        )  # fmt: skip
        self.seconds["stylize"] = run_stage(loop, work, self.saved, "stylize")
