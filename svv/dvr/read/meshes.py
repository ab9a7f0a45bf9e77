"""Grids that are no images, resampled to one: unstructured, curvilinear, AMR and hyper tree grids, and blocks of them.

Points of the image outside the cells are blanked (:mod:`svv.dvr.read.appearance`), so that nothing is drawn there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray
from vtkmodules.vtkCommonDataModel import (
    VTK_VOXEL,
    vtkCompositeDataSet,
    vtkDataObject,
    vtkDataSet,
    vtkDataSetAttributes,
    vtkGenericCell,
    vtkHyperTreeGrid,
    vtkImageData,
    vtkPolyData,
    vtkUniformGridAMR,
    vtkUnstructuredGrid,
)
from vtkmodules.vtkFiltersCore import vtkProbeFilter, vtkThreshold
from vtkmodules.vtkFiltersExtraction import vtkExtractCellsByType
from vtkmodules.vtkFiltersHyperTree import vtkHyperTreeGridToUnstructuredGrid

from svv.dvr.read.appearance import GHOSTS, named
from svv.dvr.read.grids import check_precision, pick_scalars, put_own_unit_distance, put_scalars
from svv.errors import BadInput
from svv.io.files.memory import memory_there

FINER = 8
"""Factor of the number of points if the edges of a mesh are inside the image: they are as sharp as the points are."""

LEAST_POINTS, MOST_POINTS = 96**3, 512**3
"""Least number of points in that case, and largest number in any."""

BYTES_A_POINT = 40
"""Memory that resampling and drawing take."""

INSIDE = 1e-6
"""Part of each side by which the image is smaller, because points on the faces of a mesh may be found outside."""


def is_mesh(data: object) -> TypeGuard[vtkDataObject]:
    """Return whether a data object is a grid, or blocks of grids, that must be resampled before it is drawn."""
    kinds = (vtkDataSet, vtkCompositeDataSet, vtkHyperTreeGrid)
    return isinstance(data, kinds) and not isinstance(data, vtkImageData)


def resampled(
    data: vtkDataObject,
    array: str | None = None,
    cells: bool = False,
    along: int | None = None,
    name: str = "The input",
) -> vtkImageData:
    """Return a mesh (:func:`is_mesh`) as an image with one scalar per point.

    Values of points are interpolated within the cells, as ParaView draws them; a value of a cell is that of every point
    in it. Where blocks overlap, the finest level of an AMR grid counts. The array is chosen in the first block as by
    :func:`svv.dvr.read.grids.pick_scalars`. ``along`` is the number of points along the longest side: by default, the
    image has as many points as the mesh has values, more if it has edges in the image, or the spacing of the finest
    level, as far as memory reaches.

    Raises BadInput if the mesh has no cells that fill space, or no such array, or the image would not fit into memory.
    """
    blocks = _arrays_of(data, array, cells, name)
    chosen, on_cells = str(blocks[0][1].GetName()), blocks[0][2]
    alike = [block for block, found, where in blocks if found.GetName() == chosen and where == on_cells]
    parts = [part for block in alike if (part := _only(block, chosen, on_cells)).GetNumberOfCells()]
    if not parts:
        raise BadInput(f"{name} has blanked cells only: there is nothing to show.")
    image, values, known = _sampled(parts, chosen, on_cells, along, name)
    values, known = _with_edges(image, values, known, parts, chosen)
    if not known.any():
        raise BadInput(f"{name} is resampled to points of which none lies in its cells: ask for more points.")
    put_scalars(image, values.ravel(), chosen)
    if not known.all():
        flags = np.where(known, 0, vtkDataSetAttributes.HIDDENPOINT).astype(np.uint8).ravel()
        image.GetPointData().AddArray(named(GHOSTS, flags))
    sides = np.array(image.GetSpacing()) * (np.array(image.GetDimensions()) - 1)
    count = sum(part.GetNumberOfCells() for part in parts)
    put_own_unit_distance(image, float(np.linalg.norm(sides) / np.cbrt(count)))
    return image


def describe_resampling(data: vtkDataObject, image: vtkImageData) -> str:
    """Return a sentence that says to how many points a mesh was resampled."""
    size = " x ".join(map(str, image.GetDimensions()))
    return f"The input, a {data.GetClassName()}, was resampled to {size} points."


def _blocks(data: vtkDataObject) -> Iterator[vtkDataSet]:
    """Yield the grids of a mesh that have cells, those of the finest level first."""
    if isinstance(data, vtkDataSet):
        if data.GetNumberOfCells():
            yield data
    elif isinstance(data, vtkHyperTreeGrid):
        leaves = vtkHyperTreeGridToUnstructuredGrid()
        leaves.SetInputData(data)
        leaves.Update()
        yield from _blocks(leaves.GetOutput())
    elif isinstance(data, vtkCompositeDataSet):
        iterator, found = data.NewIterator(), []
        iterator.InitTraversal()
        while not iterator.IsDoneWithTraversal():
            level = iterator.GetCurrentLevel() if isinstance(data, vtkUniformGridAMR) else 0
            found.append((level, iterator.GetCurrentDataObject()))
            iterator.GoToNextItem()
        for _, block in sorted(found, key=lambda one: -one[0]):
            yield from _blocks(block)


def _arrays_of(
    data: vtkDataObject, array: str | None, cells: bool, name: str
) -> list[tuple[vtkDataSet, vtkDataArray, bool]]:
    """Return the grids of a mesh that fill space and have an array, with it and whether it is on cells."""
    every = list(_blocks(data))
    solid = [_solid(block) for block in every if _fills_space(block)]
    refusal = f"{name} is a {data.GetClassName()} without cells, and a volume needs some."
    if every:
        refusal = (
            f"{name} is a {data.GetClassName()} of points, lines or surfaces, which fill no space: insert Delaunay 3D, "
            "or Point Volume Interpolator for particles."
        )
    found = []
    for block in solid:
        try:
            found.append((block, *pick_scalars(block, array, name, cells)))
        except BadInput as error:  # others may have it
            refusal = str(error)
    if not found:
        raise BadInput(refusal)
    return found


def _fills_space(block: vtkDataSet) -> bool:
    """Return whether a grid has cells of three dimensions."""
    if isinstance(block, vtkPolyData):
        return False
    if not isinstance(block, vtkUnstructuredGrid):
        return block.GetNumberOfCells() > 0 and int(block.GetMaxCellSize()) >= 8
    return any(_dimension(kind) == 3 for kind in _kinds(block))


def _kinds(block: vtkUnstructuredGrid) -> list[int]:
    """Return the types of a grid's cells, each once."""
    return vtk_to_numpy(block.GetDistinctCellTypesArray()).tolist()


