"""TIFF files with volumes: stacks of ImageJ, OME-TIFF, tifffile's own, plain pages, and folders of slices.

tifffile tells which image a file holds, and what its axes are.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.axes import Choice, Pick, picked
from svv.bricks.formats.chunked import CHUNK_CACHE, PACKED, ChunkedSource
from svv.bricks.formats.mapped import MappedSource
from svv.bricks.formats.places import no_size
from svv.bricks.formats.source import ArraySource, Box, Level, Source, level_of
from svv.bricks.formats.stored import Scaled, damaged
from svv.bricks.formats.tiff_files import (
    axes_of_names,
    calibration,
    in_order,
    names_of_channels,
    shape_of_pixels,
    unsized,
    voxel_size,
)
from svv.bricks.formats.tiff_packings import by_pillow, decodes_pages, no_unpacker, with_libtiff
from svv.errors import BadInput

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffFrame, TiffPage, TiffPageSeries

COMPOSITE = 7
"""Most channels of a picture in ImageJ. tifffile calls the slices of a volume channels if nobody names its axes."""


class Pages:
    """Pages of a TIFF stack, the last few of which stay decoded.

    Args:
        pages: Function for each page that decodes it.
        size: Bytes of a decoded page.
    """

    def __init__(self, pages: Sequence[Callable[[], NDArray[np.generic]]], size: int) -> None:
        self._pages, self._most = pages, max(2, CHUNK_CACHE // max(size, 1))
        self._kept: OrderedDict[int, NDArray[np.generic]] = OrderedDict()
        self._lock = Lock()

    def read(self, start: Box, stop: Box) -> NDArray[np.generic]:
        """Return a box of the stack."""
        return np.stack([self._page(z)[start[1] : stop[1], start[2] : stop[2]] for z in range(start[0], stop[0])])

    def _page(self, number: int) -> NDArray[np.generic]:
        with self._lock:  # a file has one position, which threads would move under each other
            if number not in self._kept:
                self._kept[number] = self._pages[number]()
                while len(self._kept) > self._most:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(number)
            return self._kept[number]


class _Complaints(logging.Handler):
    """A handler that keeps what tifffile logs, because it logs errors instead of raising them."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


@contextmanager
def _opened(file: Path) -> Iterator[tuple[TiffFile, _Complaints]]:
    """Open a file with tifffile, which stays open unless something is wrong with it: that becomes one sentence."""
    import tifffile  # only here: it is slow to import

    listener, opened = _Complaints(), None
    logger = tifffile.logger()
    logger.addHandler(listener)
    with_libtiff()
    try:
        opened = tifffile.TiffFile(file)
        yield opened, listener
    except Exception as error:  # damaged files make the decoders raise all kinds of errors
        if opened is not None:
            opened.close()
        if isinstance(error, BadInput):
            raise
        raise damaged(file) from error
    finally:
        logger.removeHandler(listener)


def open_tiff(path: Path, choice: Choice = Choice(), array: str | None = None, whole: bool = False) -> Source | None:  # noqa: B008 - frozen
    """Open a TIFF file, or a folder of files with a slice each.

    Args:
        path: The file or folder.
        choice: The channel and the time point that are shown.
        array: Number or name of an image, if the file holds several.
        whole: Decode it here and now if no boxes of it can be read otherwise.

    Returns:
        The volume; None if no boxes of it can be read and ``whole`` is not set.

    Raises:
        BadInput: A file is damaged or holds no volume, several images, or several channels or time points of which none
            is chosen.
    """
    if path.is_dir():
        return _open_folder(path, choice, whole)
    with _opened(path) as (opened, complaints):
        list(opened.pages)  # in a truncated file, they end with only a log message
        if any("invalid page offset" in text for text in complaints.said):
            raise damaged(path)
        series = _series(opened.series, array, path)
        axes = _axes(series, path)
        names = names_of_channels(opened, series, axes)
        pick = picked(axes, series.shape, choice, path.name, names)
        size = voxel_size(opened, series, path.name)
        sides = pick.sides(series.shape)
        level = level_of(sides, np.diag(size), np.zeros(3), path.name)
        scale = calibration(opened, series.dtype, path.name)
        source = _read(path, opened, series, pick, level, whole, scale)
        without = unsized(opened, series)
    if source is None:
        opened.close()
    else:
        source.assumed = _assumed(no_size(path.name, without, size) if without else None, scale)
        finalize(source, opened.close)
    return source


