"""Edges in the depth, alpha and regions of a scene's image: the lines that a draughtsman would draw.

Places where alpha ends, the region changes, depth jumps or the surface turns sharply (Saito and Takahashi 1990) are
ridges of a measure of such change, located to a fraction of a pixel (Steger 1998). Strengths are averaged along a
ridge. Nothing is random, and all varies smoothly with the images, so lines move with the shapes that they outline.

Constant lengths are in pixels of an image whose shorter side has :data:`VIEW`; ``scale`` is the actual shorter side
divided by that. Letters: H, W rows and columns of an image, E points of edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Distance

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]


class PixelSize(Protocol):
    """What :meth:`svv.core.geometry.cameras.Camera.pixel_at` is."""

    def __call__(self, distance: Distance, pixels: float = ..., /) -> Distance:
        """Return the width of pixels at distances."""


VIEW = 800
"""Shorter side of the reference image, in whose pixels lengths are given."""

CHANGE_DEVIATION = 1.6
"""Standard deviation of the Gaussian with which change is measured."""
SMOOTHING_DEVIATION = 1.2
"""Standard deviation of the Gaussian that smooths the measure, so that its ridges are continuous."""
LEAST_DEVIATION = 0.8
"""Lower bound of both deviations, in pixels of the actual image."""
SAMPLING_VARIANCE = 5.0 / 12.0
"""Variance, in pixels squared, by which a pixel and a difference between its neighbours widen an edge."""

DEPTH_JUMP = 0.2
"""Jump in depth, relative to the box's longest side, that counts as much as the edge of an opaque object."""
DEPTH_JUMP_PIXELS = 8.0
"""Lower bound of that jump, in pixels at that depth: the depth of rendered fields is noisy by about one pixel."""

WEAK_CHANGE, STRONG_CHANGE = 0.14, 0.4
"""Measures of change, see :func:`_silhouettes`, between which a line's strength rises from 0 to 1."""

FOLD_BOUNDS = (1.2, 1.5)
"""Changes of the unit normal across a crease between which strength rises from 0 to 1; 1 is 60, 1.4 is 90 degrees."""
FOLD_DEVIATION = 4.5
"""Standard deviation of the Gaussian that averages normals."""
FOLD_BOX = 0.011
"""Lower bound of that deviation, relative to the box: depth noise scales with the sampling distance, even close up."""
BAND_DEVIATION = 2.0
"""Standard deviation of the band along silhouettes in which normals are ignored: depth mixes two surfaces there."""

OPAQUE_ALPHAS = (0.93, 0.995)
"""Alphas between which the weight of depth rises from 0 to 1; in fog, depth belongs to no surface."""

EVENING_DEVIATION = 4.0
"""Standard deviation of the Gaussian that averages strength along a line, also the minimum in pixels of the actual
image; along creases it is 1.8 times the deviation of normals."""
WHOLE_BOUNDS = (0.3, 0.55)
"""Fractions of a line's neighbourhood along itself that exist, between which ink rises from 0 to 1; half at an end."""
STRIDE = 1.5
"""Distance in pixels of the actual image between the points that are averaged along a line."""
TURN_COSINES = (0.4, 0.8)
"""Cosines of the angle between neighbouring edge points between which their weight as one line rises from 0 to 1."""

PARTED_REACH = 2.0
"""Distance from an edge at which the two sides that it separates are looked up."""


@dataclass(frozen=True)
class Edges:
    """Points of edges, (E,) each.

    ``x`` and ``y`` are in pixels from the centre of the first pixel, to the right and down; ``nx`` and ``ny`` are the
    unit normal; ``change`` is the height of the measure there.
    """

    x: Floats
    y: Floats
    nx: Floats
    ny: Floats
    change: Floats
    spacing: int = 1
    """Distance between neighbouring points in pixels, or slightly more."""

    def chosen(self, which: NDArray[np.bool_]) -> Edges:
        """Return a subset of the points."""
        x, y, nx, ny, change = (v[which] for v in (self.x, self.y, self.nx, self.ny, self.change))
        return Edges(x, y, nx, ny, change, self.spacing)

    def scaled(self, factor: int) -> Edges:
        """Return the edges in an image ``factor`` times as large."""
        centre = 0.5 * (factor - 1)
        return Edges(self.x * factor + centre, self.y * factor + centre, self.nx, self.ny, self.change, factor)


