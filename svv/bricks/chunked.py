"""Volumes in chunks: HDF5, Zarr and OME-Zarr, and TIFF stacks."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from svv.bricks.source import Box, Level, level_of, native
from svv.bricks.tiff_files import TIFFFILE_DECODES, in_order
from svv.errors import BadInput

CHUNK_CACHE = 128 << 20
"""Bytes of decoded chunks or pages that are kept, since neighbouring boxes share them."""

ELEMENT_SIZE = ("element_size_um", "spacing", "voxel_size", "resolution")
"""Attributes of an HDF5 dataset that may hold the size of a voxel along z, y, x."""


class ChunkedSource:
    """Arrays of several resolutions.

    Args:
        name: Name in messages.
        arrays: For each level, a function that reads the box from ``start`` to ``stop``.
        dtype: Type of the values as stored.
        levels: The levels.
    """

    def __init__(
        self,
        name: str,
        arrays: Sequence[Callable[[Box, Box], NDArray[Any]]],
        dtype: Any,
        levels: Sequence[Level],
    ) -> None:
        self.name, self.dtype = name, native(dtype, name)
        self.levels: Sequence[Level] = tuple(levels)
        self._arrays = arrays

    def read(self, level: int, start: Box, stop: Box) -> NDArray[Any]:
        """Read a box; see :meth:`svv.bricks.source.Source.read`."""
        try:
            box = self._arrays[level](start, stop)
        except Exception as error:  # codecs and stores raise errors of all kinds
            where = " x ".join(f"{a}..{b - 1}" for a, b in zip(start[::-1], stop[::-1]))
            raise BadInput(f"Cannot read voxels {where} of {self.name}: {_said(error)}.") from error
        return np.ascontiguousarray(box, dtype=self.dtype)


def _said(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return (text[0].rstrip(".") if text else "") or type(error).__name__


def package(name: str, file: Path) -> Any:
    """Import a package that only some formats need.

    Raises:
        BadInput: It is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise BadInput(f"{file} needs the package {name}: pip install 'svv[large]'.") from error


def open_hdf5(file: Path, array: str | None) -> ChunkedSource:
    """Open a three-dimensional dataset of an HDF5 file; by default the only or the largest one.

    Raises:
        BadInput: The file is damaged, has no such dataset, or h5py is not installed.
    """
    h5py = package("h5py", file)
    try:
        opened = h5py.File(file, "r", rdcc_nbytes=CHUNK_CACHE, rdcc_nslots=100_003)
    except OSError as error:
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or not an HDF5 file.") from error
    found: dict[str, Any] = {}

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.ndim == 3:
            found[name] = item

    opened.visititems(note)
    if not found or (array is not None and array.strip("/") not in found):
        names = ", ".join(found) or "none"
        wanted = f"no volume '{array}'" if array else "no dataset with three axes"
        raise BadInput(f"{file} has {wanted}; datasets with three axes: {names}.")
    data = found[array.strip("/")] if array is not None else max(found.values(), key=lambda item: item.size)
    spacing = np.ones(3)
    for key in ELEMENT_SIZE:
        values = np.atleast_1d(np.asarray(data.attrs.get(key, ()), dtype=object))
        if values.shape == (3,) and all(isinstance(v, (int, float, np.number)) for v in values):
            spacing = values.astype(float)[::-1]
            break
    level = level_of(data.shape, np.diag(spacing), np.zeros(3), file.name)
    return ChunkedSource(file.name, [lambda a, b: data[a[0] : b[0], a[1] : b[1], a[2] : b[2]]], data.dtype, [level])


def open_zarr(folder: Path, array: str | None) -> ChunkedSource:
    """Open a Zarr array (versions 2 and 3) or an OME-Zarr image with all its levels.

    Of further axes (time, channel), the first entry is shown; ``array`` is the path of an array in a group.

    Raises:
        BadInput: The store is damaged, has no such array, is not a volume, or zarr is not installed.
    """
    zarr = package("zarr", folder)
    try:
        opened = zarr.open(str(folder), mode="r")
        if array is not None:
            opened = opened[array]
    except Exception as error:  # zarr's errors differ between its versions
        raise BadInput(f"Cannot read {folder}: {_said(error)}.") from error
    attributes = dict(opened.attrs)
    scales = attributes.get("ome", attributes).get("multiscales")
    if scales:
        return _ome(folder, opened, scales[0])
    if not hasattr(opened, "shape"):
        inside = ", ".join(sorted(opened)) or "none"
        raise BadInput(f"{folder} is a group of arrays: name one of them ({inside}) with --array.")
    level = level_of(opened.shape[-3:], np.eye(3), np.zeros(3), folder.name)
    return ChunkedSource(folder.name, [_first(opened)], opened.dtype, [level])


