"""Regions of a scene whose volume is known: the visible ranges of its transfer function."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.classified import ClassifiedVolume
from svv.core.colour import to_hex
from svv.core.palette import Palette, PaletteSettings
from svv.fields.networks import PaletteField
from svv.fields.region import Region
from svv.fields.rendering import composite, march
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet
from svv.kernels.types import Samples
from svv.train.batches import RayPool

LOOKED_AT = 16384
"""Rays from which the visible light of each range is estimated. With a hash grid all their samples go through networks
at once, so more would need gigabytes."""


class Owners:
    """The regions that points may belong to, as a classified volume says."""

    def __init__(self, volume: ClassifiedVolume, regions: NDArray[Any], device: torch.device) -> None:
        """Take a volume's ranges.

        Args:
            volume: R ranges.
            regions: The region that each range is part of (R,), whole numbers; or whether it may be part of each
                region, where several share one (R, P).
            device: Where points will be.
        """
        member = np.eye(int(regions.max()) + 1)[regions] if regions.ndim == 1 else regions > 0
        self.shared = bool((member.sum(axis=1) > 1).any())
        """Whether several regions share a range, so that the views have to say which part is whose."""
        self._member = torch.from_numpy(member.astype(np.float32)).to(device)
        self._range = torch.from_numpy(volume.owner).to(device)
        self._first = self._member.argmax(dim=1)
        self._cells = volume.cells

    def range_of(self, position: Tensor) -> Tensor:
        """Range at the vertex next to each point of the box: (S, 3) in [0, 1] -> (S,) int64."""
        vertex = (position * self._cells + 0.5).long()
        x, y, z = (v.clamp(0, size - 1) for v, size in zip(vertex.unbind(1), self._range.shape, strict=True))
        return self._range[x, y, z].long()

    def of(self, position: Tensor) -> Tensor:
        """Region of each point, the first of those that share it: (S, 3) in [0, 1] -> (S,) int64."""
        return self._first[self.range_of(position)]

    def told(self, weights: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
        """Region of points (S,), and what the regions that share them have of the weights (S, P), in (0, 1]. (S,)"""
        number = self.range_of(position)
        owner = self._first[number]
        if not self.shared:
            return owner, weights.gather(1, owner[:, None])[:, 0]
        return owner, (weights * self._member[number]).sum(dim=1)


@dataclass(frozen=True)
class KnownRegions:
    """What a classified volume says about the regions of its scene."""

    palette: Palette
    """A colour a region, the one with most visible light first."""
    ranges: tuple[tuple[tuple[float, float], ...], ...]
    """Smallest and largest scalar value of each range that a region is made of."""
    owners: Owners
    """Which region a point belongs to."""


@torch.no_grad()
def regions_of(volume: ClassifiedVolume, views: ViewSet, scene: Scene, seed: int) -> KnownRegions:
    """A region for each range of the transfer function that the views show.

    A range that less light comes from than the palette's ``min_share`` is part of its neighbour in value.

    Args:
        volume: The classified volume.
        views: Training views.
        scene: With its base field; its device is where the work is done.
        seed: Of the rays that are looked at.
    """
    batch = RayPool(views, scene.occupancy.box, seed, scene.device).batch(0, LOOKED_AT)
    samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
    count = len(volume.ranges)
    owner = Owners(volume, np.arange(count), scene.device).of(samples.position)
    share = shares_of(samples, scene.base.extinction(samples), owner, count)
    least = PaletteSettings().min_share
    seen = np.flatnonzero(share >= min(least, share.max()))
    steps = [f"{count} visible ranges of the transfer function, read from the volume"]
    if len(seen) < count:
        steps.append(f"{len(seen)} left: less than {least:.1%} of the visible light is of the others")
    order = seen[np.argsort(-share[seen], kind="stable")]
    region_of_range = np.abs(np.arange(count)[:, None] - order).argmin(axis=1)
    colours = np.array([volume.ranges[i].colour for i in order])
    part = np.bincount(region_of_range, share, len(order)).astype(np.float64)
    steps.append("palette " + ", ".join(f"{to_hex(c)} ({p:.1%})" for c, p in zip(colours, part, strict=True)))
    ranges = tuple(
        tuple((r.low, r.high) for r, k in zip(volume.ranges, region_of_range, strict=True) if k == region)
        for region in range(len(order))
    )
    owners = Owners(volume, region_of_range, scene.device)
    return KnownRegions(Palette(colours, part, tuple(steps)), ranges, owners)


def regions_for(
    network: PaletteField,
    shares: Sequence[float] | NDArray[np.floating],
    ranges: Sequence[tuple[tuple[float, float], ...]] | None = None,
) -> tuple[Region, ...]:
    """The regions of a palette network: its colours, their shares of what is seen, and their ranges where known."""
    known = ranges or ((),) * len(shares)
    return tuple(
        Region(tuple(colour), float(share), values=hull_of(own), ranges=own)
        for colour, share, own in zip(network.colours.tolist(), shares, known, strict=True)
    )


def hull_of(ranges: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Smallest and largest value of ranges; None of none."""
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None


