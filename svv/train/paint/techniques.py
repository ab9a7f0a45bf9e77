"""Painting techniques, the named hands: which layers a painter lays in each, and how the paint behaves.

They are only numbers. Oil is measured in the picture where its fields are None (:class:`svv.styles.hand.Hand`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import lab_to_rgb
from svv.core.strokes.strokes import Brush
from svv.options.making import HandName
from svv.styles.hand import Hand


@dataclass(frozen=True)
class Layer:
    """One layer of strokes; sizes are in widths of a main stroke."""

    width: float
    length: float | None
    """None for that of the picture's strokes; 0 for round dabs."""
    apart: tuple[float, float]
    """Semi-axes of the ellipse that is free of other seeds: along, in lengths, and across, in widths."""
    tone: tuple[float, float]
    """Wanted tone: what is added to the surface's tone, and the factor on its distance from the middle."""
    scatter: float
    """Fraction of the picture's broken tone."""
    most: float
    """Difference in tone at which a stroke ends."""
    accent: bool = False
    """Whether strokes are only where tone is extreme or changes."""
    lightest: float = 1.0
    """Tone of the surface above which nothing is laid: the ground is the light."""
    wash: int = 0
    """Number of the wash that the layer's strokes flow into, 1 to 3; 0 for strokes with bristle marks."""
    share: float = 1.0
    """Share of a glaze in its wanted colour: exponent of what it lets through."""
    swell: float = 0.0
    """How much thinner a stroke's ends are than its middle, in [0, 1]."""


@dataclass(frozen=True)
class Technique:
    """How a painter works in one technique; None where the picture's hand decides."""

    layers: tuple[Layer, ...]
    """From the lowest to the topmost."""
    brush: Brush
    """How paint looks; relief, dry and mixed count only if they are not measured."""
    measured: bool = False
    """Whether relief, dryness and streaks are those of the picture."""
    ground: tuple[float, float, float] | None = None
    """Where the bare ground shows: quantile of the picture's colours by tone that it takes after, and bounds of its
    lightness; None for the strokes' own colours."""
    lightness: tuple[float, float] = (0.0, 100.0)
    """Bounds of the mean lightness of what is shown."""
    chroma: float = 1.0
    """Chroma of what is shown, relative to the picture's."""
    most_chroma: float = 200.0
    """Upper bound of every stroke's."""
    broken: float = 0.0
    """Deviation of strokes' hues, in radians: broken colour."""
    flat: bool = False
    """Whether it prints the picture's inks (:attr:`svv.styles.hand.Hand.inks`), one in each patch and layer."""
    complements: float = 0.0
    """Fraction of strokes that have the complement of their colour."""

    def brush_for(self, hand: Hand, ground: tuple[float, float, float] | None) -> Brush:
        """Return how paint looks: thick where the picture's bristle marks are strong, if that is measured."""
        if not self.measured:
            return replace(self.brush, ground=ground)
        return replace(
            self.brush,
            relief=float(np.clip(hand.relief / 9.0, 0.08, 0.55)),
            dry=float(np.clip(0.02 * hand.relief, 0.02, 0.15)),
            mixed=float(np.clip(0.08 * hand.relief, 0.1, 0.5)),
            ground=ground,
        )

    def ground_for(self, hand: Hand) -> tuple[float, float, float] | None:
        """Return the colour of the bare ground, RGB; None for the strokes' own."""
        if self.ground is None:
            return None
        part, low, high = self.ground
        lab = hand.colours[np.abs(hand.tones - part) <= 0.03].mean(0).astype(np.float64)
        lab = np.array([np.clip(lab[0], low, high), *(0.5 * lab[1:])])
        red, green, blue = (float(v) for v in lab_to_rgb(lab))
        return red, green, blue

    def coloured(self, lab: NDArray[np.float64], generator: np.random.Generator) -> NDArray[np.float64]:
        """Return colours (N, 3), CIELAB, as this technique takes them from the picture."""
        vivid = np.maximum(np.hypot(lab[:, 1], lab[:, 2]), 1e-6)[:, None]
        lab = np.concatenate([lab[:, :1], lab[:, 1:] * np.minimum(1.0, self.most_chroma / vivid)], 1)
        if not self.broken and not self.complements:
            return lab
        turned = generator.normal(0.0, self.broken, len(lab))
        turned[generator.random(len(lab)) < self.complements] += np.pi
        a, b = lab[:, 1], lab[:, 2]
        cosine, sine = np.cos(turned), np.sin(turned)
        return np.stack([lab[:, 0], cosine * a - sine * b, sine * a + cosine * b], 1)


