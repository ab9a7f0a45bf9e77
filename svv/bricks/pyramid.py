"""Pyramids on the side: coarser levels of a volume whose file has none.

Each level halves the one before, by the means of 2 x 2 x 2 voxels, or by one of these if they are labels. All are made
in one pass over the file, box by box, which goes on where it stopped, and kept in the cache.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from svv.bricks.formats.mapped import MappedSource, mapped
from svv.bricks.formats.source import Box, Level, Source, check_finite
from svv.bricks.opened import data_files
from svv.errors import Progress
from svv.io.files.atomic import atomic_path, cannot_write, make_folder, sync_folder
from svv.io.files.cache import Cache, bytes_in, cache_folder
from svv.io.files.keyed_results import digest

Item = TypeVar("Item")
Result = TypeVar("Result")

BOUND = 50_000_000_000
"""Maximum size of all pyramids in bytes unless ``SVV_PYRAMIDS_SIZE`` is set; a pyramid has a seventh of its volume."""

DEPTH = 6
"""Maximum number of levels made in one pass: a box has 2 ** DEPTH voxels along z and y."""

COARSEST = 64
"""Longest side in voxels below which no further level is made."""

BOX_BYTES = 32 << 20
"""Approximate size of a box that is read at a time."""

NOTE_EVERY = 5.0
"""Seconds between two times at which finished boxes are noted; later ones are made again if the process dies."""

WAIT = 0.2
"""Seconds for which a process waits for another one before it tells so, again and again."""

FORMAT = "1"
"""Number at the end of pyramids' names; changes with their layout."""


class PyramidSource:
    """A volume together with a pyramid of coarser levels."""

    def __init__(self, fine: Source, coarse: Sequence[MappedSource], low: float, high: float) -> None:
        self.name, self.dtype, self._parts = fine.name, fine.dtype, (fine, *coarse)
        self.levels: Sequence[Level] = (*fine.levels[:1], *(part.levels[0] for part in coarse))
        self.assumed, self.planes = fine.assumed, fine.planes
        self.range = low, high
        """Smallest and largest value of the finest level."""

    def read(self, level: int, start: Box, stop: Box) -> NDArray[np.number]:
        """Read a box; see :meth:`svv.bricks.formats.source.Source.read`."""
        return self._parts[level].read(0, start, stop)


def pyramids() -> Cache:
    """Return the cache of pyramids: ``SVV_PYRAMIDS``, or by default the folder ``pyramids`` of the user's cache.

    Raises BadInput if ``SVV_PYRAMIDS_SIZE`` is not a size.
    """
    size = os.environ.get("SVV_PYRAMIDS_SIZE")
    folder = Path(os.environ.get("SVV_PYRAMIDS") or cache_folder() / "pyramids").expanduser()
    return Cache(folder, bytes_in(size, "SVV_PYRAMIDS_SIZE") if size else BOUND)


def with_pyramid(
    source: Source, path: Path, progress: Progress, part: Sequence[object] = (), labels: bool = False
) -> PyramidSource:
    """Return a volume with coarser levels, which are made and kept in the cache if they are not there yet.

    Only the finest level of ``source`` is used. A pyramid is made again if its file or folder, ``path``, changes; each
    ``part`` that is chosen of the file, such as an array or channel, has its own. Of ``labels``, there are no means: of
    2 x 2 x 2 voxels, the first is kept. ``progress`` is called often; the work stops when it raises, and goes on the
    next time. Raises BadInput if something cannot be read or written, or a value is not finite.
    """
    cache, name = pyramids(), _name(source, path, (*part, "labels") if labels else part)
    unfinished, made = cache.folder / f".{name}", False
    while not cache.holds(name):
        try:
            make_folder(unfinished)
            with FileLock(unfinished / "lock").acquire(timeout=WAIT):  # ends with the process, however that ends
                if not cache.holds(name):  # another process may have made it in the meantime
                    _build(source, unfinished, progress, labels)
                    sync_folder(unfinished)
                    os.replace(unfinished, cache.folder / name)
                    made = True
        except Timeout:
            progress(0.0, "Waiting for another process that makes the same pyramid")
        except OSError as error:
            if not cache.holds(name):  # otherwise, the folder has just got its name
                raise cannot_write(unfinished, error) from error
    if made:
        cache.trim(cache.folder / name)
    folder = cache.folder / name
    with suppress(OSError):  # belongs to another user: it will merely appear older than it is
        os.utime(folder)
    ranges = np.load(folder / "ranges.npy")
    levels = _levels(source)
    coarse = [
        mapped(folder / f"level-{k}.raw", 0, source.dtype, level.shape, level.axes, level.origin.tolist())
        for k, level in enumerate(levels, 1)
    ]
    return PyramidSource(source, coarse, float(ranges[..., 0].min()), float(ranges[..., 1].max()))


