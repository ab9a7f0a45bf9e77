"""The stage on which a volume is rendered: cropped to its visible part, centred and scaled to unit size.

VTK's volume mappers lose accuracy with spacings of 1e-9 or 1e6, and the CPU ray caster ignores direction matrices: the
stage has neither, and cameras are transformed to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkRenderingCore import vtkRenderer

from svv.core.differences import above
from svv.core.geometry.cameras import Camera
from svv.dvr.functions.jumps import settled
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.grids import check_precision, from_array, index_to_world, level_of_image, put_scalars, to_array
from svv.errors import BadInput

Array = NDArray[np.float64]

MARGIN = 1
"""Number of voxels kept around the visible cells, whose gradients reach one voxel further."""

SLAB = 16
"""Number of layers of cells that are examined together."""

FAR = 1e4
"""Range of the values, in widths of what a function tells apart, beyond which float32 would not resolve that."""

STEP = 1e-6
"""Width, relative to its values, below which a function is a step: it needs no resolution of its own."""

FINE = 1000.0
"""Largest ratio of small integers to their range at which the GPU ray caster's table tells them apart."""

LEVELS = 4096
"""Range of whole numbers above which they are so close that VTK's ray casters need no reals between them."""

FARTHEST = 1e15
"""Largest value of the stage: the square of its gradient is one in float32, too."""


@dataclass(frozen=True, eq=False)
class Stage:
    """A volume ready to be rendered, and its position in the world.

    stage coordinates = scale * rotation^T (world coordinates - centre)
    """

    image: vtkImageData
    """The volume: cropped, centred at 0, with a longest side of 1, right-handed, without a direction matrix."""
    tf: TransferFunction
    """Transfer function for the values of ``image``."""
    unit_distance: float
    """Opacity unit distance, stage units."""
    rotation: Array
    """Axes of the stage in the world, as columns. (3, 3)"""
    centre: Array
    """Origin of the stage in the world: the centre of the visible part. (3,)"""
    scale: float
    """Stage units per world unit."""
    visible_size: Array
    """Side lengths of the visible box along the volume's own axes, world units. (3,)"""
    gain: float
    """Factor in the equation: value in ``image`` = ``gain`` * (value of the volume - ``origin``)."""
    origin: float
    """Value of the volume that is 0 in ``image``. Subtracted first, it leaves differences of large values accurate."""
    appearance: Appearance
    """How the volume is shown apart from that; indices are those of ``image``, which carries it, too."""
    settled: TransferFunction
    """``tf`` for tables over these values (:mod:`svv.dvr.functions.jumps`)."""

    @property
    def voxel(self) -> float:
        """Size of a voxel in stage units: the cube root of its volume, but at most twice the smallest spacing."""
        spacing = np.array(self.image.GetSpacing())
        return float(min(np.cbrt(spacing.prod()), 2.0 * spacing.min()))

    @property
    def reals(self) -> vtkImageData:
        """``image`` for VTK's ray casters, which would show whole numbers only between those of voxels."""
        values = to_array(self.image)
        if values.dtype.kind == "f" or float(values.max()) - float(values.min()) > LEVELS:
            return self.image
        image = vtkImageData()
        image.ShallowCopy(self.image)
        put_scalars(image, values.astype(np.float32).ravel(), self.image.GetPointData().GetScalars().GetName())
        return image

    def staged(self, values: ArrayLike) -> Array:
        """Return values of the volume as they are in ``image``, in float64."""
        return self.gain * above(np.asarray(values), self.origin)

    def of_volume(self, staged: ArrayLike) -> Array:
        """Return values in ``image`` as they are in the volume."""
        return self.origin + np.asarray(staged, np.float64) / self.gain

    def set_clipping_planes(self, renderer: vtkRenderer) -> None:
        """Place a VTK camera's clipping planes around the volume; rays are sampled in whole steps from the near one."""
        renderer.ResetCameraClippingRange()

    @property
    def bounds(self) -> Array:
        """Axis-aligned world bounds of the visible box: lower and upper corner. (2, 3)"""
        half = 0.5 * np.abs(self.rotation) @ self.visible_size
        return np.stack([self.centre - half, self.centre + half])

    def pose(self, camera: Camera) -> tuple[Array, Array, Array]:
        """Return the position, view direction and view-up of a camera on the stage. (3,) each"""
        turned = self.rotation.T @ camera.camera_to_world[:3, :3]
        return self.scale * self.rotation.T @ (camera.position - self.centre), -turned[:, 2], turned[:, 1]


def set_stage(image: vtkImageData, tf: TransferFunction) -> Stage:
    """Crop a volume (see ``as_volume``) to its visible cells and scale it to unit size.

    The transfer function is one for its values (``TransferFunction.fitted``); without an opacity unit distance, it has
    ParaView's default. Raises BadInput if nothing is visible, or all of that is blanked or cropped away.
    """
    values, shown = to_array(image), Appearance.of(image)
    seen = shown.shown_cells(visible_cells(values, tf))
    return place_part(values, np.zeros(3, np.intp), visible_box(seen, tf), image, tf)


