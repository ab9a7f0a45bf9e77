"""The colours in which the regions of a scene appear in pictures, and how far they are apart.

The colours of a region are those of the pixels that it dominates, with its light and paint, over the background.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import WHITE, over
from svv.core.colour.colour_vision import LEAST_DIFFERENCE, VISIONS, VisionName, set_difference
from svv.core.geometry.cameras import Camera
from svv.core.json_values import list_in, number_in, object_in, text_in, vector_in
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.region import label_of
from svv.fields.scene.scene import Rendering, Scene

FRAMES = (30, 60, 90, 120, 150)
"""Views of the path around a scene in which its colours are looked at."""

VIEW_SIZE = 160
"""Side of these views in pixels."""

COLOURS = 8
"""Colours that stand for a region: its paint, light and shade."""

MOST_PIXELS = 4000
"""Pixels of a region that its colours are found from."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """The colours in which a region appears."""

    name: str
    colours: Array
    """sRGB in [0, 1]. (N, 3)"""
    weights: Array
    """How much of the region has each; they sum to 1. (N,)"""

    def to_json(self) -> dict[str, object]:
        """Return plain values."""
        return {"name": self.name, "colours": self.colours.round(4).tolist(), "weights": self.weights.round(5).tolist()}

    @classmethod
    def from_json(cls, told: object) -> Seen:
        """Invert :meth:`to_json`; raises BadInput or KeyError if the content is of another form."""
        content = object_in(told, "a region")
        rows: Any = content["colours"]
        colours = np.array([vector_in(row, "a colour") for row in list_in(rows, len(rows), "colours")])
        weights = np.array([number_in(w, "a weight") for w in list_in(content["weights"], len(rows), "weights")])
        if not len(rows) or weights.min() < 0.0 or not weights.sum() > 0.0:
            raise BadInput("the colours of a region need weights above 0.")
        return cls(text_in(content["name"], "a name"), colours, weights / weights.sum())


@dataclass(frozen=True)
class Pair:
    """How far two regions are apart in one way of seeing them."""

    first: str
    second: str
    vision: VisionName
    difference: float
    """CIEDE2000 (:func:`svv.core.colour.colour_vision.set_difference`)."""


def seen_in(
    scene: Scene,
    network: str | None = None,
    background: Sequence[float] = WHITE,
    cameras: Sequence[Camera] | None = None,
    progress: Progress = silent,
) -> dict[int, Seen]:
    """Return the colours of each region that is visible in some views, by its number.

    ``network``: as for :meth:`svv.fields.scene.scene.Scene.render`; ``background``: RGB in [0, 1]; ``cameras``: by
    default five from all around. Raises BadInput if the scene has no palette network, so no regions.
    """
    if scene.palette_network is None:
        raise BadInput("The scene has no regions because it holds no palette network; train it again.")
    views = scene.rig.orbit(181, VIEW_SIZE, frames=FRAMES) if cameras is None else cameras
    pictures = []
    for number, camera in enumerate(views):
        progress(number / len(views), "colours")
        pictures.append(scene.render(camera, network))
    return seen_of(scene, pictures, background)


def seen_of(scene: Scene, pictures: Sequence[Rendering], background: Sequence[float]) -> dict[int, Seen]:
    """Return the colours of each region that is visible in some pictures of a scene, by its number."""
    rgba = np.concatenate([picture.rgba.reshape(-1, 4) for picture in pictures])
    regions = np.concatenate([picture.region.ravel() for picture in pictures])
    found = {}
    for number in range(len(scene.regions)):
        own = rgba[(regions == number) & (rgba[:, 3] > 0.0)]
        if not len(own):
            continue
        # Pixels at the border of a region show the background above all.
        own = own[own[:, 3] >= 0.5 * np.percentile(own[:, 3], 90)]
        colours = over(own, background)
        found[number] = Seen(label_of(scene.regions, number), *clustered(colours, own[:, 3]))
    return found


def clustered(colours: NDArray[np.floating], weights: NDArray[np.floating]) -> tuple[Array, Array]:
    """Return at most :data:`COLOURS` colours that stand for many (N, 3), and their weights."""
    from scipy.cluster.vq import kmeans2

    rng = np.random.default_rng(0)
    if len(colours) > MOST_PIXELS:
        kept = rng.choice(len(colours), MOST_PIXELS, replace=False)
        colours, weights = colours[kept], weights[kept]
    distinct = np.unique(colours, axis=0)
    if len(distinct) <= COLOURS:
        centres = distinct.astype(np.float64)
    else:
        start = distinct[np.linspace(0, len(distinct) - 1, COLOURS).astype(int)].astype(np.float64)
        centres, _ = kmeans2(colours.astype(np.float64), start, minit="matrix", iter=20, missing="warn")
    nearest = ((colours[:, None] - centres) ** 2).sum(2).argmin(1)
    share = np.bincount(nearest, weights, len(centres))
    return centres[share > 0], share[share > 0] / share.sum()


def pairs_of(seen: Sequence[Seen], visions: Sequence[VisionName] = VISIONS) -> list[Pair]:
    """Return how far each pair of regions is apart in each way of seeing them."""
    return [
        Pair(a.name, b.name, vision, set_difference(a.colours, b.colours, a.weights, b.weights, vision))
        for vision in visions
        for a, b in combinations(seen, 2)
    ]


def look_alikes(scene: Scene, background: Sequence[float] = WHITE) -> list[Pair]:
    """Return the pairs of regions of a painted scene that look alike, and less so in its volume rendering."""
    painted = pairs_of(list(seen_in(scene, None, background).values()), VISIONS[:1])
    alike = [pair for pair in painted if pair.difference < LEAST_DIFFERENCE]
    if not alike:
        return []
    before = pairs_of(list(seen_in(scene, "pcn", background).values()), VISIONS[:1])
    asked = {(pair.first, pair.second): pair.difference for pair in before}
    return [pair for pair in alike if pair.difference < asked.get((pair.first, pair.second), LEAST_DIFFERENCE)]
