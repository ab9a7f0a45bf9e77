"""Which region gets which style: by hand, in turn, or by likeness of colour; and what is left over."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from svv.core.colour import colour_differences
from svv.errors import BadInput
from svv.fields.region import Region
from svv.train.ink import PAPER, Ink, Style, StyleInput, picture_of

Mask = NDArray[np.bool_]


def checked_masks(styles: Sequence[StyleInput]) -> tuple[list[Mask | None], list[str]]:
    """One mask or None for each style, and what is to be said about them.

    A mask of everything says nothing, so it counts as None.

    Raises:
        BadInput: a mask of another shape than its style, an empty one, or one of an ink.
    """
    found: list[Mask | None] = []
    notes = []
    for number, given in enumerate(styles):
        if given.mask is None:
            found.append(None)
            continue
        mask, (height, width) = np.asarray(given.mask, dtype=bool), picture_of(given.style).shape[:2]
        if mask.shape != (height, width):
            raise BadInput(
                f"The mask of style {number} has {mask.shape[1]} x {mask.shape[0]} pixels, its picture "
                f"{width} x {height}: make it from that picture."
            )
        if not mask.any():
            raise BadInput(f"The mask of style {number} is empty: nothing of the picture is left to learn from.")
        if mask.all():
            notes.append(f"The mask of style {number} covers the whole picture, so it changes nothing.")
        found.append(None if mask.all() else mask)
    return found, notes


def mean_colour(style: Style, mask: Mask | None = None) -> NDArray[np.float64]:
    """Mean colour of a style picture, where its mask is, sRGB; of an ink, its paper. (3,)"""
    if isinstance(style, Ink):
        return np.array(PAPER)
    pixels = np.asarray(style, np.float64).reshape(-1, 3) if mask is None else np.asarray(style, np.float64)[mask]
    return np.asarray(pixels.mean(0))


def style_pairs(regions: int, styles: int, mapping: dict[int, int] | None, keep: Collection[int]) -> dict[int, int]:
    """Style of each region that gets one; raises BadInput for pairs that cannot be."""
    if regions == 0:
        raise BadInput("The scene holds no palette network, so it has no regions to style; train it again.")
    if styles == 0:
        raise BadInput("Give at least one style picture.")
    for region in [*keep, *(mapping or {})]:
        if not 0 <= region < regions:
            raise BadInput(f"There is no region {region}: the scene has the regions 0 to {regions - 1}.")
    for style in (mapping or {}).values():
        if not 0 <= style < styles:
            raise BadInput(f"There is no style {style}: the styles given are 0 to {styles - 1}.")
    both = sorted(set(keep) & set(mapping or {}))
    if both:
        raise BadInput(f"Region {both[0]} is to be kept and styled at once; leave it out of --keep or of --map.")
    free = [k for k in range(regions) if k not in set(keep)]
    pairs = dict(mapping) if mapping is not None else {region: k % styles for k, region in enumerate(free)}
    if not pairs:
        raise BadInput("No region is left to style: every one is kept.")
    return pairs


def pairs_by_colour(
    regions: Sequence[Region],
    styles: Sequence[Style],
    masks: Sequence[Mask | None] | None = None,
    keep: Collection[int] = (),
) -> dict[int, int]:
    """Style of each region that is not kept: every region near to its style's mean colour (where the mask is).

    As many regions and styles as there are of the fewer are paired one to one, so that the sum of their CIEDE2000
    differences is least. Regions left over take the style nearest to them; styles left over are not used
    (:func:`leftovers` says which). A region's colour is the one shown: edited, if it was.

    Raises:
        BadInput: no region, no style, or none left to be styled.
    """
    free = [k for k in range(len(regions)) if k not in set(keep)]
    if not free or not styles:
        return {}
    shown = np.array([regions[k].edited_colour or regions[k].colour for k in free])
    means = np.stack([mean_colour(s, m) for s, m in zip(styles, masks or [None] * len(styles), strict=True)])
    difference = colour_differences(shown, means)
    rows, columns = linear_sum_assignment(difference)
    pairs = dict(enumerate(difference.argmin(1).tolist())) | dict(zip(rows.tolist(), columns.tolist(), strict=True))
    return {free[row]: style for row, style in sorted(pairs.items())}


def leftovers(pairs: dict[int, int], names: Sequence[str]) -> list[str]:
    """Sentences about styles that no region has, and those that several share."""
    notes = []
    unused = [k for k in range(len(names)) if k not in set(pairs.values())]
    if unused:
        listed = ", ".join(f"{k} ({names[k]})" for k in unused)
        one = len(unused) == 1
        notes.append(
            f"{'Style' if one else 'Styles'} {listed} {'has' if one else 'have'} no region and "
            f"{'is' if one else 'are'} not used; say where with --map."
        )
    for style in sorted(set(pairs.values())):
        of = [region for region, k in sorted(pairs.items()) if k == style]
        if len(of) > 1 and len(names) > 1:
            notes.append(f"Style {style} ({names[style]}) is shared by the regions {', '.join(map(str, of))}.")
    return notes