def _dimension(kind: int) -> int:
    """Return the number of dimensions of a type of cells."""
    cell = vtkGenericCell()
    cell.SetCellType(kind)
    return int(cell.GetCellDimension())


def _solid(block: vtkDataSet) -> vtkDataSet:
    """Return a grid without its points, lines and surfaces, which ParaView's volumes do not show."""
    if not isinstance(block, vtkUnstructuredGrid):
        return block
    kinds = _kinds(block)
    cells = [kind for kind in kinds if _dimension(kind) == 3]
    if len(cells) == len(kinds):
        return block
    extract = vtkExtractCellsByType()
    extract.SetInputData(block)
    for kind in cells:
        extract.AddCellType(kind)
    extract.Update()
    return extract.GetOutput()


def _only(block: vtkDataSet, name: str, on_cells: bool) -> vtkDataSet:
    """Return a grid with one array, of real numbers if it is interpolated, and without its hidden cells."""
    part = block.NewInstance()
    part.CopyStructure(block)
    data, given = (part.GetCellData(), block.GetCellData()) if on_cells else (part.GetPointData(), block.GetPointData())
    array = given.GetArray(name)
    if array.GetNumberOfComponents() != 1:
        raise BadInput(
            f"The array '{name}' has {array.GetNumberOfComponents()} components per voxel; a volume needs one, so "
            "extract a component or the magnitude first."
        )
    values = vtk_to_numpy(array)
    check_precision(values)
    if not on_cells and values.dtype.kind in "iu":
        array = named(name, values.astype(np.float64))
    data.SetScalars(array)
    hidden = _hidden_cells(block)
    return part if hidden is None else _without(part, hidden, name)