OIL = (
    Layer(2.2, 9.0, (0.30, 0.62), (-0.10, 0.85), 0.3, 0.5),
    Layer(1.0, None, (0.40, 0.74), (0.0, 1.0), 1.0, 0.3),
    Layer(0.6, None, (0.45, 1.3), (0.0, 1.25), 1.0, 0.25, accent=True),
)
"""Ground, main strokes and accents."""

TECHNIQUES: dict[HandName, Technique] = {
    "oil": Technique(OIL, Brush(), measured=True),
    "watercolour": Technique(
        (
            Layer(5.0, 10.0, (0.35, 0.62), (0.22, 0.5), 0.6, 0.45, lightest=0.95, wash=1, share=0.85),
            Layer(3.0, 8.0, (0.35, 0.62), (0.08, 0.75), 0.5, 0.3, lightest=0.52, wash=2, share=0.45),
            Layer(1.6, 6.0, (0.40, 0.75), (0.0, 0.9), 0.5, 0.25, lightest=0.22, wash=3, share=0.45),
        ),
        Brush(0.0, 0.0, 0.8, rim=1.3, body=0.0, grain=0.5, tooth=0.12, flow=0.45, blunt=1.0),
        ground=(0.97, 93.0, 98.0), lightness=(68.0, 100.0), chroma=0.9,
    ),
    "dots": Technique(
        (
            Layer(1.15, 0.0, (0.62, 0.62), (0.0, 0.9), 0.5, 1.0),
            Layer(0.9, 0.0, (0.62, 0.62), (0.0, 1.0), 1.0, 1.0),
            Layer(0.6, 0.0, (0.9, 0.9), (0.0, 1.25), 1.0, 1.0, accent=True),
        ),
        Brush(0.06, 0.0, 0.0, blunt=1.0),
        ground=(0.9, 80.0, 94.0), chroma=1.2, broken=0.35, complements=0.1,
    ),
    "ink-wash": Technique(
        (
            Layer(5.0, 10.0, (0.35, 0.62), (0.15, 0.7), 0.3, 0.45, lightest=0.8, wash=1, share=0.5),
            Layer(2.8, 8.0, (0.35, 0.62), (0.0, 1.0), 0.5, 0.3, lightest=0.42, wash=2, share=0.6),
            Layer(1.8, 12.0, (0.45, 1.6), (-0.4, 1.0), 0.3, 0.5, lightest=0.16, swell=0.8),
            Layer(0.9, 14.0, (0.40, 2.6), (-0.5, 1.0), 0.5, 0.8, accent=True, lightest=0.6, swell=0.75),
        ),
        Brush(0.0, 1.0, 0.3, rim=0.7, body=0.0, grain=0.35, tooth=0.12, flow=0.4, blunt=0.4),
        ground=(0.97, 90.0, 96.0), lightness=(62.0, 100.0), most_chroma=9.0,
    ),
    "dry-brush": Technique(
        (
            Layer(2.6, 9.0, (0.30, 0.62), (-0.12, 0.7), 0.3, 0.5, wash=1),
            Layer(1.8, 12.0, (0.40, 0.80), (0.06, 1.0), 1.0, 0.4),
            Layer(1.1, 9.0, (0.45, 1.2), (0.05, 1.3), 1.0, 0.3, accent=True),
        ),
        Brush(0.05, 3.0, 0.3, grain=0.12, tooth=0.2),
    ),
    "pastel": Technique(
        (
            Layer(2.4, 8.0, (0.32, 0.66), (0.0, 0.9), 0.4, 0.45),
            Layer(0.8, 10.0, (0.38, 0.90), (0.03, 1.0), 1.2, 0.35),
            Layer(0.6, 9.0, (0.45, 1.4), (0.05, 1.3), 1.0, 0.3, accent=True),
        ),
        Brush(0.0, 0.3, 0.3, grain=0.6, tooth=0.13, feather=0.6, blunt=0.5),
        ground=(0.1, 28.0, 45.0), lightness=(40.0, 100.0),
    ),
    "print": Technique(
        (
            Layer(2.4, 6.0, (0.30, 0.62), (0.28, 0.0), 0.15, 0.6, wash=1),
            Layer(1.5, 7.0, (0.35, 0.62), (-0.12, 0.0), 0.15, 0.12, lightest=0.38, wash=2),
            Layer(1.2, 7.0, (0.35, 0.62), (-0.42, 0.0), 0.1, 0.1, lightest=0.12, wash=3),
            Layer(0.25, 20.0, (0.4, 9.0), (-0.5, 0.0), 0.0, 0.8, lightest=0.75, swell=0.7),
            Layer(0.25, 14.0, (0.4, 10.0), (0.48, 0.0), 0.0, 0.3, lightest=0.18, swell=0.7),
        ),
        Brush(0.0, 0.0, 0.0, rim=1.0, blunt=1.0), flat=True,
    ),
}  # fmt: skip
"""The techniques by name."""
