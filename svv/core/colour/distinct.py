"""Palettes whose colours everybody can tell apart: the nearest one to a given palette, hues kept where possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour_vision import LEAST_DIFFERENCE, VisionName, from_oklab, oklab, smallest_differences

GRID = 10
"""Colours along each edge of the RGB cube among which a palette is looked for, besides shades of its own hues."""

SHADES = 12
"""Lightnesses and chromas of each own hue that are tried, each."""

LIGHTNESS = (0.33, 0.93)
"""Oklab lightness of new colours: darker and lighter ones leave no room for shading."""

HUE_WEIGHT, PALE_WEIGHT = 6.0, 5.0
"""How much more a change of hue, and a loss of chroma, which takes the hue away, count than a change of lightness."""

STARTS, SWEEPS = 40, 30
"""Beginnings of the search, and how often each colour is chosen anew after one."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Distinct:
    """A palette found."""

    colours: Array
    """sRGB in [0, 1]. (N, 3)"""
    difference: float
    """Smallest CIEDE2000 of a pair in any of the ways to see it; infinite for one colour alone."""


def distinct_palette(
    colours: NDArray[np.floating],
    visions: Sequence[VisionName],
    fixed: NDArray[np.floating],
    least: float | NDArray[np.floating] = LEAST_DIFFERENCE,
    seed: int = 0,
) -> Distinct:
    """Return the nearest palette found whose colours differ by ``least`` from each other and from fixed ones.

    If there is none, it is the one found whose nearest pair comes closest to that. ``colours`` (N, 3) and ``fixed`` (F,
    3), such as the background: sRGB in [0, 1]; ``visions``: ways to see them, in all of which they are to differ;
    ``least``: CIEDE2000, for all or for each pair (N, N). The same seed gives the same palette.
    """
    own = np.clip(np.asarray(colours, np.float64), 0.0, 1.0)
    others = np.asarray(fixed, np.float64).reshape(-1, 3)
    count, pool = len(own), np.concatenate([own, others, _candidates(own)])
    apart = smallest_differences(pool, visions)
    # Fixed colours are no candidates; the distance from them is one from the others, too.
    allowed = np.r_[0:count, count + len(others) : len(pool)]
    from_fixed = apart[:, count : count + len(others)].min(1, initial=np.inf)[allowed]
    apart, pool = apart[np.ix_(allowed, allowed)], pool[allowed]
    cost, wanted = _costs(own, pool), np.broadcast_to(np.asarray(least, np.float64), (count, count))
    upper = np.triu_indices(count, 1)
    rng = np.random.default_rng(seed)
    best: tuple[float, float, NDArray[np.int64]] | None = None
    for start in range(STARTS):
        chosen = np.arange(count) if start == 0 else rng.integers(0, len(pool), count)
        chosen = _settled(chosen, cost, apart, from_fixed, wanted, rng)
        reached = (apart[np.ix_(chosen, chosen)] / wanted)[upper].min(initial=np.inf)
        smallest = float(min(reached, from_fixed[chosen].min(initial=np.inf) / LEAST_DIFFERENCE))
        total = float(cost[np.arange(count), chosen].sum())
        # The nearest of those that are far enough apart; before there is one, the farthest apart.
        key = (-min(smallest, 1.0), total)
        if best is None or key < best[:2]:
            best = (*key, chosen)
    assert best is not None
    pairs = apart[np.ix_(best[2], best[2])][upper]
    return Distinct(pool[best[2]], float(pairs.min(initial=np.inf)))


def _settled(
    chosen: NDArray[np.int64], cost: Array, apart: Array, from_fixed: Array, wanted: Array, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return a choice of candidates that no change of a single one improves. (N,)"""
    chosen = chosen.copy()
    too_near = np.maximum(LEAST_DIFFERENCE - from_fixed, 0.0) ** 2
    for sweep in range(SWEEPS):
        weight, before = 0.002 * 1.5**sweep, chosen.copy()  # what is too near counts more and more
        for k in rng.permutation(len(chosen)):
            rest = np.delete(np.arange(len(chosen)), k)
            near = (np.maximum(wanted[k, rest] - apart[:, chosen[rest]], 0.0) ** 2).sum(1) + too_near
            chosen[k] = int((cost[k] + weight * near).argmin())
        if sweep > 10 and (chosen == before).all():
            break
    return chosen


def _candidates(own: Array) -> Array:
    """Return a grid of colours and shades of a palette's hues, all neither too dark nor too light. (C, 3)"""
    steps = np.linspace(0.0, 1.0, GRID)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    lab = oklab(own)
    light, scale = np.linspace(*LIGHTNESS, SHADES), np.linspace(0.1, 1.3, SHADES)
    shades = [
        np.stack(np.broadcast_arrays(light[:, None], a * scale, b * scale), axis=-1).reshape(-1, 3) for _, a, b in lab
    ]
    rgb = from_oklab(np.concatenate(shades))
    rgb = rgb[((rgb >= 0.0) & (rgb <= 1.0)).all(1)]
    every = np.concatenate([grid, rgb])
    lightness = oklab(every)[:, 0]
    return every[(lightness >= LIGHTNESS[0]) & (lightness <= LIGHTNESS[1])]


def _costs(own: Array, pool: Array) -> Array:
    """Return how far each candidate (C, 3) lies from each colour (N, 3). (N, C)"""
    before, after = oklab(own)[:, None], oklab(pool)[None]
    chroma = np.hypot(after[..., 1], after[..., 2]) - np.hypot(before[..., 1], before[..., 2])
    aside = ((after - before)[..., 1:] ** 2).sum(-1) - chroma**2
    paler = np.where(chroma < 0.0, PALE_WEIGHT, 1.0) * chroma**2
    return (after - before)[..., 0] ** 2 + paler + HUE_WEIGHT * np.maximum(aside, 0.0)