def _without(part: vtkDataSet, hidden: NDArray[np.bool_], name: str) -> vtkDataSet:
    """Return a grid without its hidden cells, which VTK's probe does not know."""
    flags = named("StyleRF Hidden", hidden.astype(np.uint8))
    part.GetCellData().AddArray(flags)
    left = vtkThreshold()
    left.SetInputData(part)
    left.SetInputArrayToProcess(0, 0, 0, vtkDataObject.FIELD_ASSOCIATION_CELLS, flags.GetName())
    left.SetThresholdFunction(vtkThreshold.THRESHOLD_LOWER)
    left.SetLowerThreshold(0.5)
    left.Update()
    shown = left.GetOutput()
    for data in (shown.GetPointData(), shown.GetCellData()):
        data.SetActiveScalars(name if data.HasArray(name) else None)
    return shown


def _hidden_cells(block: vtkDataSet) -> NDArray[np.bool_] | None:
    """Return which cells are blanked, or have a blanked point in a grid of rows; None if there is no such flag. (C,)"""
    cells, points = block.GetCellGhostArray(), block.GetPointGhostArray()
    hidden = np.zeros(block.GetNumberOfCells(), bool)
    if cells is not None:
        hidden |= (vtk_to_numpy(cells) & vtkDataSetAttributes.HIDDENCELL) > 0
    size = [0, 0, 0]
    if points is not None and hasattr(block, "GetDimensions"):
        block.GetDimensions(size)
    if math.prod(size) == block.GetNumberOfPoints():  # points of an explicit structured grid may lie in no such rows
        blank = ((vtk_to_numpy(points) & vtkDataSetAttributes.HIDDENPOINT) > 0).reshape(size[::-1])
        for ends in product((slice(1, None), slice(None, -1)), repeat=3):
            hidden |= blank[ends].ravel()
    return hidden if hidden.any() else None