def _read(
    path: Path,
    opened: TiffFile,
    series: TiffPageSeries,
    pick: Pick,
    level: Level,
    whole: bool,
    scale: tuple[float, float],
) -> Source | None:
    _check_complete(path, series)
    if series.dataoffset is not None and series.keyframe.compression == 1:
        kind = np.dtype(series.dtype).newbyteorder(opened.byteorder)
        if path.stat().st_size < series.dataoffset + int(np.prod(series.shape, dtype=object)) * kind.itemsize:
            raise damaged(path)
        values = np.memmap(path, kind, "r", series.dataoffset, tuple(series.shape))
        if scale == (1.0, 0.0):
            return MappedSource(pick.of(values), level.axes, level.origin, path.name)
        return Scaled(pick.of(values), level.axes, level.origin, path.name, scale)
    plain = decodes_pages(path, series.keyframe)
    if not series.is_multifile and series.keyframe.axes == "YX" and series.axes.endswith("YX") and (plain or whole):
        numbers = np.arange(len(series.pages)).reshape(series.shape[:-2])[..., None, None]
        listed = pick.of(numbers).ravel()
        pages = [_page(path, series.pages[int(k)]) for k in listed]
        size = int(np.prod(series.keyframe.shape)) * np.dtype(series.dtype).itemsize
        return ChunkedSource(path.name, [Pages(pages, size).read], series.dtype, [level], _scaled(scale))
    if not whole:
        return None
    if not plain:
        raise no_unpacker(path, series.keyframe)
    decoded = pick.of(series.asarray())
    if scale == (1.0, 0.0):
        return ArraySource(decoded, level.axes, level.origin, path.name)
    return Scaled(decoded, level.axes, level.origin, path.name, scale)


def _assumed(size: str | None, scale: tuple[float, float]) -> str | None:
    """Return what is said of the size of a voxel and of calibrated values."""
    applied = f"ImageJ's calibration of values is applied: {scale[0]:g} x stored {scale[1]:+g}."
    return " ".join(filter(None, [size, applied if scale != (1.0, 0.0) else None])) or None


def _scaled(scale: tuple[float, float]) -> dict[str, float]:
    """Return gain and shift as the attributes that tell them to a :class:`ChunkedSource`."""
    return dict(zip(PACKED, scale))


def _page(path: Path, page: TiffPage | TiffFrame | None) -> Callable[[], NDArray[np.generic]]:
    """Return a function that decodes a page."""
    assert page is not None  # what is not complete was refused
    return page.asarray if decodes_pages(path, page) else partial(by_pillow, path, page)


def _check_complete(path: Path, series: TiffPageSeries) -> None:
    """Raise BadInput if pages are missing, or the file ends before their data does."""
    missing = sum(page is None for page in series.pages)
    if missing:
        raise BadInput(f"{path} lacks {missing} of the {len(series.pages)} slices that it announces: it is incomplete.")
    if series.is_multifile:
        return
    pages = [page for page in series.pages if page is not None and hasattr(page, "dataoffsets")]
    ends = [a + b for page in pages for a, b in zip(page.dataoffsets, page.databytecounts)]
    if path.stat().st_size < max(ends, default=0):
        raise damaged(path)


def _series(there: Sequence[TiffPageSeries], array: str | None, path: Path) -> TiffPageSeries:
    """Return the image that is shown: the only volume, or the one that is asked for by number or name."""
    if array is not None and len(there) > 1:
        chosen = [s for k, s in enumerate(there) if array in (str(k), s.name)]
        if len(chosen) == 1:
            return chosen[0]
    several = [s for s in there if len(s.pages) > 1 or len(s.shape) > 2]
    # A single page beside a stack is a label or a thumbnail, unless its size says that it is a slice of another kind.
    slices = [s for s in there if s not in several and several and tuple(s.shape) == tuple(several[0].shape[-2:])]
    if len(there) == 1 or (len(several) == 1 and not slices and array is None and len(there[0].pages) > 1):
        return several[0] if several else there[0]
    listed = ", ".join(f"{k} {s.name}".strip() + f" ({' x '.join(map(str, s.shape))})" for k, s in enumerate(there))
    raise BadInput(
        f"{path} is not a volume: a TIFF stack needs greyscale pages of the same size. It holds {len(there)} images "
        f"({listed[:300]}): choose one of them with --array, by its number."
    )


