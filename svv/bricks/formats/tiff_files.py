"""What TIFF files tell besides their pixels: the order of slices, the size of a voxel, and names of channels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import DTypeLike, NDArray

from svv.bricks.formats.axes import in_one_unit
from svv.core.xml_values import parsed_xml
from svv.errors import BadInput

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage, TiffPageSeries

RESOLUTION_UNITS = {2: "inch", 3: "cm", 4: "mm", 5: "um"}
"""Units of TIFF's resolutions."""


NAMED = {
    **dict.fromkeys(("c", "ch", "chan", "channel", "w", "wavelength"), "c"),
    **dict.fromkeys(("t", "tp", "time", "timepoint"), "t"),
    **dict.fromkeys(("z", "slice", "plane", "layer"), "z"),
}
"""Axes by the words before numbers in names of files."""


def in_order(folder: Path) -> list[Path]:
    """Return the TIFF files of a folder, slice_2 before slice_10, whether or not the numbers are padded."""
    files = [f for f in folder.iterdir() if f.suffix.lower() in (".tif", ".tiff")]
    return sorted(files, key=lambda f: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", f.name)])


def axes_of_names(files: Sequence[Path]) -> tuple[list[str], list[int]]:
    """Return names and lengths of the axes that the numbers in the names of slices stand for, see :func:`in_order`.

    Names such as ``scan_c0_z012.tif`` have a number for the channel and one for the slice. Several numbers that do not
    make a complete grid, such as dates, mean nothing: the slices are a stack in the order of their names.
    """
    parts = [re.split(r"(\d+)", file.stem) for file in files]
    alone = ["z"], [len(files)]
    if len({tuple(part[::2]) for part in parts}) != 1:
        return alone
    fields = [sorted({int(part[k]) for part in parts}) for k in range(1, len(parts[0]), 2)]
    varying = [k for k, values in enumerate(fields) if len(values) > 1]
    shape = [len(fields[k]) for k in varying]
    if len(varying) < 2 or int(np.prod(shape)) != len(files):
        return alone
    words = [re.split(r"[^a-z]+", parts[0][2 * k].lower().rstrip("_-. ="))[-1] for k in varying]
    names = [NAMED.get(word, word or "number") for word in words]
    unknown = [k for k, name in enumerate(names) if name not in "ctz"]
    if "z" not in names and len(unknown) == 1:
        names[unknown[0]] = "z"
    return names, shape


def voxel_size(opened: TiffFile, series: TiffPageSeries, name: str) -> NDArray[np.float64]:
    """Return the size of a voxel along x, y, z as OME-TIFF, ImageJ and tifffile give it, in the unit of x. (3,)

    It is 1 if unknown: TIFF's own resolution says nothing about the distance of slices, so without that it only tells
    how much longer pixels are than wide.

    Args:
        opened: A ``tifffile.TiffFile``.
        series: The image of it.
        name: Name of the file in messages.

    Raises:
        BadInput: The sizes have units that cannot be compared.
    """
    told = _told(opened, series)
    given = [axis for axis in "XYZ" if f"PhysicalSize{axis}" in told]
    if given:
        sizes = [float(told.get(f"PhysicalSize{axis}", 1.0)) for axis in "XYZ"]
        known = {axis: str(told.get(f"PhysicalSize{axis}Unit", "µm")) for axis in given}
        return in_one_unit(sizes, [known.get(axis, known[given[0]]) for axis in "XYZ"], name)
    if opened.is_imagej or "spacing" in told or "unit" in told:
        return in_one_unit(*_of_imagej(told, series.keyframe), name)
    return shape_of_pixels(series.keyframe)


def unsized(opened: TiffFile, series: TiffPageSeries) -> str:
    """Return the axes among x, y, z along which a file tells no size of a voxel.

    ImageJ leaves out a spacing of 1 where pixels have a size.
    """
    told = _told(opened, series)
    given = "".join(axis.lower() for axis in "XYZ" if f"PhysicalSize{axis}" in told)
    if given:
        return "".join(axis for axis in "xyz" if axis not in given)
    sizes, _ = _of_resolution(series.keyframe)
    known = opened.is_imagej and sizes[0] not in (0.0, 1.0, 1.0 / 72.0)
    return "" if known or "spacing" in told or "unit" in told else "xyz"


def _told(opened: TiffFile, series: TiffPageSeries) -> Mapping[str, Any]:
    """Return what OME, ImageJ or tifffile tell about an image."""
    if series.kind == "ome":
        return _pixels(opened, series).attrib
    if opened.is_imagej:
        return opened.imagej_metadata or {}
    if series.kind == "shaped":  # tifffile's own, with any metadata
        return next((one for one in opened.shaped_metadata or () if _fits(one, series)), {})
    return {}


def _fits(told: Mapping[str, Any], series: TiffPageSeries) -> bool:
    """Return whether metadata that tifffile has written belong to an image."""
    return tuple(told.get("shape", ())) in (tuple(series.shape), tuple(series.get_shape(squeeze=False)))


def _of_imagej(told: Mapping[str, Any], page: TiffPage) -> tuple[list[float], list[str | None]]:
    """Return the sizes along x, y, z, and their units, by the rules of ImageJ's own reader."""
    sizes, unit = _of_resolution(page)
    sizes = [size or 1.0 for size in sizes]
    if "unit" not in told and sizes[0] == 1.0 / 72.0:  # a screen's, which means nothing
        sizes = [1.0, 1.0]
    unit = str(told.get("unit") or unit)
    other = [str(told.get(f"{axis}unit") or unit) for axis in "yz"]
    spacing = abs(float(told.get("spacing", 1.0))) or 1.0
    return [*sizes, spacing], [unit, *other]


def shape_of_pixels(page: TiffPage) -> NDArray[np.float64]:
    """Return the size of a voxel along x, y, z, of which a plain page tells only how much longer pixels are. (3,)"""
    (x, y), _ = _of_resolution(page)
    return np.array([1.0, y / x if x and y else 1.0, 1.0])


def _of_resolution(page: TiffPage) -> tuple[list[float], str]:
    """Return the width and height of a pixel by a page's resolution, 0 where it tells none, and their unit."""
    sizes = []
    for tag in ("XResolution", "YResolution"):
        value = page.tags[tag].value if tag in page.tags else (0, 1)
        up, down = (float(x) for x in (value if isinstance(value, tuple) else (value, 1)))
        sizes.append(down / up if up > 0 and down > 0 else 0.0)
    unit_tag = int(page.tags["ResolutionUnit"].value) if "ResolutionUnit" in page.tags else 1
    return sizes, RESOLUTION_UNITS.get(unit_tag, "")


def names_of_channels(opened: TiffFile, series: TiffPageSeries, axes: list[str]) -> list[str]:
    """Return the names of the channels of an OME-TIFF file; nothing unless every channel has one."""
    if "c" not in axes or not opened.is_ome:
        return []
    count = int(series.shape[axes.index("c")])
    channels = (e for e in _pixels(opened, series).iter() if e.tag.rpartition("}")[2] == "Channel")
    names = [str(e.get("Name") or "") for e in channels]
    return names if len(names) == count and all(names) else []


def calibration(opened: TiffFile, kind: DTypeLike, name: str) -> tuple[float, float]:
    """Return gain and shift of the values of an image, as ImageJ calibrates them: gain * stored + shift.

    ImageJ stores signed values of 16 bits, such as those of a CT, as unsigned ones that are 32768 larger, and counts
    from there; it calibrates no real numbers. Function 20 is none.

    Args:
        opened: A ``tifffile.TiffFile``.
        kind: Type of the stored values.
        name: Name of the file in messages.

    Raises:
        BadInput: It is calibrated by something else than a straight line.
    """
    told = (opened.imagej_metadata or {}) if opened.is_imagej else {}
    function, kind = int(told.get("cf", 20)), np.dtype(kind)
    if function == 20 or kind.kind not in "iu" or "c0" not in told:
        return 1.0, 0.0
    if function != 0:
        raise BadInput(
            f"{name} has values that ImageJ calibrates by a curve (its function {function}), which is not reproduced: "
            "convert the image in ImageJ to 32 bits (Image > Type), which applies it, and save that."
        )
    gain = float(told.get("c1", 1.0))
    return gain, float(told["c0"]) + (32768.0 * gain if kind == np.int16 else 0.0)


def _pixels(opened: TiffFile, series: TiffPageSeries) -> Element:
    """Return the element ``Pixels`` of an image of an OME-TIFF file."""
    root = parsed_xml((opened.ome_metadata or "").encode())
    images = [e for e in root.iter() if e.tag.rpartition("}")[2] == "Pixels"]
    numbers = {id(s): k for k, s in enumerate(opened.series)}
    return images[min(numbers.get(id(series), 0), len(images) - 1)]
