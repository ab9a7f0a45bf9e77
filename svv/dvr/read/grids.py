"""Regular grids: a ``vtkImageData`` with one scalar per point, its NumPy array and its position in the world.

World coordinates are origin + direction matrix * spacing * index. NumPy arrays of volumes are indexed [z, y, x].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkUnsignedCharArray
from vtkmodules.vtkCommonDataModel import vtkDataSet, vtkDataSetAttributes, vtkImageData, vtkRectilinearGrid

from svv.bricks.formats.source import Level, check_finite, native
from svv.dvr.read.appearance import GHOSTS, Appearance, blanked, named, named_text, put, without_duplicates
from svv.dvr.read.gaps import without_gaps
from svv.errors import BadInput

Triple = Sequence[float]

ORTHOGONAL_TOLERANCE = 1e-3
"""Largest cosine of the angle between two axes of a grid that still count as perpendicular."""

OWN_UNIT = "StyleRF Mesh Unit Distance"
"""Field data of a resampled image: the opacity unit distance that ParaView gives the mesh."""

ASSUMED = "StyleRF Assumed"
"""Field data of an image: what was assumed of its file (:func:`assumed_of`)."""

LEAST_NUMBERS = 256
"""Least number of double-precision numbers in the range of a volume's values."""


def as_volume(
    image: vtkImageData, array: str | None = None, name: str = "The volume", cells: bool = False, gaps: bool = True
) -> vtkImageData:
    """Check an image and reduce it to one single-component point scalar array, with its own copy of the values.

    Cell scalars become point scalars at the cells' centres, which keeps every value (averaging at the corners would
    blur thin features); the bounds shrink by half a cell on each side. The array is by default that of the active
    scalars, or the first with one component; ``cells`` chooses that of the cells if points have one of its name, too.
    Blanking, and an appearance that the image carries (:mod:`svv.dvr.read.appearance`), are kept. Voxels of NaN or
    infinities are blanked (:mod:`svv.dvr.read.gaps`), which is added to what was assumed, unless ``gaps`` is False.

    Raises BadInput if there are no scalars, or they have several components or no finite value; there are NaN or
    infinities without ``gaps``; there are fewer than two points along an axis; the spacing is not positive; or the axes
    are not perpendicular.
    """
    image = without_duplicates(image)
    scalars, on_cells = pick_scalars(image, array, name, cells)
    dims = np.array(image.GetDimensions()) - (1 if on_cells else 0)
    if dims.min() < 2:
        size = " x ".join(str(max(d, 0)) for d in dims)
        raise BadInput(f"{name} has {size} voxels; a volume needs at least 2 along each axis.")
    matrix = index_to_world(image)
    _check_geometry(matrix, name)
    result = vtkImageData()
    result.SetDimensions(*(int(d) for d in dims))
    set_geometry(result, matrix[:3, :3], matrix[:3, :3] @ np.full(3, 0.5 * on_cells) + matrix[:3, 3])
    values = _plain(scalars, name)
    if not gaps and values.dtype.kind == "f":
        check_finite(values, name)
    if values.size != dims.prod():
        raise BadInput(f"{name} has {values.size} values for {dims.prod()} voxels; it is damaged.")
    whole, missing, said = without_gaps(values.reshape(dims[::-1]), name)
    put_scalars(result, whole.ravel(), scalars.GetName() or "scalars")
    blank = blanked(image, on_cells, name)
    blank = blank if missing is None else missing if blank is None else blank | missing
    put(result, replace(Appearance.of(image), blank=blank))
    if image.GetFieldData().GetAbstractArray(OWN_UNIT):
        result.GetFieldData().AddArray(image.GetFieldData().GetAbstractArray(OWN_UNIT))
    put_assumed(result, " ".join(filter(None, (assumed_of(image), said))) or None)
    return result


def from_array(
    values: NDArray[np.number],
    spacing: Triple = (1.0, 1.0, 1.0),
    origin: Triple = (0.0, 0.0, 0.0),
    name: str = "scalars",
) -> vtkImageData:
    """Return an image made from an array (nz, ny, nx) of integers, reals or booleans; raise BadInput for any other.

    Spacing and origin, the position of the first voxel, are (x, y, z) in world units.
    """
    if values.ndim != 3:
        raise BadInput(f"A volume needs three axes, but the array's shape is {values.shape}.")
    image = vtkImageData()
    image.SetDimensions(*values.shape[::-1])
    image.SetSpacing(*spacing)
    image.SetOrigin(*origin)
    put_scalars(image, _native(values, "The array").ravel(), name)
    return image


