"""TIFF files with volumes: stacks of ImageJ, OME-TIFF, tifffile's own, plain pages, and folders of slices.

tifffile tells which image a file holds, and what its axes are. It undoes few packings without the package imagecodecs.
Pillow's libtiff knows more, but Pillow makes pictures of what it reads: it turns values of white-is-zero pages round,
spreads 2 and 4 bits over 8, and turns pages upright. So bytes are unpacked by libtiff alone, as a page of plain bytes,
and tifffile makes of them what the file says.

Source: TIFF 6.0, sections 13 and 14; Adobe Photoshop TIFF Technical Note 3 (the predictor of real numbers).
"""

from __future__ import annotations

import io
import logging
import re
import struct
from collections import ChainMap, OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any
from weakref import finalize
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import DTypeLike, NDArray
from PIL import Image, UnidentifiedImageError

from svv.bricks.formats.axes import Choice, Pick, in_one_unit, picked
from svv.bricks.formats.chunked import CHUNK_CACHE, PACKED, ChunkedSource
from svv.bricks.formats.mapped import MappedSource
from svv.bricks.formats.places import no_size
from svv.bricks.formats.source import ArraySource, Box, Level, Source, level_of
from svv.bricks.formats.stored import Scaled, damaged
from svv.core.xml_values import parsed_xml
from svv.errors import BadInput

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffFrame, TiffPage, TiffPageSeries

LZW, ZSTD = 5, 50000
"""Numbers of the packings of bytes that libtiff undoes and tifffile does not."""

BY_PILLOW = {2: (1,), 3: (1,), 4: (1,), 5: (1,), 6: (8,), 7: (8,), 50000: (1,)}
"""Bits of grey pixels of which Pillow reads whole pages, by the number of the packing: those of faxes, and JPEG."""

WHOLE_BITS = (1, 8, 16, 32, 64)
"""Bits of values that tifffile separates by itself."""


def with_libtiff() -> None:
    """Let tifffile use Pillow's libtiff for what it cannot unpack, unless imagecodecs is installed."""
    import tifffile

    if find_spec("imagecodecs") is None and not isinstance(tifffile.TIFF.DECOMPRESSORS, ChainMap):
        ours: dict[int, Callable[..., Any]] = {number: _unpacker(number) for number in (LZW, ZSTD)}
        tifffile.TIFF.DECOMPRESSORS = ChainMap(ours, tifffile.TIFF.DECOMPRESSORS)  # type: ignore[arg-type]
        tifffile.TIFF.UNPREDICTORS = ChainMap({3: _summed}, tifffile.TIFF.UNPREDICTORS)  # type: ignore[arg-type]


def decodes_pages(path: Path, one: TiffPage | TiffFrame) -> bool:
    """Return whether tifffile decodes pages like one of them; otherwise, :func:`by_pillow` does.

    Raises BadInput if neither does.
    """
    import tifffile

    page = _like(one)
    packing, predictor = int(page.compression), int(page.predictor)
    unpacks = packing == 1 or packing in tifffile.TIFF.DECOMPRESSORS
    adds = predictor == 1 or predictor in tifffile.TIFF.UNPREDICTORS
    if find_spec("imagecodecs") is not None:
        if unpacks and adds:
            return True
    elif page.samplesperpixel == 1 and page.bitspersample in BY_PILLOW.get(packing, ()):
        return False
    elif unpacks and adds and page.bitspersample in WHOLE_BITS:
        return True
    raise no_unpacker(path, page)


def by_pillow(path: Path, page: TiffPage | TiffFrame) -> NDArray[np.generic]:
    """Decode a page of a file by Pillow. (height, width)

    Raises BadInput if Pillow does not read it either.
    """
    try:
        with Image.open(path) as image:
            image.seek(page.index)
            image.getexif().pop(274, None)  # the orientation: pages are read as they are stored
            values = np.asarray(image)
    except UnidentifiedImageError as error:
        raise no_unpacker(path, _like(page)) from error
    if values.shape != page.shape:
        raise BadInput(f"{path} has pages that lie on their side and are packed as pictures: save them upright.")
    return ~values if int(_like(page).photometric) == 0 else values  # Pillow makes white the largest value


