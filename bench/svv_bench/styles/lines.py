"""Lines in a picture, and the distance between the lines of two pictures, without any trained network.

A smoothed structure tensor gives every pixel a strength and a direction; its ridges, thinned and linked, are lines.
Pictures are compared by distributions over all pixels: the strength of lines and the area that they cover, their
length, how straight and unbroken they are, and how strongly one direction dominates around a pixel.

Letters: H, W a picture's height and width; L its pixels on lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt, gaussian_filter, map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import wasserstein_distance

from svv.errors import BadInput

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

SMOOTHING_DEVIATION = 1.0
"""Standard deviation in pixels of the derivatives and of the tensor used for finding lines."""
COHERENCE_DEVIATIONS = (2.0, 4.0, 8.0)
"""Standard deviations in pixels at which coherence is measured."""
STRONG_THRESHOLD, WEAK_THRESHOLD = 1.0, 0.5
"""Hysteresis thresholds as fractions of the style's root mean square strength."""
LEAST_STRENGTH = 0.01
"""Lower bound of the style's root mean square strength: a few 8-bit levels across a line."""
STEADY_ANGLE = np.radians(30)
"""Largest difference, in radians, between the directions of neighbours on one line."""
LONGEST_LINE = 48
"""Upper bound of line lengths in pixels, because regions cut their lines."""
TURNING_STEPS = (3, 6, 12)
"""Distances along a line, in pixels, over which its turning is measured."""
LEAST_PIXELS = 64
"""Fewest pixels that a mask must contain."""


class Sample(NamedTuple):
    """Values with non-negative weights."""

    values: Floats
    """Values of the distribution."""
    weights: Floats
    """Weight of each value, >= 0."""


@dataclass(frozen=True)
class Ridges:
    """Measurements at every pixel of a picture, from which lines are traced."""

    strength: Floats
    """Square root of the tensor's larger eigenvalue: colour change per pixel. (H, W)"""
    angle: Floats
    """Line direction, normal to the steepest change; radians in (-pi/2, pi/2], x towards y (down). (H, W)"""
    thin: Mask
    """Whether no neighbour across the line is stronger. (H, W)"""
    coherence: tuple[Floats, ...]
    """(l1 - l2) / (l1 + l2) of the tensor's eigenvalues at each of :data:`COHERENCE_DEVIATIONS`, 0 to 1. (H, W) each"""
    energy: Floats
    """Squared length of the gradient. (H, W)"""
    inside: Mask
    """Pixels that count. (H, W)"""

    @property
    def scale(self) -> float:
        """Root mean square strength, or :data:`LEAST_STRENGTH`."""
        return max(LEAST_STRENGTH, float(np.sqrt(np.square(self.strength[self.inside]).mean())))


def interior(cover: Mask) -> Mask:
    """Remove the border pixels of a mask; the picture's border does not count as one. (H, W)"""
    return np.asarray(binary_erosion(cover, np.ones((3, 3)), border_value=1))


def find_ridges(picture: NDArray[np.floating], mask: NDArray[np.floating | np.bool_] | None = None) -> Ridges:
    """Find strength and direction of lines at every pixel with the structure tensor of all three channels.

    J = G * sum_c grad(I_c) grad(I_c)^T  (Di Zenzo 1986; Bigun and Granlund 1987)

    Outside the mask, the nearest pixel inside is repeated, so that the border of the mask does not become a line.

    Args:
        picture: sRGB in [0, 1]. (H, W, 3)
        mask: Pixels that count: bool, or opacity, which counts above 0.9; all by default. (H, W)

    Raises:
        BadInput: The picture does not have three channels, or the mask has another size or fewer than 64 pixels inside.
    """
    if picture.ndim != 3 or picture.shape[2] != 3:
        raise BadInput("Lines can be found only in colour pictures: give an array of (height, width, 3).")
    cover = np.ones(picture.shape[:2], bool) if mask is None else np.asarray(mask, np.float64) > 0.9
    if cover.shape != picture.shape[:2]:
        raise BadInput("The mask must have the picture's size.")
    inside = interior(cover)
    if inside.sum() < LEAST_PIXELS:
        raise BadInput(f"Fewer than {LEAST_PIXELS} pixels lie inside the mask: render the picture larger.")
    values = np.asarray(picture, np.float64)
    if not cover.all():
        values = values[tuple(distance_transform_edt(~cover, return_distances=False, return_indices=True))]
    dy, dx = (
        gaussian_filter(values, SMOOTHING_DEVIATION, order=o, axes=(0, 1), mode="nearest") for o in ((1, 0), (0, 1))
    )
    products = [(a * b).sum(2) for a, b in ((dx, dx), (dx, dy), (dy, dy))]  # xx, xy, yy
    weight = inside.astype(np.float64)
    xx, xy, yy = (gaussian_filter(p, SMOOTHING_DEVIATION, mode="nearest") for p in products)
    apart = np.hypot(xx - yy, 2 * xy)
    strength = np.sqrt(np.maximum(xx + yy + apart, 0) / 2)
    across = np.arctan2(2 * xy, xx - yy) / 2
    rows, columns = np.indices(strength.shape)
    beside = [
        map_coordinates(strength, (rows + s * np.sin(across), columns + s * np.cos(across)), order=1, mode="nearest")
        for s in (-1, 1)
    ]
    coherence = []
    for scale in COHERENCE_DEVIATIONS:
        xx, xy, yy = (gaussian_filter(p * weight, scale, mode="nearest") for p in products)
        coherence.append(np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-12))
    angle = np.where(across > 0, across - np.pi / 2, across + np.pi / 2)
    thin = (strength >= beside[0]) & (strength > beside[1]) & inside
    return Ridges(strength, angle, thin, tuple(coherence), (products[0] + products[2]) * weight, inside)


