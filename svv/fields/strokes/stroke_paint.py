"""Paint of brush strokes, evaluated at positions of a scene."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.strokes.strokes import NOISE, Brush, Floats, Strokes
from svv.fields.strokes.stroke_tables import bins_of, cells_near, tables_of
from svv.kernels.numba import strokes as numba_strokes
from svv.kernels.types import StrokeTables

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

MOST_BINS = 160
"""Maximum number of bins along the box: four million in all."""

ROOM = 1.2
"""How much wider edges may become before they need other bins: a camera that comes closer has all its widths."""

CPU = torch.device("cpu")

BARE = 0.98
"""Coverage below which the ground shows."""

GROUND = 0.85
"""Brightness of bare ground relative to the nearest stroke: the gaps between strokes are a little darker."""


def shared_width(width: float) -> float:
    """Return a width of pixels rounded to a 32nd of a power of two: views from about as far away share their bins.

    >>> shared_width(0.0101) == shared_width(0.0102), round(shared_width(0.0101), 5)
    (True, 0.01013)
    """
    return float(2.0 ** (round(np.log2(width) * 32.0) / 32.0))


class Bins:
    """The points whose paint may reach into each bin of a grid, for paint of any width up to ``soft``.

    ``around`` (K, 16): :func:`svv.kernels.numba.strokes.surroundings`, ``narrow`` edges; ``radius``: the median of all.
    """

    def __init__(self, around: Floats, radius: float, narrow: float) -> None:
        self.soft = ROOM * narrow
        # In wide pixels every point reaches far: finer bins would list it a thousand times.
        side = max(radius, 0.5 * self.soft, 1.0 / MOST_BINS)
        self.size = max(int(np.ceil(1.0 / side)), 1)
        self._around, self._wider = around, 2.0 * (self.soft - narrow)
        self._there: dict[torch.device, tuple[Tensor, Tensor]] = {}

    def suit(self, soft: float) -> bool:
        """Return whether they serve edges of another width about as well as bins of their own would."""
        return soft <= self.soft <= ROOM**2 * soft

    def on(self, device: torch.device) -> tuple[Tensor, Tensor]:
        """Return the first entry of each bin (size^3 + 1,) and the points (B,), made when they are first asked for."""
        if device not in self._there:
            if device.type == "cpu":
                start, points = numba_strokes.sort_into_bins(self._around, self._wider, self.size)
                self._there[device] = torch.from_numpy(start), torch.from_numpy(points)
            else:
                self._there[device] = bins_of(self._around, self._wider, self.size, device)
        return self._there[device]


class StrokePaint:
    """The paint of one region, everywhere: where no stroke reaches, the ground shows.

    ``soft``: width of soft edges in box units, the cell or pixel in which the paint is shown; ``like``: paint of the
    same strokes with edges of another width, whose bins are used again if they suit.
    """

    def __init__(self, strokes: Strokes, brush: Brush, soft: float, like: StrokePaint | None = None) -> None:
        self.strokes, self.brush, self.soft = strokes, brush, float(soft)
        self.around = numba_strokes.surroundings(
            strokes.where, strokes.normal, strokes.frames[0], strokes.frames[2], strokes.radius, strokes.inner,
            strokes.outer, self.soft,
        )  # fmt: skip
        if like is not None and like.strokes is strokes and like.bins.suit(self.soft):
            self.bins: Bins = like.bins
        else:
            self.bins = Bins(self.around, float(np.median(strokes.radius)), self.soft)
        """Shared with the paint of other colours and of similar widths."""
        self._there: dict[torch.device, StrokeTables] = {}

    def on(self, device: torch.device) -> StrokeTables:
        """Return the strokes as the kernels of a GPU take them, made when they are first asked for."""
        if device not in self._there:
            bins = self.bins.size, *self.bins.on(device)
            widths, ground = (self.soft, self.reach), (GROUND, BARE)
            self._there[device] = tables_of(self.strokes, self.brush, self.around, bins, widths, ground, device)
        return self._there[device]

    @cached_property
    def reach(self) -> float:
        """How far from the strokes' points there is paint, in box units."""
        strokes = self.strokes
        return max(2.0 * float(np.median(strokes.radius)), float(np.quantile(strokes.outer, 0.9)))

    def is_near(self, place: Floats) -> NDArray[np.bool_]:
        """Return whether each of the places (V, 3) is within reach of the strokes. (V,)"""
        cells, grid = cells_near(self.strokes.where, self.reach)
        return grid[tuple((place * cells).astype(np.int64).clip(0, cells).T)]

    def with_strokes(self, strokes: Strokes, brush: Brush) -> StrokePaint:
        """Return the paint of strokes and a brush that differ only in their colours."""
        other = copy.copy(self)
        other.strokes, other.brush, other._there = strokes, brush, {}
        return other

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self.strokes.where)

    def coverage(self, position: Floats) -> Floats:
        """Return colour times coverage, and coverage, at box coordinates (P, 3). (P, 4)"""
        strokes, brush = self.strokes, self.brush
        out = np.empty((len(position), 4), np.float32)
        size, (start, points) = self.bins.size, self.bins.on(CPU)
        tangent, arc, _, widen = strokes.frames
        look = np.array([brush.relief, brush.dry, brush.mixed, brush.rim, brush.body, brush.grain, brush.tooth,
                         brush.flow, brush.feather, brush.blunt])  # fmt: skip
        numba_strokes.paint(
            np.ascontiguousarray(position, np.float32), 1.0 / size, size, start.numpy(), points.numpy(), NOISE,
            self.around, strokes.normal, tangent, arc, widen, strokes.radius, strokes.inner, strokes.outer,
            strokes.stroke, strokes.length, strokes.colour, strokes.second, strokes.bristles, strokes.seed,
            look, np.array(brush.light), np.array(brush.paper), strokes.unit, self.soft, out,
        )  # fmt: skip
        return out

    def __call__(self, position: Floats) -> Floats:
        """Return the colours at box coordinates (P, 3). (P, 3)"""
        found = self.coverage(position)
        colours, bare = found[:, :3], np.flatnonzero(found[:, 3] < BARE)
        if len(bare):
            colours[bare] += (1.0 - found[bare, 3:]) * self.ground(position[bare])
        return np.asarray(colours, np.float32)

    def over_ground(self, position: Floats) -> Floats:
        """Return colour times coverage, and coverage, of strokes and of the ground among them. (P, 4)"""
        found = self.coverage(position)
        bare = np.flatnonzero((found[:, 3] < BARE) & self.is_near(position))
        if len(bare):
            found[bare, :3] += (1.0 - found[bare, 3:]) * self.ground(position[bare])
            found[bare, 3] = 1.0
        return found

    def ground(self, position: Floats) -> Floats:
        """Return the colour of the ground at box coordinates: the brush's, or the nearest stroke's, darker. (P, 3)"""
        if self.brush.ground is not None:
            return np.tile(np.array(self.brush.ground, np.float32), (len(position), 1))
        nearest: NDArray[np.int64] = self._tree.query(position, workers=-1)[1]
        return np.asarray(GROUND * self.strokes.colour[self.strokes.stroke[nearest]], np.float32)
