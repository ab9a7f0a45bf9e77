"""Where programs write the axes and the size of a voxel in HDF5 files.

A layout is a function that returns what a dataset's surroundings tell, or None if they are another program's.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from svv.bricks.formats.big_data_viewer import view_of
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


def layout_of(data: h5py.Dataset, file: Path) -> Layout:
    """Return what a file tells about a dataset."""
    return next(filter(None, (read(data, file) for read in LAYOUTS)))


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
    """OpenPMD 1 and 2: meshes, which are datasets or groups of components; lengths and values become SI units."""
    mesh = next((one.attrs for one in (data, data.parent) if "gridSpacing" in one.attrs), None)
    if mesh is None:
        return None
    geometry = text_of(mesh.get("geometry", "cartesian"))
    if geometry != "cartesian":
        raise BadInput(
            f"{file.name} has its values in {geometry} coordinates: resample them to a cartesian grid first."
        )
    unit = np.ravel(mesh.get("gridUnitSI", 1.0))  # a number, or in version 2 one for each axis
    step, first = np.ravel(mesh["gridSpacing"]) * unit, np.ravel(mesh.get("gridGlobalOffset", 0.0)) * unit
    first = first + np.ravel(data.attrs.get("position", 0.0)) * step
    names = [text_of(name) for name in np.ravel(mesh["axisLabels"])]
    axes = [Axis(name, float(a), float(b), "m") for name, a, b in zip(names, step, first)]
    order = -1 if text_of(mesh.get("dataOrder", "C")) == "F" else 1
    return Layout(axes[::order], attributes={"scale_factor": float(data.attrs.get("unitSI", 1.0))})


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