def rectilinear(
    values: NDArray[np.number], planes: Sequence[NDArray[np.float64]], name: str, assumed: str | None = None
) -> vtkRectilinearGrid:
    """Return a grid with a value (nz, ny, nx) where planes along x, y and z cross, which are put in rising order."""
    turned = [slice(None, None, -1 if part[0] > part[-1] else 1) for part in planes]
    grid = vtkRectilinearGrid()
    grid.SetDimensions(*values.shape[::-1])
    puts = (grid.SetXCoordinates, grid.SetYCoordinates, grid.SetZCoordinates)
    for put_places, part, turn in zip(puts, planes, turned):
        put_places(named("planes", part[turn]))
    put_scalars(grid, _native(values[tuple(turned[::-1])], "The array").ravel(), name)
    put_assumed(grid, assumed)
    return grid


def to_array(image: vtkImageData) -> NDArray[np.number]:
    """Return the scalars as an array (nz, ny, nx) that shares the image's memory."""
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(image.GetDimensions()[::-1])


UNNAMED = ("scalars", "Scalars_", "ImageScalars", "MetaImage", "ImageFile", "NIFTI", "NRRD", "DICOMImage")
"""What svv and VTK's readers call the values of files that have no names for them."""


def array_in(image: vtkImageData) -> str | None:
    """Return the name of the scalars, None if their file has no name for them."""
    name = image.GetPointData().GetScalars().GetName()
    return None if name in UNNAMED else name


def check_precision(values: NDArray[np.number]) -> None:
    """Raise BadInput for 64-bit integers that double precision, in which transfer functions are, cannot tell apart."""
    if values.dtype.kind not in "iu" or values.dtype.itemsize < 8:
        return
    low, high = int(values.min()), int(values.max())
    count = (high - low) / float(np.spacing(float(max(abs(low), abs(high)))))
    if low < high and count < min(LEAST_NUMBERS, high - low):
        raise BadInput(
            f"The values run from {low} to {high}, and transfer functions have double precision, which cannot tell "
            f"most of them apart: subtract {low} from the values first."
        )


def index_to_world(image: vtkImageData) -> NDArray[np.float64]:
    """Return the matrix from voxel indices, counted from the first voxel, to world coordinates. (4, 4)"""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(direction_of(image), (3, 3)) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin() + matrix[:3, :3] @ image.GetExtent()[::2]
    return matrix


def direction_of(image: vtkImageData) -> list[float]:
    """Return an image's direction matrix, row by row."""
    matrix = image.GetDirectionMatrix()
    return [matrix.GetElement(i, j) for i in range(3) for j in range(3)]


def grid_numbers(image: vtkImageData) -> dict[str, Sequence[float]]:
    """Return an image's grid as JSON, for another process (:func:`image_on`)."""
    return {
        "extent": image.GetExtent(), "spacing": image.GetSpacing(), "origin": image.GetOrigin(),
        "direction": direction_of(image),
    }  # fmt: skip


def image_on(grid: Mapping[str, Sequence[float]]) -> vtkImageData:
    """Return an image without values on a grid (:func:`grid_numbers`)."""
    image = vtkImageData()
    image.SetExtent([int(end) for end in grid["extent"]])
    image.SetSpacing(grid["spacing"])
    image.SetOrigin(grid["origin"])
    image.SetDirectionMatrix(grid["direction"])
    return image


def own_unit_distance(image: vtkImageData) -> float | None:
    """Return ParaView's default opacity unit distance of the mesh from which an image was resampled; otherwise None.

    It is the diagonal over the cube root of the number of cells (:func:`svv.core.volumes.opacity_code.unit_distance`).
    """
    kept = image.GetFieldData().GetArray(OWN_UNIT)
    return None if kept is None else float(kept.GetValue(0))


def put_own_unit_distance(image: vtkImageData, distance: float) -> None:
    """Let an image carry what :func:`own_unit_distance` returns."""
    image.GetFieldData().AddArray(named(OWN_UNIT, np.array([distance])))


