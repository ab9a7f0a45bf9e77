"""Transfer functions, which map scalar values to colours and opacities.

An opacity applies to a slab as thick as one *opacity unit distance*: a ray that passes a distance d through a value of
opacity a keeps the fraction (1 - a) ** (d / unit) of the light behind it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

from svv.bricks.formats.source import Level
from svv.core.colour.shading import Shading
from svv.core.interval_text import interval_text
from svv.core.json_values import parsed
from svv.core.volumes.opacity_code import unit_distance
from svv.core.xml_values import parsed_xml
from svv.dvr.functions import colour_maps, other_programs, presets, scales, slicer
from svv.dvr.functions.bumps import points_of_bumps
from svv.dvr.functions.colour_paths import colours_at
from svv.dvr.functions.named import chosen, file_and_name
from svv.dvr.functions.scales import LARGEST_VALUE, MOST_POINTS, Points, own_range
from svv.errors import BadInput

COLOUR_SPACES = ("RGB", "HSV", "Lab", "Diverging", "Lab/CIEDE2000", "Step")
"""Spaces in which colours are interpolated between two points (ParaView's names)."""

XML_FILES = (".xml", ".mrml", ".ct", ".session")
"""Endings of files in XML, whose root says of which program they are."""

OPAQUE = 0.99
"""A function that is nowhere below this opacity shows only the volume's box."""

BETWEEN = 17
"""Number of pieces into which the interval between two points is divided."""

NORMALIZED = ((0.0, 1.0), (-1.0, 1.0))
"""Ranges of functions that are meant to be stretched over the data: nearly all of ParaView's presets have one."""


@dataclass(frozen=True)
class TransferFunction:
    """Colour and opacity as functions of the scalar value.

    Args:
        colours: (value, red, green, blue) in ascending order of values, colours in [0, 1]. Two points with the same
            value make a jump.
        opacities: (value, opacity, midpoint, sharpness), ascending, all but the value in [0, 1]; midpoint and
            sharpness shape the curve to the next point as in VTK (0.5 and 0: a straight line).
        unit_distance: Opacity unit distance in world units; None for ParaView's default (see ``unit_distance_for``).
        name: Name in messages.
        space: One of ``COLOUR_SPACES``.
        hsv_wrap: Whether hues take the shorter way around the circle in the space HSV; in ParaView, they do so only if
            asked.
        log_scale: Whether colours are on a logarithmic scale, as ParaView draws it (:mod:`svv.dvr.functions.scales`).
        log_opacity: Whether opacities are.
        placed: Whether the points are at values of the data. A preset without opacity points has none of its own: it
            is always stretched over the data's range.
        below: Red, green and blue of what is smaller than the first colour's value; None for the first colour.
        above: Of what is larger than the last one's.
        shading: How the program that wrote the function shades; None if it does not say.
        notes: Sentences on what it asks for that is drawn otherwise.
        slabs: Without a unit distance, how many of them lie along the volume's mean side; None for ParaView's default.

    Raises:
        BadInput: There are no points, values are not finite or not ascending, numbers are outside [0, 1], or the
            colour space is unknown.

    >>> points = [(0.0, 0.0, 0.5, 0.0), (0.4, 0.0, 0.5, 0.0), (1.0, 0.6, 0.5, 0.0)]
    >>> tf = svv.TransferFunction([(0.0, 0.1, 0.2, 0.8), (1.0, 0.9, 0.3, 0.1)], points)
    >>> tf.range
    (0.0, 1.0)
    """

    colours: Points
    opacities: Points
    unit_distance: float | None = None
    name: str = "transfer function"
    space: str = "RGB"
    hsv_wrap: bool = False
    log_scale: bool = False
    log_opacity: bool = False
    placed: bool = True
    below: tuple[float, ...] | None = None
    above: tuple[float, ...] | None = None
    shading: Shading | None = None
    notes: tuple[str, ...] = ()
    slabs: float | None = None

    def __post_init__(self) -> None:
        for kind in ("colours", "opacities"):
            try:
                points = np.array(getattr(self, kind), dtype=np.float64)
            except (TypeError, ValueError, OverflowError):
                points = np.empty(0)
            if len(points) > MOST_POINTS:
                raise BadInput(f"'{self.name}' has {len(points)} {kind}, more than {MOST_POINTS}; resample it.")
            if points.ndim != 2 or points.shape[1] != 4 or not np.isfinite(points).all():
                raise BadInput(f"'{self.name}' needs {kind} as a list of points of four finite numbers each.")
            if np.abs(points[:, 0]).max() > LARGEST_VALUE:
                raise BadInput(
                    f"The values of '{self.name}' must lie between -{LARGEST_VALUE:g} and {LARGEST_VALUE:g}."
                )
            if (np.diff(points[:, 0]) < 0).any():
                raise BadInput(f"The {kind} of '{self.name}' must be in ascending order of their values.")
            if points[:, 1:].min() < 0 or points[:, 1:].max() > 1:
                raise BadInput(f"The {kind} of '{self.name}' must lie between 0 and 1.")
            object.__setattr__(self, kind, tuple(tuple(float(x) for x in point) for point in points))
        for outside in (self.below, self.above):
            if outside is not None and not (len(outside) == 3 and all(0.0 <= level <= 1.0 for level in outside)):
                raise BadInput(f"The colours of '{self.name}' beyond its range must be three numbers between 0 and 1.")
        if self.space not in COLOUR_SPACES:
            raise BadInput(f"'{self.name}' has the colour space {self.space}; use one of {', '.join(COLOUR_SPACES)}.")
        if self.unit_distance is not None and not (np.isfinite(self.unit_distance) and self.unit_distance > 0):
            raise BadInput(f"The opacity unit distance must be a positive number, not {self.unit_distance}.")

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value of any point."""
        values = [point[0] for point in (*self.colours, *self.opacities)]
        return min(values), max(values)

    def mapped(self, scale: float, offset: float, origin: float = 0.0) -> TransferFunction:
        """Return the same function for values mapped to scale * (value - origin) + offset (scale > 0)."""
        colours = tuple((scale * (v - origin) + offset, *rest) for v, *rest in self.colours)
        opacities = tuple((scale * (v - origin) + offset, *rest) for v, *rest in self.opacities)
        return replace(self, colours=colours, opacities=opacities)

    def is_stretched(self, low: float, high: float, rescale: bool | None = None) -> bool:
        """Return whether :meth:`fitted` stretches the function over data in [low, high]."""
        if rescale is not None:
            return rescale
        if not self.placed:
            return high > low
        ranges = [own_range(self.colours), own_range(self.opacities)]
        if not high > low or any(own not in NORMALIZED for own in ranges):
            return False
        start, stop = self.range
        width = stop - start
        return low < start - 0.5 * width or high > stop + 0.5 * width or high - low < 0.1 * width

    def fitted(self, low: float, high: float, rescale: bool | None = None) -> TransferFunction:
        """Return the function for data in [low, high], on linear scales.

        Args:
            low: Smallest value of the data.
            high: Largest value of the data.
            rescale: True stretches the points over the data's range, colours and opacities each from their own, as
                ParaView does if *Use preset range* is off; False leaves them. None stretches a preset without opacity
                points, and a function whose ranges are in ``NORMALIZED`` if the data is clearly elsewhere: beyond them
                by half of their width, or within less than a tenth of it.

        Raises:
            BadInput: The function lies outside the data's range, or is transparent or opaque throughout it, or its
                logarithmic scale does not suit the data.
        """
        colours, opacities = self.colours, self.opacities
        if self.is_stretched(low, high, rescale):
            if not (high > low and all(stop > start for start, stop in map(own_range, (colours, opacities)))):
                raise BadInput(f"'{self.name}' cannot be rescaled: it or the data has only one value.")
            colours = scales.stretched(colours, low, high, self.log_scale)
            opacities = scales.stretched(opacities, low, high, self.log_opacity)
        else:
            colours = scales.as_drawn(colours, low, high, self.name) if self.log_scale else colours
            opacities = scales.straightened(opacities, self.name) if self.log_opacity else opacities
        fitted = replace(self, colours=colours, opacities=opacities, log_scale=False, log_opacity=False, placed=True)
        fitted._check(low, high)
        return fitted

    def _check(self, low: float, high: float) -> None:
        data = f"the data runs from {interval_text(low, high)}"
        start, stop = self.range
        if start > high or stop < low:
            raise BadInput(
                f"'{self.name}' runs from {interval_text(start, stop)}, but {data}; rescale it (--rescale, or in "
                "ParaView: Rescale to Data Range)."
            )
        opacity = self.opacity_at(self.samples(low, high))
        if opacity.max() <= 0:
            raise BadInput(f"'{self.name}' is transparent everywhere in the data's range ({data}).")
        if opacity.min() >= OPAQUE and high > low:
            raise BadInput(f"'{self.name}' is opaque everywhere in the data's range ({data}): only a box would show.")

    def samples(self, low: float, high: float) -> NDArray[np.float64]:
        """Return values in [low, high] that miss no extremum: evenly spaced, the points and both sides of each.

        As a single value far away makes the even ones coarse, there are some between each two points, too.
        """
        values = np.array([point[0] for point in self.opacities])
        between = np.linspace(values[:-1], values[1:], BETWEEN, endpoint=False)[1:].ravel()
        near = np.concatenate([values, np.nextafter(values, -np.inf), np.nextafter(values, np.inf), between])
        return np.unique(np.clip(np.concatenate([np.linspace(low, high, 1025), near]), low, high))

    def resolved(self, low: float, high: float, count: int = 4097) -> NDArray[np.float64]:
        """Return ascending values in [low, high] that miss no extremum, ``count`` of them even where values differ."""
        return np.union1d(self.samples(low, high), np.linspace(*self.varying_range(low, high), count))

    def visible_ranges(self, low: float, high: float) -> list[tuple[float, float]]:
        """Return the intervals of values in [low, high] with an opacity above 0, in ascending order."""
        samples = self.samples(low, high)
        seen = np.pad(self.opacity_at(samples) > 0, 1)
        starts, stops = np.flatnonzero(seen[1:] & ~seen[:-1]), np.flatnonzero(seen[:-1] & ~seen[1:]) - 1
        last = len(samples) - 1
        return [
            (float(samples[max(a - 1, 0)]), float(samples[min(b + 1, last)]))
            for a, b in zip(starts.tolist(), stops.tolist())
        ]

    def varying_range(self, low: float, high: float) -> tuple[float, float]:
        """Return the part of the values in [low, high] outside of which all look the same, or are invisible.

        A table of entries from end to end then resolves the function, whatever single values lie far away.
        """
        points = [point[0] for point in (*self.colours, *self.opacities)]
        first, last = max(low, min(points)), min(high, max(points))
        if first >= last:
            return low, high
        seen = self.visible_ranges(first, last)
        if seen and seen[0][0] < seen[-1][1]:
            first, last = seen[0][0], seen[-1][1]
        return first, last

    def opacity_at(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the opacities per unit distance of these values, as VTK interpolates them.

        At two points of one value, that is the opacity of the second (:mod:`svv.dvr.functions.jumps`).
        """
        function = self.to_vtk()[1]
        values = np.asarray(values, dtype=np.float64)
        values = np.where(np.isin(values, scales.doubled(self.opacities)), np.nextafter(values, np.inf), values)
        return np.array([function.GetValue(float(v)) for v in values.ravel()]).reshape(values.shape)

    def colour_at(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the colours (..., 3) of these values, as VTK interpolates them; of the first of two at one value."""
        values = np.asarray(values, dtype=np.float64)
        if self.space == "Lab/CIEDE2000":  # VTK takes too long for each
            found = colours_at(np.array(self.colours), values.ravel(), self.log_scale).reshape(*values.shape, 3)
            beyond = ((self.below, values < self.colours[0][0]), (self.above, values > self.colours[-1][0]))
            for colour, there in beyond:
                found[there] = found[there] if colour is None else colour
            return found
        function = self.to_vtk()[0]
        return np.array([function.GetColor(float(v)) for v in values.ravel()]).reshape(*values.shape, 3)

    def to_vtk(self) -> tuple[vtkColorTransferFunction, vtkPiecewiseFunction]:
        """Return VTK's colour transfer function and scalar opacity function."""
        colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
        getattr(colour, f"SetColorSpaceTo{self.space.replace('/', '')}")()
        colour.SetHSVWrap(self.hsv_wrap)
        if self.log_scale:
            colour.SetScaleToLog10()
        colour.AllowDuplicateScalarsOn()
        opacity.AllowDuplicateScalarsOn()
        opacity.SetUseLogScale(self.log_opacity)
        for value, *rgb in self.colours:
            colour.AddRGBPoint(value, *rgb)
        if self.below is not None:
            colour.SetBelowRangeColor(*self.below)
            colour.UseBelowRangeColorOn()
        if self.above is not None:
            colour.SetAboveRangeColor(*self.above)
            colour.UseAboveRangeColorOn()
        for point in self.opacities:
            opacity.AddPoint(*point)
        return colour, opacity

    def to_dict(self) -> dict[str, object]:
        """Return a ParaView preset (JSON), with the unit distance under ParaView's property name."""
        preset: dict[str, object] = {
            "Name": self.name,
            "ColorSpace": self.space,
            "RGBPoints": [x for point in self.colours for x in point],
        }
        if self.placed or len(self.opacities) > 2:
            preset |= {"Points": [x for point in self.opacities for x in point]}
            preset |= {} if self.placed else {presets.STRETCHED: 1}
        if self.unit_distance is not None:
            preset["ScalarOpacityUnitDistance"] = self.unit_distance
        if self.hsv_wrap:
            preset["HSVWrap"] = 1
        for word, outside in (("Below", self.below), ("Above", self.above)):
            if outside is not None:
                preset |= {f"Use{word}RangeColor": 1, f"{word}RangeColor": list(outside)}
        if self.log_scale or self.log_opacity:  # ParaView applies the first to both
            preset |= {"UseLogScale": int(self.log_scale), "OpacityUseLogScale": int(self.log_opacity)}
        return preset

    def unit_in(self, level: Level) -> float:
        """Return the opacity unit distance in a volume, world units."""
        if self.unit_distance is None and self.slabs is not None:
            return float(np.cbrt(np.prod(level.spacing * level.shape[::-1]))) / self.slabs
        return self.unit_distance or unit_distance_for(level)

    @classmethod
    def from_dict(cls, data: object, name: str = "transfer function") -> TransferFunction:
        """Make a function from a ParaView preset (an object, or a list whose first object is used) or from bumps.

        A preset without ``Points`` gets ParaView's default opacity, a ramp from 0 to 1 over the data's range. An object
        ``{"bumps": [...]}``, or the list alone, contains the arguments of ``from_bumps``. Raises BadInput if ``data``
        is neither of these, or does not fit the class.
        """
        preset = presets.preset_in(data, name)
        if "bumps" not in preset:
            return cls(**presets.fields_of_preset(preset, name))
        return cls.from_bumps(preset["bumps"], *presets.name_and_unit(preset, name))

    @classmethod
    def from_vtk(
        cls,
        colour: vtkColorTransferFunction,
        opacity: vtkPiecewiseFunction,
        unit_distance: float | None = None,
        name: str = "transfer function",
    ) -> TransferFunction:
        """Make a function from VTK's functions, such as those edited in ParaView; the inverse of ``to_vtk``.

        Args:
            colour: Colours. What ParaView does not draw in volumes is ignored: discrete and categorical colours.
            opacity: Opacity per unit distance.
            unit_distance: Opacity unit distance in world units, see the class.
            name: Name in messages.

        Raises:
            BadInput: One of the functions has no points or does not fit the class.
        """
        if not colour.GetSize() or not opacity.GetSize():
            raise BadInput(f"'{name}' has no points; edit it in the colour map editor.")
        fields = presets.fields_of_colours(colour, COLOUR_SPACES)
        opacities = []
        for i in range(opacity.GetSize()):
            opacity.GetNodeValue(i, node := [0.0] * 4)
            opacities.append(tuple(node))
        if not opacity.GetClamping():  # nothing is shown beyond the points
            (first, *_), (last, *_) = opacities[0], opacities[-1]
            opacities = [(first, 0.0, 0.5, 0.0), *opacities, (last, 0.0, 0.5, 0.0)]
        log = bool(opacity.GetUseLogScale())
        return cls(opacities=tuple(opacities), unit_distance=unit_distance, name=name, log_opacity=log, **fields)

    @classmethod
    def from_yt(cls, tf: Any, depth: float, name: str = "yt") -> TransferFunction:
        """Make a function from a ``yt.ColorTransferFunction`` with ``grey_opacity=True``.

        yt's alpha is an extinction for the whole depth of its camera, e^-alpha of the light passes the depth, and what
        lies outside the function's bounds is not shown. A source of yt with ``log_field`` looks up the logarithm (base
        10): give svv the volume's logarithm, too.

        Args:
            tf: The function.
            depth: The camera's ``width[2]`` in the volume's world units, > 0.
            name: Name in messages.

        Raises:
            BadInput: It is another object, its channels have opacities of their own (yt's default), a colour is above
                1, or the depth is not positive.

        >>> class Table:  # as yt.ColorTransferFunction((0.0, 1.0), nbins=3, grey_opacity=True)
        ...     def __init__(self, *y):
        ...         self.x, self.y = np.linspace(0.0, 1.0, len(y)), np.array(y)
        >>> class Function:
        ...     red, green, blue, alpha = Table(1, 1, 1), Table(0, 0, 1), Table(0, 0, 1), Table(0, 2, 0)
        ...     grey_opacity = True
        >>> made = TransferFunction.from_yt(Function(), depth=100.0)
        >>> light = 1.0 - made.opacity_at(0.5)
        >>> float((light ** (100.0 / made.unit_distance)).round(6))  # e^-2
        0.135335
        """
        return cls(**other_programs.fields_of_yt(tf, depth, name))

    @classmethod
    def read(cls, path: str | Path) -> TransferFunction:
        """Read a function from a file or, for one of several in a file or a colour map, by name.

        A file is JSON, see ``from_dict``, or one of 3D Slicer (.vp, .vp.json, or a scene or presets in XML), ParaView
        (colours in XML), VisIt (.ct, or attributes in XML), Inviwo, Voreen or ImageJ
        (:mod:`svv.dvr.functions.other_programs`). A name follows its file after a colon, as in ``presets.xml:CT-Bone``;
        one alone is a colour map of matplotlib, ``viridis`` or ``matplotlib:viridis``. Raises BadInput if the file does
        not exist, is of no kind, or is rejected by ``from_dict``; it has none of the name, or several functions and no
        name is given; or there is no such colour map.
        """
        file, name = file_and_name(path)
        if file is None:
            return cls(**colour_maps.fields_of_map(name or ""))
        try:
            return cls._of_content(file.read_bytes(), file.name, name)
        except OSError as error:
            raise BadInput(f"Cannot read the transfer function {path}: {error.strerror or error}.") from error

    @classmethod
    def _of_content(cls, content: bytes, file: str, name: str | None) -> TransferFunction:
        """Return the function in the content of a file, of the name if several are there."""
        if file.lower().endswith(XML_FILES):
            return cls._of_xml(content, file, name)
        reader = other_programs.PROGRAMS.get(Path(file).suffix.lower())
        if name is not None and (reader or file.lower().endswith(".vp")):
            raise BadInput(f"{file} has one transfer function, without a name: leave out ':{name}'.")
        if file.lower().endswith(".vp"):
            return cls._of_slicer(slicer.parsed_vp(content, file), file)
        if reader:
            return cls(**reader(content, file))
        try:
            data = parsed(content)
        except ValueError as error:
            raise BadInput(f"The transfer function {file} is not valid JSON ({error}).") from error
        if isinstance(data, Mapping) and "volumeProperties" in data:
            return cls._of_slicer(slicer.parsed_json(data, file), file)
        if name is not None:
            presets_there = data if isinstance(data, list) else [data]
            named = [(str(one.get("Name")), one) for one in presets_there if isinstance(one, Mapping)]
            data = chosen(named, name, file, "preset")
        return cls.from_dict(data, file)

    @classmethod
    def _of_xml(cls, content: bytes, file: str, name: str | None) -> TransferFunction:
        try:
            root = parsed_xml(content)
        except ValueError as error:
            raise BadInput(f"The transfer function {file} is not valid XML ({error}).") from error
        if root.find(".//VolumeProperty") is not None or root.tag == "MRML":
            return cls._of_slicer(slicer.parsed_node(root, name, file), name or file)
        if root.tag in ("ColorMap", "ColorMaps") or root.find(".//ColorMap") is not None:
            return cls.from_dict(colour_maps.preset_in_xml(root, name, file), file)
        if name is not None:
            raise BadInput(f"{file} has no transfer functions with names: leave out ':{name}'.")
        if root.tag != "Object":
            raise BadInput(
                f"{file} is no transfer function of 3D Slicer, ParaView or VisIt: it begins with {root.tag}."
            )
        return cls(**colour_maps.parsed_visit(root, file))

    @classmethod
    def _of_slicer(cls, found: slicer.VolumeProperty, name: str) -> TransferFunction:
        made = cls.from_vtk(found.colour, found.opacity, found.unit_distance, name)
        return replace(made, shading=found.shading, notes=found.notes)

    @classmethod
    def from_bumps(
        cls, bumps: Iterable[Mapping[str, Any]], name: str = "bumps", unit_distance: float | None = None
    ) -> TransferFunction:
        """Make a function of one visible range per bump, a triangle of opacity in one colour.

        Where bumps overlap, the larger opacity applies. Colours change halfway between two centres.

        Args:
            bumps: Mappings with ``centre``, ``width`` (full, at the base), ``opacity`` (at the centre, in (0, 1]) and
                ``colour`` (red, green, blue in [0, 1]; by default one of ``HUES``).
            name: Name in messages.
            unit_distance: Opacity unit distance in world units, see the class.

        Raises:
            BadInput: There is no bump, a bump lacks a number, or the function does not fit the class.
        """
        return cls(*points_of_bumps(bumps, name), unit_distance, name)


def unit_distance_for(level: Level) -> float:
    """Return ParaView's own unit distance (:func:`svv.core.volumes.opacity_code.unit_distance`), world units."""
    return unit_distance(np.array(level.shape[::-1]) - 1, level.spacing)
