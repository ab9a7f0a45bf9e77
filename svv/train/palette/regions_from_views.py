"""Regions of a scene without its volume: which points are of one material, and its colour in full light.

Pixels may show no material alone, nor tell grey from white in the shade. The base field says how much of each point a
pixel shows; what it shows beyond the field's colours is given back to its points. Points of one hue are one region,
unless hues or brightness in full light fall into two groups. Rays then correct the points' regions
(:mod:`svv.train.palette.along_rays`), and least squares over many pixels find the regions' colours.

Letters: S samples, R rays, V vertices of the grid of regions, P regions.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from svv.core.colour.colour import hsb_array
from svv.core.colour.hex_codes import to_hex
from svv.core.colour.palette import Palette, PaletteSettings
from svv.core.rays.encodings import stored_rows
from svv.core.two_groups import gap_of, weighted_quantile
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import encode_directions
from svv.fields.radiance.phong import softened_extinction
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels.constants import moved
from svv.kernels.dispatch import kernels_for
from svv.measure import trim_memory
from svv.train.palette.along_rays import Seen, agreement, divided, joined, summed, unmixed
from svv.train.palette.confidence import (
    Evidence,
    agreed_by_brightness,
    errors_where_alone,
    light_in_front,
    likely_overlap,
)
from svv.train.palette.doubts import SURE, Question
from svv.train.palette.ranges import KnownRegions, Labelled
from svv.train.run.batches import RayPool

Array = NDArray[np.float64]

RAYS = 1 << 16
"""Number of training rays that show the points."""

AT_A_TIME = 1 << 13
"""Rays followed together: all at once would take gigabytes in a fog."""

LEAST_ALPHA = 0.02
"""Alpha below which what a pixel shows beyond the field's colours is not divided by alpha any further."""

ANGLE = 0.1
"""Angle between two directions of RGB, in radians, that counts as the noise of a point's colour."""

BLUR = 0.6
"""Standard deviation in vertices of the Gaussian over which points vote for their region."""

NORMAL_BLUR = 1.0
"""Standard deviation in vertices of the Gaussians that smooth normals."""

LEAST_HUE_GAP = 0.02
"""Distance of two groups of hues from which they may be two regions; 1 is the full circle."""

LEAST_BRIGHTNESS_RATIO = 1.4
"""Ratio of the brightness of two groups in full light from which they may be two regions."""

BEST_LIT = 0.995
"""Quantile of the brightness of a region's points that counts as full light: some normals are not known well."""

LEAST_COLOUR = 0.02
"""Brightness below which a region's colour was not found."""

LEAST_SOLID = 0.1
"""Alpha below which what a pixel shows beyond its regions is not divided by alpha any further."""

MOST_CELLS = 256
"""Maximum number of cells along the longest side of the grid of regions, which is worked on whole."""

SAME_HUE = 0.06
"""Angle in radians between two colours' directions up to which only their brightness tells them apart."""


class Labels(Labelled):
    """Regions of the vertices of a grid, which are those of the points around them."""

    def __init__(self, lattice: SparseLattice, region: NDArray[np.integer], device: torch.device) -> None:
        """Keep the region of each vertex (V,) of a lattice with one level, in the order of its rows."""
        self._lattice = lattice.to(device)
        self._region = torch.from_numpy(region.astype(np.int64)).to(device)

    def rows_of(self, position: Tensor) -> Tensor:
        """Return the row of the vertex nearest to each point, which lies in an occupied cell: (S, 3) -> (S,)."""
        shape = self._lattice.shapes[0]
        vertex = (position * self._lattice.scales[0] + 0.5).long()
        return stored_rows(torch.minimum(vertex.clamp(min=0), shape - 1), shape, 0, self._lattice.index)

    def of(self, position: Tensor) -> Tensor:
        """Return the region of each point. (S,)"""
        return self._region[self.rows_of(position).clamp(max=len(self._region) - 1)]


@dataclass(frozen=True)
class _Agreed:
    """How far single rays agree with P regions of points."""

    agreement: Array
    """Intersection over union, by light. (P,)"""
    alike: NDArray[np.bool_]
    """Which regions have one hue. (P, P)"""
    both: Array
    """Light of the region in each row that single rays call the one in each column. (P, P)"""
    hue: Tensor
    """Region that each sample's hue tells. (S,)"""


