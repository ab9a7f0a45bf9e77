"""Volumes whose files can be mapped into memory: raw data, VTK XML image data, and NumPy arrays.

A box is copied from the map when it is needed; the system reads the pages that this touches, and drops them when
memory is short. The pages count as memory of the process until then, so the map lets go of them from time to time.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element
from zipfile import ZipFile

import numpy as np
from numpy.typing import DTypeLike, NDArray

from svv.bricks.formats.source import ArraySource, Box
from svv.core.xml_values import parsed_xml
from svv.errors import BadInput
from svv.io.files.memory import memory_there

KEPT = 16 << 20
"""Bytes read from a map after which its pages are let go."""

MOST_HEADER = 1 << 20
"""Bytes at the beginning of a file in which a header must end."""

RAW_TYPES = {
    "uchar": "uint8", "char": "int8", "ushort": "uint16", "short": "int16", "uint": "uint32", "int": "int32",
    "float": "float32", "double": "float64", "half": "float16",
}  # fmt: skip
"""C types that may occur in the names of raw files, besides NumPy's own type names."""

BIG, LITTLE = ("be", "bigendian", "msb"), ("le", "littleendian", "lsb")
ORDERS: dict[str, Literal["<", ">"]] = {**dict.fromkeys(BIG, ">"), **dict.fromkeys(LITTLE, "<")}
"""Orders of bytes that may occur in the names of raw files."""

