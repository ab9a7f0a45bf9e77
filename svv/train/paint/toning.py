"""Tone of painted regions in closed loop: what views show has the tone of the picture, and regions stay apart.

A pixel mixes the strokes along its ray, so paintings look flatter and greyer than strokes. Their colours change until
each region shows its picture's mean lightness, deviation and mean chroma. Letters: P pixels, R regions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import lab_to_rgb, rgb_to_lab
from svv.core.strokes.strokes import Strokes
from svv.fields.scene.seen_colours import Seen
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.styles.hand import Hand
from svv.train.paint.brushwork import LIFTED, Brushwork
from svv.train.paint.legibility import FEWEST, Legibility, Move
from svv.train.paint.styled_views import StyledView
from svv.train.paint.techniques import TECHNIQUES
from svv.train.paint.view_pixels import ViewPixels

PASSES = 2
"""Number of corrections: colours are clipped, and the tones of strokes are not those of their mixtures."""

VIEWS, MOST = 5, 200
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

DEEPENED = (1.3, 1.5, -12.0)
"""Factors on the contrast and on the chroma of glazes, and change of their lightness, CIELAB, where nothing is opaque:
thin paint shows little of its own colour."""

COVERED = 0.1
"""Alpha above which a pixel counts."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Laid:
    """Strokes on a region, before or after toning."""

    work: Brushwork
    hand: Hand
    clear: float
    """How translucent the region's sheets are, from 0 to 1."""
    glazed: float = 0.0
    """How much its strokes are glazes between which one sees through, from 0 to 1."""


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
    legibility: Legibility
    """What keeps the regions apart."""
    lab: Mapping[int, Floats]
    """Colours of the regions in its pixels, CIELAB. (P, 3)"""


