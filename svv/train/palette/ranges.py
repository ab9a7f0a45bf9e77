"""Regions of a scene with a known volume: the visible ranges of its transfer function."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from svv.core.colour.hex_codes import to_hex
from svv.core.colour.palette import Palette, PaletteSettings
from svv.core.volumes.classified import ClassifiedVolume
from svv.fields.radiance.networks import PaletteField
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels.types import Samples
from svv.train.palette.doubts import Question
from svv.train.run.batches import RayPool

LOOKED_AT = 16384
"""Rays that tell the visible light of each range; a hash grid's networks take all their samples at once."""


class Labelled(Protocol):
    """Regions to which points belong; what is no point, such as NaN, belongs to any."""

    shared: bool = False
    """Whether a point may belong to several regions; the views then decide which part belongs to which."""

    def of(self, position: Tensor) -> Tensor:
        """Return the region of each point, the first of those that share it: (S, 3) in [0, 1] -> (S,) int64."""

    def assign(self, weights: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
        """Return the region of each point (S,), and the sum of ``weights`` (S, P) over the regions sharing it (S,)."""
        owner = self.of(position)
        return owner, weights.gather(1, owner[:, None])[:, 0]


class Owners(Labelled):
    """The regions to which points may belong, according to a classified volume."""

    def __init__(self, volume: ClassifiedVolume, regions: NDArray[np.integer], device: torch.device) -> None:
        """Assign a volume's R ranges to regions: the region of each (R,), or whether it may be part of each (R, P)."""
        member = np.eye(int(regions.max()) + 1)[regions] if regions.ndim == 1 else regions > 0
        self.shared = bool((member.sum(axis=1) > 1).any())
        self._member = torch.from_numpy(member.astype(np.float32)).to(device)
        self._range = torch.from_numpy(volume.owner).to(device)
        self._first = self._member.argmax(dim=1)
        self._cells = volume.cells

    def range_of(self, position: Tensor) -> Tensor:
        """Return the range at the vertex nearest to each point of the box: (S, 3) in [0, 1] -> (S,) int64."""
        vertex = (position * self._cells + 0.5).long()
        x, y, z = (v.clamp(0, size - 1) for v, size in zip(vertex.unbind(1), self._range.shape, strict=True))
        return self._range[x, y, z].long()

    def of(self, position: Tensor) -> Tensor:
        """Return the region of each point. (S,)"""
        return self._first[self.range_of(position)]

    def assign(self, weights: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
        """Return the region of each point, and the sum of its weights over the regions sharing it. (S,) each"""
        if not self.shared:
            return super().assign(weights, position)
        number = self.range_of(position)
        return self._first[number], (weights * self._member[number]).sum(dim=1)


@dataclass(frozen=True)
class KnownRegions:
    """Regions of a scene according to its classified volume, or to views alone."""

    palette: Palette
    """One colour per region, the region with the most visible light first."""
    ranges: tuple[tuple[tuple[float, float], ...], ...]
    """Smallest and largest scalar value of each range of each region; none if only views are known."""
    owners: Labelled
    """Region of each point."""
    confidence: tuple[float, ...] = ()
    """How far each region is likely to be right, in [0, 1]; none where the volume tells the regions."""
    mixed: tuple[tuple[int, NDArray[np.float64]], ...] = ()
    """Regions that hold light of another hue than their own, RGB (3,), because there are too many to divide them."""
    questions: tuple[Question, ...] = ()
    """What would settle the regions of low confidence."""


@torch.no_grad()
def regions_of(volume: ClassifiedVolume, views: ViewSet, scene: Scene, seed: int) -> KnownRegions:
    """Return a region for each range of the transfer function that the views show, by rays through the base field.

    A range whose fraction of the light is below the palette's ``min_share`` joins its neighbour in value.
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
        steps.append(f"{len(seen)} left: each of the others has less than {least:.1%} of the visible light")
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
    """Return the regions of a palette network: colours, shares of the visible light, and ranges if they are known."""
    known = ranges or ((),) * len(shares)
    return tuple(
        Region(tuple(colour), float(share), values=hull_of(own), ranges=own)
        for colour, share, own in zip(network.colours.tolist(), shares, known, strict=True)
    )


def hull_of(ranges: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Return the smallest and largest value of ranges; None if there are no ranges."""
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None


def membership(regions: Sequence[Region], volume: ClassifiedVolume) -> NDArray[np.bool_]:
    """Return whether each range of a volume is part of each region: those around its middle, or the nearest. (R, P)"""
    middles = np.array([0.5 * (r.low + r.high) for r in volume.ranges])
    away = np.full((len(middles), len(regions)), np.inf)
    for number, region in enumerate(regions):
        for low, high in region.ranges or filter(None, [region.values]):
            away[:, number] = np.minimum(away[:, number], np.maximum(low - middles, middles - high))
    return (away <= 0) | (away == away.min(axis=1, keepdims=True)) & (away > 0).all(axis=1, keepdims=True)


@torch.no_grad()
def shares_of(samples: Samples, sigma: Tensor, region: Tensor, count: int) -> NDArray[np.float64]:
    """Return each region's fraction of the visible light, from the extinction and region of samples (S,). (count,)"""
    _, _, seen = composite(samples, sigma, torch.zeros(len(samples), 1, device=sigma.device))
    share = np.bincount(region.cpu().numpy(), weights=seen.cpu().numpy(), minlength=count)
    return np.asarray(share / max(share.sum(), 1e-9), np.float64)


@torch.no_grad()
def region_overlaps(scene: Scene, views: ViewSet, volume: ClassifiedVolume) -> list[float]:
    """Return the intersection over union of regions and ranges, in [0, 1], over random pixels of the views.

    One number per region of the palette if the scene knows their values, and none if such regions share a range. For
    regions found in views alone, one per range with at least the palette's ``min_share`` of the visible light, in
    ascending order of values, each with a region of its own so that the sum is largest; 0 for a range without one.
    """
    assert scene.palette_network is not None
    regions = scene.palette_regions
    valued = all(region.values for region in regions)
    ranges, count = len(volume.ranges), len(regions)
    region_of_range = np.arange(ranges)
    if valued:
        member = membership(regions, volume)
        if (member.sum(axis=1) > 1).any():
            return []
        region_of_range = member.argmax(axis=1)
    batch = RayPool(views, scene.occupancy.box, 0, scene.device).batch(0, LOOKED_AT)
    samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
    ours, theirs = scene.occupancy.box, volume.box
    shift = samples.position.new_tensor((np.asarray(ours.low) - np.asarray(theirs.low)) / theirs.size)
    owner = Owners(volume, region_of_range, scene.device).of(samples.position * (ours.size / theirs.size) + shift)
    found = scene.palette_network.material(samples.position)[1].argmax(1)
    classes = count if valued else ranges
    both = shares_of(samples, scene.base.extinction(samples), owner * count + found, classes * count)
    both = both.reshape(classes, count)
    share = both.sum(axis=1)
    each = both / np.maximum(share[:, None] + both.sum(axis=0) - both, 1e-12)
    if valued:
        return [float(part) for part in each.diagonal()]
    row, column = linear_sum_assignment(-each)
    matched = np.zeros(ranges)
    matched[row] = each[row, column]
    return [float(part) for part in matched[share >= PaletteSettings().min_share]]
