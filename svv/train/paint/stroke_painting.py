"""Regions of a scene painted by brush strokes: how large the strokes are, where they lie, and their tone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import colour_differences, lab_to_rgb
from svv.errors import Progress, part
from svv.fields.scene.scene import Scene
from svv.styles.hand import Hand
from svv.train.match.stylize import StyledView
from svv.train.paint.brushwork import CLEAR, Brushwork, Painter
from svv.train.paint.surface_form import Floats, Form, form_of_opacity, grid_cells, opacity_grid
from svv.train.paint.toning import retoned, toned
from svv.train.paint.visible_surface import VisibleSurface, visible_surface

WIDTH, PICTURE = 10.0, 800.0
"""Width of strokes in pixels of a picture whose sides have that many, by default."""

DEEPEST = 0.8
"""Largest median depth of a visible sheet, in widths of strokes: where it is deeper, strokes become larger."""

LARGEST = 3.0
"""Largest factor by which they do: what is deeper still is fog."""

FAINT, GLAZED = 0.2, 5.0
"""Opacity of a sheet below which strokes become larger, and by how much per opacity: of what is hardly there, only
large ones remain strokes."""

GLAZE, WASH = 1.5, 0.15
"""How much the opacity of what is hardly opaque follows its strokes, up to 1: they show, and between them one sees
through better; and how much it follows washes, which have no ground between them."""

DEEPENED = (1.3, 1.5, -12.0)
"""Factors on the contrast and on the chroma of glazes, and change of their lightness, CIELAB, where nothing is opaque:
thin paint shows little of its own colour."""

SPECKLED = (0.5, 0.62)
"""How crumpled a region is from which its opacity would become speckled if it followed the strokes, and at which it no
longer follows them: strokes are cut up there, and the form is all in the opacity."""

SKY = 0.5
"""Fraction of the picture, from its top, whose light strokes give fog its colour."""

APART = 10.0
"""CIEDE2000 between the mean colours of two regions below which they look alike."""


@dataclass(frozen=True, eq=False)
class PaintedRegion:
    """The paint of one region."""

    work: Brushwork | None
    """The strokes; None for an even wash."""
    flat: Floats | None
    """Colour of the wash, RGB. (3,)"""
    mean: NDArray[np.float64] | None
    """Mean colour that views show, CIELAB; None if hardly anything is visible. (3,)"""
    glaze: float = 0.0
    """How much the region's opacity is to follow the strokes, from 0 for what is opaque."""


def stroke_width(scene: Scene, size: float) -> float:
    """Return the width of strokes in box units; ``size`` 1 means :data:`WIDTH` pixels at the scene's centre."""
    return size * WIDTH * scene.rig.view_width / scene.occupancy.box.size / PICTURE


