"""The strokes of a painting on a region's surface, layer by layer, as a painter works: ground, main strokes, accents.

Seeds are Poisson-disc samples, traced both ways along the surface (Hertzmann 1998; Meier 1996). Every stroke has one
broken colour of the picture, of the wanted tone and near its place there. Letters: S points of the surface, N strokes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from svv.core.colour.colour import lab_to_rgb
from svv.core.strokes.strokes import Brush, Strokes, joined
from svv.errors import Progress
from svv.styles.hand import Hand
from svv.train.paint import tracing_kernels as numba_tracing
from svv.train.paint.picture_map import PictureMap
from svv.train.paint.surface_form import Floats
from svv.train.paint.techniques import TECHNIQUES, Layer
from svv.train.paint.visible_surface import BENT, Bends, VisibleSurface

STEP = 0.7
"""Distance of a stroke's points, in widths."""

LENGTHS = (2.0, 11.0)
"""Bounds of the length of main strokes, in widths."""

LONGER = 2.0
"""Length of main strokes relative to the measured elongation: autocorrelation sees only the uncovered part."""

TURN = 0.8
"""Cosine of the turn from point to point at which a stroke ends."""

ROUND = 0.9
"""Largest width of a stroke, in radii of curvature: thin bodies have thin strokes."""

NARROWEST, WIDEST = 0.5, 1.6
"""Bounds of the width of strokes relative to the usual one: on thin bodies, and where the surface is crumpled."""

CRUMPLED = (0.22, 0.5)
"""Deviations of normals, in radians, from which strokes become wider, and at which they are widest."""

ROUGH = (0.12, 0.35)
"""Deviations of heights, in widths, from which they become wider, and at which they are widest."""

DEEP, CELLS, GLAZE = 2.4, 3.5, 0.8
"""How deep paint reaches: in deviations of the visible depth and of heights; at least, in cells of the paint; and on
what is wholly transparent, in widths."""

CLEAR = 0.7
"""Opacity of a sheet from which its two sides have tones of their own."""

SIDES = 2.0
"""Standard deviation of the distance over which both sides of what is translucent share their tone, in widths."""

LIFTED, DULL, COLOURFUL = 0.1, 0.3, 35.0
"""On what is translucent: how far the tone of washes is lifted towards the lightest; lack of chroma, relative to the
picture's most vivid colours, that costs as much as :data:`TONE`; and chroma from which a colour is vivid in any
picture, so that a bright yellow does not drive out a teal."""

PALE, MIDDLE, FORM, VARIED, SPARSE = 0.4, 0.3, 0.15, 0.35, 0.2
"""On what is wholly transparent, strokes lie sparse and deep in tone on a lighter and clearer ground, as glazes do,
which shows the sheet and what lies behind it (Interrante, Fuchs & Pizer 1997): how far the ground's tone is lifted
towards the lightest, the middle tone of the strokes above it, how much of the form's tone remains in theirs, the
deviation from it, and by how much wider apart they are."""

TONE, PLACE, CHANCE = 0.06, 0.15, 0.5
"""Difference in tone, in ranks, and distance in the picture, in its long side, that cost as much when a stroke's colour
is chosen; and the weight of chance."""

LOOSE = 5.0
"""How much more inks on what is wholly transparent may differ in tone from what is wanted."""

DULLED = 0.98
"""How much less often a grey ink is chosen on what is wholly transparent; it may be the only kind that there is."""

APT = 0.4
"""How far an ink's rank by lightness may be from a block's tone until it is seldom chosen."""

NEAR, ANYWHERE = 80, 120
"""Number of colours from around a stroke's place in the picture, and from all of it, among which one is chosen."""

BROKEN, MOST_SCATTER = 1.4, 0.18
"""Broken tone of strokes relative to that of the picture, whose neighbouring samples may lie on one stroke; and its
largest value: with more, the form is lost."""

SAG = 0.5
"""How deep the paint of washes reaches at least, in half widths."""

DAB = 0.02
"""Length of round dabs, in widths: a stroke has two points."""


@dataclass(frozen=True, eq=False)
class Brushwork:
    """Strokes on a region."""

    strokes: Strokes
    brush: Brush
    seen: NDArray[np.float64]
    """How visible each stroke's middle is. (N,)"""


