"""Regions unmixed along rays: which region each point of a scene has, solved over many rays at once.

Behind a translucent shell, the base field's colours are tinted. A pixel is a sum over points, of their weights in it
times their regions' colours, and rays from many sides disagree with a wrong region. With soft memberships of vertices,
this is a sparse convex problem: least squares over rays, plus differences of neighbours, weighted by the light of both,
solved in turn with the colours. Rays that are held out choose the smoothness, or no solution, and divide regions whose
halves explain them much better. Letters: S samples, R rays, V vertices, P regions.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls
from skimage.filters import threshold_otsu
from torch import Tensor

from svv.kernels.constants import moved
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import RaySamples, RegionKernels, VertexSamples

Array = NDArray[np.float64]
Regions = NDArray[np.int64]

SMOOTHNESS = (0.001, 0.005, 0.02, 0.1)
"""Weights of neighbours' differences that are tried, in ascending order, until held-out rays are explained worse."""

DIVIDING_GAIN = 0.15
"""Part of the error of held-out rays by which a region's halves must be better than the region."""

LEAST_SPREAD = 0.03
"""Root mean square angle of a region's colours from their mean, in radians, below which it is of one hue."""

HELD_OUT = 5
"""Spacing of held-out rays: one of every five."""

LEAST_GAIN = 0.01
"""Part of the error of held-out rays by which a solution must be better than the regions before it."""

ALONG = 0.1
"""Weight of an error along a pixel's own colour, relative to one across it."""

TURNS, STEPS = 2, 15
"""How often colours and memberships are solved in turn, and the steps for the memberships each time."""


@dataclass(frozen=True)
class Seen:
    """What rays see of a scene's vertices, on the device that works on it."""

    vertices: int
    """Number of vertices V."""
    vertex: Tensor
    """Vertex that each sample stands for, int32. (S,)"""
    ray: Tensor
    """Ray of each sample, in ascending order, int32. (S,)"""
    weight: Tensor
    """Weight of each sample in its pixel. (S,)"""
    cosine: Tensor
    """Cosine between each sample's normal and the headlight. (S,)"""
    pixel: Tensor
    """Colour of each pixel over black, RGB. (R, 3)"""

    @property
    def kernels(self) -> RegionKernels:
        """The kernels of the device."""
        return kernels_for(self.pixel).REGIONS

    @cached_property
    def samples(self) -> RaySamples:
        """The same for the kernels."""
        rays = torch.arange(len(self.pixel) + 1, dtype=self.ray.dtype, device=self.pixel.device)
        first = torch.searchsorted(self.ray, rays, out_int32=True)
        along = self.pixel / self.pixel.square().sum(dim=1, keepdim=True).sqrt().clamp(min=1e-6)
        return RaySamples(first, self.vertex.int(), self.weight, self.cosine, self.pixel, along)

    @cached_property
    def parts(self) -> tuple[Seen, Seen]:
        """What is seen by the rays that solutions are found with, and by those that are held out."""
        held = torch.arange(len(self.pixel), device=self.pixel.device) % HELD_OUT == 0
        return self._part(~held), self._part(held)

    def _part(self, kept: Tensor) -> Seen:
        """Return what some of the rays (R,) see."""
        mine, number = kept[self.ray].nonzero()[:, 0], kept.cumsum(0, dtype=self.ray.dtype) - 1
        return Seen(
            self.vertices, self.vertex[mine], number[self.ray[mine]], self.weight[mine], self.cosine[mine],
            self.pixel[kept],
        )  # fmt: skip

    def light(self, region: Tensor, count: int) -> tuple[Array, Array]:
        """Return what regions (V,) reflect of light from everywhere and of a headlight, (P, 3) each.

        Non-negative least squares over all pixels: colour over black = sum of weight (ambient + diffuse cosine).
        """
        total = self.kernels.normal_equations(self.samples, region, count).cpu().numpy()
        lower, right = np.tril(total[:, : 2 * count]), total[:, 2 * count :]
        normal = lower + np.tril(lower, -1).T
        # The Cholesky factor of the normal equations is a problem of 2 P rows with the same solution.
        scale = max(float(np.trace(normal)), 1e-12)
        factor = np.linalg.cholesky(normal + 1e-9 * scale * np.eye(len(normal)))
        target = np.linalg.solve(factor, right)
        found = np.stack([nnls(factor.T, column)[0] for column in target.T], axis=1)
        return found[:count], found[count:]

    def errors(self, region: Tensor, light: tuple[Array, Array], along: float) -> Tensor:
        """Return what is shown of regions (V,) less the pixels. (R, 3)

        ``along`` is the part that is left of errors along the pixels' own colours.
        """
        return self.kernels.errors(self.samples, along, self.both(light), members(region, len(light[0])))

    def error_across(self, region: Tensor, light: tuple[Array, Array]) -> float:
        """Return the root mean square error of pixels across their own colours, for regions (V,) and their light."""
        return float(self.errors(region, light, 0.0).square().sum(dim=1).mean().sqrt())

    def both(self, light: tuple[Array, Array]) -> Tensor:
        """Return what regions reflect of both kinds of light side by side. (P, 6)"""
        return moved(np.concatenate(light, axis=1).astype(np.float32), self.pixel.device)