def lines_of(
    alpha: Floats, depth: Floats, region: NDArray[np.int16], pixel_at: PixelSize, box: float, scale: float
) -> tuple[tuple[Edges, Floats], tuple[Edges, Floats]]:
    """Find silhouettes and creases, each with the strength in [0, 1] of its points (E,).

    ``alpha``: in [0, 1]; ``depth``: distance from the camera in world units, nan where nothing is visible; ``region``:
    its number, -1 where nothing is visible, all (H, W); ``box``: longest side of the scene's box in world units;
    ``scale``: shorter side of the whole image, of which these may be a crop, divided by :data:`VIEW`.
    """
    from scipy.ndimage import maximum_filter

    sigma = max(LEAST_DEVIATION, CHANGE_DEVIATION * scale)
    share = _gauss(alpha, sigma)
    seen = np.where(np.isnan(depth), 0.0, depth).astype(np.float32)
    smooth = _gauss(alpha * seen, sigma) / np.maximum(share, 1e-4)
    edges = _silhouettes(alpha, smooth, share, region, pixel_at, box, scale)
    strength = _along(
        edges, ramp(edges.change, WEAK_CHANGE, STRONG_CHANGE), alpha.shape, EVENING_DEVIATION * max(scale, 1.0)
    )
    # The line of a translucent shell is as faint as the shell itself.
    strength *= maximum_filter(alpha, 2 * int(np.ceil(PARTED_REACH * scale)) + 1)[pixels_of(edges, alpha.shape)]
    return (edges, strength), _creases(edges, strength, smooth, share, pixel_at, box, scale)


def pixels_of(edges: Edges, shape: tuple[int, ...], reach: float = 0.0) -> tuple[Indices, Indices]:
    """Return row and column of the pixels that contain the points, moved by ``reach`` pixels along the normal."""
    row, column = (np.rint(at + reach * n).astype(np.intp) for at, n in ((edges.y, edges.ny), (edges.x, edges.nx)))
    return np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)


def _silhouettes(
    alpha: Floats,
    depth: Floats,
    share: Floats,
    region: NDArray[np.int16],
    pixel_at: PixelSize,
    box: float,
    scale: float,
) -> Edges:
    """Find edges of alpha, regions and depth together, so that several coinciding changes give one line.

    The measure is log(1 + s). s is the gradient's length, scaled to 1 at the middle of a jump of 1 from one region's
    alpha to another's, or of :data:`DEPTH_JUMP` in depth. The logarithm keeps high jumps from hiding low ones nearby.
    """
    sigma = max(LEAST_DEVIATION, CHANGE_DEVIATION * scale)
    square = np.zeros_like(alpha)
    for number in np.flatnonzero(np.bincount(region[region >= 0])):
        square += _square(_gauss(np.where(region == number, alpha, np.float32(0.0)), sigma))
    step = np.maximum(DEPTH_JUMP * box, pixel_at(depth, DEPTH_JUMP_PIXELS * scale))
    square += _square(depth) * (ramp(share, *OPAQUE_ALPHAS) / np.maximum(step, 1e-30)) ** 2
    change = np.log1p(np.sqrt(square) * _spread(sigma) * np.sqrt(2.0 * np.pi))
    return _ridges(
        change.astype(np.float32), sigma, max(LEAST_DEVIATION, SMOOTHING_DEVIATION * scale), 0.5 * WEAK_CHANGE
    )


