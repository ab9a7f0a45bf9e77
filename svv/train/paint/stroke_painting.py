"""Regions of a scene painted by brush strokes: how large the strokes are, where they lie, and their tone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from svv.core.colour.colour import lab_to_rgb
from svv.errors import Progress, part
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import seen_in
from svv.styles.hand import Hand
from svv.train.paint.brushwork import CLEAR, Brushwork, Painter
from svv.train.paint.fog import sky_of, washed
from svv.train.paint.styled_views import StyledView
from svv.train.paint.surface_form import Floats, Form, form_of_opacity, grid_cells, opacity_grid
from svv.train.paint.toning import Laid, toned
from svv.train.paint.visible_surface import VisibleSurface, visible_surface

WIDTH, PICTURE = 10.0, 800.0
"""Width of strokes in pixels of a picture whose sides have that many, by default."""

DEEPEST = 0.8
"""Largest median depth of a visible sheet, in widths of strokes: where it is deeper, strokes become larger."""

LARGEST = 3.0
"""Largest factor by which they do: what is deeper still is fog."""

FAINT, GLAZED = 0.2, 5.0
"""Opacity of a sheet below which strokes become larger, to remain strokes, and by how much per opacity."""

GLAZE, WASH = 1.5, 0.15
"""How much the opacity of what is hardly opaque follows its strokes, up to 1: they show, and between them one sees
through better; and how much it follows washes, which have no ground between them."""

THINNED = 0.25
"""How much of its extinction a region loses on average whose opacity wholly follows its strokes."""

LEAST_FOG = 1.0 / 48.0
"""Least width of strokes through fog in box units: they fill its volume, and finer ones would be too many."""


@dataclass(frozen=True, eq=False)
class PaintedRegion:
    """The paint of one region."""

    work: Brushwork | None
    """The strokes; None for an even wash."""
    flat: Floats | None
    """Colour of the wash, RGB. (3,)"""
    glaze: float = 0.0
    """How much the region's opacity is to follow the strokes, from 0 for what is opaque."""


def stroke_width(scene: Scene, size: float) -> float:
    """Return the width of strokes in box units; ``size`` 1 means :data:`WIDTH` pixels at the scene's centre."""
    return size * WIDTH * scene.rig.view_width / scene.occupancy.box.size / PICTURE


