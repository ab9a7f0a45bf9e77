"""Whether the regions of a scene or of a figure can be told apart by everybody, as they are rendered.

The colours of a region are those of the pixels that it dominates, with its light and paint, over the background.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.core.colour.colour import over
from svv.core.colour.colour_vision import LEAST_DIFFERENCE, VISIONS, simulated
from svv.core.colour.hex_codes import to_hex
from svv.core.colour.palette import extract_palette
from svv.core.json_values import object_in, parsed
from svv.errors import BadInput
from svv.fields.scene.seen_colours import Pair, Seen, pairs_of
from svv.io.pictures.output import to_bytes
from svv.render.pictures import sheet

MOST_GROUPS = 3
"""Groups of regions that look alike, of which a legend names that many."""

Array = NDArray[np.float64]


def merging(seen: Sequence[Seen]) -> list[Pair]:
    """Return the pairs of regions that look alike to everybody, the most alike first."""
    alike = [pair for pair in pairs_of(seen, VISIONS[:1]) if pair.difference < LEAST_DIFFERENCE]
    return sorted(alike, key=lambda pair: pair.difference)


def describe_lookalikes(pairs: Sequence[Pair]) -> str:
    """Return which regions look alike, for a legend; '' if none do.

    >>> names = ("bone fat", "bone skin", "fat skin", "fat air")
    >>> describe_lookalikes([Pair(*pair.split(), "normal", 5.0) for pair in names])
    'bone, fat and skin look alike; fat and air look alike'
    """
    alike = {frozenset((pair.first, pair.second)) for pair in pairs}
    names = list(dict.fromkeys(name for pair in pairs for name in (pair.first, pair.second)))
    groups: list[list[str]] = []
    for pair in pairs:
        if any(pair.first in group and pair.second in group for group in groups):
            continue
        group = [pair.first, pair.second]
        for name in names:
            if all(frozenset((name, other)) in alike for other in group):
                group.append(name)
        groups.append(group)
    listed = [f"{', '.join(group[:-1])} and {group[-1]} look alike" for group in groups[:MOST_GROUPS]]
    return "; ".join([*listed, "others look alike, too"] if len(groups) > MOST_GROUPS else listed)


def report_on(seen: Sequence[Seen], least: float = LEAST_DIFFERENCE) -> dict[str, Any]:
    """Return the smallest difference in each way of seeing, with its pair, and the pairs that merge."""
    pairs = pairs_of(seen)
    smallest = {}
    for vision in VISIONS:
        nearest = min((pair for pair in pairs if pair.vision == vision), key=lambda pair: pair.difference, default=None)
        if nearest is not None:
            smallest[vision] = {"difference": nearest.difference, "between": [nearest.first, nearest.second]}
    merging = [vars(pair) for pair in sorted(pairs, key=lambda pair: pair.difference) if pair.difference < least]
    return {"regions": [one.name for one in seen], "least": least, "smallest": smallest, "merging": merging}


def seen_in_picture(path: Path) -> list[list[Seen]]:
    """Return the colours of the regions of each panel of a figure, or the main colours of another PNG or TIFF.

    Figures of ``svv figure`` tell their regions. Raises BadInput if it is no picture, or what it tells is damaged.
    """
    from svv.render.figures.files import read_region_metadata

    try:
        with Image.open(path) as picture:
            metadata, rgba = read_region_metadata(picture), np.asarray(picture.convert("RGBA"), np.float32) / 255.0
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise BadInput(
            f"{path} is no picture that can be checked: give a scene, or a PNG or TIFF of the figure."
        ) from error
    if metadata:
        try:
            content = object_in(parsed(metadata), "the figure")
            panels: Any = content["panels"]
            return [[Seen.from_json(one) for one in panel] for panel in panels]
        except (ValueError, KeyError, TypeError) as error:
            raise BadInput(f"What {path} tells of its regions is damaged: make the figure again.") from error
    return [_main_colours(over(rgba).reshape(-1, 3))]


def regions_to_json(panels: Sequence[Sequence[Seen]]) -> str:
    """Return what a figure tells of the colours of its panels' regions, for :func:`seen_in_picture`."""
    return json.dumps({"panels": [[one.to_json() for one in panel] for panel in panels]}, ensure_ascii=True)


def _main_colours(colours: NDArray[np.floating]) -> list[Seen]:
    """Return the main colours of a picture (N, 3), each as a region named by its code, without the background."""
    levels, counts = np.unique(to_bytes(colours), axis=0, return_counts=True)
    shown = (colours != levels[counts.argmax()] / np.float32(255.0)).any(1)
    if not shown.any():
        return []
    palette = extract_palette(colours[shown], np.ones(int(shown.sum())))
    one = np.ones(1)
    return [Seen(to_hex(colour), colour[None], one) for colour in palette.colours]


def simulation_sheet(picture: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3) in all ways of seeing it, with their names; side by side unless it is wide."""
    pictures = [to_bytes(simulated(picture, vision)) for vision in VISIONS]
    if picture.shape[0] > 0.6 * picture.shape[1]:
        return sheet([pictures], VISIONS)
    return np.concatenate([sheet([[one]], [vision]) for one, vision in zip(pictures, VISIONS, strict=True)])
