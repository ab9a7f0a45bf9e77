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
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.sparse import coo_matrix, csr_matrix
from skimage.filters import threshold_otsu

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
    """What rays see of a scene's vertices."""

    vertices: int
    """Number of vertices V."""
    vertex: NDArray[np.int64]
    """Vertex that each sample stands for. (S,)"""
    ray: NDArray[np.int64]
    """Ray of each sample. (S,)"""
    weight: NDArray[np.floating]
    """Weight of each sample in its pixel. (S,)"""
    cosine: NDArray[np.floating]
    """Cosine between each sample's normal and the headlight. (S,)"""
    pixel: NDArray[np.floating]
    """Colour of each pixel over black, RGB. (R, 3)"""

    def part(self, kept: NDArray[np.bool_]) -> Seen:
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
        own, rays = region[self.vertex], len(self.pixel)
        place = self.ray * count + own
        part = np.bincount(place, self.weight, rays * count).reshape(rays, count)
        lit = np.bincount(place, self.weight * self.cosine, rays * count).reshape(rays, count)
        design = np.concatenate((part, lit), axis=1)
        # The Cholesky factor of the normal equations is a problem of 2 P rows with the same solution.
        normal, right = design.T @ design, design.T @ self.pixel.astype(np.float64)
        scale = max(float(np.trace(normal)), 1e-12)
        factor = np.linalg.cholesky(normal + 1e-9 * scale * np.eye(len(normal)))
        target = np.linalg.solve(factor, right)
        found = np.stack([nnls(factor.T, column)[0] for column in target.T], axis=1)
        return found[:count], found[count:]

    def error_across(self, region: Regions, light: tuple[Array, Array]) -> float:
        """Return the root mean square error of pixels across their own colours, for regions (V,) and their light."""
        own = region[self.vertex]
        colour = light[0][own] + light[1][own] * self.cosine[:, None]
        shown = np.stack([np.bincount(self.ray, self.weight * c, len(self.pixel)) for c in colour.T], axis=1)
        return float(np.sqrt(np.square(_across(shown - self.pixel, _directions(self.pixel), 0.0)).sum(axis=1).mean()))


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
    kept = np.arange(len(seen.pixel)) % HELD_OUT > 0
    known, held = seen.part(kept), seen.part(~kept)
    before = held.error_across(region, known.light(region, count))
    best, least, edges = region, (1.0 - LEAST_GAIN) * before, _neighbours(places)
    solver, last = _Solver(known, edges), np.inf
    for smoothness in SMOOTHNESS:
        found = solver.solve(region, count, smoothness)
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
    kept = np.arange(len(seen.pixel)) % HELD_OUT > 0
    known, held = seen.part(kept), seen.part(~kept)
    error = held.error_across(region, known.light(region, count))
    done, left, number = [], [], 0
    while number < count and time.monotonic() < until:
        half = _half(light, region == number)
        found = region if half is None else np.where(half, count, region)
        after = error if half is None else held.error_across(found, known.light(found, count + 1))
        gain = 1.0 - after / max(error, 1e-12)
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


