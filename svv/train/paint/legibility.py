"""What keeps the regions of a painting apart, as they are rendered over white.

What could be confused moves apart in lightness and chroma, within the range of its picture, and what encloses stays
lighter or darker than what it encloses. Letters: P pixels, R regions, N pixels of one region.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from svv.core.colour.colour import WHITE, lab_differences, lab_to_rgb, rgb_to_lab
from svv.core.colour.colour_vision import LEAST_DIFFERENCE, VisionName, set_difference, simulated
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import Seen, look_alikes
from svv.train.paint.view_pixels import ViewPixels

FEWEST = 16
"""Number of pixels from which a region counts."""

MARGIN = 1.25
"""How much more than what is asked two regions are to differ in these views, because others show less."""

DOUBTFUL = 1.05
"""How much more than what is asked they differ by in these views from which they surely do in images."""

LEAST_DIMMED, MOST_DIMMED = 1.1, 1.4
"""How many times less images show of a difference, from what :data:`MARGIN` does not cover up to what strokes can make
up for: what is nearly black shows next to nothing of its colour."""

SMALL, VESSELS = 0.15, 24.0
"""Share of what is visible below which a region is a vessel, a wire or a speck, and the largest CIEDE2000 to what is
around it that it keeps of the volume rendering's."""

AWAY, GREYER, VIVIDER = 40.0, 0.35, 1.8
"""Largest change of lightness, and the bounds of the factor on chroma, that keep regions apart."""

STIFF = 30.0
"""Cost, in squared CIEDE2000, of a change of lightness by :data:`AWAY`, or of chroma by a factor of e."""

ORDERED, EASY = 5.0, 3.0
"""Difference in lightness from which the order of what encloses and is enclosed is kept, and how much of it is."""

QUANTILES, SAMPLED = 10, 250
"""Number of tones at which regions are compared, and maximum number of pixels of each."""