def _like(page: TiffPage | TiffFrame) -> TiffPage:
    """Return the page that tells how the pixels of a page are stored: itself, or one that is alike."""
    assert page.keyframe is not None
    return page.keyframe


def no_unpacker(path: Path, page: TiffPage) -> BadInput:
    """Return the error to raise for a file that is packed in a way that cannot be undone here."""
    from tifffile import COMPRESSION

    try:
        how = COMPRESSION(page.compression).name
    except ValueError:
        how = f"the method {int(page.compression)}"
    bits = "" if page.bitspersample in WHOLE_BITS else f" in {page.bitspersample} bits per value"
    how = f"packed by {how}{bits}" if int(page.compression) != 1 else f"stored{bits}"
    return BadInput(
        f"{path} is {how}, which tifffile reads only with the package imagecodecs: pip install imagecodecs, or save "
        "the file without compression or packed by deflate or LZW, in 8, 16 or 32 bits."
    )


def _unpacker(packing: int) -> Callable[..., bytes]:
    """Return a function as tifffile wants it, which unpacks a strip or a tile of ``out`` bytes."""

    def unpacked(data: bytes, *, out: int) -> bytes:
        with Image.open(io.BytesIO(_page_of_bytes(data, packing, out))) as image:
            return image.tobytes()

    return unpacked


def _page_of_bytes(data: bytes, packing: int, size: int) -> bytes:
    """Return a TIFF file of one row of ``size`` grey pixels of 8 bits, which are packed in ``data``."""
    fields = {
        256: size, 257: 1, 258: 8, 259: packing, 262: 1, 273: 8 + 2 + 9 * 12 + 4, 277: 1, 278: 1, 279: len(data),
    }  # fmt: skip
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in fields.items())
    return b"II*\0" + struct.pack("<IH", 8, len(fields)) + entries + bytes(4) + data


def _summed(data: NDArray[np.generic], axis: int = -2, out: object = None) -> NDArray[np.generic]:
    """Undo the predictor of real numbers, which stores the differences of their bytes, the highest bytes first.

    Args:
        data: Rows as they are stored, seen as real numbers in the machine's order of bytes. (..., width, samples)
        axis: The axis of the pixels of a row, which is the last but one.
        out: Not used.
    """
    *before, width, samples = data.shape
    size = data.dtype.itemsize
    stored = np.ascontiguousarray(data).view(np.uint8).reshape(*before, size * width, samples)
    planes = np.cumsum(stored, axis=-2, dtype=np.uint8).reshape(*before, size, width * samples)
    values = np.ascontiguousarray(np.moveaxis(planes, -2, -1)).view(data.dtype.newbyteorder(">"))
    return values.astype(data.dtype).reshape(data.shape)


RESOLUTION_UNITS = {2: "inch", 3: "cm", 4: "mm", 5: "um"}
"""Units of TIFF's resolutions."""

NAMED = {
    **dict.fromkeys(("c", "ch", "chan", "channel", "w", "wavelength"), "c"),
    **dict.fromkeys(("t", "tp", "time", "timepoint"), "t"),
    **dict.fromkeys(("z", "slice", "plane", "layer"), "z"),
}
"""Axes by the words before numbers in names of files."""


