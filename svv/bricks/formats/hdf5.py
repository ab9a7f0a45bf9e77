"""HDF5 files: which dataset is shown, and which of the many layouts of programs it follows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from svv.bricks.formats.axes import Choice, picked
from svv.bricks.formats.big_data_viewer import view_of
from svv.bricks.formats.chunked import CHUNK_CACHE, ChunkedSource, package, source_of
from svv.bricks.formats.minc import open_minc
from svv.bricks.formats.open_pmd import axes_of_mesh
from svv.bricks.formats.places import Array, Axis, axis_of, sized, text_of
from svv.core.json_values import parsed
from svv.errors import BadInput

if TYPE_CHECKING:
    import h5py


@dataclass(frozen=True, eq=False)
class Layout:
    """What a file tells about a dataset."""

    axes: Sequence[Axis]
    turn: Array | None = None
    """Directions of x, y and z; see :func:`svv.bricks.formats.places.placed`."""
    shape: tuple[int, ...] = ()
    """Entries along its axes that belong to the volume, if the rest is padding."""
    attributes: Mapping[str, Any] = field(default_factory=dict)
    """How values are packed, in addition to its own attributes."""
    assumed: str | None = None


def _itk(data: h5py.Dataset, _: Path) -> Layout | None:
    """ITK's HDF5ImageIO: VoxelData and its neighbours, of which Directions has an axis in each row."""
    group = data.parent
    if not data.name.endswith("/VoxelData") or not {"Spacing", "Origin"} <= set(group):
        return None
    step, first = (np.ravel(group[key][...]).astype(float) for key in ("Spacing", "Origin"))
    count = len(step)
    rows = np.reshape(group["Directions"][...], (count, count)) if "Directions" in group else np.eye(count)
    axes = [Axis("xyzt"[k], float(step[k]), float(first[k])) for k in reversed(range(count))]
    return Layout([*axes, *[Axis("c")] * (data.ndim - count)], rows.T[:3, :3])


def _imaris(data: h5py.Dataset, _: Path) -> Layout | None:
    """Imaris 5.5: numbers are texts, one character an entry; datasets are padded to whole chunks."""
    if not re.fullmatch(r"/DataSet/ResolutionLevel \d+/TimePoint \d+/Channel \d+/Data", data.name):
        return None
    about, sizes = data.file["DataSetInfo/Image"].attrs, data.parent.attrs
    unit, axes, shape = _joined(about.get("Unit", "")), [], []
    for k, letter in reversed(list(enumerate("xyz"))):
        count = int(_joined(sizes.get(f"ImageSize{letter.upper()}", data.shape[2 - k])))
        low, high = (float(_joined(about[f"{end}{k}"])) for end in ("ExtMin", "ExtMax"))
        step = (high - low) / count
        axes.append(Axis(letter, step, low + 0.5 * step, unit))
        shape.append(count)
    return Layout(axes, shape=tuple(shape))


def _joined(value: Any) -> str:
    """Return the text of an attribute with a character an entry."""
    parts = np.ravel(value).tolist()
    return "".join(part.decode("latin-1") if isinstance(part, bytes) else str(part) for part in parts)


def _big_data_viewer(data: h5py.Dataset, file: Path) -> Layout | None:
    """BigDataViewer: 16 bits without a sign, written as if they had one; the .xml has the size of a voxel."""
    path = re.fullmatch(r"/t(\d+)/s(\d+)/(\d+)/cells", data.name)
    if path is None:
        return None
    time, setup, level = (int(number) for number in path.groups())
    view = view_of(file, setup, time)
    factors = data.file.get(f"s{path[2]}/resolutions")
    factor = np.ones(3) if factors is None else np.asarray(factors[level], float)
    attributes = {"_Unsigned": "true"} if data.dtype == np.int16 else {}
    if view is None:
        return Layout([Axis(letter) for letter in "zyx"], attributes=attributes)
    steps = [Axis(a, s * f, 0.5 * s * (f - 1), view.unit) for a, s, f in zip("xyz", view.size, factor)]
    return Layout(steps[::-1], attributes=attributes, assumed=view.assumed)


def _openpmd(data: h5py.Dataset, file: Path) -> Layout | None:
    """OpenPMD: meshes, which are datasets or groups of components."""
    mesh = next((one.attrs for one in (data, data.parent) if "gridSpacing" in one.attrs), None)
    if mesh is None:
        return None
    axes, attributes = axes_of_mesh(mesh, data.attrs, file.name)
    return Layout(axes, attributes=attributes)


def of_nexus(opened: h5py.File) -> Iterator[tuple[h5py.Group, h5py.Dataset]]:
    """Yield the groups of a NeXus file that describe a volume (NXdata), with it; only the default one if any."""
    groups: list[Any] = []
    opened.visititems(lambda _, item: groups.append(item) if text_of(item.attrs.get("NX_class")) == "NXdata" else None)
    chosen: Any = opened
    while "default" in chosen.attrs and text_of(chosen.attrs["default"]) in chosen:
        chosen = chosen[text_of(chosen.attrs["default"])]
    for group in [chosen] if chosen in groups else groups:
        marked = [key for key, item in group.items() if item is not None and "signal" in item.attrs]
        signal = group.get(text_of(group.attrs.get("signal")) or next(iter(marked), ""))
        if signal is not None and sum(side > 1 for side in getattr(signal, "shape", None) or ()) >= 3:
            yield group, signal