class Painter:
    """Lays strokes on the visible surface of a region.

    ``opacity`` (X, Y, Z) is that of the scene's cells along a side of theirs, ``cells`` per box unit; ``width`` of main
    strokes and ``cell`` of the paint are in box units.
    """

    def __init__(
        self, hand: Hand, surface: VisibleSurface, opacity: Floats, cells: int, width: float, cell: float, seed: int
    ) -> None:
        self.hand, self.surface, self.width = hand, surface, width
        self.technique = TECHNIQUES[hand.technique]
        self.ground = self.technique.ground_for(hand)
        self.generator = np.random.default_rng(seed)
        bends = surface.bends(BENT * width)
        self.clear = np.asarray(1.0 - (surface.alpha / CLEAR).clip(0.0, 1.0), np.float64)
        """How translucent each point is, in [0, 1]. (S,)"""
        dry = self.technique.brush.body == 1.0 and not self.technique.flat
        self.on_glass = self.clear if dry else np.zeros(len(surface))
        """How far strokes are sparse and opaque on a clear ground: washes flow into each other. (S,)"""
        self.tone = self._of_both_sides(surface.tones(opacity, cells, width, bends.mean))
        """Tone of each point, from dark to light, evenly distributed over what is visible. (S,)"""
        self.map = PictureMap(hand, surface, self.tone, width, self.generator)
        self.tangent = self.map.flow(bends)
        crumpled = self._crumpled(bends)
        self.crumpled = float(np.average(crumpled, weights=surface.seen))
        """How crumpled what is visible is at the scale of a stroke, in [0, 1]."""
        self.size = self._sizes(bends, crumpled)
        """Width of strokes relative to the usual one. (S,)"""
        self.inner, self.outer = self._depths(bends, cell)
        smooth = surface.average(self.tone)
        spread = surface.average(np.square(self.tone - smooth))
        edge = np.sqrt(spread) / 0.10
        self.accent = np.clip(np.maximum(2.2 * np.abs(self.tone - 0.5) - 0.3, edge), 0.0, 1.0)
        """How much each point calls for an accent. (S,)"""

    def _of_both_sides(self, tone: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the tone, where one sees through that of both sides: light over dark of another hue is grey. (S,)"""
        surface = self.surface
        clear = self.clear
        if not clear.any():
            return tone
        mean = surface.spread(tone, SIDES * self.width)
        return surface.ranked(tone + clear * (surface.ranked(mean) - tone))

    def painted(self, progress: Progress) -> Brushwork | None:
        """Return the strokes; None if the surface is too small for any."""
        parts, seen = [], []
        layers = self.technique.layers
        for number, layer in enumerate(layers):
            progress(number / len(layers), "laying strokes")
            laid = self._laid(layer)
            if laid is not None:
                parts.append(laid[0])
                seen.append(laid[1])
        progress(1.0, "laying strokes")
        brush = self.technique.brush_for(self.hand, self.ground)
        return Brushwork(joined(parts), brush, np.concatenate(seen)) if parts else None

    def _crumpled(self, bends: Bends) -> NDArray[np.float64]:
        """Return how crumpled the surface is at the scale of a stroke, in [0, 1]. (S,)"""
        (low, high), (fine, coarse) = CRUMPLED, ROUGH
        turned = (bends.left - low) / (high - low)
        raised = (bends.rough / self.width - fine) / (coarse - fine)
        # A rim or a thin tube bends as strongly, but in one direction only.
        one_way = (bends.strongest - bends.weakest) / np.maximum(bends.strongest + bends.weakest, 1e-9)
        return np.asarray(np.clip(np.maximum(turned, raised), 0.0, 1.0) * (1.0 - np.square(one_way)))

    def _sizes(self, bends: Bends, crumpled: NDArray[np.float64]) -> NDArray[np.float64]:
        thin = np.clip(ROUND / np.maximum(bends.strongest * self.width, 1e-6), NARROWEST, 1.0)
        size = thin * (1.0 - crumpled) + WIDEST * crumpled
        return self.surface.average(size)

    def _depths(self, bends: Bends, cell: float) -> tuple[Floats, Floats]:
        """Return how deep paint reaches below and above each point, both (S,)."""
        surface = self.surface
        # On crumpled ground, points lie above and below the stroke; and what is translucent is seen as a whole.
        deep = np.maximum.reduce([
            DEEP * surface.depth, np.full(len(surface), CELLS * cell), DEEP * bends.rough,
            GLAZE * self.width * (1.0 - surface.alpha.clip(0.0, 1.0)),
        ])  # fmt: skip
        half = 0.5 * surface.thickness(min(float(2.0 * deep.max()), 4.0 * self.width))
        inner = np.minimum(deep, np.maximum(half, 0.8 * cell))
        return inner.astype(np.float32), deep.astype(np.float32)

    def _laid(self, layer: Layer) -> tuple[Strokes, NDArray[np.float64]] | None:
        """Return the strokes of a layer, and how visible they are (N,); None if there is no room for any."""
        surface, generator = self.surface, self.generator
        ratio = float(np.clip(LONGER * self.hand.elongation, *LENGTHS)) if layer.length is None else layer.length
        wide = layer.width * self.width * self.size
        long = ratio * self.width * np.sqrt(self.size) if ratio > 0.0 else wide
        apart = 1.0 + SPARSE * self.on_glass * (layer is not self.technique.layers[0])
        along, across = (
            layer.apart[0] * long * np.sqrt(apart),
            np.maximum(layer.apart[1] * wide * apart, 0.7 * surface.side),
        )
        along = np.maximum(along, across)
        order = generator.permutation(len(surface))
        order = order[self.tone[order] <= layer.lightest]
        if layer.accent:
            order = order[generator.random(len(order)) < self.accent[order]]
        kept = np.empty(len(surface), np.int64)
        points, normals = surface.points, surface.normals
        count = numba_tracing.seeds(order, points, normals, self.tangent, along, across, float(along.max()), kept)
        seed = kept[:count]
        out, first, number = self._traced(layer, seed, wide, long)
        fine = number >= 2
        if not fine.any():
            return None
        seed, out, first, number = seed[fine], out[fine], first[fine], number[fine]
        wanted = 0.5 + layer.tone[1] * (self.tone[seed] - 0.5) + layer.tone[0]
        scatter = layer.scatter * min(BROKEN * self.hand.scatter, MOST_SCATTER)
        wanted = np.clip(wanted + generator.normal(0.0, scatter, len(seed)), 0.01, 0.99)
        # Lights lie over darks: the topmost strokes are the last and the lightest.
        rank = np.argsort(generator.random(len(seed)) + 0.6 * wanted)
        strokes = self._record(layer, seed[rank], out[rank], first[rank], number[rank], wanted[rank])
        return strokes, surface.seen[seed[rank]].astype(np.float64)

    def _traced(
        self, layer: Layer, seed: NDArray[np.int64], wide: NDArray[np.float64], long: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        """Return positions and normals along strokes (N, M, 6), their first row (N,) and number of rows (N,)."""
        generator, surface, count = self.generator, self.surface, len(seed)
        points, normals = surface.points, surface.normals
        if layer.length == 0.0:
            return self._dabs(seed, wide), np.zeros(count, np.int64), np.full(count, 2)
        # Broad washes follow bends of the size of a usual stroke: their own width would step over small bodies.
        step = STEP * np.minimum(wide[seed], self.width)
        share = generator.uniform(0.4, 0.6, count)
        length = long[seed] * generator.lognormal(0.0, 0.25, count)
        steps = np.rint(np.stack([share, 1.0 - share], 1) * (length / step)[:, None]).clip(1, 60).astype(np.int64)
        most = int(steps.sum(1).max(initial=0)) + 1
        out = np.zeros((count, most, 6))
        first, number = np.zeros(count, np.int64), np.zeros(count, np.int64)
        tone = self.tone.astype(np.float32)
        numba_tracing.trace(
            seed, steps, step, TURN, surface.side, surface.slot, points, normals, self.tangent, tone, layer.most,
            out, first, number,
        )  # fmt: skip
        if layer.wash:  # a body too small for a stroke is covered all the same
            short = np.flatnonzero(number < 2)
            out[short, :2], first[short], number[short] = self._dabs(seed[short], wide), 0, 2
        return out, first, number

    def _dabs(self, seed: NDArray[np.int64], wide: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return positions and normals of round dabs, which are strokes of two points. (N, 2, 6)"""
        middle = np.concatenate([self.surface.points[seed], self.surface.normals[seed]], 1).astype(np.float64)
        out = np.repeat(middle[:, None], 2, 1)
        half = 0.5 * DAB * wide[seed, None] * self.tangent[seed]
        out[:, 0, :3] -= half
        out[:, 1, :3] += half
        return out

    def _record(
        self, layer: Layer, seed: NDArray[np.int64], out: NDArray[np.float64], first: NDArray[np.int64],
        number: NDArray[np.int64], wanted: NDArray[np.float64],
    ) -> Strokes:  # fmt: skip
        """Return traced lines as strokes."""
        generator = self.generator
        row = np.repeat(np.arange(len(seed)), number)
        start = np.concatenate([[0], np.cumsum(number)])
        index = np.arange(len(row)) - start[row]
        backwards = generator.random(len(seed)) < 0.5
        column = first[row] + np.where(backwards[row], number[row] - 1 - index, index)
        where, normal = out[row, column, :3], out[row, column, 3:]
        nearest = self.surface.tree.query(where)[1]
        each = generator.uniform(0.85, 1.15, len(seed))
        radius = 0.5 * layer.width * self.width * self.size[nearest] * each[row]
        radius *= 1.0 - layer.swell * np.square(2.0 * index / (number[row] - 1) - 1.0)
        inner, outer = self.inner[nearest], self.outer[nearest]
        if layer.wash:  # broad strokes bridge what the surface bends below them
            deep = np.maximum(outer, SAG * radius).astype(np.float32)
            inner, outer = np.where(inner < outer, np.minimum(2.0 * inner, deep), deep), deep
        colour, second = self._colours(layer, seed, wanted)
        count = float(np.clip(1.0 + 1.2 * self.hand.bristles, 2.0, 6.0)) * min(layer.width, 1.6)
        count = 0.125 * layer.wash if layer.wash else max(count, 1.5)
        return Strokes(
            where.astype(np.float32), np.ascontiguousarray(normal, np.float32), radius.astype(np.float32),
            inner, outer, start, colour, second,
            np.full(len(seed), count, np.float32), generator.integers(0, 1024, len(seed)),
        )  # fmt: skip

    def _colours(self, layer: Layer, seed: NDArray[np.int64], wanted: NDArray[np.float64]) -> tuple[Floats, Floats]:
        """Return two colours of the picture for each stroke, RGB, both (N, 3): of glazes, what they let through."""
        hand, generator, surface = self.hand, self.generator, self.surface
        around = surface.points[seed] + generator.normal(0.0, self.width, (len(seed), 3))
        patch = self.map.tree.query(around)[1]
        place = self.map.places(surface.points[seed], patch)
        near = self.map.picture_tree.query(place, min(2 * NEAR, len(hand.places)))[1]
        among = np.concatenate([near[:, ::2], generator.integers(0, len(hand.places), (len(seed), ANYWHERE))], 1)
        away = np.linalg.norm(hand.places[among] - place[:, None], axis=2)
        # Dull glazes over each other are only grey: on what is translucent, vivid ones are chosen.
        clear = self.clear[seed, None]
        bare = layer is self.technique.layers[0]
        vary = generator.normal(0.0, VARIED, len(seed))
        asked = wanted + PALE * (1.0 - wanted) if bare else MIDDLE + FORM * (wanted - 0.5) + vary
        wanted = (
            wanted
            + self.on_glass[seed] * (asked - wanted)
            + LIFTED * (clear[:, 0] - self.on_glass[seed]) * (1.0 - wanted)
        )
        dull = self._dull(hand.colours)
        # Inks on what is translucent need not show the form, which shows in its opacity.
        loose = 1.0 + LOOSE * self.technique.flat * clear
        cost = np.square((hand.tones[among] - wanted[:, None]) / (TONE * loose)) + np.square(away / PLACE)
        cost += clear * np.square(dull[among] / DULL)
        each = np.arange(len(seed))
        chosen = [among[each, (cost + CHANCE * generator.random(cost.shape)).argmin(1)] for _ in range(2)]
        if self.technique.flat:
            ink = np.asarray(lab_to_rgb(self._inks(layer, seed, hand.colours[chosen[0]])), np.float32)
            return ink, ink
        found = [lab_to_rgb(self.technique.coloured(hand.colours[c], generator)) for c in chosen]
        if self.technique.brush.body < 1.0:
            paper = np.maximum(np.array(self.ground or (1.0, 1.0, 1.0)), 0.05)
            found = [(one / paper).clip(0.02, 1.0) ** layer.share for one in found]
        return tuple(np.asarray(one, np.float32) for one in found)  # type: ignore[return-value]

    def _dull(self, colours: Floats) -> NDArray[np.float64]:
        """Return how colours (N, 3), CIELAB, lack chroma beside the picture's most vivid ones, in [0, 1]. (N,)"""
        vivid = float(np.quantile(np.hypot(self.hand.colours[:, 1], self.hand.colours[:, 2]), 0.95))
        chroma = np.hypot(colours[:, 1], colours[:, 2]).astype(np.float64)
        return np.asarray(1.0 - (chroma / np.clip(vivid, 1.0, COLOURFUL)).clip(0.0, 1.0))

    def _inks(self, layer: Layer, seed: NDArray[np.int64], asked: Floats) -> NDArray[np.float64]:
        """Return the ink of strokes, CIELAB (N, 3): one in each patch of the surface, drawn from what they ask for."""
        inks = self.hand.inks
        votes = np.zeros((len(self.map.patches), len(inks)))
        patch = self.map.tree.query(self.surface.points[seed])[1]
        ink = cKDTree(inks).query(asked)[1]
        # Blocks differ: the middle one has the inks between the darkest and the lightest, however common these are.
        order = np.argsort(np.argsort(inks[:, 0])) / max(len(inks) - 1, 1)
        apt = np.exp(-np.square((order - 0.5 - layer.tone[0]) / APT))
        np.add.at(votes, (patch, ink), apt[ink] * (1.0 - DULLED * self.clear[seed] * self._dull(inks)[ink]))
        share = np.cumsum(votes, 1) / np.maximum(votes.sum(1, keepdims=True), 1e-9)
        drawn = (share < self.generator.random((len(votes), 1))).sum(1).clip(max=len(inks) - 1)
        return np.asarray(inks[drawn[patch]], np.float64)
