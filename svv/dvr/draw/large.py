"""Volumes that are drawn brick by brick, whether or not they fit into memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike, NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.bricks.formats.axes import Choice
from svv.bricks.formats.source import ArraySource, Level, Source, WithoutValues, check_finite
from svv.bricks.opened import open_bricks
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.casters import CpuMapper, Pixels, choose_mapper
from svv.dvr.draw.frame import STEP, Stage
from svv.dvr.draw.tables import light
from svv.dvr.functions.jumps import settled
from svv.dvr.functions.transfer_functions import TransferFunction, unit_distance_for
from svv.dvr.read.appearance import Appearance, without_interpolation
from svv.dvr.read.grids import from_array, level_of_image, own_unit_distance, set_geometry, to_array
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput, Progress, silent
from svv.io.files.memory import memory_there
from svv.measure import usable_cpus

if TYPE_CHECKING:
    from svv.bricks.caster import BrickCaster

ENTRIES = 1 << 14
"""Number of entries of the table of colours and opacities."""

MOST_ENTRIES, TRIED, UNRESOLVED = 1 << 20, 4096, 0.01
"""Most entries; number of voxels whose colours and opacities decide how many are needed; and the error, as a fraction
of the opacity, above which there are too few."""


def entries_for(tf: TransferFunction, low: float, high: float, voxels: NDArray[np.number]) -> int:
    """Return how many entries a table from ``low`` to ``high`` needs to show voxels as the function does.

    More are needed if the function varies at both ends of a wide range, such as on a logarithmic scale.
    """
    entries, span = ENTRIES, high - low
    tried = voxels.ravel()[:: max(1, voxels.size // TRIED)].astype(np.float64)
    tried = tried[(tried >= low) & (tried <= high)]
    exact = light(tf, tried)
    while span > 0.0 and exact.any() and entries < MOST_ENTRIES:
        step = span / (entries - 1)
        error = np.abs(light(tf, low + np.rint((tried - low) / step) * step) - exact)
        if error.mean() <= UNRESOLVED * exact[:, 3].mean():
            break
        entries *= 4
    return entries


VTK_BYTES = 5
"""Bytes per voxel that VTK's ray casters need besides three copies of the values: normals, and tables of blocks."""

REAL_BYTES = 4
"""Least number of bytes of a value in the last copy, see :data:`svv.dvr.draw.frame.LEVELS`."""

OVERVIEW = 512
"""Maximum number of voxels along the longest side of the level from which the visible part and the training's
classified volume are found."""

OVERVIEW_BYTES = 300_000_000
"""Maximum size of the same level in bytes."""

MOST_WIDTHS = 100.0
"""Range of the values, in widths of what a function tells apart, beyond which tables of VTK do not resolve that."""

WANTED, COARSEST = 0.5, 1.0
"""Largest side of the drawn level's voxels, in pixels: where the level fits into memory, and otherwise. Means of voxels
lose what is thinner than they are: against 2 x 2 rays per pixel of the finest level, a volume of thin tubes has 32 dB
with voxels of one pixel, 38 with voxels of half a pixel, and 41 with a ray per pixel of the finest level itself."""

FAINT = 0.5 / 255.0
"""Opacity that 8 bits show as none."""

BRICK_BYTES = 2.2
"""Bytes per voxel in memory besides its value: its normal, and what bricks share at their borders."""


