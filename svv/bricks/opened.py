"""Opening of volumes for bricked access, by the format of the file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from svv.bricks.chunked import is_zarr, open_hdf5, open_tiff, open_zarr
from svv.bricks.mapped import mapped, open_meta, open_npy, open_vti, raw_layout
from svv.bricks.source import Level, Source, level_of
from svv.errors import BadInput

HDF5 = (".h5", ".hdf5", ".he5")
"""Endings of HDF5 files."""

RAW = (".raw", ".bin", ".dat")
"""Endings of raw files."""

BRICKED = ".raw .mhd .mha .vti .npy .h5 .zarr .tif (or a folder of .tif)"
"""Formats of which bricks can be read, if the values are stored as they are or in chunks."""


def open_bricks(
    path: str | Path,
    dims: Sequence[int] | None = None,
    dtype: DTypeLike | None = None,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    array: str | None = None,
) -> Source | None:
    """Open a volume for bricked access; nothing but its header is read.

    Args:
        path: A file or folder of one of the formats in :data:`BRICKED`.
        dims: Number of points along x, y, z, for raw files only; by default taken from the file name.
        dtype: Type of a raw file's values; by default taken from the file name.
        spacing: Spacing (x, y, z) in world units that overrides the file's.
        origin: Origin (x, y, z) in world units that overrides the file's.
        array: Name of the array, dataset or group, if there are several.

    Returns:
        The volume, or None if bricks cannot be read of this file.

    Raises:
        BadInput: The file does not exist or is damaged, or an argument does not fit it.
    """
    file = Path(path)
    if not file.exists():
        raise BadInput(f"There is no volume {file}; check the path.")
    source = _opened(file, dims, dtype, array)
    if source is None or (spacing is None and origin is None):
        return source
    source.levels = [_moved(level, source.levels[0], spacing, origin, source.name) for level in source.levels]
    return source


def _opened(file: Path, dims: Sequence[int] | None, dtype: DTypeLike | None, array: str | None) -> Source | None:
    if file.is_dir():
        if is_zarr(file):
            return open_zarr(file, array)
        return open_tiff(file) if any(f.suffix.lower() in (".tif", ".tiff") for f in file.iterdir()) else None
    suffix = file.suffix.lower()
    if file.stat().st_size == 0:
        raise BadInput(f"{file} is empty.")
    if suffix == ".npy":
        return open_npy(file)
    if suffix in (".mhd", ".mha"):
        return open_meta(file)
    if suffix == ".vti":
        return open_vti(file, array)
    if suffix in HDF5:
        return open_hdf5(file, array)
    if suffix in (".tif", ".tiff"):
        return open_tiff(file)
    if suffix in RAW or dims is not None or dtype is not None:
        size, kind = raw_layout(file, dims, dtype)
        return mapped(file, 0, kind, size[::-1], np.eye(3), (0.0, 0.0, 0.0))
    return None


def _moved(
    level: Level, finest: Level, spacing: Sequence[float] | None, origin: Sequence[float] | None, name: str
) -> Level:
    """Return a level of a volume whose finest level gets another spacing or origin."""
    for values in (spacing, origin):
        if values is not None and len(values) != 3:
            raise BadInput(f"Spacing and origin need three numbers (x, y, z), not {values}.")
    scale = np.ones(3) if spacing is None else np.asarray(spacing, float) / finest.spacing
    shift = np.linalg.solve(finest.axes, level.origin - finest.origin)  # in voxels of the finest level
    axes = finest.axes * scale
    start = finest.origin if origin is None else np.asarray(origin, float)
    return level_of(level.shape, level.axes * scale, start + axes @ shift, name)
