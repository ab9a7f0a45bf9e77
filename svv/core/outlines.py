"""Outlines: silhouettes and creases of an image drawn as ink, found in its depth, alpha and regions.

Not edges of colours but of what is seen (Saito and Takahashi 1990): where alpha ends, the region changes, depth jumps,
and the surface turns sharply. An edge is a ridge of a measure of such change, found to a fraction of a pixel as
Steger (1998) finds lines. Along the ridge its strength is averaged, so that lines are even and what is too short for
one is none. Then it is drawn as a stroke of the width asked for, whatever the amount of change. Nothing is random, and
strengths and places go smoothly with the images, so lines move as what they outline.

Letters: H, W rows and columns of an image, E points of edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, maximum_filter

from svv.errors import BadInput

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]

VIEW = 800
"""Shorter side of the image in whose pixels widths are given; all lengths below are in such pixels."""

WIDTH = 2.0
"""Width of a silhouette unless an edit says otherwise, and"""
INK = (0.06, 0.05, 0.05)
"""its colour."""
WIDEST = 16.0

SIGMA = 1.2
"""Standard deviation over which change is measured,"""
AGAIN = 0.8
"""and of what smooths the measure, so that its ridges are continuous;"""
LEAST = 0.6
"""in pixels of the image itself, neither is less."""

STEP = 0.16
"""Jump in depth, in sides of the box, that counts as much as the end of what is opaque,"""
STEP_PIXELS = 8.0
"""but at least so many pixels at that depth; of rendered fields, depth is noisy by about one."""

WEAK, STRONG = 0.1, 0.3
"""Between these measures of change, see :func:`_silhouettes`, a line's strength goes from 0 to 1."""

FOLD = (1.0, 1.5)
"""Likewise of a crease: the length by which the unit normal changes across it, 1 for 60 degrees, 1.4 for 90."""
FOLD_SIGMA = 3.5
"""Standard deviation over which normals are averaged."""
BAND = 2.0
"""Standard deviation of the band beside silhouettes in which normals are not used: depth mixes two surfaces there."""
THIN = 0.6
"""Width of creases in that of silhouettes."""

OPAQUE = (0.88, 0.985)
"""Between these alphas depth begins to count; in fog it is the depth of nothing in particular."""

EVEN = 4.0
"""Standard deviation along a line over which its strength is averaged; twice this along creases."""
WHOLE = (0.3, 0.55)
"""Between these parts of a line's surroundings along itself that are there, ink goes from 0 to 1; at an end half is."""
STRIDE = 1.5
"""Distance in pixels of the image between places that are averaged."""
TURN = (0.4, 0.8)
"""Cosines of the angle between two neighbours of an edge from which on they are of one line."""

REACH = 2.0
"""How far from an edge the two pixels are looked up that it parts."""

PRESSURE = 0.45
"""Part of a line's width that goes with its strength, as with a pen that is pressed."""

FAINT = 1.0 / 512.0
"""Less ink than half a step of 8 bits is none."""


@dataclass(frozen=True)
class Pen:
    """What a region is outlined with."""

    strength: float
    """How much of the ink is seen, in [0, 1]."""
    width: float
    """Of silhouettes, in pixels of an image whose shorter side has :data:`VIEW`, in (0, :data:`WIDEST`]."""
    colour: tuple[float, float, float]
    """RGB in [0, 1]."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.strength <= 1.0:
            raise BadInput(f"The strength of an outline must lie between 0 and 1, not {self.strength}.")
        if not 0.0 < self.width <= WIDEST:
            raise BadInput(f"An outline must be wider than 0 and at most {WIDEST:g} pixels wide, not {self.width}.")
        if len(self.colour) != 3 or not all(0.0 <= c <= 1.0 for c in self.colour):
            raise BadInput(f"The colour {tuple(self.colour)} is none: give red, green and blue between 0 and 1.")


@dataclass(frozen=True)
class Edges:
    """Points of edges, (E,) each: ``x`` and ``y`` in pixels from the middle of the first, right and down; the unit
    normal ``nx``, ``ny``; ``change``, the measure's height there."""

    x: Floats
    y: Floats
    nx: Floats
    ny: Floats
    change: Floats
    spacing: int = 1
    """Distance of neighbours in pixels, or a little more."""

    def scaled(self, factor: int) -> Edges:
        """The edges of an image ``factor`` times as large."""
        centre = 0.5 * (factor - 1)
        return Edges(self.x * factor + centre, self.y * factor + centre, self.nx, self.ny, self.change, factor)