def _creases(
    silhouettes: Edges, ink: Floats, depth: Floats, share: Floats, pixel_at: PixelSize, box: float, scale: float
) -> tuple[Edges, Floats]:
    """Find edges of the surface normal, and the strength of each of their points. (E,)"""
    away = float((share * depth).sum() / max(float(share.sum()), 1e-30))
    sigma = max(
        2.0 * LEAST_DEVIATION, FOLD_DEVIATION * scale, min(FOLD_BOX * box / max(pixel_at(away), 1e-30), 32.0 * scale)
    )
    factor = min(max(1, int(sigma / 1.5)), 3)  # an image this smooth loses nothing by being smaller
    right, down = _gradient(depth)
    toward = pixel_at(depth)
    length = np.sqrt(right**2 + down**2 + toward**2)
    beside = np.zeros_like(depth)
    beside[pixels_of(silhouettes, depth.shape)] = ink
    small = [_pooled(image, factor) for image in
             (right / np.maximum(length, 1e-30), down / np.maximum(length, 1e-30), toward / np.maximum(length, 1e-30),
              ramp(share, *OPAQUE_ALPHAS), beside)]  # fmt: skip
    band = BAND_DEVIATION * scale / factor
    free = small[3] * np.clip(1.0 - _gauss(small[4], band) * (factor * band * 4.0 * np.sqrt(2.0 * np.pi)), 0.0, 1.0)
    sigma /= factor
    known = _gauss(free, sigma)
    normal = [_gauss(component * free, sigma) / np.maximum(known, 1e-3) for component in small[:3]]
    length = np.maximum(np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2), 1e-3)
    square = np.zeros_like(known)
    for component in normal:
        square += _square(component / length)
    change = np.sqrt(square) * (_spread(sigma) * np.sqrt(2.0 * np.pi)) * free
    edges = _ridges(change.astype(np.float32), sigma, 0.7 * sigma, 0.6 * FOLD_BOUNDS[0])
    there = ramp(edges.change, *FOLD_BOUNDS) * ramp(known[pixels_of(edges, known.shape)], 0.5, 0.8)
    strength = _along(edges, there, known.shape, 1.8 * sigma)
    return edges.scaled(factor), strength


def _ridges(change: Floats, sigma: float, again: float, least: float) -> Edges:
    """Find points where the measure, smoothed by ``again``, is largest along the direction of its largest curvature.

    ``change`` of the edges is the height of the Gaussian ridge with this curvature that a jump produces when it is
    differentiated over ``sigma``.
    """
    spread = _spread(sigma)
    image = _gauss(change, again)
    rows, columns = (axis + 1 for axis in np.nonzero(image[1:-1, 1:-1] > 0.5 * least))
    around = [[image[rows + i, columns + j] for j in (-1, 0, 1)] for i in (-1, 0, 1)]
    gx, gy = 0.5 * (around[1][2] - around[1][0]), 0.5 * (around[2][1] - around[0][1])
    xx = around[1][2] - 2.0 * around[1][1] + around[1][0]
    yy = around[2][1] - 2.0 * around[1][1] + around[0][1]
    xy = 0.25 * (around[2][2] - around[2][0] - around[0][2] + around[0][0])
    bend = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)  # the smaller eigenvalue of the Hessian
    height = -bend * (spread**2 + again**2 + 1.0 / 6.0) ** 1.5 / spread  # 1/6: variance of the second difference
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi
    nx, ny = np.cos(angle), np.sin(angle)
    along = -(gx * nx + gy * ny) / np.minimum(bend, -1e-12)
    # Slightly more than half a pixel: a point found twice does no harm, but a missed one leaves a gap.
    kept = (height > least) & (np.abs(along * nx) <= 0.6) & (np.abs(along * ny) <= 0.6)
    return Edges(columns + along * nx, rows + along * ny, nx, ny, height).chosen(kept)


