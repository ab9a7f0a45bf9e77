"""How a display shows a volume, apart from transfer function and light: blanking, cropping, interpolation, scale.

An image carries it along (:func:`put`, :meth:`Appearance.of`): blanked voxels as VTK's ghost array, the rest as field
data. The rules are those of VTK's GPU ray caster, with which ParaView draws.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkDataSetAttributes, vtkImageData

from svv.errors import BadInput

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GHOSTS = vtkDataSetAttributes.GhostArrayName()
"""Name of VTK's array of ghost flags."""

CROP, NEAREST, STRETCH = "StyleRF Crop", "StyleRF Nearest", "StyleRF Stretch"
"""Names of field data."""

NOTHING_LEFT = "The display shows nothing of the volume: what its transfer function shows is blanked or cropped away."


@dataclass(frozen=True, eq=False)
class Appearance:
    """How a volume is shown. Indices are those of its voxels, (x, y, z); arrays of voxels are [z, y, x]."""

    blank: Mask | None = None
    """Which voxels are blanked (see :meth:`hidden_at`). (nz, ny, nx)"""
    crop: Array | None = None
    """The part that is shown: lower and upper corner as voxel indices. (2, 3)"""
    nearest: bool = False
    """Whether a sample has the value of the nearest voxel; otherwise values are interpolated trilinearly."""
    stretch: Array = field(default_factory=lambda: np.ones(3))
    """How much longer than their mean the axes are in the world than in the data; the product is 1. (3,)

    The opacity of a sample is that of its length in the data, as in VTK."""

    @property
    def plain(self) -> bool:
        """Whether the whole volume is shown, interpolated, and scaled alike along all axes."""
        return self.blank is None and self.crop is None and not self.nearest and not self.stretched

    @property
    def stretched(self) -> bool:
        """Whether the axes are scaled differently."""
        return bool(np.abs(self.stretch - 1.0).max() > 1e-6)

    @classmethod
    def of(cls, image: vtkImageData) -> Appearance:
        """Return what an image carries."""
        ghosts = image.GetPointData().GetArray(GHOSTS)
        blank = None if ghosts is None else vtk_to_numpy(ghosts).reshape(image.GetDimensions()[::-1]) != 0
        crop, nearest, stretch = (image.GetFieldData().GetArray(name) for name in (CROP, NEAREST, STRETCH))
        return cls(
            blank,
            None if crop is None else vtk_to_numpy(crop).reshape(2, 3).copy(),
            nearest is not None,
            np.ones(3) if stretch is None else vtk_to_numpy(stretch).copy(),
        )

    def part(self, start: NDArray[np.intp], stop: NDArray[np.intp], mirrored: bool) -> Appearance:
        """Return that of a box of voxels, ``start`` to ``stop`` included, whose x axis may count from the other end."""
        blank, crop = self.blank, self.crop
        if blank is not None:
            blank = blank[tuple(slice(a, b + 1) for a, b in zip(start[::-1], stop[::-1]))]
            blank = blank[:, :, ::-1] if mirrored else blank
        if crop is not None:
            crop = crop - start
            if mirrored:
                crop[:, 0] = stop[0] - start[0] - crop[::-1, 0]
        return Appearance(blank, crop, self.nearest, self.stretch)

    def shown_cells(self, seen: Mask) -> Mask:
        """Return which visible cells (nz - 1, ny - 1, nx - 1) something is left of; raise BadInput if nothing is."""
        left = seen
        if self.blank is not None:
            left = left & ~_wholly_hidden(self.blank)
        if self.crop is not None:
            inside = []
            for axis, count in zip((2, 1, 0), seen.shape):
                cell = np.arange(count)
                inside.append((cell + 1 > self.crop[0, axis]) & (cell < self.crop[1, axis]))
            left = left & (inside[0][:, None, None] & inside[1][:, None] & inside[2])
        if seen.any() and not left.any():
            raise BadInput(NOTHING_LEFT)
        return left

    def hidden_at(self, index: Array) -> Mask:
        """Return whether points (..., 3), as voxel indices, are cropped away or blanked.

        A point is blanked with the voxel nearest to it, and with those that are nearest to it after that along each
        axis: a single blanked voxel hides a cube of one cell around it, and half a cell more on each of its six sides.
        """
        hidden = np.zeros(index.shape[:-1], bool)
        if self.crop is not None:
            hidden |= ((index < self.crop[0]) | (index > self.crop[1])).any(axis=-1)
        if self.blank is not None:
            last = np.array(self.blank.shape[::-1]) - 1
            cell = np.clip(np.floor(index), 0, np.maximum(last - 1, 0)).astype(np.intp)
            after = index - cell >= 0.5  # the nearer end of the cell along each axis
            for axis in range(-1, 3):
                end = cell + np.where(np.arange(3) == axis, ~after, after)
                x, y, z = np.moveaxis(np.minimum(end, last), -1, 0)
                hidden |= self.blank[z, y, x]
        return hidden


