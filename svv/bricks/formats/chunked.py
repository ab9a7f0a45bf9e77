"""Volumes in chunks: HDF5, Zarr and OME-Zarr."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from svv.bricks.formats.axes import Choice, in_one_unit, named, picked
from svv.bricks.source import Box, Level, level_of, native, scaled_type
from svv.core.json_values import parsed
from svv.errors import BadInput

if TYPE_CHECKING:
    import h5py

CHUNK_CACHE = 128 << 20
"""Bytes of decoded chunks or pages that are kept, since neighbouring boxes share them."""

ELEMENT_SIZE = ("element_size_um", "spacing", "voxel_size", "resolution")
"""Attributes of an HDF5 dataset that may hold the size of a voxel along z, y, x."""

PACKED = {"scale_factor": 1.0, "add_offset": 0.0}
"""Attributes by which stored values are multiplied, and to which the products are added (climate and forecast metadata
conventions, section 8.1), and what stands for a missing one."""

MISSING = ("_FillValue", "missing_value")
"""Attributes with stored values that stand for none (ibid., section 2.5.1)."""

UNEVEN = 0.01
"""Part of a step by which steps between voxels may differ: scales are often stored in single precision."""


class ChunkedSource:
    """Arrays of several resolutions.

    Args:
        name: Name in messages.
        arrays: For each level, a function that reads the box from ``start`` to ``stop``.
        dtype: Type of the values as stored.
        levels: The levels.
        attributes: Of the array, which may tell how its values are packed.

    Raises:
        BadInput: What the attributes tell are not numbers.
    """

    def __init__(
        self,
        name: str,
        arrays: Sequence[Callable[[Box, Box], NDArray[np.generic]]],
        dtype: DTypeLike,
        levels: Sequence[Level],
        attributes: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self.name, self._stored = name, native(dtype, name)
        self.levels: Sequence[Level] = tuple(levels)
        self._arrays = arrays
        (gain,), (shift,) = (_numbers(attributes, key, name) or (first,) for key, first in PACKED.items())
        self._scale = None if (gain, shift) == (1.0, 0.0) else (gain, shift)
        self._missing = {value: key for key in MISSING for value in _numbers(attributes, key, name)}
        self.dtype = self._stored if self._scale is None else scaled_type(self._stored, *self._scale)

    def read(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box; see :meth:`svv.bricks.source.Source.read`."""
        try:
            box = self._arrays[level](start, stop)
        except Exception as error:  # codecs and stores raise errors of all kinds
            where = " x ".join(f"{a}..{b - 1}" for a, b in zip(start[::-1], stop[::-1]))
            raise BadInput(f"Cannot read voxels {where} of {self.name}: {_said(error)}.") from error
        for value, key in self._missing.items():
            if (box == value).any():
                raise BadInput(
                    f"{self.name} has voxels without a value (its attribute {key} is {value:g}): "
                    "replace them with numbers first."
                )
        if self._scale is not None:
            box = box.astype(np.float64) * self._scale[0] + self._scale[1]
        return np.ascontiguousarray(box, dtype=self.dtype)


def _numbers(attributes: Mapping[str, Any], key: str, name: str) -> tuple[float, ...]:
    """Return the numbers of an attribute; nothing without it.

    Raises:
        BadInput: It holds something else, or several numbers where a value can be packed in one way only.
    """
    told = attributes.get(key)
    if isinstance(told, str) and len(told) == 12:  # xarray writes real numbers into Zarr as base64
        with suppress(ValueError):
            told = np.frombuffer(base64.b64decode(told, validate=True), "<f8")
    values = np.atleast_1d(np.asarray(() if told is None else told))
    if values.dtype.kind not in "iuf" or values.ndim != 1 or (key in PACKED and values.size > 1):
        raise BadInput(f"{name} has the attribute {key} = {told!r}, which is no number: correct it first.")
    return tuple(values.tolist())