class _Solver:
    """Solves for the memberships of vertices in regions."""

    def __init__(self, seen: Seen, edges: NDArray[np.int64]) -> None:
        """Prepare the sparse matrices of what rays see (R, V) and of neighbours (V, V); edges (E, 2)."""
        shape, at = (len(seen.pixel), seen.vertices), (seen.ray, seen.vertex)
        self._seen = seen
        self._plain, self._lit = (
            csr_matrix((w.astype(np.float32), at), shape=shape) for w in (seen.weight, seen.weight * seen.cosine)
        )
        self._back, self._back_lit = self._plain.T.tocsr(), self._lit.T.tocsr()
        light = np.asarray(self._back @ np.ones(shape[0], np.float32))
        one, other = edges.T
        # Also where nothing is seen there is a neighbour to follow.
        both = np.sqrt(light[one] * light[other]) + 1e-3 * light.mean()
        ends = np.concatenate((one, other)), np.concatenate((other, one))
        square = (seen.vertices, seen.vertices)
        self._near = coo_matrix((np.concatenate((both, both)).astype(np.float32), ends), shape=square).tocsr()
        self._degree = np.asarray(self._near.sum(axis=1))
        # Of a matrix without negative entries, the sums of its products bound the curvature of each unknown.
        self._bound = np.asarray(self._back @ (self._plain @ np.ones((shape[1], 1), np.float32)))
        self._along = _directions(seen.pixel)

    def solve(self, region: Regions, count: int, smoothness: float) -> Regions:
        """Return the region of largest membership of each vertex (V,): accelerated projected gradients."""
        member = np.eye(count, dtype=np.float32)[region]
        pixel = self._seen.pixel.astype(np.float32)
        for _ in range(TURNS):
            ambient, diffuse = (c.astype(np.float32) for c in self._seen.light(member.argmax(axis=1), count))
            full = ambient + diffuse
            curvature = float(np.linalg.eigvalsh(full @ full.T).max()) * self._bound
            step = 1.0 / (curvature + 2.0 * smoothness * self._degree + 1e-9)
            ahead, pace = member, 1.0
            for _ in range(STEPS):
                error = _across((self._plain @ ahead) @ ambient + (self._lit @ ahead) @ diffuse - pixel, self._along)
                slope = self._back @ (error @ ambient.T) + self._back_lit @ (error @ diffuse.T)
                slope += smoothness * (self._degree * ahead - self._near @ ahead)
                found = _onto_simplex(ahead - step * slope)
                following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pace * pace))
                ahead = (found + (pace - 1.0) / following * (found - member)).astype(np.float32)
                member, pace = found, following
        return member.argmax(axis=1)


def _neighbours(places: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the pairs of vertices (V, 3) that are neighbours along an axis. (E, 2)"""
    number = np.full(tuple(places.max(axis=0) + 1), -1, np.int64)
    number[tuple(places.T)] = np.arange(len(places))
    pairs = []
    for axis in range(3):
        along = np.moveaxis(number, axis, 0)
        there = (along[:-1] >= 0) & (along[1:] >= 0)
        pairs.append(np.stack([along[:-1][there], along[1:][there]], axis=1))
    return np.concatenate(pairs)


def _directions(pixel: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the directions of colours, 0 for black. (R, 3) -> (R, 3)"""
    length = np.linalg.norm(pixel, axis=1, keepdims=True)
    return (pixel / np.maximum(length, 1e-6)).astype(np.float32)


def _across(error: NDArray[np.floating], along: NDArray[np.floating], kept: float = ALONG) -> NDArray[np.floating]:
    """Return errors of colours (R, 3) of which only the part ``kept`` is left along directions (R, 3)."""
    return np.asarray(error - (1.0 - kept) * (error * along).sum(axis=1, keepdims=True) * along)


def _onto_simplex(values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the nearest memberships, >= 0 with sum 1 (Duchi et al. 2008). (V, P) -> (V, P)"""
    falling = -np.sort(-values, axis=1)
    over = falling.cumsum(axis=1) - 1.0
    count = np.arange(1, values.shape[1] + 1)
    last = (falling - over / count > 0).sum(axis=1)
    shift = np.take_along_axis(over, last[:, None] - 1, axis=1) / last[:, None]
    return np.maximum(values - shift, 0.0).astype(np.float32)


def agreement(first: Sequence[NDArray[np.floating]], second: Sequence[NDArray[np.floating]]) -> Array:
    """Return the intersection over union of soft memberships of samples, each (S,), region by region. (P,)"""
    both = np.array([np.minimum(a, b).sum() for a, b in zip(first, second, strict=True)])
    either = np.array([np.maximum(a, b).sum() for a, b in zip(first, second, strict=True)])
    return np.asarray(both / np.maximum(either, 1e-12), np.float64)