def _name(source: Source, path: Path, part: Sequence[object]) -> str:
    """Return the name of a pyramid in the cache: it depends on the files, their sizes and times, and how it is read."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path, *data_files(path)]
    about = [(os.path.relpath(f, path), f.stat().st_size, f.stat().st_mtime_ns) for f in files if f.is_file()]
    level = source.levels[0]
    read = (source.dtype.str, level.shape, level.axes.tolist(), level.origin.tolist(), source.name, *part)
    return f"pyramid-{digest(str(path.resolve()), about)}-{digest(*read)}-{FORMAT}"


def _levels(source: Source) -> list[Level]:
    """Return the levels of the pyramid, without the volume itself."""
    levels = [source.levels[0]]
    while len(levels) <= DEPTH and max(levels[-1].shape) > COARSEST:
        levels.append(levels[-1].halved())
    return levels[1:]


def _build(source: Source, folder: Path, progress: Progress, labels: bool) -> None:
    """Write all levels, and the range of values of each box; boxes that are already there are skipped."""
    from svv.bricks.halving import halved  # loads numba, which who only asks where pyramids are need not wait for

    levels, whole = _levels(source), source.levels[0].shape
    edge = 1 << DEPTH
    rows = max(1, BOX_BYTES // (edge * whole[2] * source.dtype.itemsize * edge)) * edge
    count = -(-whole[0] // edge), -(-whole[1] // rows)
    size = sum(level.voxels for level in levels) * source.dtype.itemsize
    where = f"Making a pyramid ({_readable(size)} in {folder.parent})"
    for k, level in enumerate(levels, 1):
        _claim(folder / f"level-{k}.raw", level.voxels * source.dtype.itemsize)
    if not (folder / "ranges.npy").exists():
        with atomic_path(folder / "ranges.npy") as temporary:
            np.save(temporary, np.full((*count, 2), np.nan))
    ranges = np.lib.format.open_memmap(folder / "ranges.npy", "r+")
    files = [os.open(folder / f"level-{k}.raw", os.O_WRONLY) for k in range(1, len(levels) + 1)]

    def work(index: tuple[int, int]) -> tuple[tuple[int, int], float, float]:
        start = index[0] * edge, index[1] * rows, 0
        stop = min(start[0] + edge, whole[0]), min(start[1] + rows, whole[1]), whole[2]
        box = source.read(0, start, stop)
        check_finite(box, source.name)
        low, high = float(box.min()), float(box.max())
        for k, (file, level) in enumerate(zip(files, levels), 1):
            box = box[::2, ::2, ::2] if labels else halved(box)
            first = start[0] >> k, start[1] >> k
            for z, layer in enumerate(box):
                place = ((first[0] + z) * level.shape[1] + first[1]) * level.shape[2]
                _write(file, layer, place * source.dtype.itemsize)
        return index, low, high

    written: list[tuple[tuple[int, int], float, float]] = []

    def note() -> None:
        """Mark boxes as done, once they are on disk: after a power failure, a mark must not stand for lost voxels."""
        for file in files:
            os.fsync(file)
        for index, low, high in written:
            ranges[index] = low, high
        ranges.flush()
        written.clear()

    missing = [tuple(index) for index in np.argwhere(np.isnan(ranges[..., 0])).tolist()]
    done = count[0] * count[1] - len(missing)
    try:
        with ThreadPoolExecutor(2) as pool:  # one reads while the other one computes
            noted = time.monotonic()
            for number, found in enumerate(_in_turn(pool, work, missing)):
                written.append(found)
                if time.monotonic() - noted > NOTE_EVERY:
                    note()
                    noted = time.monotonic()
                progress((done + number + 1) / (count[0] * count[1]), where)
    finally:
        note()
        for file in files:
            os.close(file)


def _in_turn(pool: ThreadPoolExecutor, work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Do work on a few items at a time, so that little is left to do when a caller stops."""
    waiting: list[Future[Result]] = []
    for item in items:
        waiting.append(pool.submit(work, item))
        if len(waiting) > 2:
            yield waiting.pop(0).result()
    for future in waiting:
        yield future.result()


def _write(file: int, layer: NDArray[np.generic], place: int) -> None:
    data = np.ascontiguousarray(layer).data.cast("B")
    while data:
        written = os.pwrite(file, data, place)
        data, place = data[written:], place + written


def _claim(path: Path, size: int) -> None:
    """Create a file of this size if there is none, so that a full disk shows before the work."""
    if path.exists() and path.stat().st_size == size:
        return
    with path.open("wb") as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
        else:
            file.truncate(size)


def _readable(size: float) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.0f} MB"
