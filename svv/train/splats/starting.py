"""Where splats start: on what is visible of a scene, flat along its surfaces.

Samples of rays from all around are gathered in cells, of which those that show the most become splats: so edits, cuts,
paint and light count as in pictures, and nothing is spent inside. Letters: S samples, C cells, N splats, R regions.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera, look_at
from svv.core.geometry.directions import geodesic_directions
from svv.core.rays.splatting import turned
from svv.errors import BadInput, Progress, silent
from svv.fields.radiance.rendering import composite
from svv.fields.scene.images import Together
from svv.fields.scene.scene import Scene
from svv.fields.splats.splats import Floats
from svv.train.splats import starting_kernels as kernels
from svv.train.splats.raster import Gaussians

VIEWS, PIXELS = 32, 224
"""Cameras of which rays look for what is visible, and the pixels along a side of their pictures."""

FOV = np.radians(30.0)
"""Angle of view of all cameras that look at a whole scene."""

LEAST_WEIGHT = 1e-3
"""Weight in a pixel below which a sample shows nothing."""

MOST_OF_VIEW = 200_000
"""Samples of a camera beyond which every other one, or fewer, is taken, with a greater weight."""

FINEST, MANY = 8, 300_000
"""Logarithm to base 2 of the finest cells along a side, and splats beyond which there are finer ones."""

EDGE = 0.02
"""Squared difference of colours that the edge of an opaque cell stands for."""

ALMOST = 0.2
"""Decibels that a higher degree of harmonics must gain."""

BOUND = 0.02
"""Weight of harmonics that do not change with direction, as a part of that of a cell's samples."""

OVERLAP = 0.62
"""Standard deviation of a splat that fills its cells, whose own is 3 / sqrt(12) cells: of three cells."""

FLATTEST, WIDEST = 0.2, 0.75
"""Smallest and largest standard deviation in cells."""

OPACITIES = (0.01, 0.9)
"""Bounds of opacities: beyond them, gradients are almost 0."""

COVERED = 1.8
"""How often splats cover each of a layer of cells on average: 2 pi 0.54^2, from the standard deviation in cells."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Samples that pictures of a scene show, in coordinates that count from ``origin`` in units of ``size``."""

    origin: NDArray[np.float64]
    """In world units. (3,)"""
    size: float
    """In world units."""
    places: Floats
    """(S, 3)"""
    directions: Floats
    """Unit vectors from the eye to each, (S, 3)"""
    weights: Floats
    """Weight of each in its pixel. (S,)"""
    colours: Floats
    """(S, 3)"""
    densities: Floats
    """Extinction, in 1 / unit. (S,)"""
    regions: NDArray[np.int16]
    """(S,)"""
    halves: NDArray[np.bool_]
    """Whether every other camera sees it. (S,)"""


def cameras_around(
    centre: NDArray[np.float64], radius: float, count: int, pixels: int, turned: float = 0.0
) -> list[Camera]:
    """Return cameras around a ball of the world that see all that is in it, each from another side.

    ``turned``: angle in radians by which they are turned about the y axis, to look from sides between others.
    """
    distance = 1.01 * radius / np.sin(0.5 * FOV)
    cos, sin = np.cos(turned), np.sin(turned)
    sides = geodesic_directions(count) @ np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
    found = []
    for side in sides:
        matrix = look_at(side, np.zeros(3))
        matrix[:3, 3] = centre + distance * side
        found.append(Camera(matrix, FOV, pixels, pixels))
    return found


