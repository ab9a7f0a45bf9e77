"""Volumes in chunks: what they have in common, Zarr and OME-Zarr. HDF5 is in :mod:`svv.bricks.formats.hdf5`."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from itertools import product, takewhile
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from svv.bricks.formats.archives import ArchivePath
from svv.bricks.formats.axes import Choice, Indexed, in_one_unit, picked, role_of
from svv.bricks.formats.places import Array, Axis, axis_of, no_size, placed, sized, text_of
from svv.bricks.formats.source import Box, Level, WithoutValues, level_of, native, scaled_type
from svv.core.json_values import parsed
from svv.errors import BadInput

CHUNK_CACHE = 128 << 20
"""Bytes of decoded chunks or pages that are kept, since neighbouring boxes share them."""

PACKED = {"scale_factor": 1.0, "add_offset": 0.0}
"""Attributes by which stored values are multiplied, and to which the products are added (climate and forecast metadata
conventions, section 8.1), and what stands for a missing one."""

MISSING = ("_FillValue", "missing_value")
"""Attributes with stored values that stand for none (ibid., section 2.5.1)."""

UNWRITTEN = 9.969209968386869e36
"""What netCDF's libraries leave in real numbers that were not written, unless _FillValue is another number."""


class ChunkedSource:
    """Arrays of several resolutions.

    Args:
        name: Name in messages.
        arrays: For each level, a function that reads the box from ``start`` to ``stop``.
        dtype: Type of the values as stored.
        levels: The levels.
        attributes: Of the array, which may tell how its values are packed.
        planes: Places of the voxels along x, y and z, if some are not evenly spaced.
        assumed: What was assumed of the file, in sentences.

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
        planes: tuple[Array, Array, Array] | None = None,
        assumed: str | None = None,
    ) -> None:
        self.name, self._stored, self.planes, self.assumed = name, native(dtype, name), planes, assumed
        self._unsigned = text_of(attributes.get("_Unsigned")).lower() == "true" and self._stored.kind == "i"
        self.levels: Sequence[Level] = tuple(levels)
        self._arrays = arrays
        (gain,), (shift,) = (_numbers(attributes, key, name) or (first,) for key, first in PACKED.items())
        self._scale = None if (gain, shift) == (1.0, 0.0) else (gain, shift)
        self._missing = {value: key for key in MISSING for value in _numbers(attributes, key, name)}
        if self._stored.kind == "f" and "_FillValue" not in attributes:
            self._missing.setdefault(UNWRITTEN, "_FillValue, by default,")
        if self._unsigned:  # netCDF users' guide, attribute conventions: so are the values that stand for none
            size = 8 * self._stored.itemsize
            self._missing = {int(value) % (1 << size): key for value, key in self._missing.items()}
            self._stored = np.dtype(f"u{self._stored.itemsize}")
        self.dtype = self._stored if self._scale is None else scaled_type(self._stored, *self._scale)

    def read(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box; see :meth:`svv.bricks.formats.source.Source.read`. Raises WithoutValues if some are missing."""
        box, found = self._read(level, start, stop)
        for value, key, _ in found:
            raise WithoutValues(
                f"{self.name} has voxels without a value (its attribute {key} is {value:g}): replace them with numbers "
                "first."
            )
        return np.ascontiguousarray(box, dtype=self.dtype)

    def read_with_gaps(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box as real numbers, NaN where the file has no value."""
        box, found = self._read(level, start, stop)
        real = np.float32 if self.dtype.itemsize <= 2 or self.dtype == np.float32 else np.float64
        values: NDArray[np.number] = box.astype(real)
        for _, _, there in found:
            values[there] = np.nan
        return values

    def _read(
        self, level: int, start: Box, stop: Box
    ) -> tuple[NDArray[Any], list[tuple[float, str, NDArray[np.bool_]]]]:
        """Return a box, and what stands in it for no value: the number, whose attribute it is, and where."""
        try:
            box = self._arrays[level](start, stop)
        except Exception as error:  # codecs and stores raise errors of all kinds
            where = " x ".join(f"{a}..{b - 1}" for a, b in zip(start[::-1], stop[::-1]))
            raise BadInput(f"Cannot read voxels {where} of {self.name}: {_describe_error(error)}.") from error
        if self._unsigned:
            box = box.astype(self._stored)
        with np.errstate(over="ignore"):  # float16 does not reach netCDF's default
            places = [(value, key, box == value) for value, key in self._missing.items()]
        if self._scale is not None:
            box = box.astype(np.float64) * self._scale[0] + self._scale[1]
        return box, [one for one in places if one[2].any()]


def _numbers(attributes: Mapping[str, Any], key: str, name: str) -> tuple[float, ...]:
    """Return the numbers of an attribute; nothing without it.

    Raises BadInput if it holds something else, or several numbers where a value can be packed in one way only.
    """
    told = attributes.get(key)
    if isinstance(told, str) and len(told) == 12:  # xarray writes real numbers into Zarr as base64
        with suppress(ValueError):
            told = np.frombuffer(base64.b64decode(told, validate=True), "<f8")
    values = np.atleast_1d(np.asarray(() if told is None else told))
    if values.dtype.kind not in "iuf" or values.ndim != 1 or (key in PACKED and values.size > 1):
        raise BadInput(f"{name} has the attribute {key} = {told!r}, which is no number: correct it first.")
    return tuple(values.tolist())


def _describe_error(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return (text[0].rstrip(".") if text else "") or type(error).__name__


def package(name: str, file: Path) -> ModuleType:
    """Import a package that only some formats need; raises BadInput if it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        extra = {"pydicom": "standalone", "astropy.io.fits": "formats", "tensorstore": "formats"}.get(name, "large")
        raise BadInput(f"{file} needs the package {name.partition('.')[0]}: pip install 'svv[{extra}]'.") from error


def source_of(  # noqa: PLR0913 - what files tell
    name: str,
    array: Indexed,
    kind: DTypeLike,
    shape: Sequence[int],
    axes: Sequence[Axis],
    choice: Choice,
    attributes: Mapping[str, Any],
    channels: Sequence[str] = (),
    turn: Array | None = None,
) -> ChunkedSource:
    """Return a volume by what its file tells about the axes of an array; see :func:`svv.bricks.formats.places.placed`.

    Raises:
        BadInput: See there, :func:`svv.bricks.formats.axes.picked` and :func:`svv.bricks.formats.source.level_of`.
    """
    place = placed(axes, shape, name, turn)
    pick = picked(place.names, shape, choice, name, channels)
    level = level_of(pick.sides(shape), place.axes, place.origin, name)
    return ChunkedSource(name, [partial(pick.box, array)], kind, [level], attributes, place.planes, place.assumed)


def open_zarr(folder: Path, choice: Choice | None = None, array: str | None = None) -> ChunkedSource:
    """Open a Zarr array (versions 2 and 3) or an OME-Zarr image with all its levels.

    The axes of a plain array are placed by the arrays beside it that have their names, as xarray writes them.

    Args:
        folder: The array or group, or a zip archive that holds it.
        choice: The channel and the time point that are shown.
        array: Path of an array in a group.

    Raises:
        BadInput: The store is damaged, has no such array, is not a volume, has several channels or time points of
            which none is chosen, or zarr is not installed.
    """
    zarr, choice = package("zarr", folder), choice or Choice()
    base = folder if folder.is_dir() else ArchivePath.root(folder)
    try:
        whole = _opened(zarr, base)
        opened = whole if array is None else whole[array]
    except Exception as error:  # zarr's errors differ between its versions
        raise BadInput(f"Cannot read {folder}: {_describe_error(error)}.") from error
    for group in (opened, whole):  # of an image's group, an array is a single level
        attributes = dict(group.attrs)
        attributes = attributes.get("ome", attributes)
        if isinstance(attributes, dict) and attributes.get("multiscales"):
            only = None if group is opened else str(array).strip("/")
            source = _ome(folder, base, group, attributes, choice, only)
            if source is not None:
                return source
    attributes = dict(opened.attrs)
    if not hasattr(opened, "ndim"):
        inside = ", ".join(sorted(opened)) or "none"
        raise BadInput(f"{folder} is a group of arrays: name one of them ({inside}) with --array.")
    told = getattr(getattr(opened, "metadata", None), "dimension_names", None) or attributes.get("_ARRAY_DIMENSIONS")
    names = [str(name or "") for name in told or ()]
    names = names if len(names) == opened.ndim else [""] * opened.ndim
    place = base / (array or "").strip("/")
    try:
        above_it: Sequence[Path | ArchivePath] = place.parents  # the nearest first: inner groups inherit coordinates
        groups = [_opened(zarr, above) for above in takewhile(is_zarr, above_it)]
        axes = sized([_axis(groups, *one) for one in zip(names, opened.shape)], attributes, opened.shape)
    except Exception as error:  # as above
        raise BadInput(f"Cannot read {folder}: {_describe_error(error)}.") from error
    chunks = _with_chunks(place, opened)
    return source_of(folder.name, chunks, opened.dtype, opened.shape, axes, choice, attributes)


def _opened(zarr: Any, place: Path | ArchivePath) -> Any:
    """Open the array or group at a place."""
    if isinstance(place, Path):
        return zarr.open(str(place), mode="r")
    return zarr.open(
        zarr.storage.ZipStore(str(place.archive), mode="r"), mode="r", path=str(place.at.as_posix()).strip(".")
    )


def _axis(groups: Sequence[Any], name: str, count: int) -> Axis:
    """Return the axis of a dimension, by the array of its name in the nearest group that has one."""
    found = next((group[name] for group in groups if name and name in group and hasattr(group[name], "ndim")), None)
    if found is None:
        return Axis(name)
    return axis_of(name, np.asarray(found[...]) if found.ndim == 1 else None, dict(found.attrs), count)


def _with_chunks(place: Path | ArchivePath, array: Any) -> Indexed:
    """Return an array after a look at its chunks: if there are none, Zarr makes voxels of its fill value.

    Raises BadInput if it has no chunks, or under other names than it says.
    """
    file = next(place / name for name in (".zarray", "zarr.json") if (place / name).is_file())
    told = parsed(file.read_bytes())
    encoding = told.get("chunk_key_encoding", {"name": "v2"})
    default = {"separator": "/"} if encoding["name"] == "default" else {"separator": told.get("dimension_separator")}
    mark = {**default, **encoding.get("configuration", {})}["separator"] or "."
    first = f"c{mark}" if encoding["name"] == "default" else ""

    def key(numbers: Sequence[object]) -> str:
        return first + mark.join(str(number) for number in numbers)

    zeros, pattern, other = key([0] * array.ndim), re.escape(first) + re.escape(mark).join([r"\d+"] * array.ndim), ""
    for path in place.rglob("*"):
        name = path.relative_to(place).as_posix()  # type: ignore[arg-type]
        if name.startswith(".") or name == file.name or not path.is_file():
            continue
        if re.fullmatch(pattern, name):
            break
        other = other or name
    else:
        found = f"none is called as {file.name} says ({zeros}, ...), but one {other}" if other else "it has none"
        raise BadInput(f"{place} was written without its chunks of values, or these were renamed: {found}.")
    return _Written(array, lambda numbers: place / key(numbers)) if told.get("fill_value", 0) is None else array


class _Written:
    """An array whose chunks must all be there, because no fill value tells what a missing one holds."""

    def __init__(self, array: Any, file: Callable[[Sequence[int]], Path | ArchivePath]) -> None:
        self._array, self._file = array, file

    def __getitem__(self, index: tuple[int | slice, ...]) -> Any:
        spans = [(k, k + 1) if isinstance(k, int) else (k.start, k.stop) for k in index]
        counts = [range(a // n, (b - 1) // n + 1) for (a, b), n in zip(spans, self._array.chunks)]
        for numbers in product(*counts):
            if not self._file(numbers).is_file():
                raise ValueError(f"the chunk {self._file(numbers)} is missing, and no fill value says what it holds")
        return self._array[index]


def _ome(
    folder: Path, base: Path | ArchivePath, group: Any, told: Any, choice: Choice, only: str | None
) -> ChunkedSource | None:
    """Open the levels of an OME-Zarr image (OME-NGFF 0.1 to 0.5), or ``only`` one of them, if there is one."""
    try:
        scale = told["multiscales"][0]
        datasets = [entry for entry in scale["datasets"] if only in (None, entry["path"])]
        if only is not None and not datasets:
            return None
        arrays = [group[entry["path"]] for entry in datasets]
        within = group.path if isinstance(base, Path) else group.path.removeprefix(base.at.as_posix().strip("."))
        inside = base / within.strip("/")
        shown = [_with_chunks(inside / entry["path"], a) for entry, a in zip(datasets, arrays)]
        axes, units = _named_axes(scale.get("axes"), arrays[0].ndim)
        channels = _labels(told.get("omero"))
        picks = [picked(axes, data.shape, choice, folder.name, channels) for data in arrays]
        in_unit = in_one_unit(np.ones(3), [units.get(axis) for axis in "xyz"], folder.name)
        places = [axes.index(axis) for axis in "xyz"]
        levels, is_sized = [], False
        for entry, data, pick in zip(datasets, arrays, picks):
            steps = [*entry.get("coordinateTransformations", ()), *scale.get("coordinateTransformations", ())]
            size, shift = _transform(steps, data.ndim)
            is_sized |= any(step["type"] == "scale" for step in steps)
            level = pick.sides(data.shape), np.diag(size[places] * in_unit), shift[places] * in_unit
            levels.append(level_of(*level, folder.name))
    except BadInput:
        raise
    except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(f"{folder} has multiscales that do not follow OME-NGFF ({_describe_error(error)}).") from error
    return ChunkedSource(
        folder.name, [partial(pick.box, data) for pick, data in zip(picks, shown)], arrays[0].dtype, levels,
        assumed=None if is_sized else no_size(folder.name),
    )  # fmt: skip


def _named_axes(told: Sequence[object] | None, count: int) -> tuple[list[str], dict[str, str]]:
    """Return a name for each axis, and the units of those that have one."""
    axes = [one if isinstance(one, dict) else {"name": one} for one in told or "tczyx"[-count:]]
    if len(axes) != count:
        raise ValueError(f"{len(axes)} axes of {count} are named")
    kinds = {"time": "t", "channel": "c"}
    texts = [str(one["name"]).lower() for one in axes]
    names = [kinds.get(str(one.get("type"))) or role_of(text) or text for one, text in zip(axes, texts)]
    return names, {name: str(one["unit"]) for name, one in zip(names, axes) if one.get("unit")}


def _labels(omero: object) -> list[str]:
    """Return the names of the channels; nothing unless every channel has one."""
    channels = omero.get("channels") if isinstance(omero, dict) else None
    names = [str(one.get("label") or "") for one in channels or () if isinstance(one, dict)]
    return names if all(names) else []


def _transform(steps: Sequence[Mapping[str, Any]], axes: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the scale and the translation along each axis; raises ValueError if a step is neither of them."""
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


def is_zarr(path: Path | ArchivePath) -> bool:
    """Return whether a folder is a Zarr array or group."""
    return path.is_dir() and any((path / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup"))