def outlined(
    rgba: Floats, depth: Floats, region: NDArray[np.int16], pens: Sequence[Pen], footprint: float, box: float
) -> tuple[Floats, Floats, NDArray[np.int16]]:
    """An image with ink over it.

    A line is drawn where one of the two sides of an edge has a pen, with the stronger one, or of equals with that in
    front. Half of a silhouette stands beyond what it outlines: such pixels get that one's depth and region.

    Args:
        rgba: Straight alpha, in [0, 1]. (H, W, 4)
        depth: Distance from the camera in world units, nan where nothing is visible. (H, W)
        region: -1 where nothing is visible. (H, W)
        pens: One for each region.
        footprint: Size of a pixel at distance 1, in world units (1 / focal length in pixels).
        box: Longest side of the scene's box in world units.

    Returns:
        The three images; those that were given where no ink is drawn at all.
    """
    strength = np.array([pen.strength for pen in pens], np.float32)
    visible = region >= 0
    if not strength.any() or not visible.any():
        return rgba, depth, region
    scale = min(region.shape) / VIEW
    reach = scale * (max(pen.width for pen in pens) + 4.0 * FOLD_SIGMA) + 4.0
    part = tuple(_extent(visible.any(axis=1 - axis), int(np.ceil(reach))) for axis in (0, 1))
    rgba, depth, region = rgba.copy(), depth.copy(), region.copy()
    _draw(rgba[part], depth[part], region[part], pens, footprint, box, scale)
    return rgba, depth, region


def _draw(
    rgba: Floats, depth: Floats, region: NDArray[np.int16], pens: Sequence[Pen], footprint: float, box: float,
    scale: float,
) -> None:  # fmt: skip
    """Draw into the images, in place."""
    alpha = np.ascontiguousarray(rgba[..., 3])
    sigma = max(LEAST, SIGMA * scale)
    share = _gauss(alpha, sigma)
    seen = np.where(np.isnan(depth), 0.0, depth).astype(np.float32)
    smooth = _gauss(alpha * seen, sigma) / np.maximum(share, 1e-4)
    edges = _silhouettes(alpha, smooth, share, region, footprint, box, scale)
    whole = _ramp(edges.change, WEAK, STRONG)
    # A translucent shell has as faint a line as it is itself.
    near = maximum_filter(alpha, 2 * int(np.ceil(REACH * scale)) + 1)
    ink = _along(edges, whole, alpha.shape, EVEN * scale) * near[_pixels(edges, alpha.shape)]
    folds, fold_ink = _creases(edges, ink, smooth, share, footprint, scale)
    coverage, source = np.zeros(alpha.size, np.float32), np.full(alpha.size, -1, np.intp)
    for found, strokes, thin in ((edges, ink, 1.0), (folds, fold_ink, THIN)):
        side, owner = _sides(found, depth, region, pens, scale)
        strength, width = (np.array([getattr(pen, name) for pen in pens], np.float32)[owner]
                           for name in ("strength", "width"))  # fmt: skip
        drawn = (side >= 0) & (strokes * strength > FAINT)
        _strokes(_chosen(found, drawn), strokes[drawn], strength[drawn], thin * scale * width[drawn], side[drawn],
                 alpha.shape, coverage, source)  # fmt: skip
    at = np.flatnonzero(coverage > FAINT)
    rows, columns = np.unravel_index(at, alpha.shape)
    of = source[at]
    colours = np.array([pen.colour for pen in pens], np.float32)[region.reshape(-1)[of]]
    amount, below = coverage[at], alpha.reshape(-1)[at]
    above = amount + (1.0 - amount) * below
    mixed = amount[:, None] * colours + ((1.0 - amount) * below)[:, None] * rgba[rows, columns, :3]
    new_depth, new_region = depth.reshape(-1)[of], region.reshape(-1)[of]
    rgba[rows, columns, :3], rgba[rows, columns, 3] = mixed / above[:, None], above
    beyond = region[rows, columns] < 0
    depth[rows[beyond], columns[beyond]] = new_depth[beyond]
    region[rows[beyond], columns[beyond]] = new_region[beyond]


