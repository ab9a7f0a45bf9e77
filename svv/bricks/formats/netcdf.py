"""Classic netCDF files (netCDF-3), through SciPy; netCDF-4 files are HDF5 (:mod:`svv.bricks.formats.hdf5`)."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from svv.bricks.formats.axes import Choice
from svv.bricks.formats.chunked import ChunkedSource, source_of
from svv.bricks.formats.places import Axis, axis_of, sized
from svv.errors import BadInput


def open_netcdf(file: Path, choice: Choice = Choice(), array: str | None = None) -> ChunkedSource:  # noqa: B008 - frozen
    """Open a variable of a classic netCDF file; by default the only or the largest one with three axes.

    Args:
        file: The file.
        choice: The channel and the time point that are shown.
        array: Name of a variable.

    Raises:
        BadInput: The file is damaged, in another format, or has no such variable.
    """
    with file.open("rb") as head:
        magic = head.read(4)
    if magic not in (b"CDF\x01", b"CDF\x02"):
        what = "netCDF in the format CDF-5" if magic == b"CDF\x05" else "no netCDF file"
        raise BadInput(f"{file} is {what}: convert it to netCDF-4, with nccopy -k nc4 for example.")
    from scipy.io import netcdf_file

    try:
        opened = netcdf_file(file, "r", mmap=True)
        variables = opened.variables
        with warnings.catch_warnings():  # arrays keep the map open, as they shall
            warnings.simplefilter("ignore", RuntimeWarning)
            opened.close()
        found = {name: one for name, one in variables.items() if sum(side > 1 for side in one.shape) >= 3}
        sizes = {name: int(np.prod(one.shape, dtype=object)) for name, one in found.items()}
    except Exception as error:  # damaged files make SciPy raise all kinds of errors
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or not a netCDF file.") from error
    largest = [name for name, size in sizes.items() if size == max(sizes.values())] if array is None else [array]
    if len(largest) > 1:
        raise BadInput(f"{file} has several volumes of one size: name one of them ({', '.join(largest)}) with --array.")
    if not largest or largest[0] not in found:
        wanted = f"no volume '{array}'" if array else "no variable with three axes"
        raise BadInput(f"{file} has {wanted}; variables with three axes: {', '.join(found) or 'none'}.")
    shown, axes = found[largest[0]], []
    for name, count in zip(shown.dimensions, shown.shape):
        one = variables.get(name)
        known = one is not None and len(one.shape) == 1
        axes.append(axis_of(name, np.array(one.data), one._attributes, count) if known else Axis(name))
    told = shown._attributes
    return source_of(file.name, shown.data, shown.data.dtype, shown.shape, sized(axes, told, shown.shape), choice, told)