def in_order(folder: Path) -> list[Path]:
    """Return the TIFF files of a folder, slice_2 before slice_10, whether or not the numbers are padded."""
    files = [f for f in folder.iterdir() if f.suffix.lower() in (".tif", ".tiff")]
    return sorted(files, key=lambda f: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", f.name)])


def axes_of_names(files: Sequence[Path]) -> tuple[list[str], list[int]]:
    """Return names and lengths of the axes that the numbers in the names of slices stand for, see :func:`in_order`.

    Names such as ``scan_c0_z012.tif`` have a number for the channel and one for the slice. Several numbers that do not
    make a complete grid, such as dates, mean nothing: the slices are a stack in the order of their names.
    """
    parts = [re.split(r"(\d+)", file.stem) for file in files]
    alone = ["z"], [len(files)]
    if len({tuple(part[::2]) for part in parts}) != 1:
        return alone
    fields = [sorted({int(part[k]) for part in parts}) for k in range(1, len(parts[0]), 2)]
    varying = [k for k, values in enumerate(fields) if len(values) > 1]
    shape = [len(fields[k]) for k in varying]
    if len(varying) < 2 or int(np.prod(shape)) != len(files):
        return alone
    words = [re.split(r"[^a-z]+", parts[0][2 * k].lower().rstrip("_-. ="))[-1] for k in varying]
    names = [NAMED.get(word, word or "number") for word in words]
    unknown = [k for k, name in enumerate(names) if name not in "ctz"]
    if "z" not in names and len(unknown) == 1:
        names[unknown[0]] = "z"
    return names, shape


def voxel_size(opened: TiffFile, series: TiffPageSeries, name: str) -> NDArray[np.float64]:
    """Return the size of a voxel along x, y, z as OME-TIFF, ImageJ and tifffile give it, in the unit of x. (3,)

    It is 1 if unknown: TIFF's own resolution says nothing about the distance of slices, so without that it only tells
    how much longer pixels are than wide.

    Args:
        opened: A ``tifffile.TiffFile``.
        series: The image of it.
        name: Name of the file in messages.

    Raises:
        BadInput: The sizes have units that cannot be compared.
    """
    metadata = _read_metadata(opened, series)
    given = [axis for axis in "XYZ" if f"PhysicalSize{axis}" in metadata]
    if given:
        sizes = [float(metadata.get(f"PhysicalSize{axis}", 1.0)) for axis in "XYZ"]
        known = {axis: str(metadata.get(f"PhysicalSize{axis}Unit", "µm")) for axis in given}
        return in_one_unit(sizes, [known.get(axis, known[given[0]]) for axis in "XYZ"], name)
    if opened.is_imagej or "spacing" in metadata or "unit" in metadata:
        return in_one_unit(*_of_imagej(metadata, series.keyframe), name)
    return shape_of_pixels(series.keyframe)


def unsized(opened: TiffFile, series: TiffPageSeries) -> str:
    """Return the axes among x, y, z along which a file tells no size of a voxel.

    ImageJ leaves out a spacing of 1 where pixels have a size.
    """
    metadata = _read_metadata(opened, series)
    given = "".join(axis.lower() for axis in "XYZ" if f"PhysicalSize{axis}" in metadata)
    if given:
        return "".join(axis for axis in "xyz" if axis not in given)
    sizes, _ = _of_resolution(series.keyframe)
    known = opened.is_imagej and sizes[0] not in (0.0, 1.0, 1.0 / 72.0)
    return "" if known or "spacing" in metadata or "unit" in metadata else "xyz"


def _read_metadata(opened: TiffFile, series: TiffPageSeries) -> Mapping[str, Any]:
    """Return what OME, ImageJ or tifffile tell about an image."""
    if series.kind == "ome":
        return _pixels(opened, series).attrib
    if opened.is_imagej:
        return opened.imagej_metadata or {}
    if series.kind == "shaped":  # tifffile's own, with any metadata
        return next((one for one in opened.shaped_metadata or () if _fits(one, series)), {})
    return {}


def _fits(metadata: Mapping[str, Any], series: TiffPageSeries) -> bool:
    """Return whether metadata that tifffile has written belong to an image."""
    return tuple(metadata.get("shape", ())) in (tuple(series.shape), tuple(series.get_shape(squeeze=False)))


def _of_imagej(metadata: Mapping[str, Any], page: TiffPage) -> tuple[list[float], list[str | None]]:
    """Return the sizes along x, y, z, and their units, by the rules of ImageJ's own reader."""
    sizes, unit = _of_resolution(page)
    sizes = [size or 1.0 for size in sizes]
    if "unit" not in metadata and sizes[0] == 1.0 / 72.0:  # a screen's, which means nothing
        sizes = [1.0, 1.0]
    unit = str(metadata.get("unit") or unit)
    other = [str(metadata.get(f"{axis}unit") or unit) for axis in "yz"]
    spacing = abs(float(metadata.get("spacing", 1.0))) or 1.0
    return [*sizes, spacing], [unit, *other]


def shape_of_pixels(page: TiffPage) -> NDArray[np.float64]:
    """Return the size of a voxel along x, y, z, of which a plain page tells only how much longer pixels are. (3,)"""
    (x, y), _ = _of_resolution(page)
    return np.array([1.0, y / x if x and y else 1.0, 1.0])


def _of_resolution(page: TiffPage) -> tuple[list[float], str]:
    """Return the width and height of a pixel by a page's resolution, 0 where it tells none, and their unit."""
    sizes = []
    for tag in ("XResolution", "YResolution"):
        value = page.tags[tag].value if tag in page.tags else (0, 1)
        up, down = (float(x) for x in (value if isinstance(value, tuple) else (value, 1)))
        sizes.append(down / up if up > 0 and down > 0 else 0.0)
    unit_tag = int(page.tags["ResolutionUnit"].value) if "ResolutionUnit" in page.tags else 1
    return sizes, RESOLUTION_UNITS.get(unit_tag, "")


def names_of_channels(opened: TiffFile, series: TiffPageSeries, axes: list[str]) -> list[str]:
    """Return the names of the channels of an OME-TIFF file; nothing unless every channel has one."""
    if "c" not in axes or not opened.is_ome:
        return []
    count = int(series.shape[axes.index("c")])
    channels = (e for e in _pixels(opened, series).iter() if e.tag.rpartition("}")[2] == "Channel")
    names = [str(e.get("Name") or "") for e in channels]
    return names if len(names) == count and all(names) else []


def calibration(opened: TiffFile, kind: DTypeLike, name: str) -> tuple[float, float]:
    """Return gain and shift of the values of an image, as ImageJ calibrates them: gain * stored + shift.

    ImageJ stores signed values of 16 bits, such as those of a CT, as unsigned ones that are 32768 larger, and counts
    from there; it calibrates no real numbers. Function 20 is none.

    Args:
        opened: A ``tifffile.TiffFile``.
        kind: Type of the stored values.
        name: Name of the file in messages.

    Raises:
        BadInput: It is calibrated by something else than a straight line.
    """
    told = (opened.imagej_metadata or {}) if opened.is_imagej else {}
    function, kind = int(told.get("cf", 20)), np.dtype(kind)
    if function == 20 or kind.kind not in "iu" or "c0" not in told:
        return 1.0, 0.0
    if function != 0:
        raise BadInput(
            f"{name} has values that ImageJ calibrates by a curve (its function {function}), which is not reproduced: "
            "convert the image in ImageJ to 32 bits (Image > Type), which applies it, and save that."
        )
    gain = float(told.get("c1", 1.0))
    return gain, float(told["c0"]) + (32768.0 * gain if kind == np.int16 else 0.0)


def _pixels(opened: TiffFile, series: TiffPageSeries) -> Element:
    """Return the element ``Pixels`` of an image of an OME-TIFF file."""
    root = parsed_xml((opened.ome_metadata or "").encode())
    images = [e for e in root.iter() if e.tag.rpartition("}")[2] == "Pixels"]
    numbers = {id(s): k for k, s in enumerate(opened.series)}
    return images[min(numbers.get(id(series), 0), len(images) - 1)]


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
