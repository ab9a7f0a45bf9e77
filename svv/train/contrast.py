"""Contrast of paint as it is seen, brought to that of its style.

A pixel of a region shows the mean of what lies along its ray, and from another side the mean of other things. So the
strokes of a translucent region lose contrast, the finest most of all, and even a surface's a little, between vertices.
What is seen depends linearly on the paint: paint that has more contrast than its style looks as its style does.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from torch import Tensor

from svv.errors import Progress, silent
from svv.fields.encodings import SparseLattice
from svv.fields.networks import UnrestrictedField
from svv.fields.scene import Scene
from svv.kernels.dispatch import kernels_of
from svv.train.config import StylizeSettings
from svv.train.distil import paint_pixel
from svv.train.style_loss import StyleTarget
from svv.train.stylize import StyledView, visible_from

Contrast = tuple[float, float]
"""Of all colours, and of fine detail: deviations, or gains of them."""

PATCH = 5
"""Side in pixels of the patches whose deviation is fine contrast."""

LEAST, MOST = 0.8, 2.0
"""Bounds of each gain: more than twice the contrast leaves the gamut, and what is seen then is its corners' colours."""

ROUNDS = 3
"""How often the gains are corrected, since colours end at 0 and 1."""

VIEWS = 8
"""Views that are looked at."""

LEAST_SEEN = 0.02
"""Alpha from which on a pixel tells how deep a region is."""

COVERED = 0.1
"""Alpha from which on a pixel counts; of a translucent region the more opaque half of these does."""

LEAST_PATCHES = 200
"""Patches that it takes to tell a contrast."""

DEPTH = 5.0
"""Pixels of the stylization views that a region may be deep along a ray, and carry strokes of the usual size."""


class _Paint:
    """What a lattice holds of one region, and the gains that make its contrast another."""

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
    targets: Mapping[int, StyleTarget],
    settings: StylizeSettings,
    progress: Progress = silent,
) -> dict[int, Contrast]:
    """Give the paint of regions the contrast at which it is seen as strong as in its style, within bounds.

    Colours c with the mean m and the mean l of their surroundings become m + a (l - m) + b (c - l): a brings the
    deviation of what is seen to the style's, b that of its patches of :data:`PATCH` pixels from their means.

    Args:
        scene: With a palette colour network.
        field: Laid paint, changed in place.
        targets: Style of each region that is to change.
        settings: Of stage 3.
        progress: Called after each round; may raise.

    Returns:
        a and b of each region that is seen.
    """
    lattice = field.encoding
    assert isinstance(lattice, SparseLattice)
    place = lattice.places_of_level(0, scene.occupancy.occupied, scene.occupancy.cells)
    owner = _owners(scene, place)
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
    """How much larger than usual the strokes of regions must be, to be seen.

    A ray through fog sees paint from all of its depth, seen from another side each, so strokes that are not as wide as
    the fog is deep blur into each other. The depth is the weighted deviation of positions along the rays, of which the
    median over pixels counts.

    Args:
        scene: With a palette colour network.
        regions: Which.
        pixel: Side of a pixel of the stylization views, in box units.
        largest: The largest factor.

    Returns:
        A factor from 1 to ``largest`` for each.
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
    """Deviation of colours, and of patches from their means, root mean squares over pictures.

    Args:
        pictures: Colours (3, h, w) and where they count (h, w), 0 or 1.

    Returns:
        Both, or None where too little is seen to tell.
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
    """Mean colour around each point, over about ``reach``: of (V, 3) points and colours, in blocks, interpolated."""
    at = place / reach
    low = np.floor(at.min(0)).astype(np.int64) - 1
    shape = tuple(np.ceil(at.max(0)).astype(np.int64) - low + 3)
    block = np.ravel_multi_index(tuple(np.rint(at - low).astype(np.int64).T), shape)
    sums = [np.bincount(block, w, minlength=int(np.prod(shape))).reshape(shape) for w in (None, *colours.T)]
    # Between blocks sums are interpolated and then divided, so that empty ones have no say.
    count, *totals = (map_coordinates(s.astype(np.float32), (at - low).T, order=1) for s in sums)
    return (np.stack(totals, 1) / np.maximum(count, 1e-6)[:, None]).astype(np.float32)


def _seen(colours: Tensor, view: StyledView, region: int) -> tuple[Tensor, Tensor]:
    """What a view whose samples have these colours shows of a region: (3, h, w), and where they count (h, w)."""
    image, mask = view.image(colours, region, 0.0)
    there = mask[mask > COVERED]
    enough = float(there.median()) if len(there) else 1.0
    counts = (mask >= min(0.9, enough)).to(mask)
    return image / mask.clamp_min(1e-3), counts


def _owners(scene: Scene, place: NDArray[np.float32]) -> NDArray[np.int64]:
    """Which region each vertex is most of, -1 for none. (V,)"""
    assert scene.palette_network is not None
    found = []
    for piece in torch.from_numpy(place).split(1 << 17):
        best, which = scene.palette_network.material(piece.to(scene.device))[1].max(dim=1)
        found.append(torch.where(best > 0.0, which, -1).cpu().numpy())
    return np.concatenate(found)