def membership(regions: Sequence[Region], volume: ClassifiedVolume) -> NDArray[np.bool_]:
    """Whether each range of a volume is part of each region, which all say what values they show. (R, P)

    A range belongs to the regions whose values hold its middle; if none does, to the one whose values are the nearest.
    """
    middles = np.array([0.5 * (r.low + r.high) for r in volume.ranges])
    away = np.full((len(middles), len(regions)), np.inf)
    for number, region in enumerate(regions):
        for low, high in region.ranges or filter(None, [region.values]):
            away[:, number] = np.minimum(away[:, number], np.maximum(low - middles, middles - high))
    return (away <= 0) | (away == away.min(axis=1, keepdims=True)) & (away > 0).all(axis=1, keepdims=True)


@torch.no_grad()
def shares_of(samples: Samples, sigma: Tensor, region: Tensor, count: int) -> NDArray[np.float64]:
    """Part of the visible light that is of each region, for extinctions (S,) and regions (S,). (count,)"""
    _, _, seen = composite(samples, sigma, torch.zeros(len(samples), 1, device=sigma.device))
    share = np.bincount(region.cpu().numpy(), weights=seen.cpu().numpy(), minlength=count)
    return np.asarray(share / max(share.sum(), 1e-9), np.float64)


@torch.no_grad()
def region_overlaps(scene: Scene, views: ViewSet, volume: ClassifiedVolume) -> list[float]:
    """Intersection over union of each region with the values that it is said to show, over all that the views show.

    Args:
        scene: With a palette colour network.
        views: Whose pixels are looked at, ``LOOKED_AT`` of all.
        volume: Which range of the transfer function a point is of.

    Returns:
        A number in [0, 1] a region; none where the scene does not say which values its regions show, or where several
        share a range, of which the volume does not say which part is whose.
    """
    assert scene.palette_network is not None
    if not all(region.values for region in scene.regions):
        return []
    member = membership(scene.regions, volume)
    if (member.sum(axis=1) > 1).any():
        return []
    region_of_range = member.argmax(axis=1)
    batch = RayPool(views, scene.occupancy.box, 0, scene.device).batch(0, LOOKED_AT)
    samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
    ours, theirs = scene.occupancy.box, volume.box
    shift = samples.position.new_tensor((np.asarray(ours.low) - np.asarray(theirs.low)) / theirs.size)
    owner = Owners(volume, region_of_range, scene.device).of(samples.position * (ours.size / theirs.size) + shift)
    found = scene.palette_network.material(samples.position)[1].argmax(1)
    sigma, count = scene.base.extinction(samples), len(scene.regions)
    both = shares_of(samples, sigma, torch.where(owner == found, owner, count), count + 1)[:count]
    either = shares_of(samples, sigma, owner, count) + shares_of(samples, sigma, found, count) - both
    return [float(part) for part in both / np.maximum(either, 1e-12)]