def _said(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return (text[0].rstrip(".") if text else "") or type(error).__name__


def package(name: str, file: Path) -> ModuleType:
    """Import a package that only some formats need.

    Raises:
        BadInput: It is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        extra = "standalone" if name == "pydicom" else "large"
        raise BadInput(f"{file} needs the package {name}: pip install 'svv[{extra}]'.") from error


def open_hdf5(file: Path, choice: Choice = Choice(), array: str | None = None) -> ChunkedSource:  # noqa: B008 - frozen
    """Open a dataset of an HDF5 file; by default the only or the largest one with three axes.

    Further axes may be channels and times if the file names its axes: by ``axistags`` as ilastik writes them, or by
    HDF5's labels of dimensions.

    Raises:
        BadInput: The file is damaged, has no such dataset, or h5py is not installed.
    """
    h5py = package("h5py", file)
    try:
        opened = h5py.File(file, "r", rdcc_nbytes=CHUNK_CACHE, rdcc_nslots=100_003)
        data = _dataset(opened, file, array)
        axes, size, origin = _axes_of_dataset(data, file)
        shape, kind, told = data.shape, data.dtype, dict(data.attrs)
    except BadInput:
        raise
    except Exception as error:  # damaged files make HDF5 raise all kinds of errors
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or not an HDF5 file.") from error
    pick = picked(axes, shape, choice, file.name)
    level = level_of(pick.sides(shape), np.diag(size), origin, file.name)
    return ChunkedSource(file.name, [partial(pick.box, data)], kind, [level], told)


def _dataset(opened: h5py.File, file: Path, array: str | None) -> h5py.Dataset:
    """Return the dataset of a path, or the largest one with three axes.

    Raises:
        BadInput: There is none, or no path and several of the largest size.
    """
    found: dict[str, h5py.Dataset] = {}

    def note(name: str, item: object) -> None:
        if isinstance(item, package("h5py", file).Dataset) and sum(side > 1 for side in item.shape or ()) >= 3:
            found[name] = item

    opened.visititems(note)
    if not found or (array is not None and array.strip("/") not in found):
        names = ", ".join(found) or "none"
        wanted = f"no volume '{array}'" if array else "no dataset with three axes"
        raise BadInput(f"{file} has {wanted}; datasets with three axes: {names}.")
    if array is not None:
        return found[array.strip("/")]
    most = max(item.size for item in found.values())
    largest = [name for name, item in found.items() if item.size == most]
    if len(largest) > 1:
        raise BadInput(f"{file} has several volumes of one size: name one of them ({', '.join(largest)}) with --array.")
    return found[largest[0]]


def _axes_of_dataset(data: h5py.Dataset, file: Path) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    """Return the names of a dataset's axes, the size of a voxel, and the first voxel's place, along x, y, z both."""
    size, origin = np.ones(3), np.zeros(3)
    for key in ELEMENT_SIZE:
        values = np.atleast_1d(np.asarray(data.attrs.get(key, ()), dtype=object))
        if values.shape == (3,) and all(isinstance(v, (int, float, np.number)) for v in values):
            size = values.astype(float)[::-1]
            break
    try:
        tags = parsed(data.attrs["axistags"])["axes"]
        names = named(tag["key"] for tag in tags)
        steps = {str(tag["key"]).lower(): float(tag.get("resolution") or 0.0) for tag in tags}
    except (KeyError, TypeError, ValueError):
        names, steps = named(dimension.label for dimension in data.dims), {}
    if len(names) != data.ndim or not set("zyx") <= set(names):
        names, steps = unnamed(data.shape), {}
    if all(steps.get(axis, 0.0) > 0.0 for axis in "xyz"):
        size = np.array([steps[axis] for axis in "xyz"])
    elif (size == 1.0).all() and set("zyx") <= set(names):
        size, origin = _scaled([data.dims[names.index(axis)] for axis in "xyz"], file)
    return names, size, origin


def _scaled(dimensions: Sequence[h5py.DimensionProxy], file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the size of a voxel and the first voxel's place along x, y, z, by the scales attached to those axes.

    Axes without a scale keep 1 and 0, and so do all if their units differ: degrees and metres make no place.

    Raises:
        BadInput: The voxels of an axis are not evenly spaced.
    """
    size, origin, units = np.ones(3), np.zeros(3), set()
    for k, dimension in enumerate(dimensions):
        values = np.asarray(dimension[0]) if len(dimension) else np.zeros(0)
        if values.ndim != 1 or values.size < 2 or values.dtype.kind not in "iuf":
            continue
        steps = np.diff(values.astype(np.float64))
        if not np.abs(steps - steps.mean()).max() < UNEVEN * np.abs(steps.mean()):
            raise BadInput(f"{file} is not evenly spaced along its scale '{dimension[0].name}': resample it first.")
        units.add(str(dimension[0].attrs.get("units", "")))
        size[k], origin[k] = steps.mean(), values[0]
    return (size, origin) if len(units) == 1 else (np.ones(3), np.zeros(3))


def unnamed(shape: Sequence[int]) -> list[str]:
    """Return names for axes of which nothing is known: z, y, x if three of them have several entries."""
    wide = [k for k, side in enumerate(shape) if side > 1]
    if len(shape) == 3 or len(wide) != 3:
        return [*(f"axis {k}" for k in range(len(shape) - 3)), *"zyx"[-len(shape) :]]
    return [dict(zip(wide, "zyx")).get(k, f"axis {k}") for k in range(len(shape))]


def open_zarr(folder: Path, choice: Choice | None = None, array: str | None = None) -> ChunkedSource:
    """Open a Zarr array (versions 2 and 3) or an OME-Zarr image with all its levels.

    Args:
        folder: The array or group.
        choice: The channel and the time point that are shown.
        array: Path of an array in a group.

    Raises:
        BadInput: The store is damaged, has no such array, is not a volume, has several channels or time points of
            which none is chosen, or zarr is not installed.
    """
    zarr, choice = package("zarr", folder), choice or Choice()
    try:
        whole = zarr.open(str(folder), mode="r")
        opened = whole if array is None else whole[array]
    except Exception as error:  # zarr's errors differ between its versions
        raise BadInput(f"Cannot read {folder}: {_said(error)}.") from error
    for group in (opened, whole):  # of an image's group, an array is a single level
        attributes = dict(group.attrs)
        attributes = attributes.get("ome", attributes)
        if isinstance(attributes, dict) and attributes.get("multiscales"):
            only = None if group is opened else str(array).strip("/")
            source = _ome(folder, group, attributes, choice, only)
            if source is not None:
                return source
    attributes = dict(opened.attrs)
    if not hasattr(opened, "ndim"):
        inside = ", ".join(sorted(opened)) or "none"
        raise BadInput(f"{folder} is a group of arrays: name one of them ({inside}) with --array.")
    told = getattr(getattr(opened, "metadata", None), "dimension_names", None) or attributes.get("_ARRAY_DIMENSIONS")
    names = named(told or ())
    axes = names if len(names) == opened.ndim and set("zyx") <= set(names) else unnamed(opened.shape)
    pick = picked(axes, opened.shape, choice, folder.name)
    level = level_of(pick.sides(opened.shape), np.eye(3), np.zeros(3), folder.name)
    return ChunkedSource(folder.name, [partial(pick.box, opened)], opened.dtype, [level], attributes)


def _ome(folder: Path, group: Any, told: Any, choice: Choice, only: str | None) -> ChunkedSource | None:
    """Open the levels of an OME-Zarr image (OME-NGFF 0.1 to 0.5), or ``only`` one of them, if there is one."""
    try:
        scale = told["multiscales"][0]
        datasets = [entry for entry in scale["datasets"] if only in (None, entry["path"])]
        if only is not None and not datasets:
            return None
        arrays = [group[entry["path"]] for entry in datasets]
        axes, units = _named_axes(scale.get("axes"), arrays[0].ndim)
        channels = _labels(told.get("omero"))
        picks = [picked(axes, data.shape, choice, folder.name, channels) for data in arrays]
        in_unit = in_one_unit(np.ones(3), [units.get(axis) for axis in "xyz"], folder.name)
        places = [axes.index(axis) for axis in "xyz"]
        levels = []
        for entry, data, pick in zip(datasets, arrays, picks):
            steps = [*entry.get("coordinateTransformations", ()), *scale.get("coordinateTransformations", ())]
            size, shift = _transform(steps, data.ndim)
            level = pick.sides(data.shape), np.diag(size[places] * in_unit), shift[places] * in_unit
            levels.append(level_of(*level, folder.name))
    except BadInput:
        raise
    except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(f"{folder} has multiscales that do not follow OME-NGFF ({_said(error)}).") from error
    return ChunkedSource(
        folder.name, [partial(pick.box, data) for pick, data in zip(picks, arrays)], arrays[0].dtype, levels
    )


def _named_axes(told: Sequence[object] | None, count: int) -> tuple[list[str], dict[str, str]]:
    """Return a name for each axis, and the units of those that have one."""
    axes = [one if isinstance(one, dict) else {"name": one} for one in told or "tczyx"[-count:]]
    if len(axes) != count:
        raise ValueError(f"{len(axes)} axes of {count} are named")
    kinds = {"time": "t", "channel": "c"}
    names = [kinds.get(str(one.get("type")), name) for one, name in zip(axes, named(one["name"] for one in axes))]
    return names, {name: str(one["unit"]) for name, one in zip(names, axes) if one.get("unit")}


def _labels(omero: object) -> list[str]:
    """Return the names of the channels; nothing unless every channel has one."""
    channels = omero.get("channels") if isinstance(omero, dict) else None
    names = [str(one.get("label") or "") for one in channels or () if isinstance(one, dict)]
    return names if all(names) else []


def _transform(steps: Sequence[Mapping[str, Any]], axes: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the scale and the translation along each axis.

    Raises:
        ValueError: A step is neither of them.
    """
    scale, shift = np.ones(axes), np.zeros(axes)
    for step in steps:
        kind = step["type"]
        if kind == "identity":
            continue
        if kind not in ("scale", "translation") or kind not in step:
            raise ValueError(f"a transformation {kind} without numbers in it cannot be read")
        numbers = np.array(step[kind], float)
        if numbers.shape != (axes,):
            raise ValueError(f"a {kind} has {numbers.size} numbers for {axes} axes")
        if kind == "scale":
            scale, shift = scale * numbers, shift * numbers
        else:
            shift = shift + numbers
    return scale, shift


def is_zarr(path: Path) -> bool:
    """Return whether a folder is a Zarr array or group."""
    return path.is_dir() and any((path / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup"))