def traced(ridges: Ridges, scale: float) -> NDArray[np.int64]:
    """Trace lines: thin ridges above the weak threshold, linked along their direction, with at least one strong pixel.

    Two of eight neighbours are linked if their directions agree within :data:`STEADY_ANGLE` and one lies in the
    direction of the other. This is the hysteresis of Canny (1986) along lines rather than across them.

    Args:
        ridges: Ridges of the picture.
        scale: Strength of which the thresholds are fractions.

    Returns:
        Number of each pixel's line, 0 or higher, or -1 where there is no line. (H, W)
    """
    there = ridges.thin & (ridges.strength >= WEAK_THRESHOLD * scale)
    number = np.full(there.shape, -1)
    number[there] = np.arange(there.sum())
    padded = np.pad(number, 1, constant_values=-1)
    angles = ridges.angle[there]
    height, width = there.shape
    pairs = []
    for down, right in ((0, 1), (1, 1), (1, 0), (1, -1)):
        other = padded[1 + down : 1 + down + height, 1 + right : 1 + right + width]
        both = there & (other >= 0)
        a, b = number[both], other[both]
        on = np.arctan2(down, right)
        fits = (turned(angles[a], angles[b]) <= STEADY_ANGLE) & (turned(angles[a], on) <= np.pi / 3)
        pairs.append((a[fits], b[fits]))
    first, second = (np.concatenate(p) for p in zip(*pairs))
    count = len(angles)
    graph = coo_array((np.ones(len(first), bool), (first, second)), shape=(count, count))
    found, line = connected_components(graph, directed=False) if count else (0, np.zeros(0, int))
    strong = np.zeros(found, bool)
    strong[line[ridges.strength[there] >= STRONG_THRESHOLD * scale]] = True
    result = np.full(there.shape, -1)
    result[there] = np.where(strong[line], line, -1)
    return result


def turned(a: Floats | float, b: Floats | float) -> Floats:
    """Return the angle between line directions, 0 to pi/2."""
    apart = np.abs(np.asarray(a) - b) % np.pi
    return np.minimum(apart, np.pi - apart)


def _strengths(ridges: Ridges, lines: NDArray[np.int64], scale: float) -> Sample:
    """Return log2(1 + strength) of pixels on lines and 0 for all others, so that the area of lines counts, too.

    The eye perceives ratios: twice a style's strength is about as far from it as half.
    """
    values = np.log2(1 + np.where(lines >= 0, ridges.strength / scale, 0.0)[ridges.inside])
    return Sample(values, np.ones(len(values)))


def _lengths(ridges: Ridges, lines: NDArray[np.int64], scale: float) -> Sample:
    """Return log2 of the line length for each pixel on a line; a picture without lines has one line of one pixel."""
    number = lines[lines >= 0]
    if not len(number):
        return Sample(np.zeros(1), np.ones(1))
    pixels = np.bincount(number)[number]
    return Sample(np.log2(np.minimum(pixels, LONGEST_LINE)), np.ones(len(number)))