def _nexus(data: h5py.Dataset, _: Path) -> Layout | None:
    """NeXus: the axes of an NXdata group, named by it or, in older files, by the signal."""
    group = next((group for group, signal in of_nexus(data.file) if signal == data), None)
    told = None if group is None else group.attrs.get("axes", data.attrs.get("axes"))
    if group is None or told is None:
        return None
    names = [text_of(name) for name in np.ravel(told)]
    if len(names) == 1:
        names = re.split(r"[:,\s]+", names[0].strip("[] "))
    placed = {}
    for k, name in enumerate(names):
        own = np.ravel(group.attrs.get(f"{name}_indices", k))
        if len(own) == 1 and name not in ("", "."):
            placed[int(own[0])] = name
    return Layout([_coordinate(group, placed.get(k, ""), count) for k, count in enumerate(data.shape)])


def _coordinate(group: h5py.Group, key: str, count: int, name: str = "") -> Axis:
    """Return the axis whose places are a dataset of a group."""
    found = group.get(key) if key else None
    if found is None:
        return Axis(name or key)
    return axis_of(name or key, found[...], dict(found.attrs), count)


def _emd(data: h5py.Dataset, _: Path) -> Layout | None:
    """Electron microscopy dataset (Berkeley): a vector dim1, dim2, ... for each axis, from 0 in later versions."""
    group, begin = data.parent, 0 if "dim0" in data.parent else 1
    keys = [f"dim{k + begin}" for k in range(data.ndim)]
    if not ("emd_group_type" in group.attrs or data.name.endswith("/data")) or not set(keys) <= set(group):
        return None
    names = [text_of(group[key].attrs.get("name")) for key in keys]
    return Layout([_coordinate(group, key, n, name) for key, n, name in zip(keys, data.shape, names)])


def _hyperspy(data: h5py.Dataset, _: Path) -> Layout | None:
    """HyperSpy: a group axis-0, axis-1, ... for each axis."""
    keys = [f"axis-{k}" for k in range(data.ndim)]
    if not set(keys) <= set(data.parent):
        return None
    told = [data.parent[key].attrs for key in keys]
    steps = [float(one["scale"]) if "scale" in one else None for one in told]
    first = [float(one.get("offset", 0.0)) for one in told]
    names, units = ([text_of(one.get(key)) for one in told] for key in ("name", "units"))
    return Layout([Axis(*one) for one in zip(names, steps, first, units)])


def _by_itself(data: h5py.Dataset, _: Path) -> Layout:
    """The axes by ilastik's ``axistags``, labels and scales of dimensions (netCDF-4), and sizes as attributes."""
    try:
        tags = parsed(data.attrs["axistags"])["axes"]
        steps = [float(tag.get("resolution") or 0.0) or None for tag in tags]
        axes = [Axis(str(tag["key"]), step) for tag, step in zip(tags, steps)]
    except (KeyError, TypeError, ValueError):
        axes = []
    if len(axes) != data.ndim:
        axes = [_dimension(dimension, count) for dimension, count in zip(data.dims, data.shape)]
    told = {} if any(axis.step for axis in axes) else data.attrs
    return Layout(sized(axes, told, data.shape))


def _dimension(dimension: h5py.DimensionProxy, count: int) -> Axis:
    """Return the axis of a dimension by the first scale that is attached to it.

    netCDF has no labels: its scale has the dimension's name. A dimension without coordinates has a scale of zeros.
    """
    if not len(dimension):
        return Axis(str(dimension.label))
    scale = dimension[0]
    name = str(dimension.label) or str(scale.name or "").rpartition("/")[2]
    index = text_of(scale.attrs.get("NAME")).startswith("This is a netCDF dimension but not a netCDF variable")
    return axis_of(name, None if index or scale.ndim != 1 else scale[...], dict(scale.attrs), count)


def names_of_channels(opened: h5py.File) -> list[str]:
    """Return the names of the channels of an Imaris file; nothing unless every channel has one."""
    about = opened.get("DataSetInfo") or {}
    keys = sorted((key for key in about if re.fullmatch(r"Channel \d+", key)), key=lambda key: int(key[8:]))
    names = [_joined(about[key].attrs.get("Name", "")) for key in keys]
    return names if all(names) else []


LAYOUTS = (_itk, _imaris, _big_data_viewer, _openpmd, _nexus, _emd, _hyperspy, _by_itself)
"""All layouts, in the order in which they are tried."""

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
        layout = next(filter(None, (read(data, file) for read in LAYOUTS)))
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
    Raises BadInput if there is none, or no path and several of the largest size.
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