def assumed_of(image: vtkDataSet) -> str | None:
    """Return what was assumed of an image's file, in sentences, such as the size of a voxel; None for nothing."""
    kept = image.GetFieldData().GetAbstractArray(ASSUMED)
    return None if kept is None else str(kept.GetValue(0))


def put_assumed(image: vtkDataSet, said: str | None) -> None:
    """Let an image carry what :func:`assumed_of` returns."""
    image.GetFieldData().RemoveArray(ASSUMED)
    if said is not None:
        image.GetFieldData().AddArray(named_text(ASSUMED, said))


def level_of_image(image: vtkImageData) -> Level:
    """Return the grid of an image as a level."""
    matrix = index_to_world(image)
    x, y, z = image.GetDimensions()
    return Level((z, y, x), matrix[:3, :3], matrix[:3, 3])


def set_geometry(image: vtkImageData, axes: NDArray[np.float64], origin: NDArray[np.float64]) -> None:
    """Set spacing, direction and origin from the steps between voxels (3, 3: one column per index axis)."""
    spacing = np.linalg.norm(axes, axis=0)
    image.SetSpacing(*spacing)
    image.SetDirectionMatrix(*(axes / np.where(spacing > 0, spacing, 1)).ravel())
    image.SetOrigin(*origin)


def pick_scalars(
    image: vtkDataSet, array: str | None, name: str, cells_first: bool = False
) -> tuple[vtkDataArray, bool]:
    """Return the scalar array to show, and whether it belongs to the cells; see :func:`as_volume`."""
    points, cells = image.GetPointData(), image.GetCellData()
    both = sorted(((points, False), (cells, True)), key=lambda pair: pair[1] != cells_first)
    if array is not None:
        for data, on_cells in both:
            if data.GetArray(array):
                return data.GetArray(array), on_cells
        raise BadInput(f"{name} has no array '{array}'; it has {_names(points, cells)}.")
    for data, on_cells in both:
        every = [data.GetArray(i) for i in range(data.GetNumberOfArrays())]
        for candidate in (data.GetScalars(), *every):
            if candidate and candidate.GetNumberOfComponents() == 1 and candidate.GetName() != GHOSTS:
                return candidate, on_cells
    for data in (points, cells):
        if data.GetNumberOfArrays() and data.GetArray(0):
            return data.GetArray(0), data is cells  # rejected later, with the number of its components
    raise BadInput(f"{name} has no scalars; a volume needs one number per voxel.")


def _names(*attributes: vtkDataSetAttributes) -> str:
    names = [str(data.GetArrayName(i)) for data in attributes for i in range(data.GetNumberOfArrays())]
    return ", ".join(names) if names else "none"


def _plain(scalars: vtkDataArray, name: str) -> NDArray[np.number]:
    components = scalars.GetNumberOfComponents()
    if components != 1:
        raise BadInput(
            f"{name}: the array '{scalars.GetName()}' has {components} components per voxel; a volume needs one, "
            "so extract a component or the magnitude first."
        )
    if scalars.GetClassName() == "vtkBitArray":  # packed bits, which NumPy cannot view
        bytes_ = vtkUnsignedCharArray()
        bytes_.DeepCopy(scalars)
        scalars = bytes_
    return _native(vtk_to_numpy(scalars), name)


def _native(values: NDArray[np.number], name: str) -> NDArray[np.number]:
    """Return the values in a type that VTK knows."""
    return np.ascontiguousarray(values, dtype=native(values.dtype, name))


def put_scalars(image: vtkDataSet, values: NDArray[np.number], name: str) -> None:
    """Make a flat array the image's point scalars."""
    image.GetPointData().SetScalars(named(name, values))


def _check_geometry(matrix: NDArray[np.float64], name: str) -> None:
    axes = matrix[:3, :3]
    spacing = np.linalg.norm(axes, axis=0)
    if not np.isfinite(matrix).all() or spacing.min() <= 0:
        numbers = " x ".join(f"{step:g}" for step in spacing)
        raise BadInput(f"{name} has the spacing {numbers}; it must be positive along each axis.")
    cosines = (axes / spacing).T @ (axes / spacing)
    if np.abs(cosines - np.eye(3)).max() > ORTHOGONAL_TOLERANCE:
        raise BadInput(f"{name} has axes that are not perpendicular (a sheared grid); resample it first.")