def _turns(ridges: Ridges, lines: NDArray[np.int64], scale: float) -> Sample:
    """Return how far a line's direction turns a few pixels straight ahead; pi/2 if there is no line any more.

    Steps out of the mask do not count, because the picture is unknown there.
    """
    rows, columns = np.nonzero(lines >= 0)
    here, found = ridges.angle[rows, columns], [np.zeros(0)]
    height, width = lines.shape
    for step in (*TURNING_STEPS, *(-s for s in TURNING_STEPS)):
        y, x = np.rint(rows + step * np.sin(here)).astype(int), np.rint(columns + step * np.cos(here)).astype(int)
        known = (y >= 1) & (x >= 1) & (y < height - 1) & (x < width - 1)
        known[known] = ridges.inside[y[known], x[known]]
        y, x, own = y[known], x[known], here[known]
        least = np.full(len(y), np.pi / 2)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                there = y + down, x + right
                met = lines[there] >= 0
                least = np.where(met, np.minimum(least, turned(ridges.angle[there], own)), least)
        found.append(least)
    turns = np.concatenate(found)
    return Sample(turns, np.ones(len(turns))) if len(turns) else Sample(np.full(1, np.pi / 2), np.ones(1))


def _coherences(level: int) -> Callable[[Ridges, NDArray[np.int64], float], Sample]:
    """Return a sampler of coherence at a scale, weighted by energy: flat areas have no direction and do not count."""

    def sample(ridges: Ridges, lines: NDArray[np.int64], scale: float) -> Sample:
        weights = ridges.energy[ridges.inside]
        if weights.sum() <= 1e-12:
            return Sample(np.zeros(1), np.ones(1))
        return Sample(ridges.coherence[level][ridges.inside], weights)

    return sample


MEASURES: dict[str, tuple[Callable[[Ridges, NDArray[np.int64], float], Sample], float]] = {
    "strength": (_strengths, 0.25),
    "length": (_lengths, 1.5),
    "turn": (_turns, 0.3),
    **{f"coherence {scale:g}": (_coherences(level), 0.3) for level, scale in enumerate(COHERENCE_DEVIATIONS)},
}
"""Name -> distribution and its smallest unit. Many styles resemble noise, all of them in strength and mosaics in
coherence; in units of that noise alone, their differences would be exaggerated."""


def line_samples(ridges: Ridges, scale: float) -> dict[str, Sample]:
    """Return the distributions of :data:`MEASURES` for a picture."""
    lines = traced(ridges, scale)
    return {name: measure(ridges, lines, scale) for name, (measure, _) in MEASURES.items()}


def shuffled(picture: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return white noise of a picture's colours: its pixels in a random order that is the same for every call."""
    pixels = picture.reshape(-1, picture.shape[-1])
    return np.random.default_rng(0).permutation(pixels).reshape(picture.shape)


@dataclass(frozen=True)
class StyleLines:
    """The lines of a style picture, with which those of other pictures are compared."""

    scale: float
    """Root mean square strength of the style."""
    samples: dict[str, Sample]
    """Distributions of :data:`MEASURES`."""
    noise: dict[str, float]
    """Unit of each distribution: the distance of white noise of the style's colours, or the smallest unit if larger."""

    @classmethod
    def of(cls, style: NDArray[np.floating]) -> StyleLines:
        """Analyse a picture, sRGB in [0, 1], (H, W, 3); raises BadInput as :func:`find_ridges` does."""
        ridges = find_ridges(style)
        scale = ridges.scale
        own, other = line_samples(ridges, scale), line_samples(find_ridges(shuffled(style)), scale)
        noise = {name: max(least, apart(own[name], other[name])) for name, (_, least) in MEASURES.items()}
        return cls(scale, own, noise)

    def distances(
        self, picture: NDArray[np.floating], mask: NDArray[np.floating | np.bool_] | None = None
    ) -> dict[str, float]:
        """Return how far the lines of a picture are from the style's, both at the style's scale.

        Args:
            picture: sRGB in [0, 1]. (H, W, 3)
            mask: Pixels that count; see :func:`find_ridges`. (H, W)

        Returns:
            For each of :data:`MEASURES`, the 1-Wasserstein distance of the distributions in its unit: 0 for equal ones,
            1 for white noise of the style's colours unless that is closer than the smallest unit; and ``lines``, their
            mean, in which strength, length, turn and coherence have equal weight.

        Raises:
            BadInput: As :func:`find_ridges`.
        """
        found = line_samples(find_ridges(picture, mask), self.scale)
        parts = {name: apart(found[name], wanted) / self.noise[name] for name, wanted in self.samples.items()}
        coherence = [value for name, value in parts.items() if name.startswith("coherence")]
        kinds = [parts["strength"], parts["length"], parts["turn"], float(np.mean(coherence))]
        return {"lines": float(np.mean(kinds)), **{f"lines: {name}": value for name, value in parts.items()}}


def apart(a: Sample, b: Sample) -> float:
    """Return the 1-Wasserstein distance of two distributions in units of their values."""
    return float(wasserstein_distance(a.values, b.values, a.weights, b.weights))
