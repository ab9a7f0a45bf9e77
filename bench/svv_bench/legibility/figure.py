"""How legible pictures of a scene's regions are: a figure in [0, 1], compared with the volume rendering.

A picture is compared at the places at which the volume rendering shows each region, whatever it shows there itself: a
region that it hides has the colours of what is seen instead. The figure is the geometric mean of three parts:

``apart``
    How well the two regions that are most alike can be told apart, or a region from the white background: their
    CIEDE2000 as a fraction of the volume rendering's, the smallest fraction over all pairs and over normal vision and
    the three deficiencies.
``contrast``
    How well regions stand out where they end: the CIEDE2000 between the pixels just inside and just outside their
    silhouettes, tile by tile, less what strokes alone give beside it, as a fraction of the volume rendering's. Mean
    over the regions, however small they are.
``order``
    Whether what is enclosed is lighter or darker than what encloses it, as in the volume rendering: between 1/2 (all
    reversed) and 1 (all kept), weighted by the volume rendering's difference.

Differences are those of :func:`svv.core.colour.colour_vision.set_difference`: what has the same mixture of colours is
not apart, however strong the contrast of its strokes. Beyond :data:`CLEAR`, larger differences say no more.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, generate_binary_structure

from svv.core.colour.colour import WHITE, over
from svv.core.colour.colour_vision import COLOUR_VISIONS, VisionName, oklab, set_difference
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.scene import Rendering, Scene
from svv.fields.scene.seen_colours import FRAMES, clustered
from svv_bench.styles.table import markdown

VIEW_SIZE = 240
"""Width and height of the views that are measured."""

CLEAR = 25.0
"""CIEDE2000 from which a larger difference makes nothing more legible."""

LEAST = 2.3
"""CIEDE2000 that is just noticeable (Mahy et al. 1994): what is less in the volume rendering is no difference."""

BAND, TILE = 1 / 60, 1 / 6
"""Width of the bands inside and outside a silhouette, and of the tiles in which they are compared, in widths of the
picture."""

BACKGROUND = -1
"""Number of the white background among regions."""

FEWEST = 12
"""Pixels that a band needs in a tile."""

SILHOUETTE, WITHIN = 0.05, 0.97
"""Opacity from which a region alone covers a pixel, and the share of it that lies within another that encloses it."""

Bool = NDArray[np.bool_]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Legibility:
    """How legible some pictures are, compared with the volume rendering; all but ``smallest`` in [0, 1]."""

    apart: float
    contrast: float
    order: float
    smallest: Mapping[VisionName, float]
    """Smallest CIEDE2000 between two regions in each way of seeing them."""

    @property
    def legibility(self) -> float:
        """The geometric mean of the three parts."""
        return float((self.apart * self.contrast * self.order) ** (1 / 3))

    def to_json(self) -> dict[str, Any]:
        """Return plain values."""
        return {"legibility": self.legibility, **asdict(self)}


class Yardstick:
    """The volume rendering of a scene in some views, with which pictures of it are compared.

    Args:
        scene: A scene with a palette network that has at least two regions; its edits do not count.
        cameras: The views; by default five from all around.
        progress: Called before each picture.

    Raises:
        BadInput: The scene has fewer than two regions, or the views show fewer.
    """

    def __init__(self, scene: Scene, cameras: Sequence[Camera] | None = None, progress: Progress = silent) -> None:
        if scene.palette_network is None or len(scene.regions) < 2:
            raise BadInput(
                "Legibility is measured between regions: give a scene with a palette network of two or more."
            )
        self.cameras = scene.rig.orbit(181, VIEW_SIZE, frames=FRAMES) if cameras is None else list(cameras)
        self.scene, steps = scene.reset(), len(self.cameras) * (1 + len(scene.regions))
        self.pictures, alone = [], [[] for _ in scene.regions]  # type: list[Rendering], list[list[Bool]]
        for camera in self.cameras:
            progress(len(self.pictures) * (1 + len(scene.regions)) / steps, "volume rendering")
            self.pictures.append(self.scene.render(camera, "pcn"))
            for region, covered in enumerate(alone):
                covered.append(self.scene.isolated(region).render(camera, "pcn").rgba[..., 3] >= SILHOUETTE)
        self.enclosing = enclosures([np.stack(covered) for covered in alone])
        self._own = _Measured(self.pictures, self.pictures)
        if len(self._own.light) < 2:
            raise BadInput("The views show only one region: legibility is measured between regions.")

    def measure(self, pictures: Sequence[Rendering]) -> Legibility:
        """Compare pictures of the same views with the volume rendering."""
        own, found = self._own, _Measured(self.pictures, pictures)
        apart = [_fraction(found.pairs[pair], min(d, CLEAR)) for pair, d in own.pairs.items() if d >= LEAST]
        contrast = [max(0.0, _fraction(found.edges[k], edge)) for k, edge in own.edges.items() if edge >= LEAST]
        kept = weights = 0.0
        for outer, inner in self.enclosing:
            if outer in own.light and inner in own.light:
                before, after = (x.light[outer] - x.light[inner] for x in (own, found))
                weights += abs(before)
                kept += abs(before) * (before * after > 0)
        smallest = {
            vision: min(d for (_, b, v), d in found.pairs.items() if v == vision and b != BACKGROUND)
            for vision in COLOUR_VISIONS
        }
        return Legibility(
            min(apart, default=1.0), float(np.mean(contrast)) if contrast else 1.0,
            0.5 + 0.5 * kept / weights if weights else 1.0, smallest,
        )  # fmt: skip

    def measure_scene(self, scene: Scene, network: str | None = None, progress: Progress = silent) -> Legibility:
        """Render the views of a scene with the same regions, such as a painting of this one, and compare them.

        Raises:
            BadInput: It has another number of regions.
        """
        if len(scene.regions) != len(self.scene.regions):
            raise BadInput("The scenes have different numbers of regions: compare paintings of one trained scene.")
        pictures = []
        for number, camera in enumerate(self.cameras):
            progress(number / len(self.cameras), "views")
            pictures.append(scene.render(camera, network))
        return self.measure(pictures)


class _Measured:
    """What pictures show at the places where the volume rendering shows each region.

    ``light``: lightness of each region that is visible. ``pairs``: CIEDE2000 of each two, in each way of seeing them.
    ``edges``: how far each stands out along its silhouette, the mean of :func:`_along` over all views.
    """

    def __init__(self, reference: Sequence[Rendering], pictures: Sequence[Rendering]) -> None:
        colours = np.stack([over(picture.rgba, WHITE) for picture in pictures])  # (views, h, w, 3)
        alpha = np.stack([picture.rgba[..., 3] for picture in reference])
        regions = np.stack([picture.region for picture in reference])
        seen = {}
        self.light: dict[int, float] = {}
        self.edges: dict[int, float] = {}
        for region in np.unique(regions[regions >= 0]).tolist():
            # Pixels at the border of a region show the background above all.
            own = (regions == region) & (alpha >= 0.5 * np.percentile(alpha[regions == region], 90))
            seen[region] = _main(colours[own])
            self.light[region] = float(oklab(colours[own])[:, 0].mean())
            edges = [d for c, r in zip(colours, regions) for d in _along(c, r == region)]
            self.edges[region] = float(np.mean(edges)) if edges else 0.0
        seen[BACKGROUND] = np.array([WHITE], np.float64), np.ones(1)
        self.pairs = {
            (a, b, vision): _difference(seen[a], seen[b], vision)
            for a, b in combinations(seen, 2)
            for vision in COLOUR_VISIONS
        }


def _main(colours: NDArray[np.floating]) -> tuple[Array, Array]:
    """Return the main colours of many (N, 3), and their shares."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "One of the clusters is empty", UserWarning)  # it has no share
        return clustered(colours, np.ones(len(colours)))