def _axes(series: TiffPageSeries, path: Path) -> list[str]:
    """Return a name for each axis of an image; see :func:`svv.bricks.formats.axes.picked`."""
    names = [{"E": "c", "S": "s"}.get(axis, axis.lower() if axis in "TCZYX" else axis) for axis in series.axes]
    if "s" in names:
        if "c" in names or series.shape[names.index("s")] > 1:
            names[names.index("s")] = "c" if "c" not in names else "sample"
    if "z" in names:
        return names
    free = [k for k, name in enumerate(names) if name not in "tyx" and name != "c" and series.shape[k] > 1]
    if len(free) == 1:
        names[free[0]] = "z"
    elif not free and "t" not in names and "c" in names and "s" not in series.axes.lower():
        slices = names.index("c")
        if series.shape[slices] > COMPOSITE:
            names[slices] = "z"
    if "z" not in names and len(names) > 2 and not free:
        word = {"c": "channels", "t": "time points"}
        there = " and ".join(f"{n} {word[name]}" for n, name in zip(series.shape, names) if name in word)
        raise BadInput(
            f"{path} is not a volume: a TIFF stack needs greyscale pages of the same size. It says that it has "
            f"{there} of single slices; if they are the slices of a volume, say so where it is "
            "written: axes ZYX in tifffile, Image > Properties in ImageJ."
        )
    return names


def _open_folder(folder: Path, choice: Choice, whole: bool) -> Source | None:
    files = in_order(folder)
    if not files:
        raise BadInput(f"The folder {folder} contains no .tif slices; a volume is one file or a folder of slices.")
    with _opened(files[0]) as (first, _):
        series = first.series[0]
        page, count, spread = first.pages[0], len(first.pages), first.is_ome and series.is_multifile
        voxel, scale = shape_of_pixels(series.keyframe), calibration(first, page.dtype, folder.name)
        first.close()
    if spread or len(files) == 1:  # one image in all these files, of which each tells the place
        return open_tiff(files[0], choice, None, whole)
    if count > 1:
        raise BadInput(f"{files[0]} holds {count} pages, not one slice: name the file that you want, not its folder.")
    axes, shape = axes_of_names(files)
    pick = picked([*axes, "y", "x"], [*shape, *page.shape[:2]], choice, folder.name)
    files = [files[k] for k in pick.of(np.arange(len(files)).reshape(*shape, 1, 1)).ravel()]
    if not (decodes_pages(files[0], page) or whole):
        return None
    if len(page.shape) != 2:
        raise BadInput(f"{files[0]} is not a slice of a volume: a TIFF stack needs greyscale pages of the same size.")
    readers = [_slice(file, files[0], page, scale) for file in files]
    size = int(np.prod(page.shape)) * np.dtype(page.dtype).itemsize
    level = level_of((len(readers), *page.shape), np.diag(voxel), np.zeros(3), folder.name)
    said, pages = _assumed(no_size(folder.name, sizes=voxel), scale), Pages(readers, size)
    return ChunkedSource(folder.name, [pages.read], page.dtype, [level], _scaled(scale), assumed=said)


def _slice(
    file: Path, first: Path, like: TiffPage | TiffFrame, scale: tuple[float, float]
) -> Callable[[], NDArray[np.generic]]:
    """Return a function that decodes a file with one page, which has to be like another and be calibrated alike."""

    def decoded() -> NDArray[np.generic]:
        with _opened(file) as (opened, _):
            pages = list(opened.pages)
            if len(pages) != 1 or pages[0].shape != like.shape or pages[0].dtype != like.dtype:
                raise BadInput(f"{file} differs in size from {first.name}; all slices must have the same size.")
            if calibration(opened, like.dtype, file.name) != scale:
                raise BadInput(f"{file} has values that ImageJ calibrates otherwise than those of {first.name}.")
            values = _page(file, pages[0])()
            opened.close()
            return values

    return decoded