def toned(
    laid: Mapping[int, Laid], views: Sequence[StyledView], colours: Floats, flats: Floats, opacity: Floats, soft: float,
    look: Callable[[], Mapping[int, Seen]] = dict,
) -> Toned:  # fmt: skip
    """Give the strokes of regions the tone of their pictures, as views show them, and keep the regions apart.

    ``colours`` (R, 3), RGB, are those of all regions in the volume rendering, ``flats`` (R, 3) those of regions without
    strokes, and ``opacity`` (R,) the factor of edits on their extinction. Edges are ``soft`` over box units. ``look``
    returns the regions' colours in images of the volume rendering; by default none are known.
    """
    pixels = ViewPixels(views[:: max(len(views) // VIEWS, 1)], opacity, list(laid), MOST)
    loop, legibility = _Loop(pixels, laid, soft), Legibility(pixels, colours, flats)
    if legibility.close(loop.lab):
        legibility.dim(look())
    gamuts = {k: one.hand.gamut for k, one in laid.items()}
    for _ in range(PASSES):
        loop.correct()
        for k, move in legibility.moves(loop.lab, loop.means(), gamuts, loop.moves).items():
            loop.moves[k] = loop.moves[k].then(move)
        loop.repaint()
        loop.look()
    after = {k: replace(one, work=loop.works[k]) for k, one in laid.items()}
    return Toned(after, loop.means(), legibility, loop.lab)


class _Loop:
    """The strokes of all regions, what pixels show of them, and their corrections."""

    def __init__(self, pixels: ViewPixels, laid: Mapping[int, Laid], soft: float) -> None:
        self.pixels, self.laid = pixels, laid
        self.works = {k: one.work for k, one in laid.items()}
        self.paints = {k: StrokePaint(one.work.strokes, one.work.brush, soft) for k, one in laid.items()}
        self.wanted = {k: _wanted(one) for k, one in laid.items()}
        self.tones = dict.fromkeys(laid, Tone())
        """How the strokes differ from those that were laid."""
        self.moves = dict.fromkeys(laid, Move())
        """What they are changed by afterwards."""
        self.own = {k: self._own(k) for k in laid}
        self.look()

    def _own(self, region: int) -> NDArray[np.int64]:
        """Return the pixels that show enough of a region without what hides it."""
        mine = self.pixels.region == region
        alpha = np.bincount(self.pixels.pixel[mine], self.pixels.whole[mine], self.pixels.pixels)
        return np.flatnonzero(alpha > COVERED)

    def look(self) -> None:
        """Look at the strokes as they are."""
        self.lab: dict[int, Floats] = {}
        for k, paint in self.paints.items():
            where = self.pixels.where[self.pixels.region == k]
            self.lab[k] = rgb_to_lab(self.pixels.mixed(k, paint(where)).clip(0.0, 1.0))

    def figures(self, region: int) -> tuple[Floats, float, float] | None:
        """Return the mean colour of a region, the deviation of its lightness and its mean chroma, CIELAB."""
        lab = self.lab[region][self.own[region]]
        if len(lab) < FEWEST:
            return None
        return lab.mean(0), float(lab[:, 0].std()), float(np.hypot(lab[:, 1], lab[:, 2]).mean())

    def means(self) -> dict[int, Floats]:
        """Return the mean colours of the regions that can be seen, CIELAB. (3,)"""
        return {k: found[0] for k in self.laid if (found := self.figures(k)) is not None}

    def correct(self) -> None:
        """Change the tone of each region towards that of its picture, in what pixels show as if these were strokes."""
        for k, one in self.laid.items():
            found = self.figures(k)
            if found is None:
                continue
            light, contrast, chroma = self.wanted[k]
            technique, tone, move = TECHNIQUES[one.hand.technique], self.tones[k], self.moves[k]
            (weakest, strongest), away = (PRINTED, RETOUCHED) if technique.flat else (CONTRAST, SHIFT)
            most, strongest = CHROMA[1] + (CLEAR - CHROMA[1]) * one.clear, strongest + (1.0 - strongest) * one.clear
            deeper, brighter, _ = _deepened(one)
            most, strongest = brighter * most, deeper * strongest
            mean, deviation, vivid = found
            changed = Tone(
                float(np.clip(tone.contrast * contrast / max(deviation, 1e-3), weakest, strongest)),
                float(np.clip(tone.chroma * chroma * move.factor / max(vivid, 1e-3), CHROMA[0], most)),
                float(np.clip(tone.shift + light + move.shift - mean[0], -away, away)),
            )
            step = Tone(changed.contrast / tone.contrast, changed.chroma / tone.chroma, changed.shift - tone.shift)
            self.lab[k] = step.of(self.lab[k], float(mean[0]))
            self.tones[k] = changed

    def repaint(self) -> None:
        """Change the strokes of all regions as corrections ask."""
        for k, one in self.laid.items():
            tone, work, move = self.tones[k], one.work, self.moves[k]
            strokes = retoned(work.strokes, tone.contrast, tone.chroma * move.factor, tone.shift + move.shift)
            brush = work.brush
            if brush.ground is not None and move:
                red, green, blue = (float(v) for v in move.of_rgb(np.array([brush.ground]))[0])
                brush = replace(brush, ground=(red, green, blue))
            self.works[k] = replace(work, strokes=strokes, brush=brush)
            self.paints[k] = self.paints[k].with_strokes(strokes, brush)


def _wanted(one: Laid) -> tuple[float, float, float]:
    """Return the mean lightness, its deviation and the mean chroma that views are to show of a region."""
    light, technique = one.hand.colours[:, 0], TECHNIQUES[one.hand.technique]
    mean = float(np.clip(light.mean(), *technique.lightness))
    mean += (LIFTED if technique.brush.body < 1.0 else LIGHTER) * one.clear * (float(np.quantile(light, 0.95)) - mean)
    vivid = (1.0 + VIVID * one.clear) * float(np.hypot(*one.hand.colours[:, 1:].T).mean())
    deeper, brighter, shift = _deepened(one)
    return mean + shift, deeper * float(light.std()), brighter * min(technique.chroma * vivid, technique.most_chroma)


def _deepened(one: Laid) -> tuple[float, float, float]:
    """Return the factors on contrast and chroma, and the change of lightness, with which glazes show their colours."""
    contrast, chroma, shift = DEEPENED
    return 1.0 + one.glazed * (contrast - 1.0), 1.0 + one.glazed * (chroma - 1.0), one.glazed * shift


def retoned(strokes: Strokes, contrast: float, chroma: float, shift: float) -> Strokes:
    """Return strokes with factors on the contrast of lightness and on chroma, and with another mean lightness."""
    both = [rgb_to_lab(colours) for colours in (strokes.colour, strokes.second)]
    middle, tone = float(both[0][:, 0].mean()), Tone(contrast, chroma, shift)
    first, second = (lab_to_rgb(tone.of(lab, middle)) for lab in both)
    return replace(strokes, colour=first, second=second)
