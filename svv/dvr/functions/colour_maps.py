"""Colours without opacities: colour maps of matplotlib by name, and those of ParaView (XML) and VisIt in files.

The opacity is a ramp from 0 at the smallest value to 1 at the largest, which a note says.

VisIt's opacities are not read. They apply to a sample's distance, to a unit of length or to ten cells, by its renderer
and version, and a file does not say by which it was written.

Sources: ``ColorControlPointList.code`` and ``avtDefaultRenderer.C`` of VisIt, ``vtkSMTransferFunctionProxy.cxx`` of
ParaView.
"""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from svv.dvr.functions.named import chosen, listed
from svv.dvr.functions.scales import Points
from svv.errors import BadInput

RAMP = "'{name}' has colours alone: the opacity is a ramp from 0 at the smallest value to 1 at the largest."
VISIT = (
    "The opacities of '{name}' are not read, because VisIt's renderers and versions apply them to different "
    "thicknesses: the opacity is a ramp from 0 at the smallest value to 1 at the largest."
)
NO_MATPLOTLIB = (
    "There is no transfer function {name}. If it is a colour map of matplotlib, install that: pip install matplotlib."
)
DAMAGED = "{name} is not a file of {program}'s colours as {program} writes it: {why}."

STEPPED = 64
"""Colour maps of fewer colours have steps; others are tables of a smooth curve."""

LINEAR = {"Linear", "1", "true"}
"""How VisIt writes that colours are interpolated (``smoothing``, and ``smoothingFlag`` in old files)."""


def fields_of_map(name: str) -> dict[str, Any]:
    """Return the fields of a function with the colours of a matplotlib colour map.

    Raises BadInput if there is no such colour map, or no matplotlib.
    """
    try:
        from matplotlib import colormaps
    except ImportError as error:
        raise BadInput(NO_MATPLOTLIB.format(name=name)) from error
    if name not in colormaps:
        near = get_close_matches(name, list(colormaps), 3, 0.6)
        close = f"Close ones: {', '.join(near)}." if near else listed(n for n in colormaps if not n.endswith("_r"))
        raise BadInput(f"There is no transfer function {name}: neither a file nor a colour map of matplotlib. {close}")
    found = colormaps[name]
    table = found(np.arange(found.N))[:, :3]
    if found.N < STEPPED:
        return _ramped(_steps(np.linspace(0.0, 1.0, found.N + 1), table), name, RAMP)
    places = (np.arange(found.N) + 0.5) / found.N
    places[[0, -1]] = 0.0, 1.0
    return _ramped(_points(places, table), name, RAMP)


def preset_in_xml(root: Element, wanted: str | None, name: str) -> dict[str, Any]:
    """Return the preset in ParaView's old file of colour maps (XML), as ParaView converts it to JSON.

    Raises BadInput if the file is damaged, or there is none of the name.
    """
    found = chosen([(one.get("name", ""), one) for one in root.iter("ColorMap")], wanted, name, "colour map")
    named: dict[str, Any] = {"Name": found.get("name") or name}
    if found.get("indexedLookup") == "true":
        return {**named, "IndexedColors": []}
    try:
        rows = sorted([float(point.attrib[key]) for key in "xrgb"] for point in found.iter("Point"))
    except (KeyError, ValueError) as error:
        raise BadInput(DAMAGED.format(name=name, program="ParaView", why=f"a point lacks a number ({error})")) from None
    wrapped, space = found.get("space") == "Wrapped", found.get("space", "RGB")
    colours = {"RGBPoints": [number for row in rows for number in row]}
    return {**named, **colours, "ColorSpace": "HSV" if wrapped else space, "HSVWrap": int(wrapped)}


def parsed_visit(root: Element, name: str) -> dict[str, Any]:
    """Return the fields of a function with the colours of a colour table or of volume attributes of VisIt.

    Raises BadInput if the file is damaged, has none or several, or its colours are interpolated otherwise than in
    straight lines, or on a scale.
    """
    plots = [one for one in root.iter("Object") if one.get("name") == "VolumeAttributes"]
    if len(plots) > 1:
        raise BadInput(f"{name} has {len(plots)} volume plots: save the attributes of one (its window, Save).")
    found = plots[0] if plots else root
    lists = [one for one in found.iter("Object") if one.get("name") == "ColorControlPointList"]
    if len(lists) != 1:
        raise BadInput(DAMAGED.format(name=name, program="VisIt", why=f"it has {len(lists)} lists of colours"))
    if _field(found, "scaling", "Linear") not in ("Linear", "0"):
        raise BadInput(f"{name} shows values on a scale that is not drawn: set Scale to Linear in VisIt.")
    try:
        places, table = _control_points(lists[0])
        fields = _ramped(_whole(_as_visit_draws(places, table, lists[0], name)), name, VISIT if plots else RAMP)
        used = [_field(found, f"useColorVar{end}", "false") == "true" for end in ("Min", "Max")]
        ends = [float(_field(found, f"colorVar{end}", "0")) for end in ("Min", "Max")]
    except ValueError as error:
        raise BadInput(DAMAGED.format(name=name, program="VisIt", why=str(error))) from None
    if any(used):
        if not all(used) or not ends[0] < ends[1]:
            raise BadInput(f"{name} limits its colours at one end only, or backwards: set both limits or none.")
        for part in ("colours", "opacities"):
            fields[part] = tuple((ends[0] + (ends[1] - ends[0]) * value, *rest) for value, *rest in fields[part])
        fields["placed"] = True
    return fields