class LargeVolume:
    """A volume of which bricks are read when they are needed, into so many bytes of memory.

    ``overview`` is the volume itself, if it is small and in memory anyway. Voxels that are shown without interpolation
    (``nearest``) must be voxels at coarser levels, too.
    """

    def __init__(
        self,
        source: Source,
        memory: int,
        name: str = "The volume",
        overview: vtkImageData | None = None,
        nearest: bool = False,
    ) -> None:
        self.source, self.memory, self.name, self.nearest = source, memory, name, nearest
        if overview is not None:
            self.overview = overview

    @property
    def whole(self) -> Level:
        """The finest level."""
        return self.source.levels[0]

    @cached_property
    def overview(self) -> vtkImageData:
        """The finest level that is small enough, as an image."""
        sizes = [
            (max(level.shape), int(np.prod(level.shape)) * self.source.dtype.itemsize) for level in self.source.levels
        ]
        small = [k for k, (side, size) in enumerate(sizes) if side <= OVERVIEW and size <= OVERVIEW_BYTES]
        number = small[0] if small else len(sizes) - 1
        level = self.source.levels[number]
        values = np.empty(level.shape, self.source.dtype)
        for z in range(0, level.shape[0], 32):
            stop = min(z + 32, level.shape[0])
            values[z:stop] = self.source.read(number, (z, 0, 0), (stop, *level.shape[1:]))
        check_finite(values, self.name)
        image = from_array(values, name=self.name)
        set_geometry(image, level.axes, level.origin)
        return without_interpolation(image) if self.nearest else image

    @cached_property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value; of the overview's if the file has its own levels and no record of the range."""
        from svv.bricks.pyramid import PyramidSource

        if isinstance(self.source, PyramidSource):
            return self.source.range
        values = to_array(self.overview)
        return float(values.min()), float(values.max())

    @property
    def is_range_known(self) -> bool:
        """Whether no value lies outside of :attr:`range`."""
        from svv.bricks.pyramid import PyramidSource

        return isinstance(self.source, PyramidSource) or self.overview.GetDimensions() == self.whole.shape[::-1]

    def level_for(self, camera: Camera, stage: Stage) -> int:
        """Return the coarsest level that is fine enough where the volume is nearest, see :data:`WANTED`."""
        half = 0.5 * float(np.linalg.norm(stage.visible_size))
        away = float(np.linalg.norm(camera.position - stage.centre)) - half
        pixel = float(camera.pixel_at(max(away, 0.05 * half))) * (1.0 + 1e-9)
        number = max((k for k, level in enumerate(self.source.levels) if level.voxel <= WANTED * pixel), default=0)
        if self.source.levels[number].voxels * (self.source.dtype.itemsize + BRICK_BYTES) > self.memory:
            enough = (k for k, level in enumerate(self.source.levels) if level.voxel <= COARSEST * pixel)
            number = max(enough, default=0)
        return number


class BrickMapper:
    """Our own ray caster for large volumes, with the methods of VTK's, on the stage of the volume's overview.

    The transfer function is one for the volume's values, with a unit distance. The sample distance is in stage units;
    levels other than the overview are drawn with the same number of their own voxels.
    """

    name = "bricks"

    def __init__(self, volume: LargeVolume, tf: TransferFunction, stage: Stage, shading: Shading, step: float) -> None:
        from svv.bricks.caster import Look

        first, last = tf.varying_range(*volume.range)
        if last - first <= STEP * max(abs(first), abs(last)):  # one label alone
            first, last = volume.range
        tf = settled(tf, last - first)
        assert tf.unit_distance is not None
        self._volume, self._stage = volume, stage
        whole, ranges = seen_of(volume, tf)
        low, high = tf.varying_range(*whole)
        values = np.linspace(low, high, entries_for(tf, low, high, to_array(volume.overview)))
        table = np.concatenate([tf.colour_at(values), tf.opacity_at(values)[:, None]], axis=1).astype(np.float32)
        shown = Appearance.of(volume.overview)
        self._look = Look(
            low, high, table, ranges, tf.unit_distance, shading, shown.nearest, shown.blank, shown.crop,
            shown.stretch if shown.stretched else None,
        )  # fmt: skip
        self._caster: BrickCaster | None = None
        self.set_step(step)

    def render(self, camera: Camera) -> Pixels:
        """Render a view with straight alpha; its colour is 0 where alpha is 0. (height, width, 4) uint8"""
        from svv.bricks.caster import BrickCaster

        number = self._volume.level_for(camera, self._stage)
        if self._caster is None or self._caster.number != number:
            self._caster = BrickCaster(self._volume.source, number, self._look, self._volume.memory, usable_cpus())
        return straight(self._caster.render(camera, self._voxels * self._caster.level.voxel))

    def set_step(self, step: float) -> None:
        """Set the sample distance, stage units of the overview."""
        self._voxels = step / self._stage.voxel

    def close(self) -> None:
        """Let go of the bricks."""
        self._caster = None