# --- where edges are --------------------------------------------------------------------------------------------------


def _silhouettes(
    alpha: Floats, depth: Floats, share: Floats, region: NDArray[np.int16], footprint: float, box: float, scale: float
) -> Edges:
    """Edges of alpha, regions and depth together, so that where several change there is one line.

    The measure is log(1 + s), s the length of the gradient that a jump of 1 from one region's alpha to another's, or of
    :data:`STEP` in depth, has at its middle. A logarithm, for a high jump would hide the lower ones beside it.
    """
    sigma = max(LEAST, SIGMA * scale)
    square = np.zeros_like(alpha)
    for number in np.unique(region[region >= 0]):
        square += _square(_gauss(np.where(region == number, alpha, np.float32(0.0)), sigma))
    step = np.maximum(STEP * box, STEP_PIXELS * footprint * scale * depth)
    square += _square(depth) * (_ramp(share, *OPAQUE) / np.maximum(step, 1e-30)) ** 2
    change = np.log1p(np.sqrt(square) * (sigma * np.sqrt(2.0 * np.pi)))
    return _ridges(change.astype(np.float32), sigma, max(LEAST, AGAIN * scale), 0.5 * WEAK)


def _creases(
    silhouettes: Edges, ink: Floats, depth: Floats, share: Floats, footprint: float, scale: float
) -> tuple[Edges, Floats]:
    """Edges of the surface's normal, and how much ink each point of them gets. (E,)"""
    sigma = max(2.0 * LEAST, FOLD_SIGMA * scale)
    factor = max(1, int(sigma / 1.5))  # so smooth an image loses nothing by being smaller
    right, down = _gradient(depth)
    toward = footprint * depth
    length = np.sqrt(right**2 + down**2 + toward**2)
    beside = np.zeros_like(depth)
    beside[_pixels(silhouettes, depth.shape)] = ink
    small = [_pooled(image, factor) for image in
             (right / np.maximum(length, 1e-30), down / np.maximum(length, 1e-30), toward / np.maximum(length, 1e-30),
              _ramp(share, *OPAQUE), beside)]  # fmt: skip
    band = BAND * scale / factor
    free = small[3] * np.clip(1.0 - _gauss(small[4], band) * (factor * band * 4.0 * np.sqrt(2.0 * np.pi)), 0.0, 1.0)
    sigma /= factor
    known = _gauss(free, sigma)
    normal = [_gauss(component * free, sigma) / np.maximum(known, 1e-3) for component in small[:3]]
    length = np.maximum(np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2), 1e-3)
    square = np.zeros_like(known)
    for component in normal:
        square += _square(component / length)
    change = np.sqrt(square) * (sigma * np.sqrt(2.0 * np.pi)) * free
    edges = _ridges(change.astype(np.float32), sigma, 0.7 * sigma, 0.6 * FOLD[0])
    there = _ramp(edges.change, *FOLD) * _ramp(known[_pixels(edges, known.shape)], 0.5, 0.8)
    strength = _along(edges, there, known.shape, 2.0 * EVEN * scale / factor)
    return edges.scaled(factor), strength


def _ridges(change: Floats, sigma: float, again: float, least: float) -> Edges:
    """Points where the measure, smoothed by ``again``, is largest along the direction in which it bends most.

    ``change`` of the edges is the height of a Gaussian ridge of standard deviation ``sigma`` that bends as much.
    """
    image = _gauss(change, again)
    rows, columns = (axis + 1 for axis in np.nonzero(image[1:-1, 1:-1] > 0.5 * least))
    around = [[image[rows + i, columns + j] for j in (-1, 0, 1)] for i in (-1, 0, 1)]
    gx, gy = 0.5 * (around[1][2] - around[1][0]), 0.5 * (around[2][1] - around[0][1])
    xx = around[1][2] - 2.0 * around[1][1] + around[1][0]
    yy = around[2][1] - 2.0 * around[1][1] + around[0][1]
    xy = 0.25 * (around[2][2] - around[2][0] - around[0][2] + around[0][0])
    bend = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)  # the smaller eigenvalue of the Hessian
    height = -bend * (sigma**2 + again**2) ** 1.5 / sigma
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi
    nx, ny = np.cos(angle), np.sin(angle)
    along = -(gx * nx + gy * ny) / np.minimum(bend, -1e-12)
    # A little more than half a pixel: a point found twice does no harm, one that is missed is a gap.
    kept = (height > least) & (np.abs(along * nx) <= 0.6) & (np.abs(along * ny) <= 0.6)
    return _chosen(Edges(columns + along * nx, rows + along * ny, nx, ny, height), kept)