def seen_of(scene: Scene, network: str, progress: Progress = silent) -> Seen:
    """Return what pictures of a scene show; BadInput if that is nothing."""
    bounds = scene.bounds
    origin, size = bounds.mean(axis=0), 0.5 * float((bounds[1] - bounds[0]).max())
    step = scene.marching_for_images.step * scene.occupancy.box.size / size
    found: list[tuple[NDArray[Any], ...]] = []
    cameras = cameras_around(origin, 0.5 * float(np.linalg.norm(bounds[1] - bounds[0])), VIEWS, PIXELS)
    for number, camera in enumerate(cameras):
        progress(number / len(cameras), "looking for what is visible")
        whole = Together(scene, camera, network)
        pixels = whole.in_sight()
        origins, directions = (torch.from_numpy(v.reshape(-1, 3)) for v in camera.rays())
        seen = whole.samples(pixels) if len(pixels) else None
        if seen is None:
            continue
        samples, colour, region, distance, _ = seen
        _, _, weights = composite(samples, samples.sigma, colour)
        own = torch.nonzero(weights > LEAST_WEIGHT)[:, 0]
        every = 1 + len(own) // MOST_OF_VIEW
        own = own[number % every :: every]
        rays = pixels[samples.ray.long()[own]].cpu()
        away, weight, rgb, thickness, region = (
            values[own].cpu() for values in (distance, weights, colour, samples.sigma, region)
        )
        places = (origins[rays] + away[:, None] * directions[rays] - torch.from_numpy(origin)) / size
        parts = [v.float().numpy() for v in (places, directions[rays], every * weight, rgb, thickness / step)]
        found.append((*parts, region.short().numpy(), np.full(len(own), number % 2 == 0)))
    if not sum(len(part[0]) for part in found):
        raise BadInput(
            "The scene shows nothing, so there is nothing to make splats of: show regions with svv edit --show, make "
            "them more opaque, or take cuts away."
        )
    return Seen(origin, size, *(np.concatenate(parts) for parts in zip(*found, strict=True)))


def ball_around(seen: Seen) -> tuple[NDArray[np.float64], float]:
    """Return the centre (3,) and radius of a ball around what is seen, in world units."""
    middle = 0.5 * (seen.places.min(axis=0) + seen.places.max(axis=0))
    radius = float(np.linalg.norm(seen.places - middle, axis=1).max())
    return seen.origin + seen.size * middle.astype(np.float64), seen.size * radius


@dataclass(frozen=True, eq=False)
class Level:
    """Cells of one size that hold samples."""

    side: float
    keys: NDArray[np.int64]
    """Their Morton keys, ascending. (C,)"""
    starts: NDArray[np.int64]
    """Where the samples of each start. (C + 1,)"""
    moments: NDArray[np.float64]
    """(C, MOMENTS)"""

    @property
    def scores(self) -> NDArray[np.float64]:
        """What dividing each may gain: squared differences of its colours, and a blurred edge if it is opaque. (C,)"""
        weight = self.moments[:, 0]
        apart = self.moments[:, 13] - (self.moments[:, 10:13] ** 2).sum(axis=1) / weight
        opacity = 1.0 - np.exp(-self.moments[:, 14] / weight * self.side)
        return np.asarray(apart + EDGE * weight * opacity**2)


def splats_at(seen: Seen, count: int, degree: int | None) -> tuple[Gaussians, NDArray[np.int16], float]:
    """Return at most ``count`` splats on what is seen, their regions (N,), and the mean side of their cells.

    ``degree``: of the harmonics; None for the lowest that predicts colours from other sides almost as well as higher
    ones.
    """
    seen, levels = _levels_of(seen, FINEST if count <= MANY else FINEST + 1)
    chosen = _leaves(levels, count)
    low = np.concatenate([level.starts[:-1][rows] for level, rows in zip(levels, chosen, strict=True)])
    high = np.concatenate([level.starts[1:][rows] for level, rows in zip(levels, chosen, strict=True)])
    order = np.argsort(low)  # leaves hold all samples, so that one starts where another ends
    starts = np.append(low[order], high.max())
    moments = np.concatenate([level.moments[rows] for level, rows in zip(levels, chosen, strict=True)])[order]
    around = np.concatenate([_around(level, rows) for level, rows in zip(levels, chosen, strict=True)])[order]
    sides = np.concatenate([np.full(len(rows), level.side) for level, rows in zip(levels, chosen, strict=True)])[order]
    weight = moments[:, 0]
    centres = moments[:, 1:4] / weight[:, None]
    scales, rotations = _shapes(around, sides)
    thickness = moments[:, 14] / weight * sides / COVERED
    opacities = np.clip(1.0 - np.exp(-thickness), *OPACITIES)
    degree = _degree_of(seen, starts) if degree is None else degree
    harmonics = _harmonics(seen, starts, seen.weights, (degree + 1) ** 2)
    arrays = centres, scales, rotations, opacities, harmonics
    splats = Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))
    return splats, _regions(seen, starts), float(sides.mean())


