"""How values lie in files: one or several, compressed or not, as bytes or as text."""

from __future__ import annotations

import bz2
import gzip
import io
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.axes import Choice, picked
from svv.bricks.formats.mapped import MappedSource, too_short
from svv.bricks.formats.places import no_size
from svv.bricks.formats.source import Array, ArraySource, Box, level_of, scaled_type
from svv.errors import BadInput
from svv.io.files.atomic import is_file
from svv.io.files.memory import memory_there


@dataclass(frozen=True, eq=False)
class Stored:
    """A volume as its header describes it.

    Its files hold equal parts of the slowest axis, in their order.
    """

    file: Path
    """The file that was named."""
    files: tuple[Path, ...]
    """The files with the values."""
    dtype: np.dtype[np.generic]
    """Type as stored."""
    shape: tuple[int, ...]
    """Entries along each axis, the slowest first."""
    names: str
    """Name of each axis, see :func:`svv.bricks.formats.axes.picked`; one letter each."""
    axes: Array
    """Steps between voxels along x, y, z, one column each. (3, 3)"""
    origin: Array
    """World position of the first voxel. (3,)"""
    title: str
    """Name of the array, as VTK's reader of the format calls it."""
    encoding: str = "raw"
    """``raw``, ``text``, ``fortran`` (text with Fortran's exponents), ``hex``, ``zlib`` (or gzip), ``bz2`` or ``runs``
    (of AmiraMesh: up to 127 of a byte, or 128 more than the bytes that follow)."""
    start: int = 0
    """Bytes before the stored values, such as those of a header."""
    lines: int = 0
    """Lines that follow them and are left out."""
    offset: int = 0
    """Bytes that are then left out, after decompression; -1 - n: the values end n bytes before the file does."""
    gain: float = 1.0
    """Values are gain * stored + shift."""
    shift: float = 0.0
    gains: tuple[float, ...] = ()
    """Instead of one gain, that of each entry along the slowest axis."""
    channels: tuple[str, ...] = field(default=())
    """Names of the channels, if they are known."""
    is_sized: bool = True
    """Whether the header tells the size of a voxel."""

    @cached_property
    def bytes_each(self) -> int:
        """Number of bytes that the values of one file take."""
        return int(np.prod(self.shape, dtype=object)) * self.dtype.itemsize // len(self.files)

    def mappable(self) -> bool:
        """Return whether the values can be mapped into memory: as they are, in one file."""
        return self.encoding == "raw" and len(self.files) == 1

    def source(self, choice: Choice, whole: bool) -> ArraySource | None:
        """Return the volume for reading.

        Args:
            choice: The channel and the time point that are shown.
            whole: Decode it if it cannot be mapped into memory.

        Returns:
            The volume; None if it cannot be mapped and ``whole`` is not set.

        Raises:
            BadInput: The values are damaged, cut off, or more than memory can hold.
        """
        self._check(whole)
        pick = picked(tuple(self.names), self.shape, choice, self.file.name, self.channels)
        level_of(pick.sides(self.shape), self.axes, self.origin, self.file.name)
        if not (whole or self.mappable()):
            return None
        values = pick.of(self._mapped() if self.mappable() else self._decoded())
        gain = self.gains[pick.fixed[0] or 0] if self.gains else self.gain
        if (gain, self.shift) != (1.0, 0.0):
            source: ArraySource = Scaled(values, self.axes, self.origin, self.file.name, (gain, self.shift))
        else:
            source = MappedSource(values, self.axes, self.origin, self.file.name)
        source.assumed = None if self.is_sized else no_size(self.file.name)
        return source

    def _check(self, whole: bool) -> None:
        if min(self.shape) < 1 or not self.files:
            raise damaged(self.file)
        if self.bytes_each * len(self.files) > memory_there() and whole:
            raise too_large(self.file, self.shape[::-1])
        for file in self.files:
            if not is_file(file):
                raise BadInput(f"{self.file} refers to {file}, which does not exist.")

    def _mapped(self) -> NDArray[np.generic]:
        file = self.files[0]
        with file.open("rb") as opened:
            opened.seek(self.start)
            for _ in range(self.lines):
                opened.readline()
            start = opened.tell() + self.offset
        there = file.stat().st_size
        if self.offset < 0:
            start = there - self.bytes_each + self.offset + 1
        if start < 0 or there < start + self.bytes_each:
            raise too_short(file, there, max(start, 0) + self.bytes_each, self.shape[::-1], self.dtype)
        return np.memmap(file, self.dtype, "r", start, self.shape)

    def _decoded(self) -> NDArray[np.generic]:
        count = self.bytes_each // self.dtype.itemsize
        parts = []
        for file in self.files:
            content = file.read_bytes()[self.start :]
            for _ in range(self.lines):
                content = content.partition(b"\n")[2]
            if self.encoding == "raw" and self.offset < 0:
                content = content[max(len(content) - self.bytes_each + self.offset + 1, 0) :]
            try:
                values = self._values(content, count)
            except (ValueError, OverflowError, OSError, EOFError, zlib.error) as error:
                raise damaged(file) from error
            except MemoryError as error:
                raise too_large(self.file, self.shape[::-1]) from error
            if len(values) < count:
                there = len(values) * self.dtype.itemsize
                raise too_short(file, there, self.bytes_each, self.shape[::-1], self.dtype)
            parts.append(values[:count])
        return (parts[0] if len(parts) == 1 else np.concatenate(parts)).reshape(self.shape)

    def _values(self, content: bytes, count: int) -> NDArray[np.generic]:
        if self.encoding in ("text", "fortran"):
            content = with_exponents(content) if self.encoding == "fortran" else content
            words = re.split(rb"[\s,]+", content[max(self.offset, 0) :].strip(), maxsplit=count)[:count]
            kind = self.dtype.newbyteorder("=")
            if kind.kind == "f":
                return np.array(words).astype(kind)
            return np.array([_whole(word) for word in words], kind)
        if self.encoding == "hex":
            content = bytes.fromhex(content.decode("ascii"))
        elif self.encoding == "zlib":
            content = _inflated(content, max(self.offset, 0) + self.bytes_each)
        elif self.encoding == "runs":
            content = _unrolled(content, self.bytes_each)
        elif self.encoding == "bz2":
            with bz2.open(io.BytesIO(content)) as opened:
                content = opened.read(max(self.offset, 0) + self.bytes_each)
        content = content[max(self.offset, 0) :]
        return np.frombuffer(content[: len(content) // self.dtype.itemsize * self.dtype.itemsize], self.dtype)


class Scaled(ArraySource):
    """A volume whose values are gain * stored + shift."""

    def __init__(
        self, values: NDArray[np.generic], axes: Array, origin: Array, name: str, scale: tuple[float, float]
    ) -> None:
        super().__init__(values, axes, origin, name)
        self._gain, self._shift = scale
        self.dtype = scaled_type(self.dtype, *scale)

    def read(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box; see :meth:`svv.bricks.formats.source.Source.read`."""
        box = self._values[start[0] : stop[0], start[1] : stop[1], start[2] : stop[2]]
        return np.ascontiguousarray(np.multiply(box, self._gain) + self._shift, dtype=self.dtype)


def _whole(word: bytes) -> int:
    """Parse a whole number, which some programs write as a real one."""
    return int(word) if word.lstrip(b"+-").isdigit() else int(float(word))


def _inflated(content: bytes, most: int) -> bytes:
    """Decompress a stream of zlib or gzip, of which gzip may have several members."""
    if content[:2] != b"\x1f\x8b":
        return zlib.decompressobj().decompress(content, most)
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as opened:
        return opened.read(most)


def _unrolled(content: bytes, most: int) -> bytes:
    """Decode run lengths, as :attr:`Stored.encoding` describes them."""
    out, at = bytearray(), 0
    while len(out) < most and at + 1 < len(content):
        count = content[at]
        if count > 127:
            out += content[at + 1 : at + 1 + count - 128]
            at += 1 + count - 128
        else:
            out += content[at + 1 : at + 2] * count
            at += 2
    return bytes(out[:most])


def with_exponents(text: bytes) -> bytes:
    """Return numbers as everybody writes them, not as Fortran does: with ``D``, or nothing before long exponents."""
    return re.sub(rb"(?<=[0-9.])[dD]?(?=[+-][0-9]{3}\b)|(?<=[0-9.])[dD](?=[+-]?[0-9])", b"e", text)


def numbered(pattern: str, first: int, last: int, step: int, folder: Path) -> tuple[Path, ...]:
    """Return the files of a pattern such as ``slice%03d.raw``.

    Raises ValueError if the pattern does not take one whole number, or there are too many files.
    """
    if not re.fullmatch(r"[^%]*%0?\d*[du][^%]*", pattern) or step == 0 or abs(last - first) // abs(step) > 100_000:
        raise ValueError(f"{pattern} is not a pattern of numbered files")
    text = re.sub(r"%(0?\d*)u", r"%\1d", pattern)
    return tuple(folder / (text % k) for k in range(first, last + (1 if step > 0 else -1), step))


def damaged(file: Path) -> BadInput:
    """Return the error to raise for a file that its reader cannot read."""
    return BadInput(f"Cannot read {file}: it is damaged, incomplete, or not of the type that its name suggests.")


def bad_header(file: Path, error: Exception) -> BadInput:
    """Return the error to raise for a header in which something is wrong."""
    said = f"it lacks {error.args[0]}, or its value is unknown" if isinstance(error, KeyError) else str(error)
    return BadInput(f"Cannot read {file}: its header is damaged ({said}).")


def too_large(file: Path, sides: Sequence[int]) -> BadInput:
    """Return the error to raise for a header that asks for more memory than there is."""
    shape = " x ".join(str(side) for side in sides)
    return BadInput(
        f"The header of {file} gives {shape} voxels, more than this computer's (or this container's) memory can hold."
    )