def _sampled(
    parts: list[vtkDataSet], array: str, on_cells: bool, along: int | None, name: str
) -> tuple[vtkImageData, NDArray[np.number], NDArray[np.bool_]]:
    """Return an image over grids, its values, and which of its points lie in a cell. (Z, Y, X) both

    As many points as the mesh has values leave those of a box as they are, and their gradients smooth. The edges of any
    other mesh, and those of cells that differ in their values, need finer steps.
    """
    bounds = np.array([part.GetBounds() for part in parts]).reshape(-1, 3, 2)
    low, high = bounds[:, :, 0].min(axis=0), bounds[:, :, 1].max(axis=0)
    sides = high - low
    if not (np.isfinite(sides).all() and sides.min() > 0):
        raise BadInput(f"{name} is flat: a volume needs cells with an extent along x, y and z.")
    most = min(MOST_POINTS, memory_there() // 2 // BYTES_A_POINT)
    count = sum(part.GetNumberOfCells() if on_cells else part.GetNumberOfPoints() for part in parts)
    finest = [step for part in parts if (step := _finest(part, on_cells))]
    levels = len(finest) == len(parts)  # of an AMR or hyper tree grid
    centred = on_cells and levels
    if along is not None:
        step = float(sides.max()) / (along - (0 if centred else 1))
    elif levels:
        step = max(min(finest), _step(sides, most))
    else:
        step = _step(sides, min(count, most))
    image = _image_over(low, sides, step, centred, (name, most))
    values, known = _values_at(image, parts, array)
    edges = not known.all() and not all(isinstance(part, vtkImageData) for part in parts)
    if along is None and (edges or (on_cells and not levels)):
        wanted = np.clip(FINER * count / max(known.mean(), 0.01), LEAST_POINTS, most)
        image = _image_over(low, sides, _step(sides, wanted), False, (name, most))
        values, known = _values_at(image, parts, array)
    return image, values, known


def _finest(part: vtkDataSet, on_cells: bool) -> float | None:
    """Return the smallest spacing of an image, or side of cells with values of which all are voxels; otherwise None."""
    if isinstance(part, vtkImageData):
        return float(min(part.GetSpacing()))
    if not (on_cells and isinstance(part, vtkUnstructuredGrid)):
        return None
    if _kinds(part) != [VTK_VOXEL]:
        return None
    ends = vtk_to_numpy(part.GetCells().GetConnectivityArray()).reshape(-1, 8)[:, [0, 7]]
    return float(np.diff(vtk_to_numpy(part.GetPoints().GetData())[ends], axis=1).min()) or None


def _step(sides: NDArray[np.float64], count: float) -> float:
    """Return the distance of about so many points on a grid that covers a box with these sides."""
    least, most = float(sides.min()) / count, float(sides.max())
    for _ in range(60):
        step = math.sqrt(least * most)
        least, most = (step, most) if (sides / step + 1.0).prod() > count else (least, step)
    return most


def _image_over(
    low: NDArray[np.float64], sides: NDArray[np.float64], step: float, centred: bool, told: tuple[str, int]
) -> vtkImageData:
    """Return an image without values over a box, or over its cells' centres; ``told`` is name and most points."""
    if centred:
        shrunk = np.minimum(step, 0.5 * sides)
        low, sides = low + 0.5 * shrunk, sides - shrunk
    size = np.maximum(np.rint(sides / step).astype(int) + 1, 2)
    if size.prod(dtype=float) > 1.1 * told[1]:
        raise BadInput(
            f"{told[0]} would be resampled to {' x '.join(map(str, size))} points, more than fit into memory: ask for "
            "fewer along the longest side."
        )
    image = vtkImageData()
    image.SetDimensions(*size.tolist())
    image.SetOrigin(*(low + INSIDE * sides))
    image.SetSpacing(*((1 - 2 * INSIDE) * sides / (size - 1)))
    return image


def _values_at(
    image: vtkImageData, parts: list[vtkDataSet], name: str
) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """Return the values at the points of an image, and which of them lie in a cell. (Z, Y, X) both"""
    shape = image.GetDimensions()[::-1]
    arrays = [part.GetPointData().GetScalars() or part.GetCellData().GetScalars() for part in parts]
    kind = np.result_type(*(vtk_to_numpy(array).dtype for array in arrays))
    values, known = np.zeros(shape, kind), np.zeros(shape, bool)
    origin, spacing = np.array(image.GetOrigin()), np.array(image.GetSpacing())
    for part in parts:
        ends = np.array(part.GetBounds()).reshape(3, 2)
        start = np.clip(np.floor((ends[:, 0] - origin) / spacing).astype(int), 0, np.array(shape[::-1]) - 1)
        stop = np.clip(np.ceil((ends[:, 1] - origin) / spacing).astype(int), start, np.array(shape[::-1]) - 1)
        there = tuple(slice(a, b + 1) for a, b in zip(start[::-1], stop[::-1]))
        if known[there].all():
            continue
        box = vtkImageData()
        box.SetDimensions(*(stop - start + 1).tolist())
        box.SetOrigin(*(origin + start * spacing))
        box.SetSpacing(*spacing)
        probe = vtkProbeFilter()
        probe.SetInputData(box)
        probe.SetSourceData(part)
        probe.Update()
        found = probe.GetOutput().GetPointData()
        new = vtk_to_numpy(found.GetArray(probe.GetValidPointMaskArrayName())).reshape(known[there].shape) > 0
        new &= ~known[there]
        values[there][new] = vtk_to_numpy(found.GetArray(name)).reshape(new.shape)[new]
        known[there] |= new
    return values, known


def _with_edges(
    image: vtkImageData, values: NDArray[np.number], known: NDArray[np.bool_], parts: list[vtkDataSet], name: str
) -> tuple[NDArray[np.number], NDArray[np.bool_]]:
    """Return values that reach beyond the edges of a mesh, and at which points to show the image. (Z, Y, X) both

    Those cells of the image are drawn, by corners that are not blanked, whose centres lie in the mesh: its edges lie
    neither too far inside nor outside. Corners beyond have the mean value of such centres; all other points get the
    smallest value, so that the range of the values stays.
    """
    if known.all():
        return values, known
    spacing = np.array(image.GetSpacing())
    middles = vtkImageData()
    middles.SetDimensions(*(size - 1 for size in image.GetDimensions()))
    middles.SetOrigin(*(np.array(image.GetOrigin()) + 0.5 * spacing))
    middles.SetSpacing(*spacing)
    found, inside = _values_at(middles, parts, name)
    if not inside.any():
        return values, inside
    total, count = np.zeros(values.shape), np.zeros(values.shape, np.uint8)
    for ends in product((slice(1, None), slice(None, -1)), repeat=3):
        total[ends] += np.where(inside, found, 0.0)
        count[ends] += inside
    values[~known] = (values[known] if known.any() else found[inside]).min()
    beyond = (count > 0) & ~known
    values[beyond] = (total[beyond] / count[beyond]).astype(values.dtype)
    return values, count > 0
