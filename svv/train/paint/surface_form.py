"""The form of what is visible: smooth normals, and the direction of strokes.

The gradient of the blurred opacity gives normals, its second derivatives the principal curvatures. Strokes run along
the weaker one, as a painter's do along a limb; where a surface is flat or equally round, horizontally.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from svv.fields.radiance.networks import BaseField
from svv.fields.radiance.occupancy import Occupancy
from svv.measure import usable_cpus
from svv.train.paint.grid_kernels import interpolate

Floats = NDArray[np.float32]

BLUR = 2.0
"""Standard deviation of the opacity's blur, in cells of the grid: strokes do not follow finer relief."""

SPREAD = 3.0
"""Standard deviation, in cells, over which directions are averaged."""

CELLS = 128
"""Number of cells of the grid along the longest side, at most that of the occupancy."""

WIDER = 6.0
"""Standard deviation, in cells, of the blur that distinguishes ridges from hollows."""

UPRIGHT = 0.15
"""Weight of the horizontal relative to the direction of a tube (1): it decides where a surface is flat or round."""

SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Entries of a symmetric 3 x 3 matrix that are stored."""


@dataclass(frozen=True)
class Form:
    """Normals and directions on a grid over the box, looked up trilinearly."""

    cells: int
    """Number of grid cells per box unit."""
    gradient: Floats
    """Gradient of the blurred opacity. (3, X, Y, Z)"""
    filled: Floats
    """Blurred opacity of the wider surroundings: lower on ridges, higher in hollows. (X, Y, Z)"""
    up: NDArray[np.float64]
    """The world's up direction in the box. (3,)"""

    @cached_property
    def axes(self) -> Floats:
        """Averaged outer products of the directions of weakest curvature, with a trace of at most 1. (6, X, Y, Z)"""
        return stroke_axes(self.gradient, SPREAD * max(self.cells / CELLS, 0.5))

    def normals(self, position: Floats) -> Floats:
        """Return the outward unit normals at box coordinates. (S, 3)"""
        return self._facing(position).astype(np.float32)

    def _facing(self, position: Floats) -> NDArray[np.float64]:
        gradient = np.empty((len(position), 3), np.float32)
        interpolate(self.gradient, np.asarray(position, np.float64) * self.cells - 0.5, gradient)
        return _unit(-gradient.astype(np.float64))

    def frames(self, position: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the frames that strokes follow at box coordinates (S, 3).

        Outward unit normals (S, 3); unit tangents along the strokes, of either sign (S, 3); and how distinct these are:
        0 where the surface is flat or equally round in all directions, 1 on a straight tube (S,).
        """
        normal, look = self._facing(position), np.empty((len(position), 6), np.float32)
        interpolate(self.axes, np.asarray(position, np.float64) * self.cells - 0.5, look)
        right, upward = tangents(normal, self.up)
        matrix = np.empty((len(normal), 3, 3))
        for value, (i, j) in zip(look.T, SIX, strict=True):
            matrix[:, i, j] = matrix[:, j, i] = value
        # In the tangent plane this is a 2 x 2 matrix, whose larger eigenvector has a closed form.
        a = np.einsum("si,sij,sj->s", right, matrix, right)
        b = np.einsum("si,sij,sj->s", right, matrix, upward)
        d = np.einsum("si,sij,sj->s", upward, matrix, upward)
        decided = np.hypot(a - d, 2.0 * b)
        angle = 0.5 * np.arctan2(2.0 * b, a - d + UPRIGHT)  # if undecided: along the horizontal, as in most pictures
        tangent = np.cos(angle)[:, None] * right + np.sin(angle)[:, None] * upward
        return normal.astype(np.float32), tangent.astype(np.float32), np.minimum(decided, 1.0).astype(np.float32)

    def hollowness(self, position: Floats) -> Floats:
        """Return how much around box coordinates (S, 3) is filled, 1/2 on a plane (Pottmann et al. 2007). (S,)"""
        at = np.asarray(position, np.float64).T * self.cells - 0.5
        return np.asarray(map_coordinates(self.filled, at, order=1, mode="nearest"), np.float32)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (S, 3) at length 1; those of length 0 become (0, 0, 1)."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), (0.0, 0.0, 1.0)))


def tangents(normal: NDArray[np.float64], up: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return right and up, both (S, 3), as seen by a viewer facing surfaces with outward unit normals (S, 3)."""
    side = np.eye(3)[int(np.abs(up).argmin())]
    upward = up - (normal @ up)[:, None] * normal
    flat = np.linalg.norm(upward, axis=1, keepdims=True)
    other = side - (normal @ side)[:, None] * normal
    # Seen from straight above, there is no up: any direction will do if it is the same at all points.
    upward = upward + np.clip(0.2 - flat, 0.0, None) * 5.0 * other
    upward /= np.maximum(np.linalg.norm(upward, axis=1, keepdims=True), 1e-12)
    return np.cross(upward, normal), upward


def in_cubes(points: NDArray[np.floating], side: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first of points (S, 3) in each cube of side ``side``, and the number of each point's cube. (S,)"""
    cells = int(np.ceil(1.0 / side)) + 1
    cube = np.clip((points / side).astype(np.int64), 0, cells - 1)
    flat = np.ravel_multi_index(tuple(cube.T), (cells,) * 3)
    _, first, number = np.unique(flat, return_index=True, return_inverse=True)
    return first, number.reshape(-1)


def slots_of(points: NDArray[np.floating], side: float) -> NDArray[np.int32]:
    """Return the number of the point (S, 3) in each cube of side ``side``, -1 for none. (X, Y, Z)"""
    cells = int(np.ceil(1.0 / side)) + 1
    slot = np.full((cells, cells, cells), -1, np.int32)
    slot[tuple(np.clip((points / side).astype(np.int64), 0, cells - 1).T)] = np.arange(len(points))
    return slot


@torch.no_grad()
def opacity_grid(base: BaseField, occupancy: Occupancy, cells: int) -> Floats:
    """Return the opacity of grid cells along one of their sides, 1 - exp(-sigma / cells), 0 if unoccupied. (X, Y, Z)

    ``cells`` must divide the number of cells of the occupancy.
    """
    k = occupancy.cells // cells
    full = occupancy.occupied > 0
    corner = np.argwhere(full)
    points = torch.from_numpy(((corner + 0.5) / occupancy.cells).astype(np.float32))
    device = base.encoding.table.device
    parts = []
    for piece in points.split(1 << 18):
        piece = piece.to(device)
        if base.density is not None:
            exponent = base.density.look_up(piece).sum(dim=1)
        else:
            assert base.density_mlp is not None
            exponent = base.density_mlp(base.encoding(piece))[:, 0]
        parts.append((1.0 - torch.exp(-torch.exp(exponent.clamp(max=15.0)) / cells)).cpu().numpy())
    shape = [-(-n // k) for n in full.shape]
    out = np.zeros(shape, np.float32)
    np.add.at(out, tuple((corner // k).T), np.concatenate(parts) / k**3 if parts else 0.0)
    return out


def form_of(base: BaseField, occupancy: Occupancy, up: NDArray[np.float64] | tuple[float, float, float]) -> Form:
    """Return the form of a scene's extinction; ``up`` is the world's up direction (box and world share their axes)."""
    cells = grid_cells(occupancy)
    return form_of_opacity(opacity_grid(base, occupancy, cells), cells, up)


def grid_cells(occupancy: Occupancy) -> int:
    """Return the number of cells per box unit of the form's grid: at most :data:`CELLS` if possible."""
    cells = occupancy.cells
    while cells > CELLS and cells % 2 == 0:
        cells //= 2
    return cells


def form_of_opacity(opacity: Floats, cells: int, up: NDArray[np.float64] | tuple[float, float, float]) -> Form:
    """Return the form of the opacity of grid cells (X, Y, Z), with ``cells`` cells per box unit."""
    scale = cells / CELLS
    spreads = [width * max(scale, 0.5) for width in (BLUR, WIDER)]
    blur = partial(gaussian_filter, opacity, mode="constant")  # nothing is beyond the box
    with ThreadPoolExecutor(usable_cpus()) as pool:
        field, filled = pool.map(blur, spreads)
    gradient = np.stack(np.gradient(field)).astype(np.float32)
    return Form(cells, gradient, np.asarray(filled, np.float32), np.asarray(up, np.float64))


def stroke_axes(gradient: Floats, spread: float) -> Floats:
    """Return weakest-curvature directions of level surfaces as averaged outer products: (3, X, Y, Z) -> (6, X, Y, Z).

    The shape operator is P H P / |g|: gradient g, second derivatives H, tangent plane P (Kindlmann et al. 2003, eq. 5).
    """
    length = np.sqrt(np.square(gradient).sum(0))
    where = length > 0.02 * float(length.max() or 1.0)
    size = length[where].astype(np.float64)
    n = gradient[:, where] / np.maximum(size, 1e-12)
    second = np.stack([derivative[where] for row in gradient for derivative in np.gradient(row)]).reshape(3, 3, -1)
    along, across = (t.T for t in tangents(n.T, np.array((0.0, 0.0, 1.0))))
    bent_along, bent_across = ((second * t).sum(1) / np.maximum(size, 1e-12) for t in (along, across))
    shear = 0.5 * ((bent_along * across).sum(0) + (bent_across * along).sum(0))
    mean, half = (0.5 * ((bent_along * along).sum(0) + sign * (bent_across * across).sum(0)) for sign in (1.0, -1.0))
    span = np.hypot(half, shear)
    weak, strong = np.abs(np.abs(mean) - span), np.abs(mean) + span
    decided = (strong - weak) / np.maximum(strong + weak, 1e-9) * np.minimum(strong * 40.0, 1.0)
    # Half of this angle leads from ``along`` to the larger of mean + span and mean - span: the weaker where mean < 0.
    turn = 0.5 * np.arctan2(shear, half) + np.where(mean < 0.0, 0.0, 0.5 * np.pi)
    axis = np.cos(turn) * along + np.sin(turn) * across

    def blurred(values: NDArray[np.floating]) -> Floats:
        entry = np.zeros(where.shape, np.float32)
        entry[where] = values
        return gaussian_filter(entry, spread)

    with ThreadPoolExecutor(usable_cpus()) as pool:
        total, *six = pool.map(blurred, [length[where], *(decided * axis[i] * axis[j] * size for i, j in SIX)])
    return np.stack(six) / np.maximum(total, 1e-9 * float(total.max() or 1.0) + 1e-30)
