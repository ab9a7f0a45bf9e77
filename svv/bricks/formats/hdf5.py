"""HDF5 files: which dataset is shown, and which of the many layouts of programs it follows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.bricks.formats.axes import Choice, picked
from svv.bricks.formats.chunked import CHUNK_CACHE, ChunkedSource, package, source_of
from svv.bricks.formats.hdf5_layouts import layout_of, names_of_channels, of_nexus
from svv.bricks.formats.minc import open_minc
from svv.errors import BadInput

if TYPE_CHECKING:
    import h5py

FAMILIES = (
    r"t(?P<t>\d+)/s(?P<c>\d+)/(?P<rest>0/cells)",  # BigDataViewer: time points and setups
    r"DataSet/(?P<rest>ResolutionLevel 0)/TimePoint (?P<t>\d+)/Channel (?P<c>\d+)/Data",  # Imaris
    r"data/(?P<t>\d+)/(?P<rest>(?:meshes|fields)/.+)",  # openPMD
)
"""Paths of datasets that are time points ``t`` or channels ``c`` of one volume."""


def is_hdf5(file: Path) -> bool:
    """Return whether a file begins as HDF5 files do, or does so after 512 bytes of MATLAB's."""
    with file.open("rb") as opened:
        head = opened.read(520)
    return b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:])


def open_hdf5(file: Path, choice: Choice = Choice(), array: str | None = None) -> ChunkedSource | None:  # noqa: B008 - frozen
    """Open a dataset of an HDF5 file; by default the only or the largest one with three axes.

    Further axes, or further datasets of the same kind, may be channels and times.

    Args:
        file: The file.
        choice: The channel and the time point that are shown.
        array: Path of a dataset, or the end of it.

    Returns:
        The volume; None for VTK's own layout, which its reader knows.

    Raises:
        BadInput: The file is damaged, has no such dataset, or h5py is not installed.
    """
    h5py = package("h5py", file)
    try:
        opened = h5py.File(file, "r", rdcc_nbytes=CHUNK_CACHE, rdcc_nslots=100_003)
        if "VTKHDF" in opened:
            return None
        if "minc-2.0" in opened:
            opened.close()
            return open_minc(file, choice)
        data, left = _dataset(opened, file, array, choice)
        layout = layout_of(data, file)
        shape, told = layout.shape or data.shape, {**data.attrs, **layout.attributes}
    except BadInput:
        raise
    except Exception as error:  # damaged files make HDF5 raise all kinds of errors
        raise BadInput(f"Cannot read {file}: it is damaged, incomplete, or not an HDF5 file.") from error
    source = source_of(file.name, data, data.dtype, shape, layout.axes, left, told, turn=layout.turn)
    if layout.assumed:
        source.assumed = " ".join(filter(None, (source.assumed, layout.assumed)))
    return source


def _volumes(opened: h5py.File, file: Path) -> Iterator[tuple[str, h5py.Dataset]]:
    """Yield the datasets with three axes, and their paths."""
    h5py = package("h5py", file)
    items: dict[str, Any] = {}
    opened.visititems(lambda name, item: items.update({name: item}))
    for first in (key for key in opened if re.fullmatch(r"t\d{5,}", key)):  # BigDataViewer's may lie in other files
        group = opened.get(first)
        setups = group if isinstance(group, h5py.Group) else ()
        items |= {f"{first}/{key}/0/cells": group.get(f"{key}/0/cells") for key in setups}
    for name, item in items.items():
        if isinstance(item, h5py.Dataset) and sum(side > 1 for side in item.shape or ()) >= 3:
            yield name, item


def _dataset(opened: h5py.File, file: Path, array: str | None, choice: Choice) -> tuple[h5py.Dataset, Choice]:
    """Return the dataset that is shown, and what is still to be chosen within it.

    That is the dataset of a path, the one that a NeXus file plots by default, or the largest one with three axes.

    Raises:
        BadInput: There is none, or no path and several of the largest size.
    """
    found = dict(_volumes(opened, file))
    plotted = {str(signal.name).strip("/"): signal for _, signal in of_nexus(opened)}
    name = (array or "").strip("/")
    if name in found | plotted:
        return (found | plotted)[name], choice
    found = {path: item for path, item in found.items() if item not in plotted.values()} | plotted
    families: dict[str, dict[tuple[int, int], h5py.Dataset]] = {}
    for path, item in found.items():
        fits = next((fits for pattern in FAMILIES if (fits := re.fullmatch(pattern, path))), None)
        parts = fits.groupdict() if fits else {}
        key = int(parts.get("t", 0)), int(parts.get("c", 0))
        families.setdefault(parts.get("rest", path), {})[key] = item
    shown = {rest: one for rest, one in families.items() if f"/{rest}".endswith(f"/{name}" if name else "")}
    if not shown:
        names = ", ".join(found) or "none"
        wanted = f"no volume '{array}'" if array else "no dataset with three axes"
        raise BadInput(f"{file} has {wanted}; datasets with three axes: {names}.")
    preferred = {rest: one for rest, one in shown.items() if rest in plotted} or shown
    sizes = {rest: max(item.size for item in one.values()) for rest, one in preferred.items()}
    largest = [rest for rest, size in sizes.items() if size == max(sizes.values())]
    if len(largest) > 1:
        raise BadInput(f"{file} has several volumes of one size: name one of them ({', '.join(largest)}) with --array.")
    return _member(shown[largest[0]], names_of_channels(opened), file, choice)


def _member(
    family: dict[tuple[int, int], h5py.Dataset], channels: Sequence[str], file: Path, choice: Choice
) -> tuple[h5py.Dataset, Choice]:
    """Return the dataset of the chosen time point and channel, and what is still to be chosen within it."""
    times, numbers = sorted({t for t, _ in family}), sorted({c for _, c in family})
    own = Choice(choice.channel if len(numbers) > 1 else None, choice.time if len(times) > 1 else None)
    pick = picked("tczyx", (len(times), len(numbers), 2, 2, 2), own, file.name, channels)
    key = times[pick.fixed[0] or 0], numbers[pick.fixed[1] or 0]
    if key not in family:
        raise BadInput(f"{file.name} has no volume of this channel at this time point: choose another.")
    left = replace(choice, channel=None) if len(numbers) > 1 else choice
    return family[key], replace(left, time=None) if len(times) > 1 else left
