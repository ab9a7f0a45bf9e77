"""Strokes that move with the matter on which they lie, from one time step of a volume to another.

Every point of a stroke is carried to where its matter is now, and set on the surface that has the value which it had
when it was laid: optical flow tells little of what slides along a smooth surface, but strokes never leave it.
Letters: K points of strokes, N strokes. Lengths are in box units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.box import Box
from svv.core.strokes.strokes import Strokes
from svv.core.volumes.classified import ValueGrid

Points = NDArray[np.float64]

Places = Callable[[Points], Points]
"""Positions (K, 3) -> positions (K, 3)."""

ROUNDS, DAMPED = 16, 0.8
"""Iterations in which a displacement is inverted, and how far each one goes."""

SMOOTHED = 2
"""How often the displacements of a stroke's points are averaged along it."""

LANDINGS, FARTHEST = 6, 1.5
"""Newton steps to a surface, and the longest way there, in widths of a stroke."""


@dataclass(frozen=True, eq=False)
class Field:
    """Values and their gradients at positions in a box."""

    values: NDArray[np.float32]
    """On the vertices of a grid. (X, Y, Z)"""
    cells: float
    """Cells of the grid per box unit."""
    origin: Points
    """Box coordinates of its first vertex. (3,)"""

    @classmethod
    def of(cls, grid: ValueGrid, over: Box, box: Box) -> Field:
        """Return the field of a grid of values over one box, at coordinates of another one."""
        return cls(grid.values(), grid.cells * box.size / over.size, box.to_box(np.asarray([over.low]))[0])

    def at(self, place: Points) -> Points:
        """Return values at box coordinates. (K, 3) -> (K,)"""
        from scipy.ndimage import map_coordinates

        index = (place - self.origin).T * self.cells
        return np.asarray(map_coordinates(self.values, index, order=1, mode="nearest"), np.float64)

    def slope(self, place: Points) -> Points:
        """Return gradients, per box unit, by differences over two cells. (K, 3) -> (K, 3)"""
        away = np.eye(3) / self.cells
        found = [self.at(place + axis) - self.at(place - axis) for axis in away]
        return np.stack(found, axis=1) * (0.5 * self.cells)


@dataclass(frozen=True, eq=False)
class Laid:
    """Strokes as they were laid, and what leads from there to other time steps."""

    strokes: Strokes
    matter: Points
    """Where the matter under their points was in the painted step. (K, 3)"""
    value: Points
    """Value of the surface on which each point was laid. (K,)"""
    slope: Points
    """Gradient of the values there. (K, 3)"""

    @classmethod
    def on(cls, strokes: Strokes, field: Field, backward: Places = lambda place: place) -> Laid:
        """Return strokes that are laid on a field, whose matter ``backward`` leads to the painted step."""
        where = strokes.where.astype(np.float64)
        return cls(strokes, backward(where), field.at(where), field.slope(where))


def advected(laid: Laid, field: Field, backward: Places) -> tuple[Strokes, Points]:
    """Return strokes where their matter is now, and how far each point is from a surface of its value. (K,)

    ``field``: the values of now; ``backward``: where the matter at places of now was in the painted step.
    """
    strokes, start = laid.strokes, laid.strokes.where.astype(np.float64)
    place, missed = _inverse(backward, laid.matter, start)
    for _ in range(SMOOTHED):  # a brush is stiff: what moves single points apart is noise of the flow
        place = start + along_strokes(place - start, strokes)
    place = place + along_strokes(landed(place, laid.value, field, strokes.unit) - place, strokes)
    slope = field.slope(place)
    left = np.abs(laid.value - field.at(place)) / np.maximum(np.linalg.norm(slope, axis=1), 1e-3)
    normal = _turned(strokes, laid.slope, slope)
    return replace(strokes, where=place.astype(np.float32), normal=normal), np.maximum(left, missed)


def landed(place: Points, value: Points, field: Field, width: float) -> Points:
    """Return the nearest places with given values (K,), at most :data:`FARTHEST` widths from places (K, 3). (K, 3)"""
    found = place.copy()
    for _ in range(LANDINGS):
        slope = field.slope(found)
        steep = np.maximum((slope * slope).sum(1), 1e-6)
        found += ((value - field.at(found)) / steep)[:, None] * slope
        away = found - place
        far = np.linalg.norm(away, axis=1, keepdims=True)
        found = place + away * np.minimum(1.0, FARTHEST * width / np.maximum(far, 1e-12))
    return found


def along_strokes(values: Points, strokes: Strokes) -> Points:
    """Return values of points averaged with their neighbours on the stroke, by weights 1, 2, 1. (K, 3)"""
    index = np.arange(len(values))
    first, last = strokes.start[:-1][strokes.stroke], strokes.start[1:][strokes.stroke] - 1
    return np.asarray(
        0.25 * values[np.maximum(index - 1, first)] + 0.5 * values + 0.25 * values[np.minimum(index + 1, last)]
    )


def _inverse(backward: Places, wanted: Points, start: Points) -> tuple[Points, Points]:
    """Return where a displacement takes matter, and by how much that misses, (K, 3) and (K,)."""
    place = start.copy()
    for _ in range(ROUNDS):
        place -= DAMPED * (backward(place) - wanted)
    return place, np.linalg.norm(backward(place) - wanted, axis=1)


def _turned(strokes: Strokes, then: Points, now: Points) -> NDArray[np.float32]:
    """Return the strokes' normals, turned as the gradients (K, 3) under them have turned. (K, 3)"""
    normal = strokes.normal.astype(np.float64)
    then, now = unit(then), unit(now)
    # Rodrigues' rotation that takes one gradient to the other.
    axis, cosine = np.cross(then, now), (then * now).sum(1, keepdims=True)
    turned = cosine * normal + np.cross(axis, normal)
    turned += axis * (axis * normal).sum(1, keepdims=True) / np.maximum(1.0 + cosine, 1e-3)
    known = (np.linalg.norm(then, axis=1) > 0.5) & (np.linalg.norm(now, axis=1) > 0.5) & (cosine[:, 0] > -0.99)
    return np.asarray(unit(np.where(known[:, None], turned, normal)), np.float32)


def unit(vectors: Points) -> Points:
    """Return vectors at length 1; those of hardly any length become 0. (K, 3)"""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), 0.0))
