"""Which cells of the box hold something visible: from the views' alpha masks, then from the learned density."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import max_pool2d, pad

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.rays.cells import widened
from svv.core.rays.extinction import MOST_LOG_EXTINCTION
from svv.core.volumes.classified import grid_shape
from svv.errors import BadInput
from svv.fields.radiance.hull_kernels import mark_unexplained, summed, visual_hull
from svv.kernels.dispatch import kernels_for, kernels_of
from svv.kernels.types import MOST_SEEN

MASK_SIZE = 256
"""Longest side of the masks the hull is carved from, in pixels: finer masks cost time and carve no better."""

GREATEST_REACH = 0.9
"""How far the box may reach from its centre, as a fraction of the nearest camera's distance."""

SURE_VIEWS, SURE_SHARE = 8, 0.25
"""Views, and share of all, that must contain a cell to be believed where it is empty only for lack of views; half of
the views are enough in small sets. Chance alone leaves nothing that as many views contain."""

LEAST_EXTINCTION_SHARE = 0.05
"""Fraction of a scene's largest extinction above which cells are occupied in any case, however faint the scene is."""

CELLS_AT_A_TIME = 1 << 18
"""Cells whose largest extinction is looked for together, to bound the memory."""

PRUNED = 0.003
"""Optical depth of a training step below which a cell counts as empty, where views alone tell the extinction."""

SHORTEST_STEP = 1.0 / 256.0
"""Step in box units of which that is the optical depth, where steps are shorter: what is faint does not get empty by
being sampled more often."""

FAINTEST = 0.06
"""Extinction in 1 / box unit below which cells of a known volume count as empty: haze that fills the whole box would
have an alpha of 6 %. The volume's grid stores no extinction below 0.05 (``EMPTY_LOG_EXTINCTION``)."""


@dataclass
class Occupancy:
    """Cells of the box; only samples in occupied cells are ever evaluated.

    ``occupied`` is uint8 (X, Y, Z); ``cells`` is the number of cells per box unit.
    """

    box: Box
    cells: int
    occupied: NDArray[np.uint8]
    samples_a_ray: int = 16
    """Buffer size per ray that has sufficed for marching so far; it grows when it does not."""

    def __post_init__(self) -> None:
        self._moved: dict[torch.device, Tensor] = {}
        self._distance: dict[torch.device, Tensor] = {}

    def occupied_on(self, device: torch.device) -> Tensor:
        """Return ``occupied`` on a device. (X, Y, Z) uint8"""
        if device not in self._moved:
            self._moved[device] = torch.tensor(self.occupied, device=device)
        return self._moved[device]

    def distance_on(self, device: torch.device) -> Tensor:
        """Return how far a ray may leap in each octant; see :func:`svv.core.rays.cells.leaps`. (8, X, Y, Z) uint8"""
        if device not in self._distance:
            self._distance[device] = kernels_of(device.type).leaps(self.occupied_on(device))
        return self._distance[device]

    def forget_distances(self) -> None:
        """Free what :meth:`distance_on` keeps, which is eight times as large as the cells."""
        self._distance.clear()

    @property
    def fraction(self) -> float:
        """Fraction of the box's cells that are occupied."""
        return float((self.occupied > 0).mean())

    @classmethod
    def full(cls, box: Box, cells: int) -> Occupancy:
        """Return an occupancy with every cell occupied."""
        return cls(box, cells, np.ones(grid_shape(box, cells), np.uint8))

    def pruned(self, extinction: Tensor, least: float, grow: bool) -> Occupancy:
        """Return the occupancy without the cells in which the extinction never reaches ``least``.

        ``extinction``: the largest one found in each occupied cell, in raster order, on the device that is to do the
        work; ``grow``: whether to keep the neighbours of visible cells as well (while surfaces still move).
        """
        occupied = self.occupied_on(extinction.device)
        visible = torch.zeros_like(occupied, dtype=torch.bool)
        visible[occupied > 0] = extinction >= least
        left = occupied * (widened(visible) if grow else visible)
        result = Occupancy(self.box, self.cells, left.cpu().numpy(), self.samples_a_ray)
        result._moved[left.device] = left
        return result


