"""Regions unmixed along rays: which region each point of a scene has, solved over many rays at once.

The colour that a base field gives to a point behind a translucent shell is tinted by the shell, because light may lie
anywhere along a ray. How much of each point a pixel shows is known, though, and a region has one colour. A pixel is
then a sum over its points, of their weights in it times their regions' colours, and rays from many sides disagree with
a point that has the wrong one. With a soft membership x in [0, 1] of each vertex in each region, this is a sparse
convex problem: least squares over rays, plus differences of neighbours, each weighted by the light of both, so that
borders lie where little is seen. It is solved in turn with the regions' colours. The brightness of a pixel depends on
normals, which noise turns, so an error along a pixel's own colour counts less than one across it.

How much neighbours must agree depends on the scene, and rays that are held out decide: the smoothness with the smallest
error across their colours is chosen, or none if no solution explains them better than the regions did before. They also
decide how many regions there are: one is divided if its halves explain them much better.

Letters: S samples, R rays, V vertices, E edges between neighbours, P regions.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.sparse import csr_matrix
from skimage.filters import threshold_otsu

from svv.train.palette import along_rays_kernels as kernels

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Index = NDArray[np.uint32]
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
    """What rays see of a scene's vertices."""

    vertices: int
    """Number of vertices V."""
    vertex: NDArray[np.int64]
    """Vertex that each sample stands for. (S,)"""
    ray: NDArray[np.int64]
    """Ray of each sample, in ascending order. (S,)"""
    weight: NDArray[np.floating]
    """Weight of each sample in its pixel. (S,)"""
    cosine: NDArray[np.floating]
    """Cosine between each sample's normal and the headlight. (S,)"""
    pixel: NDArray[np.floating]
    """Colour of each pixel over black, RGB. (R, 3)"""

    @cached_property
    def rows(self) -> tuple[Index, Index, Single, Single, Single]:
        """For the kernels: each ray's first sample (R + 1,), vertices, weights, cosines (S,), and pixels (R, 3)."""
        first = np.searchsorted(self.ray, np.arange(len(self.pixel) + 1))
        weight, cosine, pixel = (np.ascontiguousarray(x, np.float32) for x in (self.weight, self.cosine, self.pixel))
        return first.astype(np.uint32), self.vertex.astype(np.uint32), weight, cosine, pixel

    @cached_property
    def along(self) -> Single:
        """Directions of the pixels' colours, 0 for black. (R, 3)"""
        length = np.linalg.norm(self.pixel, axis=1, keepdims=True)
        return np.ascontiguousarray(self.pixel / np.maximum(length, 1e-6), np.float32)

    @cached_property
    def parts(self) -> tuple[Seen, Seen]:
        """What is seen by the rays that solutions are found with, and by those that are held out."""
        held = np.arange(len(self.pixel)) % HELD_OUT == 0
        return self._part(~held), self._part(held)

    def _part(self, kept: NDArray[np.bool_]) -> Seen:
        """Return what some of the rays (R,) see."""
        mine, number = kept[self.ray], np.cumsum(kept) - 1
        ray = number[self.ray[mine]]
        return Seen(self.vertices, self.vertex[mine], ray, self.weight[mine], self.cosine[mine], self.pixel[kept])

    def light(self, region: Regions, count: int) -> tuple[Array, Array]:
        """Return what regions reflect of light from everywhere and of a headlight, (P, 3) each.

        Non-negative least squares over all pixels: colour over black = sum of weight (ambient + diffuse cosine).

        Args:
            region: Region of each vertex. (V,)
            count: Number of regions P.
        """
        sums = np.zeros((-(-len(self.pixel) // kernels.BLOCK), 2 * count, 2 * count + 3))
        kernels.normal_equations(*self.rows, region, sums)
        total = sums.sum(axis=0)
        lower, right = total[:, : 2 * count], total[:, 2 * count :]
        normal = lower + np.tril(lower, -1).T
        # The Cholesky factor of the normal equations is a problem of 2 P rows with the same solution.
        scale = max(float(np.trace(normal)), 1e-12)
        factor = np.linalg.cholesky(normal + 1e-9 * scale * np.eye(len(normal)))
        target = np.linalg.solve(factor, right)
        found = np.stack([nnls(factor.T, column)[0] for column in target.T], axis=1)
        return found[:count], found[count:]

    def errors(self, region: Regions, light: tuple[Array, Array], along: float) -> Single:
        """Return what is shown of regions (V,) and their light less the pixels. (R, 3)

        Args:
            region: Region of each vertex. (V,)
            light: What regions reflect, as of :meth:`light`.
            along: The part that is left of errors along the pixels' own colours.
        """
        both, error = _both(light), np.empty((len(self.pixel), 3), np.float32)
        member = np.eye(len(both), dtype=np.float32)[region]
        kernels.errors(*self.rows, self.along, np.float32(along), both, member, error)
        return error

    def error_across(self, region: Regions, light: tuple[Array, Array]) -> float:
        """Return the root mean square error of pixels across their own colours, for regions (V,) and their light."""
        return float(np.sqrt(np.square(self.errors(region, light, 0.0)).sum(axis=1).mean()))


@dataclass(frozen=True)
class Unmixed:
    """Regions found along rays."""

    region: Regions
    """Region of each vertex. (V,)"""
    gain: float
    """Part by which held-out rays are explained better than before; 0 if nothing was changed."""


def unmixed(seen: Seen, region: Regions, count: int, places: NDArray[np.integer], until: float = math.inf) -> Unmixed:
    """Return the regions of vertices that explain held-out rays best, starting from regions found otherwise.

    Args:
        seen: What rays see of the vertices.
        region: Region of each vertex. (V,)
        count: Number of regions P; one region is returned as it is.
        places: Integer coordinates of the vertices on their grid. (V, 3)
        until: When to stop with the best regions so far, on the clock of :func:`time.monotonic`.
    """
    if count < 2 or time.monotonic() >= until:
        return Unmixed(region, 0.0)
    known, held = seen.parts
    before = held.error_across(region, known.light(region, count))
    best, least = region, (1.0 - LEAST_GAIN) * before
    solver, last = Solver(known, places), np.inf
    for smoothness in SMOOTHNESS:
        found = solver.solve(region, count, smoothness).argmax(axis=1)
        error = held.error_across(found, known.light(found, count))
        if error < least:
            best, least = found, error
        elif error > last:
            break
        if time.monotonic() >= until:
            break
        last = error
    return Unmixed(best, 0.0 if best is region else 1.0 - least / max(before, 1e-12))


def divided(
    seen: Seen, region: Regions, count: int, light: Array, most: int, until: float = math.inf
) -> tuple[Regions, list[tuple[int, float]], list[tuple[int, NDArray[np.bool_]]]]:
    """Return regions of which those are divided whose halves explain held-out rays much better.

    Two materials of similar hues may be one region, because the pixels' palette mixes one of them from others. Each
    half of a region, along the direction in which its colours differ most, then has a colour of its own.

    Args:
        seen: What rays see of the vertices.
        region: Region of each vertex. (V,)
        count: Number of regions P.
        light: Light of each vertex, RGB. (V, 3)
        most: Number of regions at which no more are divided.
        until: When to stop, on the clock of :func:`time.monotonic`.

    Returns:
        Regions, of which new ones have the numbers after the last; the number of each that was divided, with the part
        by which held-out rays are explained better; and each that should be divided, beyond the most, with one half.
    """
    known, held = seen.parts
    error = held.error_across(region, known.light(region, count))
    done, left, number = [], [], 0
    while number < count and time.monotonic() < until:
        half = _half(light, region == number)
        found = region if half is None else np.where(half, count, region)
        after = error if half is None else held.error_across(found, known.light(found, count + 1))
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
    """Return one half of a region's vertices ``mine`` (V,) by their colours, ``light`` (V, 3); None if all are alike.

    Otsu's method (1979) divides them along the direction in which they differ most.
    """
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

    def __init__(self, seen: Seen, places: NDArray[np.integer]) -> None:
        """Sort what rays see by vertices, and find which of these (V, 3) are neighbours."""
        first, vertex, weight, cosine, pixel = seen.rows
        # It sorts by vertices, and by rays among those of a vertex.
        order = csr_matrix((np.arange(len(vertex)), seen.vertex, first), shape=(len(pixel), seen.vertices)).tocsc()
        weights = weight[order.data]
        self._seen = seen
        self._samples = order.indptr.astype(np.uint32), order.indices.astype(np.uint32), weights
        self._lit = weights * cosine[order.data]
        light = np.bincount(vertex, weight, seen.vertices)
        # Of a matrix without negative entries, the sums of its products bound the curvature of each unknown.
        opacity = np.bincount(seen.ray, weight, len(pixel))
        self._bound = np.bincount(vertex, weight * opacity[seen.ray], seen.vertices)
        self._neighbours = _neighbours(places)
        # Also where nothing is seen there is a neighbour to follow.
        self._root, self._least = np.sqrt(light).astype(np.float32), np.float32(1e-3 * light.mean())
        both = self._root[self._neighbours] * self._root[:, None] + self._least
        self._degree = np.where(self._neighbours != np.arange(len(light))[:, None], both, 0.0).sum(axis=1)

    def solve(self, region: Regions, count: int, smoothness: float) -> Single:
        """Return the memberships of vertices in regions, starting with one region each: (V,) -> (V, P).

        Accelerated projected gradients (Beck and Teboulle 2009).

        Args:
            region: Region of each vertex. (V,)
            count: Number of regions P.
            smoothness: Weight of neighbours' differences.
        """
        seen, member = self._seen, np.eye(count + count % 2, dtype=np.float32)[region]
        error = np.empty((len(seen.pixel), 3), np.float32)
        for turn in range(TURNS):
            light = seen.light(region if turn == 0 else member.argmax(axis=1), count)
            full, both = light[0] + light[1], _both(light)
            curvature = float(np.linalg.eigvalsh(full @ full.T).max()) * self._bound
            step = (1.0 / (curvature + 2.0 * smoothness * self._degree + 1e-9)).astype(np.float32)
            ahead, following, pace = member.copy(), np.empty_like(member), 1.0
            for _ in range(STEPS):
                last, pace = pace, 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * pace * pace))
                kernels.errors(*seen.rows, seen.along, np.float32(ALONG), both, ahead, error)
                kernels.descend(
                    *self._samples, self._lit, error, self._neighbours, self._root, self._least, both, step,
                    np.float32(smoothness), np.float32((last - 1.0) / pace), np.uint32(count), ahead, member, following,
                )  # fmt: skip
                ahead, following = following, ahead
        return member[:, :count]


def _both(light: tuple[Array, Array]) -> Single:
    """Return what regions reflect of both kinds of light side by side, for an even number of regions. (P, 6)"""
    count = len(light[0])
    return np.pad(np.concatenate(light, axis=1), ((0, count % 2), (0, 0))).astype(np.float32)


def _neighbours(places: NDArray[np.integer]) -> Index:
    """Return the neighbours of each vertex (V, 3) along the axes, itself where there is none. (V, 6)"""
    number = np.full(tuple(places.max(axis=0) + 3), -1, np.int32)  # with nothing around it
    at = np.ravel_multi_index(tuple(places.T + 1), number.shape)
    own = np.arange(len(places), dtype=np.int32)
    number.ravel()[at] = own
    steps = np.array(number.strides) // number.itemsize
    found = number.ravel()[at[:, None] + np.concatenate((steps, -steps))]
    return np.where(found >= 0, found, own[:, None]).astype(np.uint32)


def joined(
    ray: NDArray[np.integer], vertex: NDArray[np.int64], weight: Single, colour: Single
) -> tuple[NDArray[np.int64], NDArray[np.int64], Single, Single]:
    """Return samples of which those of a ray that stand for the same vertex, one after the other, are one.

    Args:
        ray: Ray of each sample, in ascending order. (S,)
        vertex: Vertex of each sample. (S,)
        weight: Weight of each sample, > 0. (S,)
        colour: Colour of each sample; the result is the mean by weight. (S, 3)
    """
    other = (ray[1:] != ray[:-1]) | (vertex[1:] != vertex[:-1])
    first = np.flatnonzero(np.concatenate((np.ones(min(len(ray), 1), np.bool_), other)))
    if not len(first):
        return ray.astype(np.int64), vertex, weight, colour
    total = np.add.reduceat(weight, first)
    mean = np.add.reduceat(weight[:, None] * colour, first, axis=0) / total[:, None]
    return ray[first].astype(np.int64), vertex[first], total, mean


def agreement(light: Array, alike: NDArray[np.bool_]) -> Array:
    """Return how far two ways to tell regions agree: intersection over union of each, in terms of light. (P,)

    Args:
        light: Light of the region in each row, of which the other way tells the one in each column. (P, P)
        alike: Regions that the other way cannot tell apart, of which it is taken to mean the right one. (P, P)
    """
    alike = alike | np.eye(len(light), dtype=np.bool_)  # a black region's colour is not even like itself
    right = np.where(alike, light, 0.0).sum(axis=1)
    wrong = np.where(alike, 0.0, light)
    return np.asarray(right / np.maximum(light.sum(axis=1) + wrong.sum(axis=0), 1e-12), np.float64)
