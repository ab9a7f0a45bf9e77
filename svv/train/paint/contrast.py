"""Adjustment of paint so that it appears with the contrast of its style.

A pixel shows the mean of the paint along its ray, so strokes lose contrast, most of all those of translucent regions.
Images depend linearly on the paint: with more contrast than its style, it can look like its style.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from svv.errors import Progress, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene
from svv.kernels.dispatch import kernels_of
from svv.train.base.resolutions import paint_pixel
from svv.train.paint.grid_kernels import interpolate
from svv.train.paint.painting import owners_at
from svv.train.paint.pieces import PieceStyle
from svv.train.paint.styled_views import StyledView, visible_from
from svv.train.run.config import StylizeSettings

Contrast = tuple[float, float]
"""Contrast of all colours, and of fine detail: standard deviations, or gains of them."""

PATCH = 5
"""Side in pixels of the patches whose deviation is the fine contrast."""

LEAST, MOST = 0.8, 2.0
"""Bounds of each gain: with more than twice the contrast, colours leave the gamut and are clipped to its corners."""

ROUNDS = 3
"""Number of corrections of the gains, needed because colours are clipped at 0 and 1."""

VIEWS = 8
"""Number of views in which contrast is measured."""

LEAST_SEEN = 0.02
"""Alpha above which a pixel counts for the depth of a region."""

COVERED = 0.1
"""Alpha above which a pixel can count; in a translucent region, the more opaque half of these pixels counts."""

LEAST_PATCHES = 200
"""Minimum number of patches from which contrast is measured."""

DEPTH = 5.0
"""Largest depth of a region along a ray, in pixels of the stylization views, for strokes of the usual size."""


class _Paint:
    """The paint of one region in a lattice, and the gains that change its contrast."""

    def __init__(
        self, lattice: SparseLattice, own: NDArray[np.int64], place: NDArray[np.float32], wanted: Contrast, reach: float
    ) -> None:
        self.lattice, self.wanted = lattice, wanted
        self.index = torch.from_numpy(own).to(lattice.table.device)
        self.before = lattice.table[self.index]
        self.mean = self.before.mean(0)
        self.low = torch.from_numpy(surroundings(place, self.before.cpu().numpy(), reach)).to(self.before)
        self.gains = 1.0, 1.0

    def correct(self, found: Contrast) -> None:
        coarse, fine = (
            float(np.clip(gain * wanted / max(seen, 1e-4), LEAST, MOST))
            for gain, wanted, seen in zip(self.gains, self.wanted, found, strict=True)
        )
        self.gains = coarse, fine
        colours = self.mean + coarse * (self.low - self.mean) + fine * (self.before - self.low)
        self.lattice.table[self.index] = colours.clamp_(0.0, 1.0)


@torch.no_grad()
def match_contrast(
    scene: Scene,
    field: UnrestrictedField,
    targets: Mapping[int, PieceStyle],
    settings: StylizeSettings,
    progress: Progress = silent,
) -> dict[int, Contrast]:
    """Change the contrast of laid paint in place such that it appears as strong as in its style; returns a, b.

    Colours c with the mean m and the mean l of their surroundings become m + a (l - m) + b (c - l): a matches the
    deviation of visible colours to the style's, b that within patches of :data:`PATCH` pixels.
    """
    lattice = field.encoding
    assert isinstance(lattice, SparseLattice)
    place = lattice.places_of_level(0, scene.occupancy.occupied, scene.occupancy.cells)
    owner = owners_at(scene, place, range(len(scene.regions)))
    paints = {}
    for k, target in targets.items():
        own, style = np.flatnonzero(owner == k), target.picture
        inside = torch.ones_like(style[0]) if target.inside is None else torch.from_numpy(target.inside).to(style)
        wanted = contrasts([(style, inside)])
        if wanted is not None and len(own):
            paints[k] = _Paint(lattice, own, place[own], wanted, PATCH * paint_pixel(scene, settings))
    views = visible_from(scene, scene.rig.sphere(VIEWS, settings.style_size), silent) if paints else []
    for turn in range(ROUNDS):
        progress(turn / ROUNDS, "contrast")
        pictures: dict[int, list[tuple[Tensor, Tensor]]] = {k: [] for k in paints}
        for view in views:
            pieces = view.position.split(kernels_of(view.position.device.type).SAMPLES)
            colours = torch.cat([field(piece) for piece in pieces])
            for k in paints:
                pictures[k].append(_seen(colours, view, k))
        for k, paint in paints.items():
            if (found := contrasts(pictures[k])) is not None:
                paint.correct(found)
    progress(1.0, "contrast")
    return {k: paint.gains for k, paint in paints.items()}


def stroke_scales(scene: Scene, regions: Collection[int], pixel: float, largest: float) -> dict[int, float]:
    """Return how much larger than usual strokes must be to be visible, from 1 to ``largest`` for each region.

    Strokes narrower than a fog is deep blur into one another: the median over pixels, whose side is ``pixel``, counts.
    """
    depths: dict[int, list[Tensor]] = {k: [] for k in regions}
    for view in visible_from(scene, scene.rig.sphere(6, 128), silent):
        for k in regions:
            own = view.region == k
            weight, at, pixels = view.weight[own, None], view.position[own], view.pixel[own]
            sums = at.new_zeros(view.height * view.width, 5)
            sums.index_add_(0, pixels, torch.cat([weight, weight * at, weight * at.square().sum(1, True)], dim=1))
            sums = sums[sums[:, 0] > LEAST_SEEN]
            mean = sums[:, 1:] / sums[:, :1]
            depths[k].append((mean[:, 3] - mean[:, :3].square().sum(1)).clamp_min(0.0).sqrt() / pixel)
    return {
        k: float(np.clip(float(torch.cat(d).median()) / DEPTH, 1.0, largest)) if sum(map(len, d)) else 1.0
        for k, d in depths.items()
    }


def contrasts(pictures: Sequence[tuple[Tensor, Tensor]]) -> Contrast | None:
    """Return the deviation of colours (3, h, w), and that within patches, where masks (h, w) are 1.

    Both are root mean squares over pictures; None if too little is visible.
    """
    total, count = 0.0, 0
    whole: list[Tensor] = []
    for colours, mask in pictures:
        if min(mask.shape) < PATCH:
            continue
        inside = F.avg_pool2d(mask[None], PATCH, 1)[0] > 1.0 - 1e-4
        mean, square = (F.avg_pool2d(x, PATCH, 1) for x in (colours, colours.square()))
        spread = (square - mean.square()).clamp_min(0.0).sum(0)[inside]
        total += float(spread.sum())
        count += len(spread)
        whole.append(colours[:, mask > 0.5])
    if count < LEAST_PATCHES:
        return None
    every = torch.cat(whole, dim=1)
    return float((every - every.mean(1, keepdim=True)).square().sum(0).mean().sqrt()), (total / count) ** 0.5


def surroundings(place: NDArray[np.float32], colours: NDArray[np.float32], reach: float) -> NDArray[np.float32]:
    """Return the mean colour within about ``reach`` of each point: (V, 3), interpolated between means of blocks."""
    at = place / reach
    low = np.floor(at.min(0)).astype(np.int64) - 1
    shape = tuple(np.ceil(at.max(0)).astype(np.int64) - low + 3)
    block = np.ravel_multi_index(tuple(np.rint(at - low).astype(np.int64).T), shape)
    sums = [np.bincount(block, w, minlength=int(np.prod(shape))).reshape(shape) for w in (None, *colours.T)]
    # Sums are interpolated between blocks and divided afterwards, so empty blocks do not count.
    found = np.empty((len(place), len(sums)), np.float32)
    interpolate(np.stack(sums).astype(np.float32), at - low, found)
    return (found[:, 1:] / np.maximum(found[:, :1], 1e-6)).astype(np.float32)


def _seen(colours: Tensor, view: StyledView, region: int) -> tuple[Tensor, Tensor]:
    """Return the colours of a region in a view, (3, h, w), and a mask of the pixels that count, (h, w)."""
    image, mask = view.image(colours, region, 0.0)
    there = mask[mask > COVERED]
    enough = float(there.median()) if len(there) else 1.0
    counts = (mask >= min(0.9, enough)).to(mask)
    return image / mask.clamp_min(1e-3), counts