def _levels_of(seen: Seen, finest: int) -> tuple[Seen, list[Level]]:
    """Return what is seen in the order of cells, and its cells, from one to 2^``finest`` a side."""
    low, high = seen.places.min(axis=0), seen.places.max(axis=0)
    extent = float((high - low).max()) * (1.0 + 1e-6) + 1e-12
    keys = np.empty(len(seen.places), np.int64)
    kernels.order_keys(seen.places, low, np.float32((1 << finest) / extent), finest, keys)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    fields: tuple[NDArray[Any], ...] = (
        seen.places, seen.directions, seen.weights, seen.colours, seen.densities, seen.regions, seen.halves
    )  # fmt: skip
    seen = Seen(seen.origin, seen.size, *(np.ascontiguousarray(field[order]) for field in fields))
    starts = np.append(np.flatnonzero(np.append(True, keys[1:] != keys[:-1])), len(keys))
    moments = np.empty((len(starts) - 1, kernels.MOMENTS))
    kernels.add_moments(starts, seen.places, seen.weights, seen.colours, seen.densities, moments)
    levels = [Level(extent / (1 << finest), keys[starts[:-1]], starts, moments)]
    for _ in range(finest):
        finer = levels[0]
        wider = finer.keys >> 3
        first = np.flatnonzero(np.append(True, wider[1:] != wider[:-1]))
        sums = np.add.reduceat(finer.moments, first, axis=0)
        levels.insert(0, Level(2.0 * finer.side, wider[first], np.append(finer.starts[first], len(keys)), sums))
    return seen, levels


def _leaves(levels: list[Level], count: int) -> list[NDArray[np.int64]]:
    """Return which cells of each level are leaves if those of the highest scores are divided, at most ``count``."""
    scores = [level.scores for level in levels]
    parents = [np.searchsorted(wide.keys, fine.keys >> 3) for wide, fine in pairwise(levels)]

    def leaves(least: float) -> list[NDArray[np.int64]]:
        there, found = np.ones(len(scores[0]), bool), []
        for number, score in enumerate(scores):
            divided = there & (score > least) if number < len(parents) else np.zeros_like(there)
            found.append(np.flatnonzero(there & ~divided))
            if number < len(parents):
                there = divided[parents[number]]
        return found

    low, high = -60.0, float(np.log(max(score.max() for score in scores) + 1e-30)) + 1e-6
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sum(map(len, leaves(np.exp(middle)))) > count else (low, middle)
    return leaves(np.exp(high))


def _degree_of(seen: Seen, starts: NDArray[np.int64]) -> int:
    """Return the lowest degree whose harmonics, of half of the cameras, predict what the others see almost the best."""
    half = seen.halves
    errors = []
    for degree in range(4):
        harmonics = _harmonics(seen, starts, np.where(half, seen.weights, 0.0).astype(np.float32), (degree + 1) ** 2)
        own = np.zeros(len(starts) - 1)
        others = np.where(half, 0.0, seen.weights).astype(np.float32)
        kernels.add_errors(starts, seen.directions, others, seen.colours, harmonics.astype(np.float32), own)
        errors.append(float(own.sum()))
    best = min(errors)
    return next(degree for degree, error in enumerate(errors) if error <= best * 10.0 ** (0.1 * ALMOST))


