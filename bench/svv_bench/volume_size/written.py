"""Writing of a volume, box by box, as a MetaImage file that every reader here, VTK and ParaView take."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from svv.bricks.formats.meta_image import META_TYPES
from svv.bricks.formats.source import Source
from svv.errors import Progress
from svv.io.files.atomic import atomic_path

SLAB_BYTES = 32 << 20
"""Approximate size of what is written at a time."""


def write_meta(path: Path, source: Source, level: int, progress: Progress) -> None:
    """Write a level of a volume as an uncompressed ``.mha`` file.

    Args:
        path: The file, which appears when it is complete.
        source: The volume.
        level: Number of the level.
        progress: Called for every slab; the work stops when it raises.

    Raises:
        BadInput: The volume cannot be read, or the file cannot be written.
    """
    grid, kind = source.levels[level], source.dtype.str[1:]
    depth, height, width = grid.shape
    axes = (grid.axes / grid.spacing).T  # its rows are the axes, as ITK reads it
    header = {
        "ObjectType": "Image", "NDims": "3", "BinaryData": "True", "BinaryDataByteOrderMSB": "False",
        "CompressedData": "False", "TransformMatrix": _words(axes.ravel()), "Offset": _words(grid.origin),
        "ElementSpacing": _words(grid.spacing), "DimSize": f"{width} {height} {depth}",
        "ElementType": next(name for name, known in META_TYPES.items() if known == kind), "ElementDataFile": "LOCAL",
    }  # fmt: skip
    layers = max(1, SLAB_BYTES // (height * width * source.dtype.itemsize))
    starts = range(0, depth, layers)
    with atomic_path(path) as temporary, temporary.open("wb") as file, ThreadPoolExecutor(2) as pool:
        file.write("".join(f"{key} = {value}\n" for key, value in header.items()).encode())
        waiting = []
        for first in starts:
            stop = min(first + layers, depth)
            waiting.append(pool.submit(source.read, level, (first, 0, 0), (stop, height, width)))
            if len(waiting) > 2:
                file.write(waiting.pop(0).result().astype(source.dtype.newbyteorder("<"), copy=False).data)
            progress(first / depth, "Writing the volume")
        for future in waiting:
            file.write(future.result().astype(source.dtype.newbyteorder("<"), copy=False).data)


def _words(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.17g}" for number in numbers)
