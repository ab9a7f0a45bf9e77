"""Volumes whose files can be mapped into memory: raw data, MetaImage, VTK XML image data, and NumPy arrays.

A box is copied from the map when it is needed; the system reads the pages that this touches, and drops them when
memory is short. The pages count as memory of the process until then, so the map lets go of them from time to time.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import DTypeLike, NDArray

from svv.bricks.source import ArraySource, Box
from svv.core.xml_values import parsed_xml
from svv.errors import BadInput
from svv.io.atomic import is_file

KEPT = 16 << 20
"""Bytes read from a map after which its pages are let go."""

MOST_HEADER = 1 << 20
"""Bytes at the beginning of a file in which a header must end."""

RAW_TYPES = {
    "uchar": "uint8", "char": "int8", "ushort": "uint16", "short": "int16", "uint": "uint32", "int": "int32",
    "float": "float32", "double": "float64", "half": "float16",
}  # fmt: skip
"""C types that may occur in the names of raw files, besides NumPy's own type names."""

META_TYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4", "MET_INT": "i4",
    "MET_ULONG_LONG": "u8", "MET_LONG_LONG": "i8", "MET_FLOAT": "f4", "MET_DOUBLE": "f8",
}  # fmt: skip
"""Types of MetaImage files."""

XML_TYPES = {
    "UInt8": "u1", "Int8": "i1", "UInt16": "u2", "Int16": "i2", "UInt32": "u4", "Int32": "i4", "UInt64": "u8",
    "Int64": "i8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
"""Types of VTK XML files."""


class MappedSource(ArraySource):
    """A volume mapped into memory from a file."""

    _read_bytes = 0

    def read(self, level: int, start: Box, stop: Box) -> NDArray[Any]:
        """Read a box; see :meth:`svv.bricks.source.Source.read`."""
        try:
            box = super().read(level, start, stop)
        except OSError as error:
            raise BadInput(f"Cannot read {self.name}: {error.strerror or error}.") from error
        self._read_bytes += box.nbytes
        if self._read_bytes > KEPT:
            self._read_bytes = 0
            pages = getattr(self._values, "_mmap", None)
            if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
                pages.madvise(mmap.MADV_DONTNEED)
        return box


def mapped(
    file: Path, offset: int, kind: DTypeLike, shape: Sequence[int], axes: NDArray[np.float64], origin: Sequence[float]
) -> MappedSource:
    """Map a file that contains values of type ``kind`` from the byte ``offset``.

    Args:
        file: The file.
        offset: Position of the first value.
        kind: Type as stored.
        shape: Voxels along z, y, x.
        axes: See :class:`svv.bricks.source.Level`. (3, 3)
        origin: World position of the first voxel.

    Raises:
        BadInput: The file is shorter than its header says.
    """
    dtype = np.dtype(kind)
    needed, there = offset + int(np.prod(shape, dtype=object)) * dtype.itemsize, file.stat().st_size
    if there < needed:
        size = " x ".join(str(side) for side in reversed(shape))
        raise BadInput(
            f"{file} has {there} bytes, but {size} voxels of {dtype.name} need {needed}: it is damaged or cut off."
        )
    if min(shape) < 1 or offset < 0:
        raise BadInput(f"Cannot read {file}: its header is damaged.")
    values = np.memmap(file, dtype, "r", offset, tuple(shape))
    return MappedSource(values, np.asarray(axes, float), np.asarray(origin, float), file.name)


def raw_layout(
    file: Path, dims: Sequence[int] | None, dtype: DTypeLike | None
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the number of voxels along x, y, z of a raw file and their type, if not given by its name.

    Raises:
        BadInput: They are not known, or do not match the file's size.
    """
    name = file.name.lower()
    found = re.search(r"(\d+)x(\d+)x(\d+)", name)
    size = [int(d) for d in dims] if dims is not None else [int(d) for d in found.groups()] if found else []
    if len(size) != 3:
        raise BadInput(f"{file} is raw data: give its dimensions (nx, ny, nz), or name it foo_64x64x64_uint8.raw.")
    kinds = "|".join(["u?int(?:8|16|32|64)", "float(?:16|32|64)", *RAW_TYPES])
    named = re.search(rf"(?:^|[_.\-])({kinds})(?=[_.\-])", name)
    if dtype is None and named is None:
        raise BadInput(f"{file} is raw data: give its type (uint8, int16, float32 ...), or include it in the name.")
    text = dtype if dtype is not None else RAW_TYPES.get(named.group(1), named.group(1))  # type: ignore[union-attr]
    try:
        kind = np.dtype(RAW_TYPES.get(text, text) if isinstance(text, str) else text)
    except TypeError:
        raise BadInput(f"'{dtype}' is not a numeric type; use uint8, int16, float32, >u2 ...") from None
    expected, there = int(np.prod(size, dtype=object)) * kind.itemsize, file.stat().st_size
    if min(size) < 1 or expected != there:
        shape = " x ".join(str(d) for d in size)
        raise BadInput(f"{file} has {there} bytes, but {shape} voxels of {kind.name} are {expected} bytes.")
    return tuple(size), kind


def open_npy(file: Path) -> MappedSource:
    """Open a NumPy file.

    Raises:
        BadInput: It is damaged, or not an array of numbers.
    """
    try:
        values = np.load(file, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a damaged header makes NumPy raise all kinds of errors
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or not an array of numbers.") from error
    return MappedSource(values, name=file.name)


def open_meta(file: Path) -> MappedSource | None:
    """Open a MetaImage file, ``.mhd`` or ``.mha``; None if its data is compressed or in several files.

    Raises:
        BadInput: The header is damaged, or the data is cut off.
    """
    with file.open("rb") as opened:
        head = opened.read(MOST_HEADER)
    # The last line of the header names the file with the data; in the same file, the data follows.
    end = re.search(rb"^\s*ElementDataFile\s*=\s*(.*?)\s*$", head, re.MULTILINE)
    if end is None:
        raise BadInput(f"Cannot read {file}: its header has no ElementDataFile.")
    lines = head[: end.start()].decode("latin-1").splitlines()
    fields = {key.strip(): value.strip() for key, sign, value in (line.partition("=") for line in lines) if sign}
    target = end[1].decode("latin-1")
    packed = fields.get("CompressedData", "False").lower() == "true"
    if packed or target.split(" ")[0] == "LIST" or "%" in target or fields.get("ElementNumberOfChannels", "1") != "1":
        return None
    try:
        dims = [int(n) for n in fields["DimSize"].split()]
        spacing = _numbers(fields, ("ElementSpacing", "ElementSize"), "1 1 1")
        axes = np.array(_numbers(fields, ("TransformMatrix", "Rotation", "Orientation"), "1 0 0 0 1 0 0 0 1"))
        origin = _numbers(fields, ("Offset", "Position", "Origin"), "0 0 0")
        msb = next((fields[k] for k in ("BinaryDataByteOrderMSB", "ElementByteOrderMSB") if k in fields), "False")
        kind = np.dtype(META_TYPES[fields["ElementType"]]).newbyteorder(">" if msb.lower() == "true" else "<")
        with np.errstate(all="ignore"):  # what is not finite is rejected below
            turned = axes.reshape(3, 3) * spacing  # the rows of VTK's direction matrix; ITK takes them for the axes
        skipped = int(fields.get("HeaderSize", "0"))
    except (KeyError, ValueError) as error:
        raise BadInput(f"Cannot read {file}: its header is damaged ({error}).") from error
    if len(dims) != 3:
        return None
    data = file if target.upper() == "LOCAL" else file.parent / target
    if not is_file(data):
        raise BadInput(f"{file} refers to {data}, which does not exist.")
    count = int(np.prod(dims, dtype=object)) * kind.itemsize
    offset = end.end() + 1 if data == file else data.stat().st_size - count if skipped < 0 else skipped
    if data == file and head[end.end() : end.end() + 1] == b"\r":
        offset += 1
    return mapped(data, max(offset, 0), kind, dims[::-1], turned, origin)


def _numbers(fields: Mapping[str, str], keys: Sequence[str], default: str) -> list[float]:
    return [float(x) for x in next((fields[key] for key in keys if key in fields), default).split()]


def open_vti(file: Path, array: str | None) -> MappedSource | None:
    """Open a VTK XML image file; None unless its values are stored as they are (raw appended data, one piece).

    Raises:
        BadInput: The header is damaged, there is no such array, or the data is cut off.
    """
    with file.open("rb") as opened:
        head = opened.read(MOST_HEADER)
    begin = re.search(rb'<AppendedData\s+encoding="raw"\s*>\s*_', head)
    if begin is None:
        return None
    try:
        root = parsed_xml(head[: begin.start()] + b"</VTKFile>")
        grid = root.find("ImageData")
        pieces = [] if grid is None else grid.findall("Piece")
        if grid is None or len(pieces) != 1 or root.get("compressor"):
            return None
        extent = [int(n) for n in pieces[0].attrib["Extent"].split()]
        if [int(n) for n in grid.attrib["WholeExtent"].split()] != extent:
            return None
        spacing = [float(x) for x in grid.attrib.get("Spacing", "1 1 1").split()]
        axes = np.array([float(x) for x in grid.attrib.get("Direction", "1 0 0 0 1 0 0 0 1").split()]).reshape(3, 3)
        origin = [float(x) for x in grid.attrib.get("Origin", "0 0 0").split()]
        chosen = _data_array(pieces[0], array, file.name)
        if chosen is None:
            return None
        data, on_cells = chosen
        kind = np.dtype((">" if root.get("byte_order") == "BigEndian" else "<") + XML_TYPES[data.attrib["type"]])
        length = np.dtype({"UInt32": "u4", "UInt64": "u8"}[root.get("header_type", "UInt32")]).itemsize
        offset = begin.end() + int(data.attrib["offset"]) + length
        if offset < begin.end() + length:
            raise ValueError("values begin before the data")
    except (KeyError, ValueError) as error:
        raise BadInput(f"Cannot read {file}: its header is damaged ({error}).") from error
    if len(extent) != 6 or len(spacing) != 3 or len(origin) != 3:
        raise BadInput(f"Cannot read {file}: its extent, spacing or origin is damaged.")
    with np.errstate(all="ignore"):  # what is not finite is rejected below
        steps = axes * spacing
    dims = [extent[2 * i + 1] - extent[2 * i] + (0 if on_cells else 1) for i in range(3)]
    first = np.array(extent[::2], np.float64) + (0.5 if on_cells else 0.0)  # cells' values are at their centres
    with np.errstate(all="ignore"):
        place = origin + steps @ first
    return mapped(file, offset, kind, dims[::-1], steps, place.tolist())


def _data_array(piece: Element, array: str | None, name: str) -> tuple[Element, bool] | None:
    """Return the array with one component that is shown, and whether it belongs to cells; None if it is not appended.

    Raises:
        BadInput: There is no array of this name.
    """
    there = [(data, False) for data in piece.iterfind("PointData/DataArray")]
    there += [(data, True) for data in piece.iterfind("CellData/DataArray")]
    wanted = [e for e in there if array in (None, e[0].get("Name")) and e[0].get("NumberOfComponents", "1") == "1"]
    if array is not None and not any(data.get("Name") == array for data, _ in there):
        names = ", ".join(str(data.get("Name")) for data, _ in there) or "none"
        raise BadInput(f"{name} has no array '{array}'; it has {names}.")
    return wanted[0] if wanted and wanted[0][0].get("format") == "appended" else None