def _first(array: Any) -> Callable[[Box, Box], NDArray[Any]]:
    """Return a function that reads a box of the last three axes, at the first entry of all others."""
    others = (0,) * (array.ndim - 3)
    return lambda a, b: np.asarray(array[(*others, *(slice(x, y) for x, y in zip(a, b)))])


def _ome(folder: Path, group: Any, scale: Any) -> ChunkedSource:
    """Open the levels of an OME-Zarr image (OME-NGFF 0.4 and 0.5)."""
    try:
        arrays, levels = [], []
        common = _transform(scale.get("coordinateTransformations", ()), 3)
        for entry in scale["datasets"]:
            data = group[entry["path"]]
            own = _transform(entry.get("coordinateTransformations", ()), data.ndim)
            size, shift = common[0] * own[0], common[0] * own[1] + common[1]
            levels.append(level_of(data.shape[-3:], np.diag(size[::-1]), shift[::-1], folder.name))
            arrays.append(data)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{folder} has multiscales that do not follow OME-NGFF ({_said(error)}).") from error
    return ChunkedSource(folder.name, [_first(data) for data in arrays], arrays[0].dtype, levels)


def _transform(steps: Sequence[Any], axes: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the scale and the translation along z, y, x."""
    scale, shift = np.ones(axes), np.zeros(axes)
    for step in steps:
        if step["type"] == "scale":
            scale = scale * np.array(step["scale"], float)[-axes:]
            shift = shift * np.array(step["scale"], float)[-axes:]
        elif step["type"] == "translation":
            shift = shift + np.array(step["translation"], float)[-axes:]
    return scale[-3:], shift[-3:]


def is_zarr(path: Path) -> bool:
    """Return whether a folder is a Zarr array or group."""
    return path.is_dir() and any((path / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup"))


class Pages:
    """Pages of a TIFF stack, the last few of which stay decoded.

    Args:
        pages: Function for each page that decodes it.
        size: Bytes of a decoded page.
    """

    def __init__(self, pages: Sequence[Callable[[], NDArray[Any]]], size: int) -> None:
        self._pages, self._most = pages, max(2, CHUNK_CACHE // max(size, 1))
        self._kept: OrderedDict[int, NDArray[Any]] = OrderedDict()
        self._lock = Lock()

    def read(self, start: Box, stop: Box) -> NDArray[Any]:
        """Return a box of the stack."""
        return np.stack([self._page(z)[start[1] : stop[1], start[2] : stop[2]] for z in range(start[0], stop[0])])

    def _page(self, number: int) -> NDArray[Any]:
        with self._lock:  # a file has one position, which threads would move under each other
            if number not in self._kept:
                self._kept[number] = self._pages[number]()
                while len(self._kept) > self._most:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(number)
            return self._kept[number]


def open_tiff(path: Path) -> ChunkedSource | None:
    """Open a TIFF file of many pages, or a folder of files with one page each.

    Returns:
        The volume; None for compressions that tifffile does not decode by itself: the reader for volumes in memory
        knows more.

    Raises:
        BadInput: A file is damaged, or pages differ in size or type.
    """
    import tifffile

    files = in_order(path) if path.is_dir() else [path]
    try:
        if path.is_dir():
            with tifffile.TiffFile(files[0]) as first:
                page = first.pages[0]
            readers: list[Callable[[], Any]] = [partial(tifffile.imread, file) for file in files]
        else:
            opened = tifffile.TiffFile(path)
            pages = list(opened.pages)
            page = pages[0]
            readers = [partial(p.asarray) for p in pages]
            if len({(p.shape, p.dtype) for p in pages}) != 1:
                raise BadInput(f"{path} is not a volume: a TIFF stack needs greyscale pages of the same size.")
        if int(page.compression) not in TIFFFILE_DECODES or len(page.shape) != 2:
            return None
    except (OSError, ValueError, IndexError, tifffile.TiffFileError) as error:
        raise BadInput(f"Cannot read {path}: it is damaged, incomplete, or not a TIFF stack.") from error
    size = int(np.prod(page.shape)) * np.dtype(page.dtype).itemsize
    level = level_of((len(readers), *page.shape), np.eye(3), np.zeros(3), path.name)
    source = ChunkedSource(path.name, [Pages(readers, size).read], page.dtype, [level])
    if not path.is_dir():
        finalize(source, opened.close)
    return source