def _along(edges: Edges, strength: Floats, shape: tuple[int, ...], even: float) -> Floats:
    """Strength averaged along the lines, whose points follow one another, twice; see :data:`EVEN`. (E,)"""
    count, (height, width) = len(edges.x), shape
    at = np.full((height + 2, width + 2), count, np.intp)
    row, column = _pixels(edges, shape)
    for i, j in ((0, 0), (0, 2), (2, 0), (2, 2), (0, 1), (2, 1), (1, 0), (1, 2), (1, 1)):  # its own pixel last
        at[row + i, column + j] = np.arange(count)
    # One more, which stands for no edge: a line goes straight on there.
    x, y, tx, ty = (np.append(v, 0.0) for v in (edges.x, edges.y, -edges.ny, edges.nx))
    steps = int(np.ceil(2.0 * even / STRIDE))
    weights = np.exp(-0.5 * (np.arange(1, steps + 1) * STRIDE / max(even, 1e-3)) ** 2)
    path: list[tuple[Indices, Any]] = [(np.arange(count), np.ones(count))]
    for sign in (1.0, -1.0):
        px, py, dx, dy, one = x[:-1], y[:-1], sign * tx[:-1], sign * ty[:-1], np.ones(count)
        for weight in weights:
            px, py = px + STRIDE * dx, py + STRIDE * dy
            j = at[np.clip(np.rint(py).astype(np.intp), -1, height) + 1,
                   np.clip(np.rint(px).astype(np.intp), -1, width) + 1]  # fmt: skip
            cosine, hit = tx[j] * dx + ty[j] * dy, j < count
            one = one * np.where(hit, _ramp(np.abs(cosine), *TURN), 1.0)
            turned = np.where(cosine < 0.0, -1.0, 1.0)
            foot = (px - x[j]) * tx[j] + (py - y[j]) * ty[j]
            dx, dy = np.where(hit, turned * tx[j], dx), np.where(hit, turned * ty[j], dy)
            px, py = np.where(hit, x[j] + foot * tx[j], px), np.where(hit, y[j] + foot * ty[j], py)
            path.append((j, weight * one))
    total = 1.0 + 2.0 * weights.sum()
    for _ in range(2):
        known = np.append(strength, 0.0)
        strength = _ramp(sum(known[j] * weight for j, weight in path) / total, *WHOLE)
    return strength.astype(np.float32)


# --- strokes ----------------------------------------------------------------------------------------------------------


def _sides(
    edges: Edges, depth: Floats, region: NDArray[np.int16], pens: Sequence[Pen], scale: float
) -> tuple[Indices, Indices]:
    """The pixel (flat index, -1 where nothing is visible) whose region's pen draws each point, and that region. (E,)"""
    strength = np.append([pen.strength for pen in pens], 0.0)
    best, pixel = np.full(len(edges.x), -1.0), np.full(len(edges.x), -1, np.intp)
    nearest = float(np.nanmin(depth))
    for way in (-1.0, 1.0, 0.0):  # what is thinner than the reach is found at the point itself
        reach = way * max(1.0, REACH * scale)
        at = np.ravel_multi_index(_pixels(edges, region.shape, reach), region.shape)
        distance = np.nan_to_num(depth.reshape(-1)[at], nan=np.inf)
        # Strength first, and of two the same the nearer: a summand below any difference of strengths that is seen.
        worth = strength[region.reshape(-1)[at]] + 1e-3 * nearest / np.maximum(distance, 1e-30)
        better = (region.reshape(-1)[at] >= 0) & (worth > best) & ((way != 0.0) | (pixel < 0))
        best, pixel = np.where(better, worth, best), np.where(better, at, pixel)
    return pixel, np.where(pixel >= 0, region.reshape(-1)[pixel], 0).astype(np.intp)


