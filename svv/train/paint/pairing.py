"""Which family of a picture's strokes paints which region, so that the painting says what the volume rendering says.

All are paired at once, by hue, lightness and vividness, by the order of lightness of what encloses and is enclosed, and
by how unlike those seen together are. Letters: R regions, F families.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from math import perm

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import WHITE, lab_differences, rgb_to_lab
from svv.errors import silent
from svv.fields.scene.joined import members
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import seen_of
from svv.styles.families import Family, features_of, joined
from svv.train.paint.styled_views import visible_from
from svv.train.paint.view_pixels import ViewPixels

GLANCES, GLANCE = 6, 64
"""Number of views in which it is seen which region encloses which, and their side in pixels."""

PROMINENT = 0.2
"""Added to a region's share of what is visible, by which its vividness is divided: small regions choose first."""

CLEAR = 40.0
"""CIEDE2000 between two families from which more makes no difference."""

ALIKE, TURNED = 0.3, 0.1
"""Cost of two families that look the same in two regions that are seen together, and of an order of lightness that is
turned by :data:`DECIDED`, where 1 is the difference of black and white."""

DECIDED = 10.0
"""Difference in lightness, CIELAB, of two regions from which their order counts wholly."""

BESIDE = 0.5
"""Weight of the order of lightness of two regions that are seen together, of which neither encloses the other."""

LEFT = 18.0
"""CIEDE2000 to the other families that a family keeps when it takes in one that no region has."""

MOST_TRIED = 30_000
"""Largest number of pairings that are all tried; above, they are improved step by step."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Glimpse:
    """What views from all around show of a scene's regions."""

    seen: Floats
    """How much of what is visible each region is; they sum to 1. (R,)"""
    together: Floats
    """Share of the pixels of one region in which another is seen too, of the two the larger. (R, R)"""
    encloses: NDArray[np.bool_]
    """Whether one region encloses another. (R, R)"""
    colours: Floats
    """Their colours, CIELAB: the lightness with which they appear over white, the hue and chroma of what they are made
    of. (R, 3)"""

    def of(self, regions: Sequence[int]) -> Glimpse:
        """Return what is seen of some of the regions."""
        both = np.ix_(regions, regions)
        return Glimpse(self.seen[list(regions)], self.together[both], self.encloses[both], self.colours[list(regions)])


def glimpse_of(scene: Scene) -> Glimpse:
    """Return what small views show of a scene as edited; regions of two members of a joined one are seen together."""
    cameras, count = scene.rig.sphere(GLANCES, GLANCE), len(scene.regions)
    seen, together, encloses = np.zeros(count), np.ones((count, count)), np.zeros((count, count), bool)
    for layer, member in enumerate(members(scene)):
        numbers = [k for k, region in enumerate(scene.regions) if region.layer == layer]
        opacity = np.array([scene.regions[k].seen_opacity for k in numbers])
        views = visible_from(member, cameras, silent)
        if views:
            pixels, block = ViewPixels(views, opacity), np.ix_(numbers, numbers)
            seen[numbers], together[block], encloses[block] = pixels.inside.sum(0), pixels.together, pixels.encloses
    own = np.array([region.edited_colour or region.colour for region in scene.regions], np.float64)
    colours = np.asarray(rgb_to_lab(own[None])[0], np.float64)
    for k, one in seen_of(scene, [scene.render(camera, "pcn") for camera in cameras], WHITE).items():
        colours[k, 0] = float(rgb_to_lab(one.colours[None])[0][:, 0] @ one.weights)
    return Glimpse(seen / max(seen.sum(), 1e-9), together, encloses, colours)


def difference_of(a: Family, b: Family) -> float:
    """Return the mean CIEDE2000 of the tones of two families: light is compared with light, and dark with dark."""
    return float(differences_of([a, b])[0, 1])


def differences_of(families: Sequence[Family]) -> Floats:
    """Return the mean CIEDE2000 of the tones of each two families. (F, F)"""
    tones = np.stack([one.tones for one in families])
    return np.asarray(lab_differences(tones[:, None], tones[None]).mean(2))


def paired(glimpse: Glimpse, families: Sequence[Family], fixed: Mapping[int, int] | None = None) -> dict[int, int]:
    """Return the family of each region, some shared if there are too few; ``fixed`` ones (region -> family) stay."""
    costs = _Costs(glimpse, families)
    fixed = dict(fixed or {})
    free = [k for k in range(len(glimpse.seen)) if k not in fixed]
    left = [f for f in range(len(families)) if f not in fixed.values()]
    while len(left) < len(free):
        left += range(len(families))
    chosen = np.zeros(len(glimpse.seen), np.int64)
    chosen[list(fixed)] = list(fixed.values())
    if not free:
        return {k: int(f) for k, f in enumerate(chosen)}
    if perm(len(left), len(free)) <= MOST_TRIED:
        tried = np.array(list(permutations(left, len(free)))).reshape(-1, len(free))
        every = np.repeat(chosen[None], len(tried), 0)
        every[:, free] = tried
        chosen = every[np.argmin(costs.of(every))]
    else:
        chosen[free] = left[: len(free)]
        chosen = _improved(costs, chosen, free, left)
    return {k: int(f) for k, f in enumerate(chosen)}