class _Points:
    """Points of a scene as training rays show them, on its device; what methods take and return lies on the CPU.

    Each is a vertex and stands for a ray's samples around it. ``vertex`` (S,), ``ray`` (S,), ``weight`` (S,): weight in
    the pixel, ``cosine`` (S,): between the normal and the headlight, ``colour`` (S, 3): true to the pixel; ``pixel``
    (R, 3): colour over black, ``alpha`` (R,).
    """

    def __init__(self, scene: Scene, views: ViewSet, seed: int, until: float = math.inf) -> None:
        """Follow :data:`RAYS` training rays through a scene, or as many as time allows (:func:`regions_in`)."""
        occupancy, settings = scene.occupancy, scene.settings
        self._shading = views.meta.shading
        assert scene.base.density is not None
        # Those of the finest features, which the network can follow.
        self._cells = min((scene.settings.resolutions + scene.settings.finer)[-1], MOST_CELLS)
        self._box = occupancy.box
        self._lattice, self._places, field = softened_extinction(scene.base.density, occupancy, self._cells)
        self._device = scene.device
        self._at, self._shape = moved(self._places, self._device), field.shape
        empty = self.labels(np.zeros(len(self._places), np.int64))
        normals = kernels_for(self._at).REGIONS.normals(moved(field, self._device), self._at, (NORMAL_BLUR,) * 2)
        del field  # a grid may have 64 MB
        pool = RayPool(views, occupancy.box, seed, self._device, settings.headlight)
        parts: list[tuple[Tensor, ...]] = []
        for number in range(RAYS // AT_A_TIME):
            if parts and time.monotonic() >= until:
                break
            parts.append(self._followed(scene, pool, number, empty, normals))
        columns = list(zip(*parts, strict=True))[::-1]
        del parts, normals
        self.vertex, self.ray, self.weight, self.cosine, self.colour, self.pixel, self.alpha = (
            torch.cat(columns.pop()) for _ in range(len(columns))
        )
        trim_memory()  # what following them has freed
        self._until = until
        self._seen = Seen(len(self._places), self.vertex, self.ray, self.weight, self.cosine, self.pixel)

    @staticmethod
    def _followed(scene: Scene, pool: RayPool, number: int, empty: Labels, normals: Tensor) -> tuple[Tensor, ...]:
        """Return what :data:`AT_A_TIME` rays show, in the order of the attributes."""
        batch = pool.batch(number, AT_A_TIME)
        samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
        sigma, geometry = scene.base.geometry(samples)
        colour = scene.base(geometry, encode_directions(batch.rays.lit_along, samples.ray))
        shown, transmittance, weight = composite(samples, sigma, colour)
        missing = (batch.premultiplied - shown) / (1.0 - transmittance).clamp(min=LEAST_ALPHA)[:, None]
        ray, vertex, part, mean = joined(samples.ray, empty.rows_of(samples.position), weight, colour)
        cosine = (normals[vertex] * batch.rays.lit_along[ray]).sum(dim=1).abs()
        light = mean + missing[ray]
        return vertex, ray + number * AT_A_TIME, part, cosine, light, batch.premultiplied, batch.alpha

    def labels(self, region: NDArray[np.integer]) -> Labels:
        """Return the regions of the vertices (V,) as those of points."""
        return Labels(self._lattice, region, self._device)

    def shares(self, region: NDArray[np.int64], count: int) -> Array:
        """Return each region's share of the visible light. (P,)"""
        share = summed(self._own(region), self.weight, count).cpu().numpy()
        return np.asarray(share / max(share.sum(), 1e-9), np.float64)

    def nearest_in_hue(self, palette: Array) -> NDArray[np.int64]:
        """Return the region of each vertex (V,) by votes: the palette colour (P, 3) nearest in hue and saturation."""
        weight = summed(self.vertex, self.weight, len(self._places))
        light = self._light / weight.clamp(min=1e-6).sqrt()[:, None]  # what is seen less is less certain
        length = light.square().sum(dim=1, keepdim=True).sqrt()
        votes = self._blurred(length * _likeness(light, palette).T)
        region, seen = (found.cpu().numpy() for found in (votes.argmax(dim=1), votes.sum(dim=1) > 0))
        if seen.any() and not seen.all():
            nearest = cKDTree(self._places[seen]).query(self._places[~seen], workers=-1)[1]
            region[~seen] = region[seen][nearest]
        return region

    def two_hues(self, region: NDArray[np.int64], number: int) -> tuple[NDArray[np.bool_], str] | None:
        """Return which vertices (V,) of a region have its second hue, and "hue"; None if it has only one."""
        mine = region == number
        light = self._blurred(self._light * moved(mine, self._device)[:, None]).cpu().numpy()[mine]
        hue, saturation, bright = hsb_array(light.clip(min=0.0)).T
        ours = hsb_array(light.sum(axis=0).clip(min=0.0))
        if ours[1] < PaletteSettings().grey_saturation:
            return None
        away = (hue - ours[0] + 0.5) % 1.0 - 0.5
        gap = gap_of(away, bright * saturation, LEAST_HUE_GAP)
        return None if gap is None else (_among(mine, away > gap), "hue")

    def two_brightnesses(self, region: NDArray[np.int64], number: int) -> tuple[NDArray[np.bool_], str] | None:
        """Return which vertices (V,) of a region are brighter in full light; None if it has only one brightness."""
        mine = region == number
        bright, weight = self._brightness(mine)
        bright = np.log(np.maximum(bright, 1e-6))
        gap = gap_of(bright, weight, np.log(LEAST_BRIGHTNESS_RATIO))
        return None if gap is None else (_among(mine, bright > gap), "brightness")

    def nearest_in_brightness(self, region: NDArray[np.int64], palette: Array) -> NDArray[np.int64]:
        """Return regions (V,) in which those of one hue are told apart by brightness in full light."""
        result, unit = region.copy(), _unit(palette)
        for number in range(len(palette)):
            alike = np.flatnonzero(np.arccos(np.clip(unit @ unit[number], -1.0, 1.0)) < SAME_HUE)
            if len(alike) > 1 and alike[0] == number:
                mine = np.isin(region, alike)
                bright = self._brightness(mine)[0]
                away = np.abs(np.log(np.maximum(bright, 1e-6))[:, None] - np.log(palette[alike].max(axis=1)))
                result[mine] = alike[away.argmin(axis=1)]
        return result

    def unmixed(self, region: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], list[str]]:
        """Return regions (V,) that explain held-out rays best, and what was gained, if anything was."""
        found = unmixed(self._seen, region, count, self._at, self._until)
        if not found.gain:
            return region, []
        return found.region, [f"unmixed along rays, regions explain the hues of held-out rays {found.gain:.0%} better"]

    def divided(
        self, region: NDArray[np.int64], hues: Array, most: int
    ) -> tuple[NDArray[np.int64], Array, list[str], list[tuple[int, Array]]]:
        """Return regions of one hue each (V,), their hues, what was done, and what holds another hue nevertheless."""
        light = self._blurred(self._light).cpu().numpy()
        found, done, left = divided(self._seen, region, len(hues), light, most, self._until)
        said = []
        for number, gain in done:
            said.append(f"{to_hex(hues[number])} is two regions: they explain held-out rays {gain:.0%} better")
            hues = np.concatenate((hues, hues[number : number + 1]))
        return found, hues, said, [(number, light[half].sum(axis=0)) for number, half in left]

    def confidence(self, region: NDArray[np.int64], colours: Array) -> tuple[Array, list[Question]]:
        """Return how far regions (V,) of ``colours`` (P, 3) are likely to be right, in [0, 1] (P,), and what to ask.

        Points behind others are tinted, so a region is known by the mean light of its points.
        """
        count, own = len(colours), self._own(region)
        looks = torch.stack([summed(own, self.weight * light, count) for light in self.colour.unbind(1)], dim=1)
        light = looks.clamp(min=0.0).cpu().numpy()
        found = self.agreed(region, light)
        tint = np.arccos(np.clip((_unit(light) * _unit(colours)).sum(axis=1), -1.0, 1.0))
        agreed = np.minimum(found.agreement, agreed_by_brightness(self._seen, self.colour, looks, own, found.alike))
        error = errors_where_alone(self._seen, moved(region, self._device), count)
        sure = likely_overlap(Evidence(agreed, error, tint, light_in_front(self._seen, own, count)))
        return sure, self.questions(region, found, sure)

    def agreed(self, region: NDArray[np.int64], looks: Array) -> _Agreed:
        """Return how far single rays agree with the regions (V,) of their points.

        The hue of a point in a ray, nearest to one of ``looks`` (P, 3), tells a region as well: intersection over
        union of both, by light. Only regions of one hue, which brightness tells apart, count as told right.
        """
        unit, own, count = _unit(looks), self._own(region), len(looks)
        hue = _likeness(self.colour, looks).argmax(dim=0).int()
        both = summed(own * count + hue, self.weight, count**2).view(count, count).cpu().numpy()
        alike = np.arccos(np.clip(unit @ unit.T, -1.0, 1.0)) < SAME_HUE
        return _Agreed(agreement(both, alike), alike, both, hue)

    def questions(self, region: NDArray[np.int64], found: _Agreed, sure: Array) -> list[Question]:
        """Return what to ask of regions (V,) that are less ``sure`` (P,) than :data:`svv.train.palette.doubts.SURE`.

        The place is where most light is told both ways.
        """
        own, hue, both = self._own(region), found.hue, found.both
        contested = np.where(found.alike | np.eye(len(sure), dtype=np.bool_), 0.0, both + both.T)
        asked = []
        for number in np.flatnonzero((sure < SURE) & (contested.max(axis=1) > 0.0)).tolist():
            other = int(contested[number].argmax())
            between = ((own == number) & (hue == other)) | ((own == other) & (hue == number))
            light = self._blurred(summed(self.vertex, self.weight * between, len(self._places))[:, None])[:, 0]
            place = self._places[int(light.argmax())] / self._cells
            asked.append(Question(number, other, tuple(self._box.to_world(place).tolist())))
        return asked

    def forget_parts(self) -> None:
        """Free the copies of what some of the rays see, once nothing is unmixed any more."""
        self._seen = replace(self._seen)

    def without_the_faint(self, region: NDArray[np.int64], hues: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Give the points of regions that are hardly visible to the others; returns regions and the numbers kept."""
        share = self.shares(region, len(hues))
        kept = np.flatnonzero(share >= min(PaletteSettings().min_share, share.max()))
        if len(kept) == len(hues):
            return region, kept
        nearest = (_unit(hues) @ _unit(hues[kept]).T).argmax(axis=1)
        nearest[kept] = np.arange(len(kept))
        return nearest[region], kept

    def colours(self, region: NDArray[np.int64], hues: Array) -> Array:
        """Return the colour of each region in full light, RGB in [0, 1]; ``hues`` (P, 3) for those not seen. (P, 3)"""
        count, own, there = len(hues), self._own(region), moved(region, self._device)
        ambient, diffuse = self._seen.light(there, count)
        # Where noise hides normals, the cosine is c = p c' + (1 - p) / 2 on average: that of a normal at random is 1/2.
        # In C (A + (1 - A) c), least squares then find ambient = C (A + (1 - A) (1 - p) / 2), diffuse = C (1 - A) p,
        # and thus C, whatever p is.
        found = (2.0 * ambient + diffuse) / (1.0 + self._ambient_part(ambient, diffuse))
        found = np.where(found.max(axis=1, keepdims=True) > LEAST_COLOUR, found, hues)
        error = self._seen.errors(there, (ambient, diffuse), 1.0)
        missing = (-error / self.alpha.clamp(min=LEAST_SOLID)[:, None]).double()
        for number in range(count):
            mine = (own == number).nonzero()[:, 0]
            if len(mine):
                one = found[number] / max(float(np.square(found[number]).sum()), 1e-12)
                bright = ambient[number] @ one + diffuse[number] @ one * self.cosine[mine].double()
                bright += (missing @ moved(one, self._device))[self.ray[mine]]
                lit = weighted_quantile(bright.cpu().numpy(), self.weight[mine].cpu().numpy(), BEST_LIT)
                found[number] *= max(1.0, lit)
        # Of a colour that is too bright, the hue is right.
        return np.asarray(found / np.maximum(found.max(axis=1, keepdims=True), 1.0))

    def _ambient_part(self, ambient: Array, diffuse: Array) -> float:
        """Return the part of full light that comes from everywhere: the views' own, or that of the best lit region."""
        shading = self._shading
        if shading is not None:
            return shading.ambient / (shading.ambient + shading.diffuse) if shading.on and shading.diffuse else 1.0
        seen = np.stack([ambient.max(axis=1), diffuse.max(axis=1)], axis=1)
        seen = seen[seen.sum(axis=1) > LEAST_COLOUR]
        return float((seen[:, 0] / seen.sum(axis=1)).min(initial=1.0))

    def _brightness(self, mine: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the brightness in full light of some vertices (V,), taken as one region, and its weight; (M,) each."""
        ambient, diffuse = self._seen.light(moved(mine.astype(np.int64), self._device), 2)
        colour = ambient[1] + diffuse[1]
        full = max(float(colour.max()), 1e-6)
        reflects = (ambient[1].max() + diffuse[1].max() * self.cosine) / full
        # A brightness of 1 is a colour whose largest channel is 1.
        scaled = moved(colour * full / max(float(np.square(colour).sum()), 1e-12), self._device)
        bright = self.colour.double() @ scaled
        sums = self._sum(self.weight * reflects, bright, reflects)
        above, below = self._blurred(sums * moved(mine, self._device)[:, None]).cpu().numpy()[mine].T
        return above / np.maximum(below, 1e-12), below

    @cached_property
    def _light(self) -> Tensor:
        """The light that pixels have from each vertex, RGB, float64. (V, 3)"""
        return self._sum(self.weight, *self.colour.unbind(1))

    def _sum(self, weight: Tensor, *values: Tensor) -> Tensor:
        """Sum the products of a weight and each of C values of samples (S,) by vertex, float64. (V, C)"""
        return torch.stack([summed(self.vertex, weight * value, len(self._places)) for value in values], dim=1)

    def _own(self, region: NDArray[np.int64]) -> Tensor:
        """Return the regions of samples, given those of vertices, int32. (V,) -> (S,)"""
        return moved(region, self._device).int()[self.vertex]

    def _blurred(self, values: Tensor) -> Tensor:
        """Sum values of vertices (V, C) over their neighbours, float64. (V, C)"""
        at, found = self._at.unbind(1), torch.empty_like(values)
        for channel, column in enumerate(values.unbind(1)):  # one at a time: a grid may have 64 MB
            grid = torch.zeros(self._shape, device=self._device)
            grid[at] = column.float()
            found[:, channel] = self._seen.kernels.blurred(grid, BLUR)[at]
        return found


def _unit(colours: Array) -> Array:
    """Return the directions of colours. (P, 3) -> (P, 3)"""
    return colours / np.maximum(np.linalg.norm(colours, axis=1, keepdims=True), 1e-9)


def _likeness(colours: Tensor, palette: Array) -> Tensor:
    """Return how much colours (N, 3) are like those of a palette (P, 3) in hue and saturation, with sum 1. (P, N)"""
    unit = torch.nn.functional.normalize(colours.float(), dim=1, eps=1e-9)
    angle = (moved(_unit(palette), colours.device).float() @ unit.T).clamp_(-1.0, 1.0).acos_()
    return (angle.square_() * (-0.5 / ANGLE**2)).softmax(dim=0)


def _among(mine: NDArray[np.bool_], some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which vertices (V,) are ``some`` (M,) of the vertices ``mine`` (V,)."""
    found = np.zeros_like(mine)
    found[mine] = some
    return found


@torch.no_grad()
def regions_in(scene: Scene, views: ViewSet, palette: Palette, seed: int, seconds: float | None = None) -> KnownRegions:
    """Return the regions of a scene that was learned from views alone; a palette's hues divide its points.

    It takes about so many seconds: fewer rays are then followed, and less is unmixed along them.
    """
    until = math.inf if seconds is None else time.monotonic() + seconds
    points, hues = _Points(scene, views, seed, until), palette.colours
    region, steps = points.nearest_in_hue(hues), list(palette.steps[:-1])
    number, count, most = 0, len(hues), PaletteSettings().max_colours
    while number < count:
        parts = points.two_hues(region, number) or points.two_brightnesses(region, number) if count < most else None
        if parts is None:
            number += 1
            continue
        apart, said = parts
        region = np.where(apart, count, region)
        steps.append(f"{to_hex(hues[number])} is two regions: in full light, their points differ in {said}")
        hues, count = np.concatenate((hues, hues[number : number + 1])), count + 1
    region, gained = points.unmixed(region, count)
    region, hues, divided, mixed = points.divided(region, hues, most)
    if divided:
        region, again = points.unmixed(region, len(hues))
        gained += [*divided, *again]
    points.forget_parts()
    region, kept = points.without_the_faint(region, hues)
    colours, share = points.colours(region, hues[kept]), points.shares(region, len(kept))
    (sure, asked), order = points.confidence(region, colours), np.argsort(-share, kind="stable")
    number_of = np.argsort(order)
    colours, share, sure = colours[order], share[order], sure[order]
    steps += [*gained, "palette " + ", ".join(f"{to_hex(c)} ({p:.1%})" for c, p in zip(colours, share, strict=True))]
    return KnownRegions(
        Palette(colours, share, tuple(steps)), ((),) * len(order), points.labels(number_of[region]),
        tuple(sure.tolist()), tuple((int(np.flatnonzero(kept[order] == k)[0]), c) for k, c in mixed if k in kept),
        tuple(replace(q, region=int(number_of[q.region]), other=int(number_of[q.other])) for q in asked),
    )  # fmt: skip


@torch.no_grad()
def owners_of(scene: Scene, views: ViewSet, colours: NDArray[np.floating], seed: int) -> Labels:
    """Return to which of the colours (P, 3) of a palette made by hand, RGB in [0, 1], each point of a scene belongs."""
    points, palette = _Points(scene, views, seed), np.asarray(colours, np.float64)
    region = points.nearest_in_brightness(points.nearest_in_hue(palette), palette)
    return points.labels(points.unmixed(region, len(palette))[0])