class Brushing:
    """Paints regions of one scene by strokes of a ``size``, on paint whose cells have a side in box units."""

    def __init__(self, scene: Scene, views: Sequence[StyledView], size: float, cell: float, seed: int) -> None:
        self.scene, self.views, self.cell, self.seed = scene, views, cell, seed
        self.width = stroke_width(scene, size)
        self.cells = grid_cells(scene.occupancy)
        self.opacity = opacity_grid(scene.base, scene.occupancy, self.cells)
        self.form: Form = form_of_opacity(self.opacity, self.cells, (0.0, 1.0, 0.0))
        self.notes: list[str] = []
        self.doubtful = False
        """Whether regions may look alike."""

    def painted(self, hands: Mapping[int, Hand], progress: Progress) -> dict[int, PaintedRegion]:
        """Return the paint of regions that are seen, by the hands of their pictures; notes say which are washed."""
        found: dict[int, PaintedRegion] = {}
        laid: dict[int, Laid] = {}
        for number, (region, hand) in enumerate(hands.items()):
            told = part(progress, 0.8 * number / len(hands), 0.8 * (number + 1) / len(hands))
            one = self._region(region, hand, told)
            if isinstance(one, PaintedRegion):
                found[region] = one
            elif one is not None:
                laid[region], glaze = one
                found[region] = PaintedRegion(None, None, glaze)
        progress(0.8, "tones")
        regions = self.scene.regions
        colours = np.array([region.edited_colour or region.colour for region in regions], np.float64)
        flats = colours.copy()
        for region, one in found.items():
            if one.flat is not None:
                flats[region] = one.flat
        opacity = np.array([region.seen_opacity for region in regions])
        opacity *= [1.0 - THINNED * found[k].glaze if k in found else 1.0 for k in range(len(regions))]
        look = partial(seen_in, self.scene, "pcn")
        done = toned(laid, self.views, colours, flats, opacity, self.cell, look)
        self.doubtful = done.legibility.doubtful(done.lab)
        for k, one in found.items():
            if k in laid:
                # Between glazes lies paint of their own colour: another one would speckle where strokes thin out.
                mean = done.means.get(k) if one.glaze > 0.0 else None
                found[k] = replace(one, work=done.laid[k].work, flat=None if mean is None else lab_to_rgb(mean))
        return found

    def _region(self, region: int, hand: Hand, progress: Progress) -> PaintedRegion | tuple[Laid, float] | None:
        """Return an even wash, or strokes and how much the opacity is to follow them; None if it is not seen."""
        progress(0.0, "laying strokes")
        surface = visible_surface(self.views, region, self.form, self.width)
        if surface is None or len(surface) < 2:
            return None
        depth, alpha = (_median(surface, values) for values in (surface.depth, surface.alpha))
        deep = depth / (DEEPEST * self.width)
        if deep > LARGEST:
            return self._fog(region, hand, alpha)
        larger = max(deep, 1.0 + GLAZED * max(FAINT - alpha, 0.0), 1.0)
        width = self.width * larger
        if larger > 1.0:
            wider = visible_surface(self.views, region, self.form, width)
            surface = surface if wider is None or len(wider) < 2 else wider
        progress(0.2, "laying strokes")
        painter = Painter(hand, surface, self.opacity, self.cells, width, self.cell, self.seed + region)
        work = painter.painted(part(progress, 0.5, 0.8))
        if work is None:
            return self._even(region, hand)
        clear = 1.0 - min(alpha / CLEAR, 1.0)
        glaze = glaze_of(work.brush.body == 1.0, clear, deep, painter.crumpled)
        if glaze > 0.0:
            self.notes.append(
                f"Region {region} is translucent, so the ground between its strokes is clearer than they are: svv "
                "edit --stroke-opacity changes that (below 0 for dark backgrounds), and svv stylize --manner pieces "
                "paints evenly."
            )
        glazed = clear if glaze > 0.0 and painter.on_glass.any() else 0.0
        return Laid(work, hand, clear, glazed), glaze

    def _fog(self, region: int, hand: Hand, alpha: float) -> PaintedRegion | tuple[Laid, float]:
        """Return a wash whose tone follows the density, or an even one where there is no room for it."""
        sky, width = sky_of(hand), max(LARGEST * self.width, LEAST_FOG)
        work = washed(sky, self.views, region, self.form, self.opacity, self.cells, width, self.seed + region)
        if work is None:
            return self._even(region, hand)
        source = "its part of the picture" if hand.part else "the picture's sky"
        self.notes.append(
            f"Region {region} is a fog without surfaces: it gets a wash in {source}, darker where it is denser."
        )
        return Laid(work, sky, 1.0 - min(alpha / CLEAR, 1.0)), 0.0

    def _even(self, region: int, hand: Hand) -> PaintedRegion:
        """Return an even wash: the mean of the lighter strokes in the upper part of the picture."""
        self.notes.append(
            f"Region {region} has no room for strokes: it gets an even wash in the colour of the picture's sky."
        )
        sky = sky_of(hand)
        return PaintedRegion(None, lab_to_rgb(sky.colours[sky.tones >= np.median(sky.tones)].mean(0)))


def glaze_of(dry: bool, clear: float, deep: float, crumpled: float) -> float:
    """Return how much a region's opacity is to follow its strokes, from 0 for what is opaque to 1.

    It follows ``dry`` strokes more than washes, the more the clearer its sheets are, and less where these are ``deep``,
    relative to :data:`DEEPEST`, or ``crumpled`` at the scale of a stroke (0 to 1).

    >>> glaze_of(True, 0.8, 0.5, 0.0), glaze_of(True, 0.8, 0.5, 0.7)
    (1.0, 0.3)
    """
    return round(min((GLAZE if dry else WASH) * clear / max(deep, 1.0), 1.0) * (1.0 - crumpled), 2)


def _median(surface: VisibleSurface, values: Floats) -> float:
    """Return the median of values over what is visible, weighted by how visible it is."""
    order = np.argsort(values)
    total = np.cumsum(surface.seen[order].astype(np.float64))
    return float(values[order[int(np.searchsorted(total, 0.5 * total[-1]))]])
