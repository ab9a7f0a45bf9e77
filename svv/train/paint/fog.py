"""Fog as a wash: broad wet strokes all through its volume flow into each other, darker where it is denser.

Where they overlap, their colours are averaged, so tones change as smoothly as the density. Letters: N strokes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from svv.core.colour.colour import lab_to_rgb
from svv.core.strokes.strokes import Brush, Strokes
from svv.styles.hand import Hand
from svv.train.paint.brushwork import Brushwork
from svv.train.paint.styled_views import StyledView
from svv.train.paint.surface_form import Floats, Form, tangents
from svv.train.paint.techniques import TECHNIQUES
from svv.train.paint.visible_surface import surface_of

SKY = 0.5
"""Fraction of the picture, from its top, whose strokes give fog its colours."""

APART, LONG, DEEP, POINTS = 0.6, 1.8, 0.8, 3
"""Distance of strokes, their length, how far they reach above and below, all in widths, and their number of points."""

SMOOTH = 0.5
"""Standard deviation of the distance over which density is averaged, in widths."""

THIN, DENSE, BROKEN = 0.95, 0.08, 0.04
"""Tone of the thinnest fog and of the densest, from dark to light, and its deviation from stroke to stroke."""

ALIKE, NEAR = 0.15, 24
"""Fraction of the picture's strokes, by tone, whose mean colour a stroke takes after, and number of the picture's most
similar colours among which one is chosen."""

DENSEST = 0.98
"""Fraction of the visible fog that is thinner than what counts as the densest."""

BRUSH = Brush(relief=0.0, dry=0.0, mixed=0.3, flow=0.15, feather=0.6, blunt=1.0)
WET = 0.125
"""Bristle marks of strokes that flow into each other."""


def sky_of(hand: Hand) -> Hand:
    """Return the hand of the upper part of a picture; that of a part of a divided picture as it is."""
    if hand.part:
        return hand
    area = np.zeros(hand.size, bool)
    top = float(hand.places[:, 1].max()) * max(hand.size)
    area[: max(round(hand.size[0] - (1.0 - SKY) * top), 1)] = True
    return hand.within(area)


def washed(
    hand: Hand, views: Sequence[StyledView], region: int, form: Form, opacity: Floats, cells: int, width: float,
    seed: int,
) -> Brushwork | None:  # fmt: skip
    """Return the strokes of a wash through a region that is fog; None if there is no room for two.

    Colours are taken from a hand (:func:`sky_of`). Strokes follow the level surfaces of a form, and have a ``width`` in
    box units; ``opacity`` (X, Y, Z) is that of the scene's cells along a side of theirs, ``cells`` per box unit.
    """
    side = APART * width
    count = int(np.ceil(1.0 / side)) + 1
    extinction = -np.log(np.maximum(1.0 - opacity, 1e-6))
    sums = np.zeros((5, count**3))
    for view in views:
        own = view.region == region
        where, weight = view.position[own].cpu().numpy(), view.weight[own].cpu().numpy()
        cell = tuple(np.minimum((where * cells).astype(np.int64), np.array(opacity.shape) - 1).T)
        cube = np.ravel_multi_index(tuple((where / side).astype(np.int64).T), (count,) * 3)
        for total, values in zip(sums, (1.0, extinction[cell], *where.T), strict=True):
            total += np.bincount(cube, weight * values, count**3)
    held = sums[:, sums[0] > 0.0]
    if held.shape[1] < 2:
        return None
    generator = np.random.default_rng(seed)
    seen, (dense, *place) = held[0], held[1:] / held[0]
    points = np.stack(place, 1).astype(np.float32)
    none = np.zeros(len(points))
    around = surface_of(points, form.normals(points), none, none, seen, side, form.up)
    dense = around.spread(dense, SMOOTH * width)
    order = np.argsort(dense)
    total = np.cumsum(seen[order])
    densest = float(dense[order[min(int(np.searchsorted(total, DENSEST * total[-1])), len(order) - 1)]])
    tone = THIN + (DENSE - THIN) * (dense / max(densest, 1e-12)).clip(0.0, 1.0)
    points += generator.normal(0.0, 0.2 * side, points.shape).astype(np.float32)
    return Brushwork(_strokes(hand, points, around.normals, form, tone, width, generator), BRUSH, seen)


def _strokes(
    hand: Hand, points: Floats, normals: Floats, form: Form, tone: NDArray[np.float64], width: float,
    generator: np.random.Generator,
) -> Strokes:  # fmt: skip
    """Return a straight stroke through each point (N, 3), across its normal, with a tone from 0 to 1 (N,)."""
    number = len(points)
    right, upward = tangents(normals.astype(np.float64), form.up)
    turn = generator.normal(0.0, 0.4, (number, 1))
    along = np.cos(turn) * right + np.sin(turn) * upward
    steps = (np.linspace(-0.5, 0.5, POINTS) * (LONG - 1.0) * width)[None, :, None]
    where = (points[:, None] + steps * along[:, None]).reshape(-1, 3)
    # Of one tone, a picture may have a red and a blue: side by side they would be flecks.
    ordered = hand.colours[np.argsort(hand.tones, kind="stable")]
    smooth = uniform_filter1d(ordered, max(round(ALIKE * len(ordered)), 1), axis=0, mode="nearest")
    rank = (tone + generator.normal(0.0, BROKEN, number)).clip(0.0, 1.0) * (len(ordered) - 1)
    near = min(NEAR, len(ordered))
    like = cKDTree(ordered).query(smooth[np.rint(rank).astype(np.int64)], near)[1].reshape(number, near)
    chosen = (ordered[like[np.arange(number), generator.integers(0, near, number)]] for _ in range(2))
    technique = TECHNIQUES[hand.technique]
    colour, second = (np.asarray(lab_to_rgb(technique.coloured(lab, generator)), np.float32) for lab in chosen)
    radius = 0.5 * width * generator.uniform(0.85, 1.15, number)
    reach = np.full(len(where), DEEP * width, np.float32)
    return Strokes(
        where.astype(np.float32), np.repeat(normals, POINTS, 0).astype(np.float32),
        np.repeat(radius, POINTS).astype(np.float32), reach, reach, np.arange(number + 1) * POINTS, colour, second,
        np.full(number, WET, np.float32), generator.integers(0, 1024, number),
    )  # fmt: skip