def members(region: Tensor, count: int) -> Tensor:
    """Return memberships of vertices of one region each, (V,), for an even number of regions. (V, P or P + 1)"""
    return torch.eye(count + count % 2, device=region.device)[region]


def summed(where: Tensor, values: Tensor, count: int) -> Tensor:
    """Return the sums of the values (N,) with each of ``count`` numbers, ``where`` (N,), float64. (count,)"""
    return torch.zeros(count, dtype=torch.float64, device=where.device).index_add_(0, where, values.double())


@dataclass(frozen=True)
class Unmixed:
    """Regions found along rays."""

    region: Regions
    """Region of each vertex. (V,)"""
    gain: float
    """Part by which held-out rays are explained better than before; 0 if nothing was changed."""


def unmixed(seen: Seen, region: Regions, count: int, places: Tensor, until: float = math.inf) -> Unmixed:
    """Return the regions (V,) of vertices at places (V, 3) on a grid that explain held-out rays best.

    It starts from ``region`` and stops at the time ``until`` of :func:`time.monotonic` with the best so far.
    """
    if count < 2 or time.monotonic() >= until:
        return Unmixed(region, 0.0)
    (known, held), begun = seen.parts, moved(region, places.device)
    before = held.error_across(begun, known.light(begun, count))
    best, least = begun, (1.0 - LEAST_GAIN) * before
    solver, last = Solver(known, places), np.inf
    for smoothness in SMOOTHNESS:
        found = solver.solve(begun, count, smoothness).argmax(dim=1)
        error = held.error_across(found, known.light(found, count))
        if error < least:
            best, least = found, error
        elif error > last:
            break
        if time.monotonic() >= until:
            break
        last = error
    if best is begun:
        return Unmixed(region, 0.0)
    return Unmixed(best.cpu().numpy(), 1.0 - least / max(before, 1e-12))


def divided(
    seen: Seen, region: Regions, count: int, light: Array, most: int, until: float = math.inf
) -> tuple[Regions, list[tuple[int, float]], list[tuple[int, NDArray[np.bool_]]]]:
    """Return regions (V,) of which those are divided whose halves explain held-out rays much better, up to ``most``.

    The pixels' palette may mix one of two materials of similar hues from others. Each half of a region, along the
    direction in which its colours in ``light`` (V, 3) differ most, then has a colour of its own.

    Returns:
        Regions, of which new ones have the numbers after the last; the number of each that was divided, with the part
        by which held-out rays are explained better; and each that should be divided, beyond the most, with one half.
    """
    known, held = seen.parts

    def error_of(region: Regions, count: int) -> float:
        there = moved(region, seen.pixel.device)
        return held.error_across(there, known.light(there, count))

    error = error_of(region, count)
    done, left, number = [], [], 0
    while number < count and time.monotonic() < until:
        half = _half(light, region == number)
        found = region if half is None else np.where(half, count, region)
        after = error if half is None else error_of(found, count + 1)
        gain = (error - after) / max(error, 1e-12)
        if half is None or gain < DIVIDING_GAIN:
            number += 1
        elif count >= most:
            left.append((number, half))
            number += 1
        else:
            region, count, error = found, count + 1, after
            done.append((number, gain))
    return region, done, left