def named(name: str, values: NDArray[np.number]) -> vtkDataArray:
    """Return a copy of an array, of tuples if it has two axes, as VTK has it, with a name."""
    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    return array


def named_text(name: str, *words: str) -> vtkStringArray:
    """Return words as VTK has them, with a name."""
    array = vtkStringArray()
    array.SetName(name)
    for word in words:
        array.InsertNextValue(word)
    return array


def put(image: vtkImageData, appearance: Appearance) -> None:
    """Let an image carry how it is shown."""
    image.GetPointData().RemoveArray(GHOSTS)
    if appearance.blank is not None:
        flags = appearance.blank * np.uint8(vtkDataSetAttributes.HIDDENPOINT)
        image.GetPointData().AddArray(named(GHOSTS, flags.ravel()))
    kept: tuple[tuple[str, Array | None], ...] = (
        (CROP, appearance.crop),
        (NEAREST, np.ones(1) if appearance.nearest else None),
        (STRETCH, appearance.stretch if appearance.stretched else None),
    )
    for name, values in kept:
        image.GetFieldData().RemoveArray(name)
        if values is not None:
            image.GetFieldData().AddArray(named(name, np.asarray(values, np.float64).ravel()))


def without_interpolation(image: vtkImageData) -> vtkImageData:
    """Return an image whose voxels are shown as they are (:attr:`Appearance.nearest`); it shares the values."""
    shown = vtkImageData()
    shown.ShallowCopy(image)
    put(shown, replace(Appearance.of(image), nearest=True))
    return shown


def without_duplicates(image: vtkImageData) -> vtkImageData:
    """Return an image without the layers of ghost cells around its own cells, as ParaView draws it."""
    ghosts = image.GetCellData().GetArray(GHOSTS)
    if ghosts is None or not (vtk_to_numpy(ghosts) & vtkDataSetAttributes.DUPLICATECELL).any():
        return image
    own = np.flatnonzero(vtk_to_numpy(ghosts) == 0)
    if not len(own):
        return image
    shape = np.array(image.GetDimensions())[::-1] - 1
    ends = [np.array(np.unravel_index(cell, shape))[::-1] + image.GetExtent()[::2] for cell in (own[0], own[-1])]
    cropped = vtkImageData()
    cropped.ShallowCopy(image)
    cropped.Crop([int(i) for pair in zip(ends[0], ends[1] + 1) for i in pair])
    return cropped


def blanked(image: vtkImageData, on_cells: bool, name: str) -> Mask | None:
    """Return which voxels of an image are blanked by its ghost flags; None if none is. (nz, ny, nx)

    With values on points, a blanked cell blanks the first of its corners, as in VTK's ray caster; with values on cells,
    blanked points raise BadInput.
    """
    points, cells = (
        None if array is None or not vtk_to_numpy(array).any() else vtk_to_numpy(array) != 0
        for array in (image.GetPointData().GetArray(GHOSTS), image.GetCellData().GetArray(GHOSTS))
    )
    x, y, z = image.GetDimensions()
    if on_cells:
        if points is not None:
            raise BadInput(
                f"{name} shows an array of its cells, but has blanked points, which ParaView draws in wrong places: "
                "insert the filter Cell Data To Point Data, and show the array of the points."
            )
        return None if cells is None else cells.reshape(z - 1, y - 1, x - 1)
    if points is None and cells is None:
        return None
    blank = np.zeros((z, y, x), bool) if points is None else points.reshape(z, y, x).copy()
    if cells is not None and min(x, y, z) > 1:
        blank[:-1, :-1, :-1] |= cells.reshape(z - 1, y - 1, x - 1)
    return blank


def _wholly_hidden(blank: Mask) -> Mask:
    """Return of which cells all eight octants are blanked, see :meth:`Appearance.hidden_at`."""

    def corner(*ends: int) -> Mask:
        return blank[tuple(slice(end, size - 1 + end) for end, size in zip(ends, blank.shape))]

    hidden = np.ones([size - 1 for size in blank.shape], bool)
    for a, b, c in product((0, 1), repeat=3):
        hidden &= corner(a, b, c) | corner(1 - a, b, c) | corner(a, 1 - b, c) | corner(a, b, 1 - c)
    return hidden