def place_part(
    values: NDArray[np.number],
    at: NDArray[np.intp],
    seen: tuple[NDArray[np.intp], NDArray[np.intp]],
    whole: vtkImageData,
    tf: TransferFunction,
    span: tuple[float, float] | None = None,
) -> Stage:
    """Place a part of a volume on the stage of the whole volume, see :func:`set_stage`.

    The part has the voxels ``values`` (z, y, x), the first one at index ``at`` (x, y, z) of the volume. ``seen`` is the
    box of visible cells: first and last voxel index along x, y, z. ``whole`` has the volume's grid and how it is shown,
    and ``span`` the smallest and largest visible value, by default those of the part.
    """
    matrix, size = index_to_world(whole), np.array(whole.GetDimensions())
    first, last = seen
    start = np.maximum(first - MARGIN, at)
    stop = np.minimum(np.minimum(last + MARGIN, size - 1), at + values.shape[::-1] - 1)
    inside = tuple(slice(a, b + 1) for a, b in zip((start - at)[::-1], (stop - at)[::-1]))
    cropped = values[inside]
    steps = matrix[:3, :3]
    corner = matrix[:3, 3] + steps @ start
    mirrored = bool(np.linalg.det(steps) < 0)
    shown = Appearance.of(whole).part(start, stop, mirrored)
    if mirrored:  # count x from the other end
        cropped, corner = cropped[:, :, ::-1], corner + steps[:, 0] * (stop[0] - start[0])
        steps = steps * (-1.0, 1.0, 1.0)
    spacing = np.linalg.norm(steps, axis=0)
    rotation = steps / spacing
    visible = (last - first) * spacing
    centre = matrix[:3, 3] + matrix[:3, :3] @ (0.5 * (first + last))
    scale = 1.0 / visible.max()
    numbers, gain, zero = _small_type(cropped, tf, span)
    unit_distance = tf.unit_in(level_of_image(whole))
    staged = from_array(numbers, scale * spacing, scale * rotation.T @ (corner - centre))
    put(staged, shown)
    low, high = span or (float(cropped.min()), float(cropped.max()))
    # Before the values are mapped, which rounds them.
    mapped, exact = (one.mapped(gain, 0.0, zero) for one in (tf, settled(tf, high - low)))
    return Stage(staged, mapped, scale * unit_distance, rotation, centre, scale, visible, gain, zero, shown, exact)


def place_whole(image: vtkImageData, tf: TransferFunction) -> Stage:
    """Place all of a volume on the stage, whatever its transfer function shows."""
    first, last = np.zeros(3, np.intp), np.array(image.GetDimensions(), np.intp) - 1
    return place_part(to_array(image), first, (first, last), image, tf)


def visible_cells(
    values: NDArray[np.number], tf: TransferFunction, span: tuple[float, float] | None = None
) -> NDArray[np.bool_]:
    """Return which cells (z, y, x; one fewer than voxels along each axis) have an interpolated value that is seen.

    All values lie in ``span``, by default exactly.
    """
    ranges = tf.visible_ranges(*(span or (float(values.min()), float(values.max()))))
    seen = np.zeros([size - 1 for size in values.shape], dtype=bool)  # (cells z, y, x)
    for first in range(0, len(seen), SLAB):  # never the whole volume at once
        low = high = values[first : first + SLAB + 1]
        for axis in range(3):
            ahead, behind = [slice(None)] * 3, [slice(None)] * 3
            ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
            low = np.minimum(low[tuple(ahead)], low[tuple(behind)])
            high = np.maximum(high[tuple(ahead)], high[tuple(behind)])
        for start, stop in ranges:
            seen[first : first + SLAB] |= (high >= start) & (low <= stop)
    return seen


def visible_box(seen: NDArray[np.bool_], tf: TransferFunction) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the smallest box of voxels that contains every visible cell: first and last index along x, y, z."""
    first, last = np.zeros(3, np.intp), np.zeros(3, np.intp)
    for axis in range(3):
        found = np.flatnonzero(seen.any(axis=tuple(a for a in range(3) if a != 2 - axis)))
        if not found.size:
            raise BadInput(f"'{tf.name}' shows nothing of this volume: it is transparent for all values in it.")
        first[axis], last[axis] = found[0], found[-1] + 1
    return first, last


def _small_type(
    values: NDArray[np.number], tf: TransferFunction, span: tuple[float, float] | None = None
) -> tuple[NDArray[np.number], float, float]:
    """Return the values in a type that both mappers accept, and the gain and origin of the mapping.

    8-bit and 16-bit values stay, unless they differ too little for their size for the GPU's single precision. Others,
    for whose huge, tiny or 64-bit values the mappers overflow, become float32 in [0, 1]; if single values (such as
    1e20) lie so far away that this would not resolve the function, what the function tells apart is mapped to [0, 1].
    """
    low, high = span or (float(values.min()), float(values.max()))
    if values.dtype.itemsize <= 2 and max(abs(low), abs(high)) <= FINE * max(high - low, 1.0):
        return values, 1.0, 0.0
    check_precision(values)
    first, last = tf.varying_range(low, high)
    width = max(last - first, STEP * max(abs(first), abs(last)))
    if high - low <= FAR * width:
        first, width = low, high - low
    gain = 1.0 / width if width > 0 else 1.0
    mapped = np.empty(values.shape, np.float32)
    for slab, out in zip(values, mapped):  # in float64, but never the whole volume at once
        out[...] = np.clip(above(slab, first) * gain, -FARTHEST, FARTHEST)
    return mapped, gain, first