def _improved(costs: _Costs, chosen: NDArray[np.int64], free: Sequence[int], left: Sequence[int]) -> NDArray[np.int64]:
    """Return a pairing that no exchange of two families, and no unused family, improves."""
    unused, best = list(left[len(free) :]), float(costs.of(chosen[None])[0])
    better = True
    while better:
        better = False
        for number, k in enumerate(free):
            for other in free[number + 1 :]:
                tried = chosen.copy()
                tried[[k, other]] = chosen[[other, k]]
                if (cost := float(costs.of(tried[None])[0])) < best - 1e-9:
                    chosen, best, better = tried, cost, True
            for place, family in enumerate(unused):
                tried = chosen.copy()
                tried[k] = family
                if (cost := float(costs.of(tried[None])[0])) < best - 1e-9:
                    unused[place] = int(chosen[k])
                    chosen, best, better = tried, cost, True
    return chosen


class _Costs:
    """Costs of pairings."""

    def __init__(self, glimpse: Glimpse, families: Sequence[Family]) -> None:
        self.regions, self.families = (
            features_of(colours) for colours in (glimpse.colours, np.stack([one.mean for one in families]))
        )
        chroma = np.hypot(*self.regions[:, 1:].T)
        weight = (0.02 + np.square(chroma)) / (PROMINENT + glimpse.seen) * (glimpse.seen > 0.0)
        self.weight = weight / max(weight.sum(), 1e-9)
        apart = differences_of(families)
        self.alike = ALIKE * np.square(1.0 - np.minimum(apart / CLEAR, 1.0))
        # Every two regions are told apart, those that are seen through or before one another above all.
        self.pairs = np.triu(0.3 + 0.7 * glimpse.together, 1) * np.outer(glimpse.seen > 0.0, glimpse.seen > 0.0)
        light, tone = glimpse.colours[:, 0], np.array([one.mean[0] for one in families])
        # Where nothing is enclosed, what is dark in the volume rendering stays dark among what is seen with it.
        before = np.maximum(glimpse.encloses, np.triu(BESIDE * glimpse.together * ~glimpse.encloses.T, 1))
        self.order = before * np.clip((light[:, None] - light) / DECIDED, -1.0, 1.0)
        self.lighter = np.clip((tone[:, None] - tone) / DECIDED, -1.0, 1.0)

    def of(self, pairings: NDArray[np.int64]) -> Floats:
        """Return the costs of pairings (T, R), lower is better. (T,)"""
        painted = self.families[pairings]
        painted = painted - painted.mean(1, keepdims=True)
        away = np.square(painted - (self.regions - self.regions.mean(0))).sum(2) @ self.weight
        first, second = pairings[:, :, None], pairings[:, None]
        alike = (self.alike[first, second] * self.pairs).sum((1, 2))
        turned = (np.abs(self.order) * np.maximum(-self.lighter[first, second] * np.sign(self.order), 0.0)).sum((1, 2))
        return np.asarray(away + alike + TURNED * turned)


def completed(families: Sequence[Family], pairs: Mapping[int, int]) -> list[Family]:
    """Return the families of paired regions, which take in those left over that leave them unlike the others."""
    used = sorted(set(pairs.values()))
    found = {f: families[f] for f in used}
    for number in [f for f in range(len(families)) if f not in used]:
        one = families[number]
        for f in sorted(used, key=lambda f: difference_of(found[f], one)):
            larger = joined([found[f], one])
            before = min((difference_of(found[f], found[g]) for g in used if g != f), default=np.inf)
            after = min((difference_of(larger, found[g]) for g in used if g != f), default=np.inf)
            if after >= min(LEFT, before):
                found[f] = larger
                break
    return [found[f] if f in found else families[f] for f in range(len(families))]


def best_division(
    divisions: Sequence[Sequence[Family]], glimpse: Glimpse, extra: Sequence[float]
) -> tuple[Sequence[Family], dict[int, int]]:
    """Return the division, of those with ``extra`` costs, that fits the regions best, and each region's family."""
    found = []
    for number, families in enumerate(divisions):
        pairs = paired(glimpse, families)
        cost = float(_Costs(glimpse, families).of(np.array([list(pairs.values())]))[0])
        found.append((cost + extra[number], number, pairs))
    _, number, pairs = min(found, key=lambda one: one[:2])
    return divisions[number], pairs