def _along(edges: Edges, strength: Floats, shape: tuple[int, ...], even: float) -> Floats:
    """Average strengths twice along the lines, following their points; see :data:`EVENING_DEVIATION`. (E,)"""
    count, (height, width) = len(edges.x), shape
    at = np.full((height + 2, width + 2), count, np.intp)
    row, column = pixels_of(edges, shape)
    for i, j in ((0, 0), (0, 2), (2, 0), (2, 2), (0, 1), (2, 1), (1, 0), (1, 2), (1, 1)):  # each point's own pixel last
        at[row + i, column + j] = np.arange(count)
    # The extra entry stands for "no edge": a line continues straight there.
    x, y, tx, ty = (np.append(v, 0.0) for v in (edges.x, edges.y, -edges.ny, edges.nx))
    steps = int(np.ceil(2.0 * even / STRIDE))
    weights = np.exp(-0.5 * (np.arange(1, steps + 1) * STRIDE / max(even, 1e-3)) ** 2)
    path: list[tuple[Indices, NDArray[np.float64]]] = [(np.arange(count), np.ones(count))]
    for sign in (1.0, -1.0):
        px, py, dx, dy, one = x[:-1], y[:-1], sign * tx[:-1], sign * ty[:-1], np.ones(count)
        for weight in weights:
            px, py = px + STRIDE * dx, py + STRIDE * dy
            j = at[np.clip(np.rint(py).astype(np.intp), -1, height) + 1,
                   np.clip(np.rint(px).astype(np.intp), -1, width) + 1]  # fmt: skip
            cosine, hit = tx[j] * dx + ty[j] * dy, j < count
            one = one * np.where(hit, ramp(np.abs(cosine), *TURN_COSINES), 1.0)
            turned = np.where(cosine < 0.0, -1.0, 1.0)
            foot = (px - x[j]) * tx[j] + (py - y[j]) * ty[j]
            dx, dy = np.where(hit, turned * tx[j], dx), np.where(hit, turned * ty[j], dy)
            px, py = np.where(hit, x[j] + foot * tx[j], px), np.where(hit, y[j] + foot * ty[j], py)
            path.append((j, weight * one))
    total = 1.0 + 2.0 * weights.sum()
    for _ in range(2):
        known = np.append(strength, 0.0)
        strength = ramp(sum(known[j] * weight for j, weight in path) / total, *WHOLE_BOUNDS)
    return strength.astype(np.float32)


def _spread(sigma: float) -> float:
    """Return the standard deviation in pixels of the gradient across a jump in an image smoothed by ``sigma``."""
    return float(np.sqrt(sigma**2 + SAMPLING_VARIANCE))


def ramp(values: NDArray[np.floating], low: float, high: float) -> NDArray[np.floating]:
    """Return 0 below ``low``, 1 above ``high`` and a smooth ramp between."""
    t = np.clip((values - low) * (1.0 / (high - low)), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _gauss(image: Floats, sigma: float) -> Floats:
    """Smooth an image; beyond its borders it is extrapolated with the same slope, or slopes would seem to end there."""
    from scipy.ndimage import correlate1d

    radius = int(np.ceil(2.7 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    for axis in (0, 1):
        width = [(0, 0), (0, 0)]
        width[axis] = radius, radius
        padded = np.pad(image, width, "reflect", reflect_type="odd")
        inside = (slice(radius, -radius), slice(None))
        image = correlate1d(padded, kernel, axis=axis)[inside if axis == 0 else inside[::-1]]
    return image


def _gradient(image: Floats) -> tuple[Floats, Floats]:
    """Return the change per pixel to the right and down. (H, W) each"""
    down, right = (np.gradient(image, axis=axis) if image.shape[axis] > 1 else np.zeros_like(image) for axis in (0, 1))
    return right, down


def _square(image: Floats) -> Floats:
    """Return the squared length of the gradient."""
    right, down = _gradient(image)
    return right * right + down * down


def _pooled(image: Floats, factor: int) -> Floats:
    """Average ``factor`` x ``factor`` pixels; the last row and column are repeated to fill incomplete blocks."""
    if factor == 1:
        return image
    height, width = image.shape
    image = np.pad(image, ((0, -height % factor), (0, -width % factor)), "edge")
    rows, columns = (size // factor for size in image.shape)
    return image.reshape(rows, factor, columns, factor).mean(axis=(1, 3))
