"""In which manner a style is painted: by brush strokes, or by pieces of its picture (:mod:`svv.train.paint.quilt`).

Strokes show a painter's hand or a printer's blocks; photographs, stones, dots and textures are better in pieces.
"""

from __future__ import annotations

import numpy as np

from svv.options.making import HandName, MannerName
from svv.styles.hand import Hand

SMOOTH = 0.15
"""Fraction of smooth area from which a picture is a print or a photograph: oil paintings have up to 0.02, watercolour
0.08, woodblock prints whose wood and paper show 0.10, and prints of flat ink and photographs 0.17 or more."""

SHORT = 1.25
"""Elongation below which marks are stones or dots."""

COMMON, EVEN = 0.9, 0.12
"""Fraction of the commonest colours, and broken tone, from which a picture is a texture or a drawing."""

DOTS = (0.12, 0.25)
"""Broken tone between which marks that are as wide as long are dots: stones of a mosaic are more even, and in noise
neighbours have nothing in common."""

FEW_COLOURS = 0.6
"""Fraction of the commonest colours from which dots are those of a pen."""

PAPER, LIGHT = 90.0, 62.0
"""Lightness of the lightest strokes from which they can be paper, and mean lightness of a picture full of it."""

BROAD, CALM = 0.02, 0.06
"""Least width of washes, in the picture's long side, and the broken tone that they have at most."""

NEUTRAL, WASHED = 10.0, 0.25
"""Chroma that all but one in twenty strokes of ink have at most, and the least fraction of tones between ink and paper:
text and line drawings have hardly any."""

INKS, HARD, ALTERNATING, LONG, BLANK = (0.52, 0.9), 14.0, 0.09, 1.8, 0.4
"""A print has few flat inks with hard edges: bounds of the fraction of the commonest colours (0.56 to 0.85 in woodblock
prints and their halves; paintings have less, drawings and text more); least contrast, broken tone and elongation, which
are less in photographs and halftones; and the largest smooth fraction."""


def manner_of(hand: Hand) -> tuple[MannerName, str]:
    """Return the manner that suits a picture, ``strokes`` or ``pieces``, and the reason, for a sentence of a note.

    >>> from svv.styles.gallery import gallery_picture
    >>> from svv.styles.hand import measure_hand
    >>> manner_of(measure_hand(gallery_picture("mosaic", 300)))
    ('pieces', 'its marks are as wide as long, like stones or dots')
    """
    if hand.plain:
        return "pieces", "it shows no strokes"
    technique, reason = technique_of(hand)
    if technique != "oil":
        return "strokes", reason
    if hand.smooth >= SMOOTH:
        return "pieces", f"{hand.smooth:.0%} of it is smooth, as in prints and photographs"
    if hand.common >= COMMON and hand.scatter >= EVEN:
        return "pieces", "a few colours alternate everywhere, as in textures and line drawings"
    if hand.elongation < SHORT:
        return "pieces", "its marks are as wide as long, like stones or dots"
    return "strokes", f"it has brush strokes, {hand.elongation:.1f} times as long as wide"


def technique_of(hand: Hand) -> tuple[HandName, str]:
    """Return the technique that a picture shows, and the reason, for a sentence of a note; in doubt, it is oil.

    Pastel and dry brush are never found: rough oil paintings measure the same.

    >>> from svv.styles.gallery import gallery_picture
    >>> from svv.styles.hand import measure_hand
    >>> technique_of(measure_hand(gallery_picture("pointillism", 300)))
    ('dots', 'its marks are round dots of broken tone')
    """
    light = hand.colours[:, 0]
    chroma = np.hypot(hand.colours[:, 1], hand.colours[:, 2])
    if hand.plain:
        return "oil", "it shows no strokes"
    even = hand.smooth < SMOOTH and hand.common < FEW_COLOURS
    if hand.elongation < SHORT and DOTS[0] <= hand.scatter <= DOTS[1] and even:
        return "dots", "its marks are round dots of broken tone"
    vivid = float(np.quantile(chroma, 0.95))
    few = INKS[0] <= hand.common < INKS[1] and vivid > NEUTRAL and hand.smooth < BLANK
    if few and hand.contrast >= HARD and hand.scatter >= ALTERNATING and hand.elongation >= LONG:
        return "print", "it has a few flat inks with hard edges"
    ink = float(((light > 35.0) & (light < 80.0)).mean())
    paper = float(np.quantile(light, 0.97))
    if paper < PAPER or float(light.mean()) < LIGHT:
        return "oil", "its lights are painted"
    if hand.width < BROAD * max(hand.size):
        return "oil", "its strokes are narrow"
    if vivid <= NEUTRAL:
        return ("ink-wash", "it has greys of one ink on light paper") if ink >= WASHED else ("oil", "its ink is a line")
    if hand.scatter <= CALM and even:
        return "watercolour", "its washes are broad, and its lights are paper"
    return "oil", "its strokes cover the ground"
