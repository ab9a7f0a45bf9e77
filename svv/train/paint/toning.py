"""Tone of painted regions in closed loop: what views show has the tone of the picture, and regions stay apart.

A pixel mixes the strokes along its ray, so a painting looks flatter and greyer than its strokes. Here the strokes'
colours are changed, in CIELAB, until the visible colours of each region have their picture's mean lightness, its
deviation and its mean chroma; positions, tones' order and hues stay. Where regions could then be confused, as they are
rendered over white, lightness and chroma move apart within the picture's own range.

Letters: P pixels, R regions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from svv.core.colour.colour import colour_differences, lab_to_rgb
from svv.core.colour.colour_vision import LEAST_DIFFERENCE
from svv.core.strokes.strokes import Strokes
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.styles.hand import Hand
from svv.train.match.stylize import StyledView
from svv.train.paint.brushwork import LIFTED, Brushwork
from svv.train.paint.techniques import TECHNIQUES
from svv.train.paint.view_pixels import ViewPixels

PASSES = 2
"""Number of corrections: colours are clipped, and the tones of strokes are not those of their mixtures."""

VIEWS, MOST = 5, 400
"""Number of views in which regions are looked at, and maximum number of pixels of each region in one."""

CONTRAST, CHROMA, CLEAR, SHIFT = (0.9, 1.7), (0.9, 1.2), 1.6, 25.0
"""Bounds of the factors on contrast and chroma (what is hardly opaque has no more contrast, and up to the third value
of chroma), and largest change of lightness."""

PRINTED, RETOUCHED = (0.95, 1.1), 6.0
"""The bounds on contrast, and the largest change of lightness, of inks: they stay what they are in the picture."""

VIVID = 0.6
"""How much more chroma than the picture what is hardly opaque shows, as a fraction: paper makes it pale."""

LIGHTER = 0.4
"""How far the mean tone of opaque strokes on what is hardly opaque is lifted towards the lightest."""

COVERED = 0.1
"""Alpha above which a pixel counts."""

FEWEST = 16
"""Number of pixels from which a region counts."""

MARGIN = 1.15
"""How much more than what is asked two regions are to differ in these views, because others show less."""

SMALL, VESSELS = 0.15, 24.0
"""Share of what is visible below which a region is a vessel, a wire or a speck, and the largest CIEDE2000 to what is
around it that it keeps of the volume rendering's."""

AWAY, GREYER, VIVIDER = 40.0, 0.35, 1.8
"""Largest change of lightness, and the bounds of the factor on chroma, that keep regions apart."""

STIFF = 0.3
"""Cost, in squared CIEDE2000, of a change by a tenth of :data:`AWAY`, against that of being alike."""

ORDERED, EASY = 5.0, 3.0
"""Difference in lightness between what encloses and what is enclosed whose order is kept, and the least that is kept
of it."""

QUANTILES, SAMPLED = 10, 600
"""Number of tones at which regions are compared, and maximum number of pixels of each."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Laid:
    """Strokes on a region, before or after toning."""

    work: Brushwork
    hand: Hand
    clear: float
    """How translucent the region's sheets are, from 0 to 1."""


@dataclass(frozen=True)
class Tone:
    """How the strokes of a region are changed."""

    contrast: float = 1.0
    chroma: float = 1.0
    shift: float = 0.0
    """Change of lightness, CIELAB."""

    def of(self, lab: Floats, middle: float) -> Floats:
        """Return colours, CIELAB (N, 3), around a middle lightness."""
        light = (middle + self.contrast * (lab[:, :1] - middle) + self.shift).clip(0.0, 100.0)
        return np.concatenate([light, self.chroma * lab[:, 1:]], 1)


@dataclass(frozen=True, eq=False)
class Toned:
    """Regions' strokes with the tone of their pictures."""

    laid: Mapping[int, Laid]
    means: Mapping[int, Floats]
    """Mean colour that views show of each region where it can be seen, CIELAB. (3,)"""
    apart: Mapping[tuple[int, int], float]
    """CIEDE2000 between each two regions as views show them over white."""
    asked: Mapping[tuple[int, int], float]
    """What it should be at least."""


