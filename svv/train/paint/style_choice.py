"""Choice of a style for each region: by hand, in turn, or by similarity of colour; and the styles left over."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from svv.core.colour.colour import colour_differences
from svv.errors import BadInput
from svv.fields.scene.region import Region
from svv.train.paint.ink import PAPER, Ink, Style, StyleInput, picture_of

Mask = NDArray[np.bool_]


def validate_masks(styles: Sequence[StyleInput]) -> tuple[list[Mask | None], list[str]]:
    """Return a mask or None (the whole picture) for each style, and notes; raises BadInput for one that cannot be."""
    found: list[Mask | None] = []
    notes = []
    for number, given in enumerate(styles):
        if given.mask is None:
            found.append(None)
            continue
        mask, (height, width) = np.asarray(given.mask, dtype=bool), picture_of(given.style).shape[:2]
        if mask.shape != (height, width):
            raise BadInput(
                f"The mask of style {number} has {mask.shape[1]} x {mask.shape[0]} pixels, but its picture has "
                f"{width} x {height}: make the mask from that picture."
            )
        if not mask.any():
            raise BadInput(f"The mask of style {number} is empty: select the part of the picture to learn from.")
        if mask.all():
            notes.append(f"The mask of style {number} covers the whole picture, so it changes nothing.")
        found.append(None if mask.all() else mask)
    return found, notes


def mean_colour(style: Style, mask: Mask | None = None) -> NDArray[np.float64]:
    """Return the mean sRGB colour of a style picture within its mask; for an ink, the colour of paper. (3,)"""
    if isinstance(style, Ink):
        return np.array(PAPER)
    pixels = np.asarray(style, np.float64).reshape(-1, 3) if mask is None else np.asarray(style, np.float64)[mask]
    return np.asarray(pixels.mean(0))


def style_pairs(
    regions: int, styles: int, mapping: Mapping[int, int | str] | None, keep: Collection[int]
) -> dict[int, int]:
    """Return the style of each region that gets one; raises BadInput for impossible pairs."""
    if regions == 0:
        raise BadInput("The scene holds no palette network, so it has no regions to style; train it again.")
    if styles == 0:
        raise BadInput("Give at least one style picture.")
    for region in [*keep, *(mapping or {})]:
        if not 0 <= region < regions:
            raise BadInput(f"There is no region {region}: the scene has the regions 0 to {regions - 1}.")
    numbers = {region: style for region, style in (mapping or {}).items() if not isinstance(style, str)}
    if len(numbers) < len(mapping or {}):
        raise BadInput("A part of a picture has a name only where the picture is divided: name styles by number.")
    for style in numbers.values():
        if not 0 <= style < styles:
            raise BadInput(f"There is no style {style}: the styles given are 0 to {styles - 1}.")
    both = sorted(set(keep) & set(mapping or {}))
    if both:
        raise BadInput(f"Region {both[0]} cannot be both kept and styled; leave it out of --keep or of --map.")
    free = [k for k in range(regions) if k not in set(keep)]
    pairs = numbers if mapping is not None else {region: k % styles for k, region in enumerate(free)}
    if not pairs:
        raise BadInput("No region is left to style: keep fewer regions.")
    return pairs


def pairs_by_colour(
    regions: Sequence[Region],
    styles: Sequence[Style],
    masks: Sequence[Mask | None] | None = None,
    keep: Collection[int] = (),
) -> dict[int, int]:
    """Return a style for each region that is not kept, by mean colours within masks; none without either of them.

    Regions as shown and styles are paired one to one, as many as possible, with the least sum of CIEDE2000 differences.
    Regions left over take the nearest style; styles left over are not used (:func:`leftovers`).
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


def leftovers(pairs: Mapping[int, int], names: Sequence[str], divided: Collection[int] = ()) -> list[str]:
    """Return sentences about styles that no region has, and about undivided styles that several regions share."""
    notes = []
    unused = [k for k in range(len(names)) if k not in set(pairs.values())]
    if unused:
        listed = ", ".join(f"{k} ({names[k]})" for k in unused)
        one = len(unused) == 1
        notes.append(
            f"{'Style' if one else 'Styles'} {listed} {'has' if one else 'have'} no region and "
            f"{'is' if one else 'are'} not used; assign regions with --map."
        )
    for style in sorted(set(pairs.values()) - set(divided)):
        of = [region for region, k in sorted(pairs.items()) if k == style]
        if len(of) > 1 and len(names) > 1:
            notes.append(f"Style {style} ({names[style]}) is shared by regions {', '.join(map(str, of))}.")
    return notes