@dataclass(frozen=True)
class _Masks:
    """What is visible in views, in squares of pixels: summed-area tables, int32. (N, H + 1, W + 1)"""

    tables: NDArray[np.int32] | Tensor
    side: int
    """Pixels along a side of a square."""

    @classmethod
    def of(cls, masks: NDArray[np.bool_] | NDArray[np.uint8] | Tensor) -> _Masks:
        """Shrink masks to at most about MASK_SIZE pixels per side; a pixel is set if any of its parts is."""
        n, h, w = masks.shape
        side = max(1, max(h, w) // MASK_SIZE)
        if isinstance(masks, Tensor):
            shrunk = [max_pool2d((some > 0).float(), side, ceil_mode=True).int() for some in masks.split(8)]
            return cls(pad(torch.cat(shrunk).cumsum(1).cumsum(2), (1, 0, 1, 0)).int(), side)
        tables = np.zeros((n, -(-h // side) + 1, -(-w // side) + 1), np.int32)
        summed(masks.view(np.uint8), side, tables)
        return cls(tables, side)

    @property
    def cut(self) -> bool:
        """Whether a frame cuts off what is visible."""
        t = self.tables
        return bool(
            t[:, 1, -1].any() or t[:, -1, 1].any() or (t[:, -1] > t[:, -2]).any() or (t[..., -1] > t[..., -2]).any()
        )


def carve(masks: NDArray[np.bool_] | NDArray[np.uint8] | Tensor, cameras: Sequence[Camera], cells: int) -> Occupancy:
    """Return the visual hull of the views' masks and the box around it, with ``cells`` along its longest side.

    A view says nothing about points outside its frame, so subjects may extend beyond the frames of some or all views.
    Cells that only few views contain are left out unless these views cannot do without them (:func:`_believed`).

    ``masks`` (N, H, W): pixels in which something is visible, or the alpha of the views; what a GPU holds, it carves,
    if it has kernels for that. BadInput if they have no common hull: every view is empty, or cameras and images do not
    fit.
    """
    small = _Masks.of(masks)
    box = _grown(_first_box(cameras), small, cameras)
    for resolution in (64, 96):
        occupied = _hull(small, cameras, box, resolution)
        filled = np.argwhere(occupied)
        if not len(filled):
            raise BadInput(
                "No point is visible in all views: either the images are empty, or the cameras do not match them; "
                "check the alpha of the images and transform_matrix."
            )
        corners = np.stack([filled.min(0), filled.max(0) + 1]) / resolution
        box = Box.of_bounds(*box.to_world(corners))
    return Occupancy(box, cells, _hull(small, cameras, box, cells))


def pruned_extinction(depth: float, step: float) -> float:
    """Return the extinction below which training prunes cells if a ``step`` in them has less optical depth.

    >>> pruned_extinction(0.003, 1 / 64), pruned_extinction(0.003, 1 / 2048)
    (0.192, 0.768)
    """
    return depth / max(step, SHORTEST_STEP)


def least_extinction(pruned: float, largest: float) -> float:
    """Return the extinction from which a cell counts as occupied, all in 1 / box unit.

    Cells below ``pruned`` would be pruned in training; in a fog whose ``largest`` extinction is not much more, a share
    of that applies.
    """
    return min(pruned, LEAST_EXTINCTION_SHARE * largest)


def largest_in(
    exponent: Callable[[Tensor], Tensor], corner: Tensor, occupancy: Occupancy, corners: bool = False
) -> Tensor:
    """Return the largest extinction in the cells with these indices. (C, 3) -> (C,)

    It is that of 27 points of a cell, or of its ``corners``, which are enough if the exponent is linear between them.
    """
    if len(corner) > CELLS_AT_A_TIME:
        return torch.cat([largest_in(exponent, some, occupancy, corners) for some in corner.split(CELLS_AT_A_TIME)])
    largest = torch.full((len(corner),), -torch.inf, device=corner.device)
    for places in itertools.product(*(_places(axis, corner, occupancy, corners) for axis in range(3))):
        largest = torch.maximum(largest, exponent(torch.stack(places, dim=1)))
    return torch.exp(largest.clamp(max=MOST_LOG_EXTINCTION))


def _places(axis: int, corner: Tensor, occupancy: Occupancy, corners: bool) -> list[Tensor]:
    """Return where the points of cells lie along an axis: 3 or, at ``corners``, 2 times (C,)."""
    first = torch.arange(occupancy.occupied.shape[axis], device=corner.device)
    end = torch.tensor(occupancy.box.extent[axis], dtype=torch.float32, device=corner.device).double()
    middle, found = ((first + 0.5) / occupancy.cells).float(), []
    for offset in (0.0, 1.0) if corners else (0.0, 0.5, 1.0):
        place = torch.minimum((first.double() + offset) / occupancy.cells, end).float()
        # A cell's far corners belong to the next cell, which may not be stored: one float nearer they are in this cell.
        found.append(torch.nextafter(place, middle)[corner[:, axis]])
    return found


def _first_box(cameras: Sequence[Camera]) -> Box:
    """Return a cube that surely contains a subject within the frames, about the point nearest to all lines of sight."""
    rig = CameraRig.of(cameras)
    centre, distance = np.array(rig.centre), rig.radius if rig.radius > 0 else 1.0
    flat = [(c, np.tan(c.fov_x / 2) * max(1.0, c.height / c.width)) for c in cameras if c.span_x is None]
    half = 1.1 * distance * max((tangent for _, tangent in flat), default=0.0)
    # Cameras may be at several distances: the farthest see most.
    farthest = 1.1 * max((np.linalg.norm(c.position - centre) * tangent for c, tangent in flat), default=0.0)
    half = farthest if farthest > 1.01 * half else half  # within rounding, it is the same
    half = max(half, *(0.55 * c.span_x * max(1.0, c.height / c.width) for c in cameras if c.span_x is not None), 0.0)
    return Box.of_bounds(centre - half, centre + half)


def _grown(box: Box, masks: _Masks, cameras: Sequence[Camera]) -> Box:
    """Enlarge a cube, at most up to the nearest camera, while a subject that the frames cut off reaches its faces."""
    centre = box.bounds.mean(axis=0)
    most = GREATEST_REACH * min(float(np.linalg.norm(c.position - centre)) for c in cameras)
    while masks.cut and 0.5 * box.size < most:
        occupied = _hull(masks, cameras, box, 32)
        if not any(occupied.take((0, -1), axis).any() for axis in range(3)):
            break
        half = min(0.75 * box.size, most)
        box = Box.of_bounds(centre - half, centre + half)
    return box


def _hull(masks: _Masks, cameras: Sequence[Camera], box: Box, cells: int) -> NDArray[np.uint8]:
    lenses, side = np.zeros((len(cameras), 4)), masks.side
    for lens, c in zip(lenses, cameras, strict=True):
        column, row = c.principal_point
        focal = c.focal * box.size if c.is_orthographic else c.focal
        lens[:] = focal / side, column / side, row / side, c.is_orthographic
    rotations = np.stack([c.camera_to_world[:3, :3].T for c in cameras])
    positions = box.to_box(np.stack([c.camera_to_world[:3, 3] for c in cameras]))
    reach, shape, tables = float(np.sqrt(0.75) / cells), grid_shape(box, cells), masks.tables
    if isinstance(tables, Tensor):
        there = kernels_for(tables).TOMOGRAPHY
        assert there is not None
        turned, placed, seen = (torch.from_numpy(a).to(tables.device) for a in (rotations, positions, lenses))
        counts = there.visual_hull(tables, (turned, placed, seen), float(cells), reach, shape.tolist()).cpu().numpy()
    else:
        counts = np.zeros(shape, np.uint8)
        visual_hull(tables, rotations, positions, lenses, float(cells), reach, counts)
    return _believed(counts, tables, (rotations, positions, lenses), cells)


def _believed(
    counts: NDArray[np.uint8],
    tables: NDArray[np.int32] | Tensor,
    views: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    cells: int,
) -> NDArray[np.uint8]:
    """Return which cells of a visual hull are believed: those that enough views contain, and what else pixels need.

    What lies outside most frames is left by chance: hardly any view cuts the cones of the few that contain it, although
    nothing need be there. It is kept only where a visible pixel shows none of the cells that enough views contain.
    Arguments are as in :func:`svv.fields.radiance.hull_kernels.mark_unexplained`.
    """
    from scipy.ndimage import binary_dilation, maximum_filter

    number = len(tables)
    enough = min(max(min(SURE_VIEWS, 0.5 * number), SURE_SHARE * number), MOST_SEEN)
    hull, sure = counts > 0, counts >= enough
    if (hull == sure).all():
        return hull.astype(np.uint8)
    marked, there = np.zeros_like(counts), tables.cpu().numpy() if isinstance(tables, Tensor) else tables
    mark_unexplained(there, *views, float(cells), maximum_filter(counts, 3), enough, marked)
    return (hull & (sure | binary_dilation(marked, np.ones((3, 3, 3))))).astype(np.uint8)