def _strokes(
    edges: Edges, ink: Floats, strength: Floats, width: Floats, side: Indices, shape: tuple[int, ...],
    coverage: Floats, source: Indices,
) -> None:  # fmt: skip
    """Draw a piece of each edge's tangent, ``width`` pixels wide, into the flat images; the most ink counts."""
    if not len(edges.x):
        return
    width = width * (1.0 - PRESSURE + PRESSURE * ink)
    row, column = _pixels(edges, shape)
    fx, fy = column - edges.x, row - edges.y
    reach = int(np.ceil(0.5 * float(width.max()) + 1.0)) + edges.spacing
    dense, most = ink * strength, np.minimum(width, 1.0)
    end = 0.75 * edges.spacing + 1.0  # whole as far as half way to a neighbour on the diagonal
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            across = np.abs((fx + j) * edges.nx + (fy + i) * edges.ny)
            along = np.abs((fy + i) * edges.nx - (fx + j) * edges.ny)
            cover = np.minimum(0.5 * width + 0.5 - across, most) * np.minimum(end - along, 1.0)
            inside = (cover > 0.0) & (along < end) & (across < 0.5 * width + 0.5)
            inside &= (row + i >= 0) & (row + i < shape[0]) & (column + j >= 0) & (column + j < shape[1])
            at = (row + i)[inside] * shape[1] + (column + j)[inside]
            amount = dense[inside] * cover[inside]
            more = amount > coverage[at]
            coverage[at[more]], source[at[more]] = amount[more], side[inside][more]


# --- helpers ----------------------------------------------------------------------------------------------------------


def _extent(taken: Any, margin: int) -> slice:
    places = np.flatnonzero(taken)
    return slice(max(0, int(places[0]) - margin), int(places[-1]) + 1 + margin)


def _ramp(values: Any, low: float, high: float) -> Any:
    """0 below ``low``, 1 above ``high``, smooth between."""
    t = np.clip((values - low) * (1.0 / (high - low)), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _gauss(image: Floats, sigma: float) -> Floats:
    radius = int(np.ceil(2.7 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    return correlate1d(correlate1d(image, kernel, axis=0, mode="nearest"), kernel, axis=1, mode="nearest")


def _gradient(image: Floats) -> tuple[Floats, Floats]:
    """Change to the right and down by a pixel, (H, W) each; 0 at the image's own edge."""
    right, down = np.zeros_like(image), np.zeros_like(image)
    right[:, 1:-1] = 0.5 * (image[:, 2:] - image[:, :-2])
    down[1:-1] = 0.5 * (image[2:] - image[:-2])
    return right, down


def _square(image: Floats) -> Floats:
    """Squared length of the gradient."""
    right, down = _gradient(image)
    return right * right + down * down


def _pooled(image: Floats, factor: int) -> Floats:
    """Means of ``factor`` x ``factor`` pixels, the last row and column repeated where they lack some."""
    if factor == 1:
        return image
    height, width = image.shape
    image = np.pad(image, ((0, -height % factor), (0, -width % factor)), "edge")
    rows, columns = (size // factor for size in image.shape)
    return image.reshape(rows, factor, columns, factor).mean(axis=(1, 3))


def _pixels(edges: Edges, shape: tuple[int, ...], reach: float = 0.0) -> tuple[Indices, Indices]:
    """Row and column of the pixels in which the points lie, or ``reach`` beside them along the normal."""
    row, column = (np.rint(at + reach * n).astype(np.intp) for at, n in ((edges.y, edges.ny), (edges.x, edges.nx)))
    return np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)


def _chosen(edges: Edges, chosen: NDArray[np.bool_]) -> Edges:
    return Edges(
        edges.x[chosen], edges.y[chosen], edges.nx[chosen], edges.ny[chosen], edges.change[chosen], edges.spacing
    )