def _harmonics(seen: Seen, starts: NDArray[np.int64], weights: Floats, count: int) -> NDArray[np.float64]:
    """Return the harmonics of the colours of cells by least squares, weakly bound to no change with direction."""
    products, sides = np.zeros((len(starts) - 1, count, count)), np.zeros((len(starts) - 1, count, 3))
    kernels.add_harmonics(starts, seen.directions, weights, seen.colours, products, sides)
    bound = BOUND * products[:, 0, 0]
    ridge = np.ones(count)
    ridge[0] = 1e-3
    products += (bound[:, None] * ridge + 1e-9)[:, :, None] * np.eye(count)
    return np.asarray(np.linalg.solve(products, sides))


def _regions(seen: Seen, starts: NDArray[np.int64]) -> NDArray[np.int16]:
    """Return the region that each cell shows the most. (C,)"""
    numbers, own = int(seen.regions.max()) + 1, np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    shares = np.bincount(own * numbers + seen.regions, seen.weights, numbers * (len(starts) - 1))
    return shares.reshape(-1, numbers).argmax(axis=1).astype(np.int16)


def _around(level: Level, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return sums of the first ten moments of some cells of a level and of those beside them. (len(rows), 10)"""

    def numbers(keys: NDArray[np.int64], k: int) -> NDArray[np.int64]:
        found = np.zeros(len(keys), np.int64)
        for bit in range(FINEST + 1):
            found |= ((keys >> (3 * bit + 2 - k)) & 1) << bit
        return found

    x, y, z = (numbers(level.keys, k) + 1 for k in range(3))
    wide = int(max(x.max(), y.max(), z.max())) + 2
    index = np.full(wide**3, len(level.keys), np.int32)
    places = (x * wide + y) * wide + z
    index[places] = np.arange(len(places))
    padded = np.concatenate([level.moments[:, :10], np.zeros((1, 10))])
    own, out = places[rows], np.zeros((len(rows), 10))
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            for dz in (-1, 0, 1):
                out += padded[index[own + (dx * wide + dy) * wide + dz]]
    return out


def _shapes(
    moments: NDArray[np.float64], sides: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return standard deviations (N, 3) and quaternions (N, 4) of splats, from the moments of what is around them."""
    weight = moments[:, 0]
    mean = moments[:, 1:4] / weight[:, None]
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    spread = np.empty((len(weight), 3, 3))
    for k, (i, j) in enumerate(pairs):
        spread[:, i, j] = spread[:, j, i] = moments[:, 4 + k] / weight - mean[:, i] * mean[:, j]
    values, vectors = np.linalg.eigh(spread)
    vectors[np.linalg.det(vectors) < 0.0, :, 0] *= -1.0
    scales = np.sqrt(np.maximum(values, 0.0)) * OVERLAP
    return np.clip(scales, FLATTEST * sides[:, None], WIDEST * sides[:, None]), quaternions_of(vectors)


def quaternions_of(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternions w, x, y, z of rotation matrices (N, 3, 3), by the largest of the four. (N, 4)"""
    r = turns
    diagonal = r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]
    squares = np.stack(
        [
            1.0 + diagonal[0] + diagonal[1] + diagonal[2],
            1.0 + diagonal[0] - diagonal[1] - diagonal[2],
            1.0 - diagonal[0] + diagonal[1] - diagonal[2],
            1.0 - diagonal[0] - diagonal[1] + diagonal[2],
        ],
        axis=1,
    )
    a, b, c = r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]
    d, e, f = r[:, 1, 0] + r[:, 0, 1], r[:, 0, 2] + r[:, 2, 0], r[:, 2, 1] + r[:, 1, 2]
    w, x, y, z = squares.T
    rows = np.stack([[w, a, b, c], [a, x, d, e], [b, d, y, f], [c, e, f, z]]).transpose(2, 0, 1)
    best = rows[np.arange(len(r)), squares.argmax(axis=1)]
    return np.asarray(best / np.linalg.norm(best, axis=1, keepdims=True))


def turns_of(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrices of quaternions w, x, y, z of any length above 0. (N, 4) -> (N, 3, 3)"""
    return turned(torch.from_numpy(quaternions)).numpy()
