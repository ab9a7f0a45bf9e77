"""Pieces of a volume that is distributed over the ranks of a parallel run; each rank has one, or none.

A rank keeps its piece and one layer of voxels around it, from which gradients at the seams follow. All that depends on
the whole volume (grid, range, visible box) is found by reductions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkDataSetAttributes, vtkImageData

from svv.dvr.parallel.ranks import Ranks
from svv.dvr.read.grids import as_volume, index_to_world, pick_scalars, set_geometry, to_array
from svv.errors import BadInput

Indices = NDArray[np.int64]

NOT_DIVIDED = (
    "The parts of the volume on the ranks do not fit together: they overlap, or leave gaps. Save the volume as a .vti "
    "file, which ParaView divides itself."
)

BLANKED = (
    "The volume has blanked points or cells, which several ranks cannot draw: use one process, or replace what is "
    "blanked by values at which the transfer function is transparent."
)


@dataclass(frozen=True, eq=False)
class Piece:
    """One rank's piece of a volume, and what the rank knows about the whole. Indices are those of the volume's voxels.

    Its own cells lie between the voxels ``own[0]`` and ``own[1]``; together, the ranks' own cells are the volume.
    """

    values: NDArray[np.number]
    """Voxels of the piece, with those of the neighbours around it; empty if the rank has none. (z, y, x)"""
    at: Indices
    """Index (x, y, z) of the first of them. (3,)"""
    own: Indices
    """First and last voxel of the own cells. (2, 3)"""
    whole: vtkImageData
    """An image with the grid of the whole volume, and without values."""
    span: tuple[float, float]
    """Smallest and largest value of the volume."""

    @property
    def exists(self) -> bool:
        """Whether this rank has a piece."""
        return self.values.size > 0


def take_piece(ranks: Ranks, data: vtkImageData | None, array: str | None, cells: bool = False) -> Piece:
    """Return a rank's piece of a volume with ghost voxels from its neighbours; all ranks must call it.

    ``data`` is the rank's part as ParaView divided it, whose ghost cells are removed first, or an empty image or None;
    if each rank has the whole volume, it is divided here. See :func:`svv.dvr.read.grids.as_volume` for array and cells.
    Raises BadInput if something is blanked, the parts do not fit together, or that function rejects one.
    """
    mine = ranks.together(lambda: _own_part(data, array, cells))
    image, on_cells = mine if mine is not None else (vtkImageData(), False)
    extents = ranks.everyones(np.array([*image.GetExtent(), on_cells], np.float64)).astype(np.int64)
    there = _has_cells(extents)
    if not there.any():
        raise BadInput("The input is empty; apply the filter or reader before this one first.")
    if there.all() and (extents == extents[0]).all():
        image.Crop(ranks.part_of(extents[0, :6].tolist()))
        extents = ranks.everyones(np.array([*image.GetExtent(), on_cells], np.float64)).astype(np.int64)
        there = _has_cells(extents)
    on_cells = bool(extents[there, 6].any())
    low, high = extents[there, 0:6:2], extents[there, 1:6:2]
    first, last = low.min(axis=0), high.max(axis=0)
    if (high - low).prod(axis=1).sum() != (last - first).prod():
        raise BadInput(NOT_DIVIDED)
    wider = _with_ghosts(ranks, image, 2 if on_cells else 1)
    volume = ranks.together(lambda: as_volume(wider, gaps=False) if there[ranks.number] else None)
    size = last - first + (0 if on_cells else 1)
    # Cells become voxels at their centres: the last own cell and its next neighbour are connected by an own cell.
    own = np.stack([extents[ranks.number, 0:6:2], extents[ranks.number, 1:6:2]]) - first
    own = np.minimum(own, size - 1)
    at = np.array(wider.GetExtent()[::2], np.int64) - first
    kind = next(filter(None, ranks.texts(str(to_array(volume).dtype) if volume is not None else "")))
    values = to_array(volume) if volume is not None else np.zeros((0, 0, 0), kind)
    ends = ranks.everyones(np.array([values.min(), values.max()] if values.size else [np.inf, -np.inf], np.float64))
    span = float(ends[:, 0].min()), float(ends[:, 1].max())
    return Piece(values, at, own, _whole_grid(ranks, volume, at, size), span)


def _has_cells(extents: Indices) -> NDArray[np.bool_]:
    """Return which extents contain cells. (N, 6 or more) -> (N,)"""
    return np.asarray((extents[:, 1:6:2] > extents[:, 0:6:2]).all(axis=1))


def _own_part(data: vtkImageData | None, array: str | None, cells: bool) -> tuple[vtkImageData, bool] | None:
    """Return a part without ghost cells and with one array only, and whether that is on cells; None if it is empty."""
    if data is None or min(data.GetDimensions()) < 2:
        return None
    if data.HasAnyBlankPoints() or data.HasAnyBlankCells():
        raise BadInput(BLANKED)
    scalars, on_cells = pick_scalars(data, array, "The input", cells)
    image = vtkImageData()
    image.CopyStructure(data)
    image.GetPointData().Initialize()  # blanking would be copied, too
    (image.GetCellData() if on_cells else image.GetPointData()).SetScalars(scalars)
    ghosts = data.GetCellGhostArray()
    if ghosts is not None:
        shape = np.array(data.GetDimensions())[::-1] - 1
        own = np.argwhere((vtk_to_numpy(ghosts) & vtkDataSetAttributes.DUPLICATECELL).reshape(shape) == 0)[:, ::-1]
        if not len(own):
            return None
        corner = np.array(data.GetExtent()[::2])
        low, high = corner + own.min(axis=0), corner + own.max(axis=0) + 1
        image.Crop([int(i) for pair in zip(low, high) for i in pair])
    return image, on_cells


def _with_ghosts(ranks: Ranks, image: vtkImageData, layers: int) -> vtkImageData:
    """Return an image with layers of the neighbours' voxels around it."""
    from vtkmodules.vtkFiltersParallelDIY2 import vtkGhostCellsGenerator  # only VTK with MPI needs it

    generator = vtkGhostCellsGenerator()
    generator.SetController(ranks.controller)
    generator.SetInputData(image)
    generator.SetNumberOfGhostLayers(layers)
    generator.UpdatePiece(ranks.number, ranks.count, layers)
    result = generator.GetOutput()
    for data in (result.GetPointData(), result.GetCellData()):
        data.RemoveArray(vtkDataSetAttributes.GhostArrayName())
    return result


def _whole_grid(ranks: Ranks, volume: vtkImageData | None, at: Indices, size: Indices) -> vtkImageData:
    """Return an image with the grid of the whole volume: that of the first rank with a piece."""
    mine = np.full((4, 4), np.nan)
    if volume is not None:
        mine = index_to_world(volume)
        mine[:3, 3] -= mine[:3, :3] @ at
    everyones = ranks.everyones(mine)
    matrix = everyones[np.flatnonzero(np.isfinite(everyones).all(axis=(1, 2)))[0]]
    whole = vtkImageData()
    whole.SetDimensions(*(int(n) for n in size))
    set_geometry(whole, matrix[:3, :3], matrix[:3, 3])
    return whole