class Brushing:
    """Paints regions of one scene by strokes.

    Args:
        scene: A scene with a palette colour network.
        views: Views from all around.
        size: Scale of the strokes.
        cell: Side of a cell of the paint in box units.
        seed: Seed of all random choices.
    """

    def __init__(self, scene: Scene, views: Sequence[StyledView], size: float, cell: float, seed: int) -> None:
        self.views, self.cell, self.seed = views, cell, seed
        self.width = stroke_width(scene, size)
        self.cells = grid_cells(scene.occupancy)
        self.opacity = opacity_grid(scene.base, scene.occupancy, self.cells)
        self.form: Form = form_of_opacity(self.opacity, self.cells, (0.0, 1.0, 0.0))
        self.notes: list[str] = []

    def painted(self, hands: Mapping[int, Hand], progress: Progress) -> dict[int, PaintedRegion]:
        """Return the paint of regions by the hands of their pictures; regions that nobody sees are left out.

        Notes say which regions are washed because they are fog, and which look alike.
        """
        found = {}
        for number, (region, hand) in enumerate(hands.items()):
            told = part(progress, number / len(hands), (number + 1) / len(hands))
            one = self._region(region, hand, told)
            if one is not None:
                found[region] = one
        self.notes += alike({k: one.mean for k, one in found.items() if one.mean is not None})
        return found

    def _region(self, region: int, hand: Hand, progress: Progress) -> PaintedRegion | None:
        progress(0.0, "laying strokes")
        surface = visible_surface(self.views, region, self.form, self.width)
        if surface is None or len(surface) < 2:
            return None
        depth, alpha = (_median(surface, values) for values in (surface.depth, surface.alpha))
        deep = depth / (DEEPEST * self.width)
        if deep > LARGEST:
            self.notes.append(
                f"Region {region} is a fog without surfaces: it gets an even wash in the colour of the picture's sky."
            )
            return _washed(hand)
        larger = max(deep, 1.0 + GLAZED * max(FAINT - alpha, 0.0), 1.0)
        width = self.width * larger
        if larger > 1.0:
            wider = visible_surface(self.views, region, self.form, width)
            surface = surface if wider is None or len(wider) < 2 else wider
        progress(0.2, "laying strokes")
        painter = Painter(hand, surface, self.opacity, self.cells, width, self.cell, self.seed + region)
        work = painter.painted(part(progress, 0.5, 0.8))
        if work is None:
            self.notes.append(
                f"Region {region} has no room for strokes: it gets an even wash in the colour of the picture's sky."
            )
            return _washed(hand)
        clear = 1.0 - min(alpha / CLEAR, 1.0)
        work, shown = toned(work, hand, self.views, region, self.cell, clear)
        glaze = glaze_of(work.brush.body == 1.0, clear, deep, painter.crumpled)
        if glaze > 0.0:
            self.notes.append(
                f"Region {region} is translucent, so the ground between its strokes is clearer than they are: svv "
                "edit --stroke-opacity changes that (below 0 for dark backgrounds), and --manner pieces paints evenly."
            )
            if painter.on_glass.any():
                work = deepened(work, clear)
        mean = None if shown is None else shown.mean
        # Between glazes lies paint of their own colour: another one would speckle where strokes thin out.
        return PaintedRegion(work, None if mean is None or glaze == 0.0 else lab_to_rgb(mean), mean, glaze)


def glaze_of(dry: bool, clear: float, deep: float, crumpled: float) -> float:
    """Return how much a region's opacity is to follow its strokes, from 0 for what is opaque to 1.

    Args:
        dry: Whether it is painted by dry strokes and not by washes.
        clear: How translucent its sheets are, from 0 to 1.
        deep: Depth of its visible sheets relative to :data:`DEEPEST`.
        crumpled: How crumpled it is at the scale of a stroke, from 0 to 1.

    >>> glaze_of(True, 0.8, 0.5, 0.0), glaze_of(True, 0.8, 0.5, 0.7)
    (1.0, 0.0)
    """
    low, high = SPECKLED
    whole = (1.0 - crumpled) * min(max((high - crumpled) / (high - low), 0.0), 1.0)
    return round(min((GLAZE if dry else WASH) * clear / max(deep, 1.0), 1.0) * whole, 2)


def deepened(work: Brushwork, clear: float) -> Brushwork:
    """Return strokes with colours as deep as glazes need to show, on what is translucent by ``clear``, 0 to 1."""
    contrast, chroma, shift = DEEPENED
    strokes = retoned(work.strokes, 1.0 + clear * (contrast - 1.0), 1.0 + clear * (chroma - 1.0), clear * shift)
    return replace(work, strokes=strokes)


def _median(surface: VisibleSurface, values: Floats) -> float:
    """Return the median of values over what is visible, weighted by how visible it is."""
    order = np.argsort(values)
    total = np.cumsum(surface.seen[order].astype(np.float64))
    return float(values[order[int(np.searchsorted(total, 0.5 * total[-1]))]])


def _washed(hand: Hand) -> PaintedRegion:
    """Return an even wash: the mean of the lighter strokes in the upper part of the picture."""
    top = hand.places[:, 1] >= (1.0 - SKY) * float(hand.places[:, 1].max())
    light = hand.colours[top & (hand.tones >= np.median(hand.tones[top]))].mean(0)
    return PaintedRegion(None, lab_to_rgb(light), light)


def alike(means: Mapping[int, NDArray[np.float64]]) -> list[str]:
    """Return a sentence about each two regions whose mean colours, CIELAB, differ by less than :data:`APART`."""
    regions = sorted(means)
    if len(regions) < 2:
        return []
    colours = np.stack([lab_to_rgb(means[k]) for k in regions])
    away = colour_differences(colours, colours)
    return [
        f"Regions {a} and {b} are hard to tell apart (CIEDE2000 {away[i, j]:.0f}): give one of them another style."
        for i, a in enumerate(regions) for j, b in enumerate(regions) if i < j and away[i, j] < APART
    ]  # fmt: skip