def _half(light: Array, mine: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Return one half of the vertices ``mine`` (V,) by their colours (V, 3) (Otsu 1979); None if all are alike."""
    colour = light[mine].clip(min=0.0)
    length = np.linalg.norm(colour, axis=1)
    mean = colour.sum(axis=0)
    if not length.sum() > 0.0:
        return None
    mean /= np.linalg.norm(mean)
    unit = colour / np.maximum(length, 1e-9)[:, None]
    away = unit - (unit @ mean)[:, None] * mean
    spread, axes = np.linalg.eigh((away * length[:, None]).T @ away / length.sum())
    if spread[-1] < LEAST_SPREAD**2:
        return None
    along = away @ axes[:, -1]
    low, high = np.quantile(along, (0.005, 0.995))
    held, edges = np.histogram(along, 256, (low, max(high, low + 1e-6)), weights=length)
    if np.count_nonzero(held) < 2:
        return None
    half = np.zeros_like(mine)
    half[mine] = along > threshold_otsu(hist=(held, 0.5 * (edges[1:] + edges[:-1])))
    return half


class Solver:
    """Solves for the memberships of vertices in regions."""

    def __init__(self, seen: Seen, places: Tensor) -> None:
        """Sort what rays see by vertices, and find which of these (V, 3) are neighbours."""
        # It sorts by vertices, and by rays among those of a vertex.
        order, device = seen.vertex.argsort(stable=True), places.device
        first = torch.searchsorted(
            seen.vertex[order], torch.arange(seen.vertices + 1, dtype=seen.vertex.dtype, device=device), out_int32=True
        )  # fmt: skip
        weight, neighbours = seen.weight[order], _neighbours(places)
        light = summed(seen.vertex, seen.weight, seen.vertices)
        # Of a matrix without negative entries, the sums of its products bound the curvature of each unknown.
        opacity = summed(seen.ray, seen.weight, len(seen.pixel))
        self._bound = summed(seen.vertex, seen.weight * opacity[seen.ray], seen.vertices)
        # Also where nothing is seen there is a neighbour to follow.
        root, least = light.sqrt().float(), 1e-3 * float(light.mean())
        both = root[neighbours] * root[:, None] + least
        own = torch.arange(len(places), device=device)[:, None]
        self._degree = torch.where(neighbours != own, both, 0.0).sum(dim=1)
        self._seen = seen
        self._near = VertexSamples(
            first, seen.ray[order].int(), weight, weight * seen.cosine[order], neighbours, root, least
        )  # fmt: skip

    def solve(self, region: Tensor, count: int, smoothness: float) -> Tensor:
        """Return the memberships of vertices in regions, starting with one region each: (V,) -> (V, P).

        Accelerated projected gradients (Beck & Teboulle 2009); ``smoothness`` is the weight of neighbours' differences.
        """
        seen, kernels, member = self._seen, self._seen.kernels, members(region, count)
        for turn in range(TURNS):
            light = seen.light(region if turn == 0 else member.argmax(dim=1), count)
            full, both = light[0] + light[1], seen.both(light)
            curvature = float(np.linalg.eigvalsh(full @ full.T).max()) * self._bound
            step = (1.0 / (curvature + 2.0 * smoothness * self._degree + 1e-9)).float()
            ahead, following, pace = member.clone(), torch.empty_like(member), 1.0
            for _ in range(STEPS):
                last, pace = pace, 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * pace * pace))
                error, momentum = kernels.errors(seen.samples, ALONG, both, ahead), (last - 1.0) / pace
                kernels.descend(self._near, error, both, step, (smoothness, momentum), ahead, member, following)
                ahead, following = following, ahead
        return member[:, :count]


def _neighbours(places: Tensor) -> Tensor:
    """Return the neighbours of each vertex (V, 3) along the axes, itself where there is none, int32. (V, 6)"""
    shape = [size + 3 for size in places.amax(dim=0).tolist()]  # with nothing around it
    strides = shape[1] * shape[2], shape[2], 1
    at = sum(stride * (column + 1) for stride, column in zip(strides, places.unbind(1), strict=True))
    own = torch.arange(len(places), dtype=torch.int32, device=places.device)
    number = torch.full((math.prod(shape),), -1, dtype=torch.int32, device=places.device)
    number[at] = own
    found = torch.stack([number[at + side * stride] for side in (1, -1) for stride in strides], dim=1)
    return torch.where(found >= 0, found, own[:, None])


def joined(ray: Tensor, vertex: Tensor, weight: Tensor, colour: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return samples (S,) of which consecutive ones of a ray with one vertex are one; colours (S, 3) are means."""
    begins = torch.ones(len(ray), dtype=torch.bool, device=ray.device)
    begins[1:] = (ray[1:] != ray[:-1]) | (vertex[1:] != vertex[:-1])
    first, run = begins.nonzero()[:, 0], begins.cumsum(0) - 1
    total, *light = (
        torch.zeros(len(first), device=ray.device).index_add_(0, run, values)
        for values in (weight, *(weight[:, None] * colour).unbind(1))
    )
    return ray[first].int(), vertex[first].int(), total, torch.stack(light, dim=1) / total[:, None]


def agreement(light: Array, alike: NDArray[np.bool_]) -> Array:
    """Return how far two ways to tell regions agree: intersection over union of each, in terms of light. (P,)

    ``light`` (P, P): of the region in each row, what the other way tells the one in each column; ``alike`` (P, P):
    regions that it cannot tell apart, of which it is taken to mean the right one.
    """
    alike = alike | np.eye(len(light), dtype=np.bool_)  # a black region's colour is not even like itself
    right = np.where(alike, light, 0.0).sum(axis=1)
    wrong = np.where(alike, 0.0, light)
    return np.asarray(right / np.maximum(light.sum(axis=1) + wrong.sum(axis=0), 1e-12), np.float64)
