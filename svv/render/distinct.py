"""Recolouring of a scene so that everybody can tell its regions apart, as they are rendered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from svv.core.colour import WHITE
from svv.core.colour_vision import COLOUR_VISIONS, LEAST_DIFFERENCE, VISIONS
from svv.core.distinct import distinct_palette
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene import Scene
from svv.options.editing import DistinctName
from svv.render.colour_check import Pair, Seen, pairs_of, seen_in

ASKED = (1.0, 1.3, 1.7, 2.2, 2.8)
"""Differences that the palette is asked for, relative to those that are to be seen: light, shade and opacity bring the
colours of regions closer."""


@dataclass(frozen=True)
class Recoloured:
    """A scene with other colours, and its nearest pair as it is rendered; None with fewer than two regions."""

    scene: Scene
    nearest: Pair | None


def distinct(
    scene: Scene,
    how: DistinctName = "colours",
    least: float = LEAST_DIFFERENCE,
    background: Sequence[float] = WHITE,
    progress: Progress = silent,
) -> Recoloured:
    """Return a scene with the nearest colours found that everybody can tell apart, as one edit.

    Painted regions keep their colours; the others keep their hues where that is possible.

    Args:
        scene: A scene with a palette network.
        how: ``colours`` are told apart by people with any colour vision, ``lightness`` also in a grey print.
        least: CIEDE2000 to be reached between the regions as rendered (:mod:`svv.render.colour_check`).
        background: What they are rendered over, RGB in [0, 1].
        progress: Called while it works.

    Returns:
        The scene, of all that were tried the one whose nearest pair is farthest apart, unless an earlier one sufficed.

    Raises:
        BadInput: The scene has no regions, or all that are visible are painted.
    """
    visions = VISIONS if how == "lightness" else COLOUR_VISIONS
    free = [k for k, r in enumerate(scene.regions) if r.seen_opacity > 0.0 and r.style is None]
    before = seen_in(scene, None, background, progress=part(progress, 0.0, 0.1))
    if not free:
        raise BadInput(
            "No visible region has a colour that can be changed: their colours come from styles; show the palette with "
            "--strength 0, or paint other styles."
        )
    fixed = [one.colours[one.weights.argmax()] for k, one in before.items() if k not in free]
    own = np.array([scene.regions[k].edited_colour or scene.regions[k].colour for k in free])
    best = Recoloured(scene, _nearest(before.values(), visions))
    for number, factor in enumerate(ASKED):
        if best.nearest is None or best.nearest.difference >= least:
            break
        each = part(progress, 0.1 + 0.9 * number / len(ASKED), 0.1 + 0.9 * (number + 1) / len(ASKED))
        each(0.0, "palette")
        found = distinct_palette(own, visions, np.array([background, *fixed]), factor * least)
        changed = scene
        for k, colour, old in zip(free, found.colours, own, strict=True):
            if (colour != old).any():
                changed = changed.edited(k, tuple(colour))
        nearest = _nearest(seen_in(changed, None, background, progress=each).values(), visions)
        if nearest is not None and nearest.difference > best.nearest.difference:
            best = Recoloured(changed, nearest)
    return Recoloured(best.scene.as_one_step(scene), best.nearest)


def _nearest(seen: Iterable[Seen], visions: Sequence[str]) -> Pair | None:
    pairs = (pair for pair in pairs_of(list(seen)) if pair.vision in visions)
    return min(pairs, key=lambda pair: pair.difference, default=None)
