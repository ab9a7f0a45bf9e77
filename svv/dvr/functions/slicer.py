"""Volume properties of 3D Slicer: the text files .vp; .vp.json, which Slicer writes since 5.2; and nodes of MRML.

A .vp has nine lines: interpolation (0 nearest, 1 linear), shading (0 or 1), diffuse, ambient, specular, specular power,
opacities, opacities of gradients, and colours. The last three begin with how many numbers follow: pairs of value and
opacity, or value, red, green and blue. A node of a scene (.mrml) or of Slicer's presets.xml has the same numbers as
attributes, and a name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

from svv.core.colour.shading import Shading
from svv.core.json_values import number_in
from svv.dvr.functions.named import chosen
from svv.errors import BadInput

UNIT = 1.0
"""Opacity unit distance of a .vp, which has none: VTK's own, in world units."""

NEAREST = "{name} shows volumes without interpolation: add --nearest (Python: nearest=True) to draw them so."
GRADIENTS = (
    "{name} has opacities that depend on gradients, which are not drawn: set Gradient Opacity to 1 everywhere in "
    "Slicer (Volume Rendering, Advanced, Volume properties), or export without it."
)
DAMAGED = "{name} is not a volume property of 3D Slicer as Slicer writes it: {why}."

ATTRIBUTES = {
    "interpolation": "1", "shade": "0", "diffuse": "1", "ambient": "0", "specular": "0", "specularPower": "1",
    "scalarOpacity": "0", "gradientOpacity": "0", "colorTransfer": "0",
}  # fmt: skip
"""Attributes of a node, in the order of the lines of a .vp, and what they mean where they are missing."""


@dataclass(frozen=True)
class VolumeProperty:
    """What is read from a file."""

    colour: vtkColorTransferFunction
    opacity: vtkPiecewiseFunction
    shading: Shading
    unit_distance: float
    notes: tuple[str, ...]


def parsed_vp(content: bytes, name: str) -> VolumeProperty:
    """Return the volume property in a .vp.

    Raises BadInput if the file is damaged, or gradients have opacities of their own.
    """
    lines = [line.split() for line in content.decode("utf-8", "replace").splitlines() if line.strip()]
    try:
        numbers = [[float(word) for word in line] for line in lines[:9]]
    except ValueError as error:
        raise BadInput(DAMAGED.format(name=name, why=str(error))) from None
    if len(numbers) < 9 or any(len(line) != 1 for line in numbers[:6]):
        raise BadInput(DAMAGED.format(name=name, why="it needs nine lines, the first six with a number each"))
    return _of_numbers(numbers, name)


def parsed_node(root: Element, wanted: str | None, name: str) -> VolumeProperty:
    """Return the volume property of a name in a scene or a file of presets; without one, the only one.

    Raises BadInput if there is none of the name, several and no name, a node is damaged, or gradients have opacities of
    their own.
    """
    node = chosen([(one.get("name", ""), one) for one in root.iter("VolumeProperty")], wanted, name, "volume property")
    name = node.get("name") or name
    try:
        numbers = [[float(word) for word in node.get(key, usual).split()] for key, usual in ATTRIBUTES.items()]
        if any(len(one) != 1 for one in numbers[:6]) or not all(numbers):
            raise ValueError("an attribute has another number of values")
    except ValueError as error:
        raise BadInput(DAMAGED.format(name=name, why=str(error))) from None
    return _of_numbers(numbers, name)


def _of_numbers(numbers: Sequence[Sequence[float]], name: str) -> VolumeProperty:
    """Return a volume property from the numbers of nine lines."""
    rows = [_rows(line, width, name) for line, width in zip(numbers[6:], (2, 2, 4))]
    (interpolation,), (shade,), (diffuse,), (ambient,), (specular,), (power,) = numbers[:6]
    colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for value, *rgb in _distinct(rows[2]):
        colour.AddRGBPoint(value, *rgb)
    for value, level in _distinct(rows[0]):
        opacity.AddPoint(value, level)
    _check_gradients([level for _, level in rows[1]], name)
    shading = Shading(bool(shade), ambient, diffuse, specular, power)
    return VolumeProperty(colour, opacity, shading, UNIT, _notes(interpolation == 0, name))


def parsed_json(data: Mapping[str, Any], name: str) -> VolumeProperty:
    """Return the first volume property in a .vp.json.

    Raises:
        BadInput: Its entries have another form, it shows several components, or gradients have opacities of their own.
    """
    try:
        whole = data["volumeProperties"][0]
        parts = whole["components"]
        if len(parts) != 1:
            raise BadInput(f"{name} shows {len(parts)} components; a volume here has one: save the property of one.")
        part = parts[0]
        colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
        for point in part["rgbTransferFunction"]["points"]:
            red, green, blue = (_number(level, name) for level in point["color"])
            colour.AddRGBPoint(_number(point["x"], name), red, green, blue, *_curve(point, name))
        for point in part["scalarOpacity"]["points"]:
            opacity.AddPoint(_number(point["x"], name), _number(point["y"], name), *_curve(point, name))
        gradients = () if part.get("disableGradientOpacity") else part.get("gradientOpacity", {}).get("points", ())
        levels = [_number(point["y"], name) for point in gradients]
        light = {"ambient": 0.1, "diffuse": 0.7, "specular": 0.2, "specularPower": 10.0, **part.get("lighting", {})}
        ambient, diffuse, specular, power = (
            _number(light[key], name) for key in ("ambient", "diffuse", "specular", "specularPower")
        )
        unit = _number(part.get("scalarOpacityUnitDistance", UNIT), name)
        shading = Shading(bool(part.get("shade", False)), ambient, diffuse, specular, power)
        nearest = whole.get("interpolationType", "linear") == "nearest"
    except BadInput:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        why = f"it lacks {error}" if isinstance(error, KeyError) else "an entry has another form"
        raise BadInput(DAMAGED.format(name=name, why=why)) from None
    _check_gradients(levels, name)
    return VolumeProperty(colour, opacity, shading, unit, _notes(nearest, name))


def _rows(numbers: Sequence[float], width: int, name: str) -> list[list[float]]:
    """Return the points of a line that begins with how many numbers they have."""
    count, *values = numbers
    if len(values) != count or len(values) % width or not np.isfinite(values).all():
        raise BadInput(DAMAGED.format(name=name, why=f"a line says {count:g} numbers, and {len(values)} follow"))
    return [list(values[i : i + width]) for i in range(0, len(values), width)]


def _distinct(rows: list[list[float]]) -> list[list[float]]:
    """Return points of ascending values, as Slicer does: one that is not larger comes just behind the last."""
    result: list[list[float]] = []
    for value, *rest in rows:
        if result and value <= result[-1][0]:
            value = float(np.nextafter(result[-1][0], np.inf))
        result.append([value, *rest])
    return result


def _number(value: object, name: str) -> float:
    return float(number_in(value, f"A number of {name}"))


def _curve(point: Mapping[str, Any], name: str) -> tuple[float, float]:
    return _number(point.get("midpoint", 0.5), name), _number(point.get("sharpness", 0.0), name)


def _check_gradients(levels: Sequence[float], name: str) -> None:
    if any(abs(level - 1.0) > 1e-6 for level in levels):
        raise BadInput(GRADIENTS.format(name=name))


def _notes(nearest: bool, name: str) -> tuple[str, ...]:
    return (NEAREST.format(name=name),) if nearest else ()