def _difference(one: tuple[Array, Array], other: tuple[Array, Array], vision: VisionName) -> float:
    return set_difference(one[0], other[0], one[1], other[1], vision)


def _along(colours: NDArray[np.floating], mask: Bool) -> Iterator[float]:
    """Yield the CIEDE2000 across a silhouette (h, w) in each tile, less what strokes alone would give.

    Across is between the bands just inside and just outside; the strokes' is between that outside and a band beyond it.
    A picture that has nothing to do with the region has 0 in the mean.
    """
    cross, width = generate_binary_structure(2, 1), max(1, round(BAND * mask.shape[1]))
    inside = mask & ~binary_erosion(mask, cross, width, border_value=1)
    near, far = (binary_dilation(mask, cross, n * width) for n in (1, 2))
    bands = inside, near & ~mask, far & ~near
    side = max(1, round(TILE * mask.shape[1]))
    for top in range(0, mask.shape[0], side):
        for left in range(0, mask.shape[1], side):
            tile = np.s_[top : top + side, left : left + side]
            parts = [colours[tile][band[tile]] for band in bands]
            if min(map(len, parts)) >= FEWEST:
                within, beyond, farther = map(_main, parts)
                across, strokes = (min(CLEAR, _difference(beyond, c, "normal")) for c in (within, farther))
                yield across - strokes


def enclosures(silhouettes: Sequence[Bool]) -> list[tuple[int, int]]:
    """Return which region encloses which, as (outer, inner), from the pixels that each alone covers in some views.

    Args:
        silhouettes: For each region. (views, h, w) each
    """
    sizes = [int(silhouette.sum()) for silhouette in silhouettes]
    return [
        (outer, inner)
        for outer, inner in permutations(range(len(sizes)), 2)
        if 0 < sizes[inner] < WITHIN * sizes[outer]
        and (silhouettes[outer] & silhouettes[inner]).sum() >= WITHIN * sizes[inner]
    ]


def _fraction(found: float, wanted: float) -> float:
    """Return a difference as a fraction of the volume rendering's, at most 1."""
    return min(1.0, found / wanted)


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format figures of paintings as Markdown: each a scene, a painting and :meth:`Legibility.to_json`."""
    lines = [
        {"scene": str(Path(row["scene"]).with_suffix("")), "painting": row["painting"],
         **{name: f"{row[name]:.2f}" for name in ("legibility", "apart", "contrast", "order")},
         **{vision: f"{difference:.1f}" for vision, difference in row["smallest"].items()}}
        for row in rows
    ]  # fmt: skip
    return markdown(lines, "scene", list(lines[0])[1:]) + "\n"
