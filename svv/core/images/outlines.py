"""Outlines: silhouettes and creases in an image of a scene, drawn over it in ink.

:mod:`svv.core.images.edges` finds them. Each point of an edge is drawn as a short stroke of the requested width,
whatever changes there and by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.images.edges import PARTED_REACH, VIEW, Edges, Floats, Indices, PixelSize, lines_of, pixels_of
from svv.errors import BadInput

WIDEST = 16.0
"""Largest width of an outline, in pixels of an image whose shorter side has :data:`VIEW`."""

CREASE_WIDTH = 0.6
"""Width of creases relative to silhouettes."""

PRESSURE_SHARE = 0.45
"""Fraction of a line's width that varies with its strength, as with a pressed pen."""

LEAST_COVERAGE = 1.0 / 512.0
"""Half an 8-bit step; ink that covers no more than this is not drawn."""


@dataclass(frozen=True)
class Pen:
    """How a region is outlined."""

    strength: float
    """Opacity of the ink, in [0, 1]."""
    width: float
    """Width of silhouettes in pixels of an image whose shorter side has :data:`VIEW`, in (0, :data:`WIDEST`]."""
    colour: Sequence[float]
    """Colour of the ink, RGB in [0, 1]."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.strength <= 1.0:
            raise BadInput(f"The strength of an outline must lie between 0 and 1, not {self.strength}.")
        if not 0.0 < self.width <= WIDEST:
            raise BadInput(f"An outline must be wider than 0 and at most {WIDEST:g} pixels wide, not {self.width}.")
        if len(self.colour) != 3 or not all(0.0 <= c <= 1.0 for c in self.colour):
            raise BadInput(f"{tuple(self.colour)} is not a colour: give red, green and blue between 0 and 1.")


def outlined(
    rgba: Floats, depth: Floats, region: NDArray[np.int16], pens: Sequence[Pen], pixel_at: PixelSize, box: float
) -> tuple[Floats, Floats, NDArray[np.int16]]:
    """Return an image, its depth and regions with ink outlines over them; as they are if no ink is drawn at all.

    A line is drawn if either side of an edge has a pen: the stronger pen, or of two equal ones that of the side in
    front. Half of a silhouette lies outside the shape that it outlines; there, pixels get its depth and region.

    ``rgba``: straight alpha, in [0, 1] (H, W, 4); the others are as for :func:`svv.core.images.edges.lines_of`, with
    one pen for each region.
    """
    strength = np.array([pen.strength for pen in pens], np.float32)
    visible = region >= 0
    if not strength.any() or not visible.any():
        return rgba, depth, region
    scale = min(region.shape) / VIEW
    reach = scale * (WIDEST + 8.0) + 4.0  # how far ink and smoothing extend
    part = tuple(_extent(np.asarray(visible.any(axis=1 - axis)), int(np.ceil(reach))) for axis in (0, 1))
    rgba, depth, region = rgba.copy(), depth.copy(), region.copy()
    _draw(rgba[part], depth[part], region[part], pens, pixel_at, box, scale)
    return rgba, depth, region


def _draw(
    rgba: Floats, depth: Floats, region: NDArray[np.int16], pens: Sequence[Pen], pixel_at: PixelSize, box: float,
    scale: float,
) -> None:  # fmt: skip
    """Draw into the images in place."""
    alpha = np.ascontiguousarray(rgba[..., 3])
    silhouettes, creases = lines_of(alpha, depth, region, pixel_at, box, scale)
    coverage, source = np.zeros(alpha.size, np.float32), np.full(alpha.size, -1, np.intp)
    for found, strokes, thin in ((*silhouettes, 1.0), (*creases, CREASE_WIDTH)):
        side, owner = _sides(found, depth, region, pens, scale)
        strength, width = (np.array([getattr(pen, name) for pen in pens], np.float32)[owner]
                           for name in ("strength", "width"))  # fmt: skip
        drawn = (side >= 0) & (strokes * strength > LEAST_COVERAGE)
        _strokes(found.chosen(drawn), strokes[drawn], strength[drawn], thin * scale * width[drawn], side[drawn],
                 alpha.shape, coverage, source)  # fmt: skip
    at = np.flatnonzero(coverage > LEAST_COVERAGE)
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


def _sides(
    edges: Edges, depth: Floats, region: NDArray[np.int16], pens: Sequence[Pen], scale: float
) -> tuple[Indices, Indices]:
    """Return the pixel (flat index, -1 for none) whose region's pen draws each point, and that region. (E,)"""
    strength = np.append([pen.strength for pen in pens], 0.0)
    best, pixel = np.full(len(edges.x), -1.0), np.full(len(edges.x), -1, np.intp)
    nearest = float(np.nanmin(depth))
    for way in (-1.0, 1.0, 0.0):  # shapes thinner than the reach are found at the point itself
        reach = way * max(1.0, PARTED_REACH * scale)
        at = np.ravel_multi_index(pixels_of(edges, region.shape, reach), region.shape)
        distance = np.nan_to_num(depth.reshape(-1)[at], nan=np.inf)
        # Compare by strength first and then by nearness, whose term is smaller than any visible difference in strength.
        worth = strength[region.reshape(-1)[at]] + 1e-3 * nearest / np.maximum(distance, 1e-30)
        better = (region.reshape(-1)[at] >= 0) & (worth > best) & ((way != 0.0) | (pixel < 0))
        best, pixel = np.where(better, worth, best), np.where(better, at, pixel)
    return pixel, np.where(pixel >= 0, region.reshape(-1)[pixel], 0).astype(np.intp)


def _strokes(
    edges: Edges, ink: Floats, strength: Floats, width: Floats, side: Indices, shape: tuple[int, ...],
    coverage: Floats, source: Indices,
) -> None:  # fmt: skip
    """Draw a piece of each edge's tangent, ``width`` pixels wide, into the flat images; the most ink wins."""
    if not len(edges.x):
        return
    width = width * (1.0 - PRESSURE_SHARE + PRESSURE_SHARE * ink)
    row, column = pixels_of(edges, shape)
    fx, fy = column - edges.x, row - edges.y
    reach = int(np.ceil(0.5 * float(width.max()) + 1.0)) + edges.spacing
    dense, most = ink * strength, np.minimum(width, 1.0)
    end = 0.75 * edges.spacing + 1.0  # full strength up to half the distance to a diagonal neighbour
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


def _extent(taken: NDArray[np.bool_], margin: int) -> slice:
    places = np.flatnonzero(taken)
    return slice(max(0, int(places[0]) - margin), int(places[-1]) + 1 + margin)
