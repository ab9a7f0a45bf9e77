"""Recolouring of a scene so that everybody can tell its regions apart, as they are rendered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import WHITE, rgb_to_lab
from svv.core.colour.colour_vision import (
    COLOUR_VISIONS,
    LEAST_DIFFERENCE,
    VISIONS,
    VisionName,
    set_difference,
    smallest_differences,
)
from svv.core.colour.distinct import distinct_palette
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import FRAMES, VIEW_SIZE, Pair, Seen, pairs_of, seen_in
from svv.fields.scene.stroke_edits import PALETTE_SIZE, luminance
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.options.editing import DistinctName
from svv.train.paint.legibility import Legibility
from svv.train.paint.styled_views import visible_from
from svv.train.paint.view_pixels import ViewPixels

MOST = 400
"""Maximum number of pixels of a painted region in a view."""

TRIES = 5
"""How often a palette is looked for: each shows how much closer light, shade and opacity bring its colours."""

BEYOND = 1.1
"""How much more than what is to be seen is asked of a palette."""

LEAST_SHOWN = 0.02
"""Least fraction of a palette's difference that counts as shown: less is not worth asking for."""


@dataclass(frozen=True)
class Recoloured:
    """A scene with other colours, and its nearest pair as it is rendered; None with fewer than two regions."""

    scene: Scene
    nearest: Pair | None


def distinct(scene: Scene, how: DistinctName = "colours", progress: Progress = silent) -> Recoloured:
    """Return a scene with the nearest colours found that everybody can tell apart, as one edit.

    Strokes keep their hues, and other regions where that is possible; pieces of pictures, ink and the strokes of joined
    scenes do not change. ``colours`` are told apart by people with any colour vision, ``lightness`` also in a grey
    print, as rendered over white (:mod:`svv.render.figures.colour_check`). Of all that were tried, it is the scene
    whose nearest pair is farthest apart, unless an earlier one sufficed. Raises BadInput if no visible region has a
    colour that can change.
    """
    visions, least, background = VISIONS if how == "lightness" else COLOUR_VISIONS, LEAST_DIFFERENCE, WHITE
    free = [k for k, r in enumerate(scene.regions) if r.seen_opacity > 0.0 and r.style is None]
    before = seen_in(scene, None, background, progress=part(progress, 0.0, 0.1))
    if all(region.seen_opacity == 0.0 for region in scene.regions):
        raise BadInput("Every region is hidden or transparent, so no colour shows: show one, with svv edit --show all.")
    strokes = bool(scene.stroked) and not scene.layers
    if not free and not strokes:
        raise BadInput(
            "No visible region has a colour that can be changed: their colours come from pieces of pictures, from ink, "
            "or from strokes of a joined scene; show the palette with --strength 0, or paint otherwise."
        )
    fixed = [one.colours[one.weights.argmax()] for k, one in before.items() if k not in free]
    own = np.array([scene.regions[k].edited_colour or scene.regions[k].colour for k in free])
    best, colours, seen = Recoloured(scene, _nearest(before.values(), visions)), own, before
    for number in range(TRIES if free else 0):
        if best.nearest is None or best.nearest.difference >= least:
            break
        each = part(progress, 0.1 + 0.9 * number / TRIES, 0.1 + 0.9 * (number + 1) / TRIES)
        each(0.0, "palette")
        wanted = _wanted(colours, [seen.get(k) for k in free], visions, least)
        colours = distinct_palette(own, visions, np.array([background, *fixed]), wanted).colours
        changed = scene
        for k, colour, old in zip(free, colours, own, strict=True):
            if (colour != old).any():
                changed = changed.edited(k, tuple(colour))
        seen = seen_in(changed, None, background, progress=each)
        nearest = _nearest(seen.values(), visions)
        if nearest is not None and nearest.difference > best.nearest.difference:
            best = Recoloured(changed, nearest)
    for number in range(TRIES if strokes else 0):
        if best.nearest is None or best.nearest.difference >= least:
            break
        changed = _strokes_apart(best.scene, visions, BEYOND ** (2 * number + 1) * least, background)
        seen = seen_in(changed, None, background, progress=part(progress, 1.0, 1.0))
        nearest = _nearest(seen.values(), visions)
        if nearest is None or nearest.difference <= best.nearest.difference:
            break
        best = Recoloured(changed, nearest)
    return Recoloured(best.scene.as_one_step(scene), best.nearest)


def _strokes_apart(scene: Scene, visions: Sequence[VisionName], least: float, background: Sequence[float]) -> Scene:
    """Return a scene with other lightness and chroma of strokes of regions that are alike, within those of all."""
    paint = scene.paint_shown
    assert paint is not None and paint.brushed is not None
    views = visible_from(scene, scene.rig.orbit(181, VIEW_SIZE, frames=FRAMES), silent)
    opacity = np.array([region.seen_opacity for region in scene.regions])
    pixels = ViewPixels(views, opacity, sorted(scene.stroked), MOST)
    labs, means, strokes = {}, {}, {}
    for k, root in scene.stroked.items():
        own = paint.brushed.regions[k if k in paint.brushed.regions else root]
        strokes[k], mine = own[0], pixels.region == k
        if mine.any():
            labs[k] = rgb_to_lab(pixels.mixed(k, StrokePaint(*own, 1.0 / paint.resolutions[-1])(pixels.where[mine])))
            means[k] = labs[k][np.unique(pixels.pixel[mine])].mean(0)
    every = rgb_to_lab(np.concatenate([one.colour for one in strokes.values()]))
    low, high = np.quantile(every[:, 0], (0.03, 0.97)).tolist()
    gamut = low, high, float(np.quantile(np.hypot(every[:, 1], every[:, 2]), 0.97))
    flats = np.array([region.edited_colour or region.colour for region in scene.regions], np.float64)
    legibility = Legibility(pixels, flats, flats, visions, least, background)
    moves = legibility.moves(labs, means, dict.fromkeys(means, gamut), {})
    for k, move in moves.items():
        colours = strokes[k].colour[np.argsort(luminance(strokes[k].colour), kind="stable")]
        chosen = colours[((np.arange(PALETTE_SIZE) + 0.5) * len(colours) / PALETTE_SIZE).astype(np.int64)]
        scene = scene.with_strokes(k, palette=move.of_rgb(chosen).astype(np.float64).clip(0.0, 1.0).tolist())
    return scene


def _wanted(
    colours: NDArray[np.float64], seen: Sequence[Seen | None], visions: Sequence[VisionName], least: float
) -> NDArray[np.float64]:
    """Return the CIEDE2000 to ask of each pair of a palette (N, 3), so that ``least`` is left as rendered. (N, N)

    ``seen`` are the colours in which the last palette's regions appeared, None for those that did not.
    """
    wanted, palette = np.full((len(seen),) * 2, least), smallest_differences(colours, visions)
    for i, j in combinations(range(len(seen)), 2):
        a, b = seen[i], seen[j]
        if a is None or b is None:
            continue
        shown = min(set_difference(a.colours, b.colours, a.weights, b.weights, vision) for vision in visions)
        ratio = shown / max(palette[i, j], 1e-6)
        wanted[i, j] = wanted[j, i] = BEYOND * least / max(ratio, LEAST_SHOWN)
    return wanted


def _nearest(seen: Iterable[Seen], visions: Sequence[str]) -> Pair | None:
    pairs = (pair for pair in pairs_of(list(seen)) if pair.vision in visions)
    return min(pairs, key=lambda pair: pair.difference, default=None)
