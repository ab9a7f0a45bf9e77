"""Tone of painted regions in closed loop: what the views show gets the lightness, contrast and chroma of the picture.

A pixel mixes the strokes along its ray, so a painting looks flatter and greyer than its strokes. Here the strokes'
colours are changed, in CIELAB, until the visible colours have the picture's mean lightness, its deviation and its mean
chroma; positions, tones' order and hues stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import lab_to_rgb
from svv.core.strokes.strokes import Strokes
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.styles.hand import Hand
from svv.train.match.stylize import StyledView
from svv.train.paint.brushwork import LIFTED, Brushwork
from svv.train.paint.surface_form import Floats
from svv.train.paint.techniques import TECHNIQUES

ROUNDS = 5
"""Number of corrections, needed because colours are clipped."""

VIEWS, MOST = 5, 3_000
"""Number of views in which a region is looked at, and maximum number of samples of each."""

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


@dataclass(frozen=True)
class Shown:
    """What views show of a region, in CIELAB."""

    mean: NDArray[np.float64]
    """Mean colour. (3,)"""
    contrast: float
    """Standard deviation of lightness."""
    chroma: float
    """Mean chroma."""


class Looked:
    """Samples of a region in several views, and the pixels that they make up."""

    def __init__(self, views: Sequence[StyledView], region: int) -> None:
        where, weight, pixel, first = [], [], [], 0
        for view in views[:: max(len(views) // VIEWS, 1)]:
            own = (view.region == region).cpu().numpy()
            number = view.pixel.cpu().numpy()[own]
            # Whole pixels are left out, not samples: the others stay as they are.
            thin = number % max(int(own.sum()) // MOST, 1) == 0
            where.append(view.position.cpu().numpy()[own][thin])
            weight.append(view.weight.cpu().numpy()[own][thin])
            pixel.append(number[thin].astype(np.int64) + first)
            first += view.height * view.width
        self.where = np.ascontiguousarray(np.concatenate(where), np.float32)
        self.weight = np.concatenate(weight).astype(np.float64)
        _, self.pixel = np.unique(np.concatenate(pixel), return_inverse=True)
        self.pixel = self.pixel.reshape(-1)
        self.alpha = np.bincount(self.pixel, self.weight)

    def shown(self, colours: Floats) -> Shown | None:
        """Return what pixels show of colours (S, 3) of the samples; None if too little is visible."""
        from skimage.color import rgb2lab

        counts = self.alpha > COVERED
        if counts.sum() < 16:
            return None
        alpha = self.alpha[counts]
        mixed = [np.bincount(self.pixel, self.weight * c)[counts] / alpha for c in colours.T]
        lab = rgb2lab(np.stack(mixed, 1).clip(0.0, 1.0))
        mean = np.average(lab, axis=0, weights=alpha)
        spread = np.sqrt(np.average(np.square(lab[:, 0] - mean[0]), weights=alpha))
        return Shown(mean, float(spread), float(np.average(np.hypot(lab[:, 1], lab[:, 2]), weights=alpha)))


def toned(
    work: Brushwork, hand: Hand, views: Sequence[StyledView], region: int, soft: float, clear: float = 0.0
) -> tuple[Brushwork, Shown | None]:
    """Return strokes with the tone of their picture as views show them, and what the views then show.

    Args:
        work: The strokes.
        hand: The picture's hand.
        views: Views from all around.
        region: Number of the region.
        soft: Width of soft edges in box units.
        clear: How translucent the region's sheets are, from 0 to 1.
    """
    looked = Looked(views, region)
    paint = StrokePaint(work.strokes, work.brush, soft)
    light = hand.colours[:, 0]
    technique = TECHNIQUES[hand.technique]
    mean = hand.colours.mean(0).astype(np.float64)
    mean[0] = np.clip(mean[0], *technique.lightness)
    mean[0] += (LIFTED if technique.brush.body < 1.0 else LIGHTER) * clear * (np.quantile(light, 0.95) - mean[0])
    vivid = (1.0 + VIVID * clear) * float(np.hypot(*hand.colours[:, 1:].T).mean())
    wanted = Shown(mean, float(light.std()), min(technique.chroma * vivid, technique.most_chroma))
    contrast, chroma, shift, found = 1.0, 1.0, 0.0, None
    (weakest, strongest), away = (PRINTED, RETOUCHED) if technique.flat else (CONTRAST, SHIFT)
    most, strongest = CHROMA[1] + (CLEAR - CHROMA[1]) * clear, strongest + (1.0 - strongest) * clear
    for _ in range(ROUNDS):
        found = looked.shown(paint(looked.where))
        if found is None:
            break
        contrast = float(np.clip(contrast * wanted.contrast / max(found.contrast, 1e-3), weakest, strongest))
        chroma = float(np.clip(chroma * wanted.chroma / max(found.chroma, 1e-3), CHROMA[0], most))
        shift = float(np.clip(shift + wanted.mean[0] - found.mean[0], -away, away))
        paint = paint.with_strokes(retoned(work.strokes, contrast, chroma, shift))
    return replace(work, strokes=paint.strokes), looked.shown(paint(looked.where))


def retoned(strokes: Strokes, contrast: float, chroma: float, shift: float) -> Strokes:
    """Return strokes with factors on the contrast of lightness and on chroma, and with another mean lightness."""
    from skimage.color import rgb2lab

    both = [rgb2lab(colours) for colours in (strokes.colour, strokes.second)]
    middle = float(both[0][:, 0].mean())
    out = []
    for lab in both:
        lab[:, 0] = (middle + contrast * (lab[:, 0] - middle) + shift).clip(0.0, 100.0)
        lab[:, 1:] *= chroma
        out.append(lab_to_rgb(lab))
    return replace(strokes, colour=out[0], second=out[1])