STEPS, TRIALS = 12, 150
"""Maximum numbers of steps of the search, and of trials."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Move:
    """A change of a region's colours that keeps their hues."""

    shift: float = 0.0
    """Change of lightness, CIELAB."""
    factor: float = 1.0
    """Factor on chroma."""

    def __bool__(self) -> bool:
        return self != Move()

    def then(self, other: Move) -> Move:
        """Return both changes, one after the other."""
        return Move(self.shift + other.shift, self.factor * other.factor)

    def of(self, lab: Floats) -> Floats:
        """Return colours, CIELAB (N, 3), after the change."""
        return np.concatenate([(lab[:, :1] + self.shift).clip(0.0, 100.0), self.factor * lab[:, 1:]], 1)

    def of_rgb(self, rgb: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return colours, RGB (N, 3), after the change."""
        return np.asarray(lab_to_rgb(self.of(rgb_to_lab(np.asarray(rgb, np.float64)))), np.float32)


class Legibility:
    """How far regions are apart in some pixels, seen in some ways over a background, and what they should be.

    ``colours`` (R, 3), RGB, are those of all regions in the volume rendering, and ``flats`` (R, 3) those of regions of
    which no others are given. ``least`` is the CIEDE2000 that all are to differ by: by default
    :data:`LEAST_DIFFERENCE`, more for vessels, and no more than in the volume rendering.
    """

    def __init__(
        self, pixels: ViewPixels, colours: Floats, flats: Floats, visions: Sequence[VisionName] = ("normal",),
        least: float | None = None, background: Sequence[float] = WHITE,
    ) -> None:  # fmt: skip
        self.pixels, self.flats, self.visions = pixels, np.asarray(flats, np.float64), visions
        self.background = np.array(background, np.float64)
        sets = self._sets()
        self.rows = np.concatenate([*sets.values(), np.zeros(0, np.int64)])
        """Pixels that count, of one region after the other."""
        ends = np.cumsum([len(own) for own in sets.values()])
        self.parts = {k: slice(end - len(own), end) for (k, own), end in zip(sets.items(), ends.tolist(), strict=True)}
        """Those that each region dominates."""
        self.weight = pixels.inside[self.rows]
        volume = self._over(np.asarray(colours, np.float64)[None])
        self.flat = self.differences(volume)
        """CIEDE2000 between each two regions in the volume rendering, without light."""
        self.lighter = {pair: _lighter(volume, pair) for pair in self.flat}
        """How much lighter the first of each two regions is there, CIELAB."""
        self.asked = {pair: self._asked(pair, away) if least is None else least for pair, away in self.flat.items()}
        """The least CIEDE2000 of each two regions."""
        self.dimmed = dict.fromkeys(self.flat, 1.0)
        """How many times less of it images show, in which light and shade are."""
        self.order: dict[tuple[int, int], float] = {}
        """Sign of the difference in lightness of two regions, one of which encloses the other."""
        for pair in self.asked:
            away = self.lighter[pair]
            if (pixels.encloses[pair] or pixels.encloses[pair[::-1]]) and abs(away) > ORDERED:
                self.order[pair] = float(np.sign(away))

    def _sets(self) -> dict[int, NDArray[np.int64]]:
        """Return the pixels that each region dominates, as :func:`svv.fields.scene.seen_colours.seen_of` takes them."""
        inside = self.pixels.inside
        alpha, first = inside.sum(1), inside.argmax(1)
        found = {}
        for k in range(self.pixels.count):
            own = np.flatnonzero((first == k) & (inside[:, k] > 0.0))
            if len(own) >= FEWEST:
                own = own[alpha[own] >= 0.5 * np.percentile(alpha[own], 90)]
                found[k] = own[:: -(-len(own) // SAMPLED)]
        return found

    def _asked(self, pair: tuple[int, int], away: float) -> float:
        """Return the least difference of two regions, of which the volume rendering has some."""
        seen = self.pixels.inside.sum(0) / max(float(self.pixels.inside.sum()), 1e-9)
        small = min(seen[list(pair)]) < SMALL and self.pixels.together[pair] > 0.5
        return min(away, VESSELS if small else LEAST_DIFFERENCE)

    def _over(self, colours: Floats) -> dict[int, Floats]:
        """Return what is shown over the background of colours, RGB (rows or 1, R, 3), CIELAB (N, 3), by region."""
        mixed = (self.weight[:, :, None] * colours).sum(1) + (1.0 - self.weight.sum(1))[:, None] * self.background
        lab = rgb_to_lab(mixed.clip(0.0, 1.0))
        return {k: lab[part] for k, part in self.parts.items()}

    def shown(self, lab: Mapping[int, Floats]) -> dict[int, Floats]:
        """Return what each region's pixels show over the background (N, 3), from colours (P, 3) of regions, CIELAB."""
        return self._moved({k: own[self.rows] for k, own in lab.items()}, {})

    def _moved(self, lab: Mapping[int, Floats], moves: Mapping[int, Move]) -> dict[int, Floats]:
        """Return what is shown after changes of the colours of some regions in the rows, CIELAB."""
        colours = np.tile(self.flats, (len(self.rows), 1, 1))
        if lab:
            every = np.concatenate([moves.get(k, Move()).of(own) for k, own in lab.items()])
            colours[:, list(lab)] = lab_to_rgb(every).reshape(len(lab), -1, 3).transpose(1, 0, 2)
        return self._over(colours)

    def differences(self, shown: Mapping[int, Floats]) -> dict[tuple[int, int], float]:
        """Return CIEDE2000 between each two regions of which colours, CIELAB, are shown, tone by tone."""
        pairs = list(combinations(sorted(shown), 2))
        if not pairs:
            return {}
        tones = {k: _quantiles(lab) for k, lab in shown.items()}
        first, second = (np.stack([tones[pair[side]] for pair in pairs]) for side in (0, 1))
        away = [
            lab_differences(first, second) if vision == "normal" else lab_differences(
                *(rgb_to_lab(simulated(lab_to_rgb(own), vision)) for own in (first, second))
            )
            for vision in self.visions
        ]  # fmt: skip
        return dict(zip(pairs, np.min([one.mean(1) for one in away], 0).tolist(), strict=True))

    def close(self, lab: Mapping[int, Floats]) -> bool:
        """Return whether two regions are so near each other that it counts how much light and shade take from that."""
        apart = self.differences(self.shown(lab))
        return any(away < MOST_DIMMED * MARGIN * self.asked[pair] for pair, away in apart.items())

    def dim(self, seen: Mapping[int, Seen]) -> None:
        """Ask more of regions of which images of the volume rendering show less than pixels without light do."""
        lights = {k: float(one.weights @ rgb_to_lab(one.colours)[:, 0]) for k, one in seen.items()}
        for pair, away in self.flat.items():
            if not seen.keys() >= set(pair):
                continue
            one, other = (seen[k] for k in pair)
            ratio = away / max(set_difference(one.colours, other.colours, one.weights, other.weights, "normal"), 1e-6)
            if abs(self.lighter[pair]) > ORDERED:  # in lightness, by which strokes move apart, shade takes the most
                ratio = max(ratio, abs(self.lighter[pair]) / max(abs(lights[pair[0]] - lights[pair[1]]), 1e-6))
            self.dimmed[pair] = min(float(ratio), MOST_DIMMED) if ratio > LEAST_DIMMED else 1.0
            self.asked[pair] *= self.dimmed[pair]

    def doubtful(self, lab: Mapping[int, Floats]) -> bool:
        """Return whether regions may look alike: only images tell, which have light and edges as well."""
        apart = self.differences(self.shown(lab))
        enough = {pair: min(least, self.dimmed[pair] * LEAST_DIFFERENCE) for pair, least in self.asked.items()}
        return any(away < DOUBTFUL * enough[pair] for pair, away in apart.items())

    def moves(
        self, lab: Mapping[int, Floats], means: Mapping[int, Floats], gamuts: Mapping[int, tuple[float, float, float]],
        before: Mapping[int, Move],
    ) -> dict[int, Move]:  # fmt: skip
        """Return changes of regions that keep all apart, from their colours (P, 3) and means (3,); none if they are.

        ``gamuts``: least and largest lightness, and largest chroma, of their pictures; ``before`` counts towards the
        bounds.
        """
        own = {k: lab[k][self.rows] for k in lab}
        shown = self._moved(own, {})
        differ = self.differences(shown)
        alike = [pair for pair, least in self.asked.items() if differ[pair] < MARGIN * least]
        turned = [pair for pair, sign in self.order.items() if sign * _lighter(shown, pair) < EASY]
        movable = sorted({k for pair in [*alike, *turned] for k in pair if k in means})
        if not movable:
            return {}
        bounds = np.array([
            bound for k in movable for bound in _bounds(means[k], gamuts[k], before.get(k, Move()))
        ])  # fmt: skip
        pairs = [pair for pair in self.asked if set(pair) & set(movable)]
        share = self.pixels.inside.sum(0)[movable] / max(float(self.pixels.inside.sum()), 1e-9)

        def changes(values: Floats) -> dict[int, Move]:
            return {k: Move(AWAY * values[2 * n], float(np.exp(values[2 * n + 1]))) for n, k in enumerate(movable)}

        def cost(values: Floats) -> float:
            tried = self._moved(own, changes(values))
            found = self.differences(tried)
            missing = sum(max(MARGIN * self.asked[pair] - found[pair], 0.0) ** 2 for pair in pairs)
            wrong = sum(max(EASY - sign * _lighter(tried, pair), 0.0) ** 2 for pair, sign in self.order.items())
            tone = len(movable) * float(share @ values[::2]) ** 2  # the painting as a whole stays as light
            return float(missing + wrong + STIFF * (np.square(values).sum() + tone))

        # Where regions are equally light, both ways apart are possible, and the search would stay between them.
        spread = _spread([float(means[k][0]) for k in movable])
        starts = [np.clip(sign * spread, *bounds.T) for sign in (0.0, 1.0, -1.0)]
        limits = {"maxiter": STEPS, "maxfun": TRIALS, "eps": 0.02}
        found = minimize(cost, min(starts, key=cost), method="L-BFGS-B", bounds=bounds, options=limits)
        return changes(found.x)


def _spread(light: Sequence[float]) -> Floats:
    """Return changes, as the search counts them, that make the lightest region lighter and the darkest darker."""
    rank = np.argsort(np.argsort(light)) - 0.5 * (len(light) - 1)
    out = np.zeros(2 * len(light))
    out[::2] = 0.25 * rank / max(float(np.abs(rank).max()), 0.5)
    return out


def _lighter(shown: Mapping[int, Floats], pair: tuple[int, int]) -> float:
    return float(shown[pair[0]][:, 0].mean() - shown[pair[1]][:, 0].mean())


def _bounds(mean: Floats, gamut: tuple[float, float, float], before: Move) -> list[tuple[float, float]]:
    """Return bounds of the changes of a region, as the search counts them: within the range of its whole picture."""
    (low, high, vivid), chroma = gamut, float(np.hypot(mean[1], mean[2]))
    most = min(VIVIDER / before.factor, max(vivid / max(chroma, 1e-3), 1.0))
    return [
        (max(min(low - mean[0], 0.0), -AWAY - before.shift) / AWAY,
         min(max(high - mean[0], 0.0), AWAY - before.shift) / AWAY),
        (min(float(np.log(GREYER / before.factor)), 0.0), max(float(np.log(most)), 0.0)),
    ]  # fmt: skip


def _quantiles(lab: Floats) -> Floats:
    """Return the mean colours of as many parts of colours (N, 3), from dark to light. (QUANTILES, 3)"""
    ordered = lab[np.argsort(lab[:, 0], kind="stable")]
    at = ((np.arange(QUANTILES) + 0.5) / QUANTILES * len(ordered)).astype(np.int64)
    wide = max(len(ordered) // (2 * QUANTILES), 0)
    return np.stack([ordered[max(k - wide, 0) : k + wide + 1].mean(0) for k in at])


def notes_on(scene: Scene) -> list[str]:
    """Return a sentence about each two regions of a painted scene that look alike as they are rendered."""
    also = ", or move them apart with svv edit --distinct" if scene.stroked and not scene.layers else ""
    return [
        f"{pair.first} and {pair.second} are hard to tell apart (CIEDE2000 {pair.difference:.0f}): give one of them "
        f"another style{also}."
        for pair in look_alikes(scene)
    ]
