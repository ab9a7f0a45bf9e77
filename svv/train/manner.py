"""In which manner a style is painted: by brush strokes, or by pieces of its picture.

Strokes show the hand of a painter. What has no such hand is better shown by pieces (:mod:`svv.train.quilt`): flat inks
of prints and the smooth parts of photographs would become strokes that nobody painted, and stones, dots and textures
would lose their shapes.
"""

from __future__ import annotations

from svv.options.making import MannerName
from svv.styles.hand import Hand

SMOOTH = 0.15
"""Fraction of smooth area from which a picture is a print or a photograph: oil paintings have up to 0.02, watercolour
0.08, woodblock prints whose wood and paper show 0.10, and prints of flat ink and photographs 0.17 or more."""

SHORT = 1.25
"""Elongation below which marks are stones or dots."""

COMMON, EVEN = 0.9, 0.12
"""Fraction of the commonest colours, and broken tone, from which a picture is a texture or a drawing: few colours that
alternate everywhere."""


def manner_of(hand: Hand) -> tuple[MannerName, str]:
    """Return the manner that suits a picture, ``strokes`` or ``pieces``, and the reason, for a sentence of a note.

    >>> from svv.styles.gallery import gallery_picture
    >>> from svv.styles.hand import measure_hand
    >>> manner_of(measure_hand(gallery_picture("mosaic", 300)))
    ('pieces', 'its marks are as wide as long, like stones or dots')
    """
    if hand.plain:
        return "pieces", "it shows no strokes"
    if hand.smooth >= SMOOTH:
        return "pieces", f"{hand.smooth:.0%} of it is smooth, as in prints and photographs"
    if hand.common >= COMMON and hand.scatter >= EVEN:
        return "pieces", "a few colours alternate everywhere, as in textures and line drawings"
    if hand.elongation < SHORT:
        return "pieces", "its marks are as wide as long, like stones or dots"
    return "strokes", f"it has brush strokes, {hand.elongation:.1f} times as long as wide"