XML_TYPES = {
    "UInt8": "u1", "Int8": "i1", "UInt16": "u2", "Int16": "i2", "UInt32": "u4", "Int32": "i4", "UInt64": "u8",
    "Int64": "i8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
"""Types of VTK XML files."""


class MappedSource(ArraySource):
    """A volume mapped into memory from a file."""

    _read_bytes = 0

    def read(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box; see :meth:`svv.bricks.formats.source.Source.read`."""
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
        axes: See :class:`svv.bricks.formats.source.Level`. (3, 3)
        origin: World position of the first voxel.

    Raises:
        BadInput: The file is shorter than its header says.
    """
    dtype = np.dtype(kind)
    needed, there = offset + int(np.prod(shape, dtype=object)) * dtype.itemsize, file.stat().st_size
    if there < needed:
        raise too_short(file, there, needed, shape[::-1], dtype)
    if min(shape) < 1 or offset < 0:
        raise BadInput(f"Cannot read {file}: its header is damaged.")
    values = np.memmap(file, dtype, "r", offset, tuple(shape))
    return MappedSource(values, np.asarray(axes, float), np.asarray(origin, float), file.name)


def too_short(file: Path, there: int, needed: int, sides: Sequence[int], dtype: np.dtype[np.generic]) -> BadInput:
    """Return the error to raise for a file that is shorter than its header says."""
    size = " x ".join(str(side) for side in sides)
    return BadInput(
        f"{file} has {there} bytes, but {size} voxels of {dtype.name} need {needed}: it is damaged or cut off."
    )


def raw_layout(
    file: Path, dims: Sequence[int] | None, dtype: DTypeLike | None
) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    """Return the number of voxels along x, y, z of a raw file and their type, if not given by its name.

    Raises BadInput if they are not known, or do not match the file's size.
    """
    name = file.name.lower()
    found = re.search(r"(\d+)x(\d+)x(\d+)", name)
    size = [int(d) for d in dims] if dims is not None else [int(d) for d in found.groups()] if found else []
    if len(size) != 3:
        check_no_text(file)
        raise BadInput(f"{file} is raw data: give its dimensions (nx, ny, nz), or name it foo_64x64x64_uint8.raw.")
    kinds = "|".join(["u?int(?:8|16|32|64)", "float(?:16|32|64)", *RAW_TYPES])
    orders = "|".join(ORDERS)
    named = re.search(rf"(?:^|[_.\-])({kinds})(?=(?:{orders})?[_.\-])", name)
    if dtype is None and named is None:
        check_no_text(file)
        raise BadInput(f"{file} is raw data: give its type (uint8, int16, float32 ...), or include it in the name.")
    text = dtype if dtype is not None else RAW_TYPES.get(named.group(1), named.group(1))  # type: ignore[union-attr]
    try:
        kind = np.dtype(RAW_TYPES.get(text, text) if isinstance(text, str) else text)
    except TypeError:
        raise BadInput(f"'{dtype}' is not a numeric type; use uint8, int16, float32, >u2 ...") from None
    order = re.search(rf"(?:[_.\-]|[_.\-](?:{kinds}))({orders})(?=[_.\-])", name)
    told = text[:1] in ("<", ">", "=") if isinstance(text, str) else not kind.isnative
    if order is not None and not told:
        kind = kind.newbyteorder(ORDERS[order.group(1)])
    expected, there = int(np.prod(size, dtype=object)) * kind.itemsize, file.stat().st_size
    if min(size) < 1 or expected != there:
        shape = " x ".join(str(d) for d in size)
        raise BadInput(f"{file} has {there} bytes, but {shape} voxels of {kind.name} are {expected} bytes.")
    return tuple(size), kind


def first_text(file: Path) -> bytes | None:
    """Return the first 4096 bytes of a file if they are text, which raw data hardly is."""
    with file.open("rb") as opened:
        head = opened.read(4096)
    return head if b"\n" in head and re.fullmatch(rb"[\t\n\r\x20-\x7e\xa0-\xff]*", head) else None


def is_tecplot(file: Path) -> bool:
    """Return whether a file is text of Tecplot, whose files end in .dat as raw ones may."""
    head = first_text(file)
    return head is not None and re.search(rb"(?i)^\s*(?:title|variables|zone)\b", head) is not None


def check_no_text(file: Path) -> None:
    """Raise BadInput if a file is text, such as a header of another file with the values."""
    head = first_text(file)
    if head is None:
        return
    if re.search(rb"(?im)^[ \t]*data_file[ \t]*:", head):
        raise BadInput(f"{file} is a BOV header, not raw data: give it a name that ends in .bov.")
    raise BadInput(f"{file} is text, not raw data: if it is the header of a file with the values, name that one.")


def open_npy(file: Path) -> MappedSource:
    """Open a NumPy file; raises BadInput if it is damaged, or not an array of numbers."""
    try:
        values = np.load(file, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a damaged header makes NumPy raise all kinds of errors
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or not an array of numbers.") from error
    return MappedSource(values, name=file.name)


def open_npz(file: Path, array: str | None) -> ArraySource:
    """Open an array of three axes in an archive of NumPy's, which is decoded as a whole.

    Raises BadInput if it is damaged, has no such array, several of which none is named, or one that memory cannot hold.
    """
    try:
        with ZipFile(file) as archive:
            members = {name.removesuffix(".npy"): name for name in archive.namelist() if name.endswith(".npy")}
            found = {name: _npy_header(archive, member) for name, member in members.items()}
            volumes = [name for name, (shape, _) in found.items() if len(shape) == 3 and array in (None, name)]
            if len(volumes) != 1:
                said = f"no volume '{array}'" if array else "several volumes" if volumes else "no array with three axes"
                listed = ", ".join(f"{name} {shape}" for name, (shape, _) in found.items()) or "none"
                raise BadInput(f"{file} has {said}; its arrays: {listed}. Choose one with --array.")
            shape, kind = found[volumes[0]]
            if int(np.prod(shape, dtype=object)) * kind.itemsize > memory_there():
                raise BadInput(f"{volumes[0]} in {file} needs more memory than this computer or container has.")
            with archive.open(members[volumes[0]]) as member:
                return ArraySource(np.lib.format.read_array(member, allow_pickle=False), name=file.name)
    except BadInput:
        raise
    except Exception as error:  # a damaged archive makes zipfile and NumPy raise all kinds of errors
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or holds no arrays of numbers.") from error


def _npy_header(archive: ZipFile, name: str) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    """Return the shape and the type of an array in an archive."""
    with archive.open(name) as member:
        is_first = np.lib.format.read_magic(member) == (1, 0)
        read = np.lib.format.read_array_header_1_0 if is_first else np.lib.format.read_array_header_2_0
        shape, _, kind = read(member)
    return shape, kind


def open_vti(file: Path, array: str | None) -> MappedSource | None:
    """Open a VTK XML image file; None unless its values are stored as they are, in one piece, without blanking.

    As they are: as raw appended data that is not compressed. Raises BadInput if the header is damaged, there is no such
    array, or the data is cut off.
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
        blanked = any(
            data.get("Name") == "vtkGhostType" for data in root.iter("DataArray")
        )  # points that are not shown
        if grid is None or len(pieces) != 1 or root.get("compressor") or blanked:
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
        if data.attrib["type"] == "Bit":
            return None
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

    Without a name it is the active one, as for :func:`svv.dvr.read.grids.pick_scalars`, which chooses among VTK's
    arrays. Raises BadInput if there is no array of this name.
    """
    there: list[tuple[Element, bool]] = []
    wanted: list[tuple[Element, bool]] = []
    for place, on_cells in (("PointData", False), ("CellData", True)):
        group = piece.find(place)
        arrays = [] if group is None else [(data, on_cells) for data in group.iterfind("DataArray")]
        active = None if group is None else group.get("Scalars")
        there += arrays
        single = [e for e in arrays if e[0].get("NumberOfComponents", "1") == "1"]
        wanted += sorted(single, key=lambda e: e[0].get("Name") != active)
    if array is not None and not any(data.get("Name") == array for data, _ in there):
        names = ", ".join(str(data.get("Name")) for data, _ in there) or "none"
        raise BadInput(f"{name} has no array '{array}'; it has {names}.")
    named = [e for e in wanted if array in (None, e[0].get("Name"))]
    return named[0] if named and named[0][0].get("format") == "appended" else None