def _control_points(whole: Element) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return places (n,) and colours (n, 3) of VisIt's control points, in the long or the compact form.

    Raises ValueError if there are fewer than two, or numbers are missing.
    """
    if compact := _field(whole, "compactColors", ""):
        table = np.array([float(word) for word in compact.split()]).reshape(-1, 4)
        places = np.array([float(word) for word in _field(whole, "compactPositions", "").split()])
    else:
        points = [one for one in whole.findall("Object") if one.get("name") == "ColorControlPoint"]
        rows = [[float(word) for word in _field(one, "colors", "0 0 0 255").split()] for one in points]
        table = np.array([row[:3] for row in rows if len(row) in (3, 4)])
        places = np.array([float(_field(one, "position", "0")) for one in points])
    if len(table) < 2 or len(table) != len(places) or not 0.0 <= places.min() <= places.max() <= 1.0:
        raise ValueError("it needs two or more colours at places between 0 and 1")
    if not (table.min() >= 0 and table.max() <= 255):
        raise ValueError("a colour is beyond 0 and 255")
    order = np.argsort(places, kind="stable")
    return places[order], table[order, :3] / 255.0


def _as_visit_draws(places: NDArray[np.float64], table: NDArray[np.float64], whole: Element, name: str) -> Points:
    """Return the points of control points that are interpolated, evenly spaced or steps, as VisIt samples them."""
    smoothing = _field(whole, "smoothing", _field(whole, "smoothingFlag", "Linear"))
    discrete = _field(whole, "discreteFlag", "false") == "true"
    if smoothing in ("CubicSpline", "2") and not discrete:
        raise BadInput(
            f"{name} has colours along a cubic spline, which is not drawn: set Smoothing to Linear in VisIt."
        )
    smooth = smoothing in LINEAR
    if discrete or _field(whole, "equalSpacingFlag", "false") == "true":
        edges = np.linspace(0.0, 1.0, len(table) + 1)
        if not smooth:
            return _steps(edges, table)
        return _points(edges, np.vstack([table[:1], 0.5 * (table[1:] + table[:-1]), table[-1:]]))
    if smooth:
        return _points(places, table)
    return _steps(np.concatenate([places[:1], 0.5 * (places[1:] + places[:-1]), places[-1:]]), table)


def _whole(colours: Points) -> Points:
    """Return points from 0 to 1, beyond whose own ones the first and the last colour hold."""
    before = ((0.0, *colours[0][1:]),) if colours[0][0] > 0.0 else ()
    after = ((1.0, *colours[-1][1:]),) if colours[-1][0] < 1.0 else ()
    return (*before, *colours, *after)


def _field(element: Element, name: str, usual: str) -> str:
    """Return the text of one of VisIt's fields, the usual one without it."""
    for field in element.findall("Field"):
        if field.get("name") == name:
            return (field.text or "").strip().strip('"')
    return usual


def _points(places: NDArray[np.float64], table: NDArray[np.float64]) -> Points:
    return tuple((value, *colour) for value, colour in zip(places.tolist(), table.tolist()))


def _steps(edges: NDArray[np.float64], table: NDArray[np.float64]) -> Points:
    """Return points of colours that hold from each edge to the next."""
    return _points(np.repeat(edges, 2)[1:-1], np.repeat(table, 2, axis=0))


def _ramped(colours: Sequence[tuple[float, ...]], name: str, note: str) -> dict[str, Any]:
    """Return fields with an opacity that is a ramp from end to end, which a note says."""
    low, high = (colours[0][0], colours[-1][0]) if colours[0][0] < colours[-1][0] else (0.0, 1.0)
    ramp = ((low, 0.0, 0.5, 0.0), (high, 1.0, 0.5, 0.0))
    return {
        "colours": tuple(colours), "opacities": ramp, "name": name, "placed": False, "notes": (note.format(name=name),),
    }  # fmt: skip