def seen_of(volume: LargeVolume, tf: TransferFunction) -> tuple[tuple[float, float], NDArray[np.float64]]:
    """Return the range of a volume's values, maybe wider than the overview's, and the visible intervals. (R, 2)"""
    (low, high), (first, last) = volume.range, tf.range
    if volume.is_range_known:
        return (low, high), np.array(tf.visible_ranges(low, high)).reshape(-1, 2)
    low, high = min(low, first), max(high, last)
    ranges = np.array(tf.visible_ranges(low, high)).reshape(-1, 2)
    return (low, high), np.where(ranges <= low, -np.inf, np.where(ranges >= high, np.inf, ranges))


def straight(drawn: NDArray[np.float32]) -> Pixels:
    """Convert colours times opacity and opacity (h, w, 4) to 8-bit levels with straight alpha."""
    pixels: Pixels = np.zeros(drawn.shape, np.uint8)
    shown = drawn[..., 3] > FAINT
    levels = 255.0 * drawn[shown]  # (pixels, 4)
    levels[:, :3] /= drawn[shown][:, 3:]
    pixels[shown] = np.rint(np.clip(levels, 0.0, 255.0))
    return pixels


def open_volume(  # noqa: PLR0913 - what users choose: how a file is read, which part of it, and how it is drawn
    path: str | Path,
    dims: Sequence[int] | None = None,
    dtype: DTypeLike | None = None,
    spacing: Sequence[float] | None = None,
    array: str | None = None,
    mapper: str = "auto",
    memory: float | None = None,
    progress: Progress = silent,
    channel: str | int | None = None,
    time: int | None = None,
    resample_to: int | None = None,
    nearest: bool = False,
) -> vtkImageData | LargeVolume:
    """Read a volume, or open it for drawing by bricks if the ray caster is ``bricks``, or ``auto`` and it is too large.

    A format of which bricks cannot be read (see :data:`svv.bricks.opened.BRICKED`) is always read as a whole. Arguments
    that are not explained here, and errors, are those of :func:`svv.dvr.read.volumes.read_volume`. ``array`` may also
    be the path of a dataset in an HDF5 file, or of an array in a Zarr group. ``mapper`` is ``auto``, ``bricks``,
    ``gpu`` or ``cpu``; ``memory`` is in gigabytes, by default half of what there is. With ``nearest``, voxels are shown
    without interpolation, as labels need: coarser levels for drawing by bricks then consist of voxels, not of means,
    and the file's own are not used.
    """
    file, allowed = Path(path), memory_allowed(memory)
    if not file.exists():
        raise BadInput(f"There is no volume {file}; check the path.")
    progress(0.0, "Reading the volume")
    choice = Choice(None if channel is None else str(channel), time)
    source = open_bricks(file, dims, dtype, spacing, None, array, choice) if mapper in ("auto", "bricks") else None
    needed = 0 if source is None else vtk_bytes(source)
    is_small = mapper == "auto" and needed <= allowed and file.suffix.lower() not in READ_BY_BRICKS_ONLY
    if source is None or is_small:
        image = read_volume(file, dims, dtype, spacing, None, array, channel, time, resample_to)
        return without_interpolation(image) if nearest else image
    if mapper == "auto" and needed > allowed:
        progress(0.0, f"Drawing by bricks: VTK would need {needed / 1e9:.1f} GB, more than {allowed / 1e9:.1f} GB")
    try:
        if len(source.levels) == 1 or nearest:
            from svv.bricks.pyramid import with_pyramid

            source = with_pyramid(source, file, progress, (array, choice.channel, choice.time), nearest)
        volume = LargeVolume(source, allowed // 2, file.name, nearest=nearest)
        _ = volume.overview  # which raises, too
        return volume
    except WithoutValues as error:
        if mapper != "auto" or needed > allowed:
            raise BadInput(f"{str(error).rstrip('.')}. {IN_MEMORY_ONLY}") from error
    image = read_volume(file, dims, dtype, spacing, None, array, channel, time, resample_to)
    return without_interpolation(image) if nearest else image


IN_MEMORY_ONLY = (
    "Voxels without a value are left out of volumes in memory only: with --mapper auto, if it is large enough."
)
"""What to do about a volume by bricks with such voxels."""

READ_BY_BRICKS_ONLY = (".h5", ".hdf5", ".he5", ".zarr")
"""Endings of volumes that are drawn by bricks unless another ray caster is asked for."""


def vtk_bytes(source: Source) -> int:
    """Return the memory in bytes that drawing a volume with VTK takes."""
    size = source.dtype.itemsize
    return source.levels[0].voxels * (2 * size + max(size, REAL_BYTES) + VTK_BYTES)


def memory_allowed(gigabytes: float | None) -> int:
    """Return a limit in bytes, by default half of what there is; raise BadInput below a quarter of a gigabyte."""
    if gigabytes is None:
        return memory_there() // 2
    if not 0.25 <= gigabytes < np.inf:
        raise BadInput(f"Drawing needs at least 0.25 GB of memory, not {gigabytes:g}.")
    return int(gigabytes * 1e9)


def in_memory(image: vtkImageData, memory: int) -> LargeVolume:
    """Return an image in memory as a volume for our own ray caster; its values are shared, not copied."""
    level = level_of_image(image)
    values: NDArray[np.number] = to_array(image)
    source = ArraySource(values, level.axes, level.origin)
    return LargeVolume(source, memory, overview=image, nearest=Appearance.of(image).nearest)


def quickest(
    volume: vtkImageData | LargeVolume,
    mapper: str,
    memory: float | None,
    tf: TransferFunction | None = None,
    rescale: bool | None = None,
) -> str:
    """Return the ray caster for views of a volume: with ``auto``, ours instead of VTK's on the CPU.

    Both draw the same picture (a mean difference of 0.1 to 0.4 of 255 levels), ours in .5 to .8 of the time. VTK keeps
    what ours would draw otherwise, whole numbers with more levels than the table of colours has entries, and what does
    not fit into memory twice. Ours draws even where there is a GPU if values lie so far apart (fill values) that VTK's
    tables, which run from the smallest to the largest value, would not resolve the function.
    """
    if mapper != "auto" or not isinstance(volume, vtkImageData):
        return mapper
    voxels, (low, high) = int(np.prod(volume.GetDimensions())), volume.GetScalarRange()
    first, last = (low, high) if tf is None or tf.is_stretched(low, high, rescale) else tf.varying_range(low, high)
    is_far = high - low > MOST_WIDTHS * (last - first) > 0.0
    if choose_mapper(mapper) is not CpuMapper and not is_far:
        return mapper
    resolved = to_array(volume).dtype.kind == "f" or last - first < ENTRIES
    fits = voxels * (volume.GetScalarSize() + BRICK_BYTES) <= memory_allowed(memory) // 2
    return "bricks" if resolved and fits else mapper


@dataclass(frozen=True, eq=False)
class Opened:
    """A volume of which views are drawn, in memory or not."""

    image: vtkImageData
    """The volume, or an overview of it."""
    whole: Level
    range: tuple[float, float]
    type: str
    """NumPy's name of the values' type."""
    large: LargeVolume | None = None
    """The volume, if it is drawn by bricks."""

    @classmethod
    def of(cls, volume: vtkImageData | LargeVolume, mapper: str, memory: float | None) -> Opened:
        """Return an image (see ``as_volume``) or a large volume for a ray caster: ours if VTK's knows no blanking."""
        if isinstance(volume, vtkImageData) and (
            mapper == "bricks" or (not Appearance.of(volume).plain and choose_mapper(mapper) is CpuMapper)
        ):
            volume = in_memory(volume, memory_allowed(memory) // 2)
        if isinstance(volume, LargeVolume):
            return cls(volume.overview, volume.whole, volume.range, str(volume.source.dtype), volume)
        values = to_array(volume)
        low, high = float(values.min()), float(values.max())
        return cls(volume, level_of_image(volume), (low, high), str(values.dtype))

    @property
    def unit_distance(self) -> float:
        """ParaView's default opacity unit distance, world units."""
        return own_unit_distance(self.image) or unit_distance_for(self.whole)

    def caster(self, tf: TransferFunction) -> Callable[[Stage, Shading, float], BrickMapper] | None:
        """Return what makes the ray caster for a transfer function of the values; None for one of VTK's."""
        return None if self.large is None else partial(BrickMapper, self.large, tf)