def toned(
    laid: Mapping[int, Laid], views: Sequence[StyledView], colours: Floats, flats: Floats, opacity: Floats, soft: float
) -> Toned:
    """Give the strokes of regions the tone of their pictures, as views show them, and keep the regions apart.

    Args:
        laid: Strokes of the regions.
        views: Views from all around.
        colours: Colours of all regions in the volume rendering, RGB. (R, 3)
        flats: Colours of the regions without strokes, RGB. (R, 3)
        opacity: Factor of the edits on the extinction of each region. (R,)
        soft: Width of soft edges in box units.
    """
    pixels = ViewPixels(views[:: max(len(views) // VIEWS, 1)], opacity, list(laid), MOST)
    loop = _Loop(pixels, colours, flats, laid, soft)
    for _ in range(PASSES):
        loop.correct()
        loop.keep_apart()
        loop.repaint()
        loop.look()
    return Toned(
        {k: replace(one, work=loop.works[k]) for k, one in laid.items()},
        {k: found[0] for k in laid if (found := loop.figures(k)) is not None}, loop.differences(loop.shown), loop.asked,
    )  # fmt: skip


class _Loop:
    """The strokes of all regions, what pixels show of them, and their corrections."""

    def __init__(
        self, pixels: ViewPixels, colours: Floats, flats: Floats, laid: Mapping[int, Laid], soft: float
    ) -> None:  # fmt: skip
        from skimage.color import rgb2lab

        self.pixels, self.laid = pixels, laid
        self.works = {k: one.work for k, one in laid.items()}
        self.paints = {k: StrokePaint(one.work.strokes, one.work.brush, soft) for k, one in laid.items()}
        self.wanted = {k: _wanted(one) for k, one in laid.items()}
        self.tones = dict.fromkeys(laid, Tone())
        """How the strokes differ from those that were laid."""
        self.apart = dict.fromkeys(laid, (0.0, 1.0))
        """Change of lightness and factor on chroma, of these, that keep regions apart."""
        self.own = {k: self._own(k) for k in laid}
        self.asked: dict[tuple[int, int], float] = {}
        self.order: dict[tuple[int, int], float] = {}
        self.flats, self.sets = np.asarray(flats, np.float64), self._sets()
        volume = {k: rgb2lab(self._over(np.asarray(colours, np.float64), k, {})) for k in self.sets}
        self.asked = {pair: self._asked(pair, away) for pair, away in self.differences(volume).items()}
        for first, second in self.asked:
            enclosing = pixels.encloses[first, second] or pixels.encloses[second, first]
            away = float(volume[first][:, 0].mean() - volume[second][:, 0].mean())
            if enclosing and abs(away) > ORDERED:
                self.order[first, second] = np.sign(away)
        self.look()

    def _own(self, region: int) -> NDArray[np.int64]:
        """Return the pixels that show enough of a region without what hides it."""
        mine = self.pixels.region == region
        alpha = np.bincount(self.pixels.pixel[mine], self.pixels.whole[mine], self.pixels.pixels)
        return np.flatnonzero(alpha > COVERED)

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

    def look(self) -> None:
        """Look at the strokes with the present changes."""
        from skimage.color import rgb2lab

        self.lab: dict[int, Floats] = {}
        for k, paint in self.paints.items():
            where = self.pixels.where[self.pixels.region == k]
            self.lab[k] = rgb2lab(self.pixels.mixed(k, paint(where)).clip(0.0, 1.0))
        self.shown = self._shown({})

    def repaint(self) -> None:
        """Change the strokes of all regions as corrections ask."""
        for k, one in self.laid.items():
            tone, work, (shift, factor) = self.tones[k], one.work, self.apart[k]
            strokes = retoned(work.strokes, tone.contrast, tone.chroma * factor, tone.shift + shift)
            ground = work.brush.ground
            brush = work.brush if ground is None else replace(work.brush, ground=_moved(ground, shift, factor))
            self.works[k] = replace(work, strokes=strokes, brush=brush)
            self.paints[k] = self.paints[k].with_strokes(strokes, brush)

    def figures(self, region: int) -> tuple[Floats, float, float] | None:
        """Return the mean colour of a region, the deviation of its lightness and its mean chroma, CIELAB."""
        lab = self.lab[region][self.own[region]]
        if len(lab) < FEWEST:
            return None
        return lab.mean(0), float(lab[:, 0].std()), float(np.hypot(lab[:, 1], lab[:, 2]).mean())

    def correct(self) -> None:
        """Change the strokes of each region towards the tone of its picture."""
        for k, one in self.laid.items():
            found = self.figures(k)
            if found is None:
                continue
            light, contrast, chroma = self.wanted[k]
            technique, tone, (shift, factor) = TECHNIQUES[one.hand.technique], self.tones[k], self.apart[k]
            (weakest, strongest), away = (PRINTED, RETOUCHED) if technique.flat else (CONTRAST, SHIFT)
            most, strongest = CHROMA[1] + (CLEAR - CHROMA[1]) * one.clear, strongest + (1.0 - strongest) * one.clear
            mean, deviation, vivid = found
            self._set(k, Tone(
                float(np.clip(tone.contrast * contrast / max(deviation, 1e-3), weakest, strongest)),
                float(np.clip(tone.chroma * chroma * factor / max(vivid, 1e-3), CHROMA[0], most)),
                float(np.clip(tone.shift + light + shift - mean[0], -away, away)),
            ))  # fmt: skip
        self.shown = self._shown({})

    def _set(self, region: int, tone: Tone) -> None:
        """Change the tone of a region, and what pixels show of it as if its mixtures were strokes."""
        old, lab = self.tones[region], self.lab[region]
        middle = float(lab[self.own[region], 0].mean()) if len(self.own[region]) else 50.0
        step = Tone(tone.contrast / old.contrast, tone.chroma / old.chroma, tone.shift - old.shift)
        self.lab[region] = step.of(lab, middle)
        self.tones[region] = tone

    def _over(self, flats: Floats, region: int, among: Mapping[int, Floats]) -> Floats:
        """Return what pixels that a region dominates show over white, RGB. (N, 3)

        Args:
            flats: Colour of each region. (R, 3)
            region: The region.
            among: Colours of some regions in all pixels, (P, 3), in place of flat ones.
        """
        chosen = self.sets[region]
        weight = self.pixels.inside[chosen]
        own = np.tile(flats, (len(chosen), 1, 1))
        for k, mixed in among.items():
            own[:, k] = mixed[chosen]
        return np.asarray((weight[:, :, None] * own).sum(1) + (1.0 - weight.sum(1))[:, None])

    def _shown(self, apart: Mapping[int, tuple[float, float]]) -> dict[int, Floats]:
        """Return what pixels that each region dominates show over white after changes, CIELAB. (N, 3)"""
        from skimage.color import rgb2lab

        every = np.unique(np.concatenate([*self.sets.values(), np.zeros(0, np.int64)]))
        colours = {}
        for k, lab in self.lab.items():
            own = np.zeros((self.pixels.pixels, 3))
            shift, factor = apart.get(k, (0.0, 1.0))
            own[every] = lab_to_rgb(Tone(1.0, factor, shift).of(lab[every], 0.0))
            colours[k] = own
        return {k: rgb2lab(self._over(self.flats, k, colours).clip(0.0, 1.0)) for k in self.sets}

    def differences(self, shown: Mapping[int, Floats]) -> dict[tuple[int, int], float]:
        """Return CIEDE2000 between each two regions of which colours, CIELAB, are shown, tone by tone."""
        tones = {k: lab_to_rgb(_quantiles(lab)) for k, lab in shown.items()}
        return {
            (a, b): float(np.diag(colour_differences(tones[a], tones[b])).mean())
            for a, b in combinations(sorted(tones), 2)
        }

    def keep_apart(self) -> None:
        """Move the lightness and chroma of regions that are alike."""
        differ = self.differences(self.shown)
        alike = [pair for pair, least in self.asked.items() if differ[pair] < MARGIN * least]
        turned = [pair for pair, sign in self.order.items() if sign * self._lighter(self.shown, pair) < EASY]
        movable = sorted({k for pair in [*alike, *turned] for k in pair if k in self.laid})
        if not movable:
            return
        bounds = [bound for k in movable for bound in self._bounds(k)]
        start = np.zeros(2 * len(movable))
        pairs = [pair for pair in self.asked if set(pair) & set(movable)]

        def changes(values: Floats) -> dict[int, tuple[float, float]]:
            return {k: (AWAY * values[2 * n], float(np.exp(values[2 * n + 1]))) for n, k in enumerate(movable)}

        def cost(values: Floats) -> float:
            shown = self._shown(changes(values))
            found = self.differences(shown)
            missing = sum(max(MARGIN * self.asked[pair] - found[pair], 0.0) ** 2 for pair in pairs)
            wrong = sum(max(EASY - sign * self._lighter(shown, pair), 0.0) ** 2 for pair, sign in self.order.items())
            return float(missing + wrong + 100.0 * STIFF * np.square(values).sum())

        # From the middle, a step of either sign may help: the better one is taken up.
        steps = [np.clip(sign * self._first_step(movable, differ), *np.array(bounds).T) for sign in (1.0, -1.0)]
        start = min([start, *steps], key=cost)
        found = minimize(cost, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": 12, "eps": 0.02})
        for k, (shift, factor) in changes(found.x).items():
            before = self.apart[k]
            self.apart[k] = before[0] + shift, before[1] * factor

    def _first_step(self, movable: Sequence[int], differ: Mapping[tuple[int, int], float]) -> Floats:
        """Return changes that spread the lightness of regions: the lightest becomes lighter, the darkest darker."""
        light = np.array([self.lab[k][self.own[k], 0].mean() if len(self.own[k]) else 50.0 for k in movable])
        rank = np.argsort(np.argsort(light)) - 0.5 * (len(light) - 1)
        out = np.zeros(2 * len(movable))
        out[::2] = 0.25 * rank / max(float(np.abs(rank).max()), 0.5)
        return out

    def _lighter(self, shown: Mapping[int, Floats], pair: tuple[int, int]) -> float:
        return float(shown[pair[0]][:, 0].mean() - shown[pair[1]][:, 0].mean())

    def _bounds(self, region: int) -> list[tuple[float, float]]:
        """Return bounds of the changes of a region that remain: within the range of its whole picture."""
        one, (shift, factor), lab = self.laid[region], self.apart[region], self.lab[region][self.own[region]]
        low, high, vivid = one.hand.gamut
        light = float(lab[:, 0].mean()) if len(lab) else 50.0
        chroma = float(np.hypot(lab[:, 1], lab[:, 2]).mean()) if len(lab) else 1.0
        most = min(VIVIDER / factor, max(vivid / max(chroma, 1e-3), 1.0))
        return [
            (max(min(low - light, 0.0), -AWAY - shift) / AWAY, min(max(high - light, 0.0), AWAY - shift) / AWAY),
            (min(np.log(GREYER / factor), 0.0), max(np.log(most), 0.0)),
        ]


def _wanted(one: Laid) -> tuple[float, float, float]:
    """Return the mean lightness, its deviation and the mean chroma that views are to show of a region."""
    light, technique = one.hand.colours[:, 0], TECHNIQUES[one.hand.technique]
    mean = float(np.clip(light.mean(), *technique.lightness))
    mean += (LIFTED if technique.brush.body < 1.0 else LIGHTER) * one.clear * (float(np.quantile(light, 0.95)) - mean)
    vivid = (1.0 + VIVID * one.clear) * float(np.hypot(*one.hand.colours[:, 1:].T).mean())
    return mean, float(light.std()), min(technique.chroma * vivid, technique.most_chroma)


def _quantiles(lab: Floats) -> Floats:
    """Return the mean colours of as many parts of colours (N, 3), from dark to light. (QUANTILES, 3)"""
    ordered = lab[np.argsort(lab[:, 0], kind="stable")]
    at = ((np.arange(QUANTILES) + 0.5) / QUANTILES * len(ordered)).astype(np.int64)
    wide = max(len(ordered) // (2 * QUANTILES), 0)
    return np.stack([ordered[max(k - wide, 0) : k + wide + 1].mean(0) for k in at])


def _moved(rgb: tuple[float, float, float], shift: float, factor: float) -> tuple[float, float, float]:
    """Return a colour, RGB, with another lightness and chroma."""
    from skimage.color import rgb2lab

    lab = Tone(1.0, factor, shift).of(rgb2lab(np.array([rgb], np.float64)), 0.0)
    red, green, blue = (float(v) for v in lab_to_rgb(lab)[0])
    return red, green, blue


def retoned(strokes: Strokes, contrast: float, chroma: float, shift: float) -> Strokes:
    """Return strokes with factors on the contrast of lightness and on chroma, and with another mean lightness."""
    from skimage.color import rgb2lab

    both = [rgb2lab(colours) for colours in (strokes.colour, strokes.second)]
    middle, tone = float(both[0][:, 0].mean()), Tone(contrast, chroma, shift)
    first, second = (lab_to_rgb(tone.of(lab, middle)) for lab in both)
    return replace(strokes, colour=first, second=second)
