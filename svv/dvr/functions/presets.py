"""Fields of a transfer function from ParaView's presets and VTK's colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal, TypedDict

import numpy as np
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

from svv.core.json_values import Json, number_in
from svv.dvr.functions import prolab
from svv.dvr.functions.scales import Points
from svv.errors import BadInput

Colour = tuple[float, ...]

PROLAB = "ProLab"
"""A colour space of VTK 9.5 and later."""

STRETCHED = "StretchedOverData"
"""Our key in presets whose points are parts of the data's range, as those of some other programs are."""

SAMPLES = 256
"""Colours that replace those between two points if they are interpolated in a way that we do not know."""

OUTSIDE: tuple[tuple[Literal["Below", "Above"], Literal["below", "above"]], ...] = (
    ("Below", "below"),
    ("Above", "above"),
)
"""Words in the names of the properties for colours beyond the points, and the names of the fields."""


class ColourFields(TypedDict):
    """Fields of :class:`svv.dvr.functions.transfer_functions.TransferFunction` about colours."""

    colours: Points
    space: str
    hsv_wrap: bool
    log_scale: bool
    below: Colour | None
    above: Colour | None


class Fields(ColourFields):
    """All of its fields."""

    opacities: Points
    unit_distance: float | None
    name: str
    log_opacity: bool
    placed: bool


def preset_in(data: object, name: str) -> Mapping[str, Any]:
    """Return the preset or the bumps in a JSON value, which may be a list with one of them, or of bumps.

    Raises BadInput if it contains neither, or colours for categories only.
    """
    if isinstance(data, list) and data:
        is_bump = isinstance(data[0], Mapping) and "centre" in data[0]
        data = {"bumps": data} if is_bump else data[0]
    if not isinstance(data, Mapping) or not ("RGBPoints" in data or "bumps" in data):
        if isinstance(data, Mapping) and "IndexedColors" in data:
            raise BadInput(
                f"'{data.get('Name', name)}' has colours for categories only (IndexedColors), which ParaView does not "
                "use in volumes: choose a continuous preset, or give each value a bump with its colour."
            )
        raise BadInput(f"{name} is not a transfer function: it has neither RGBPoints (a ParaView preset) nor bumps.")
    return data


def name_and_unit(preset: Json, name: str) -> tuple[str, float | None]:
    """Return the name and the opacity unit distance of a preset; ``name`` and None if it has none."""
    name, unit = str(preset.get("Name", name)), preset.get("ScalarOpacityUnitDistance")
    if unit is not None:
        unit = float(number_in(unit, f"The ScalarOpacityUnitDistance of '{name}'"))
    return name, unit


def fields_of_preset(preset: Json, name: str) -> Fields:
    """Return the fields of the function that a preset with ``RGBPoints`` describes.

    Raises BadInput if its entries have another form.
    """
    name, unit = name_and_unit(preset, name)
    colours = _quadruples(preset["RGBPoints"], "RGBPoints", name)
    log = bool(preset.get("UseLogScale"))
    placed = preset.get("Points") is not None and not preset.get(STRETCHED)
    if preset.get("Points") is not None:
        opacities = _quadruples(preset["Points"], "Points", name)
    else:
        opacities = ((colours[0][0], 0.0, 0.5, 0.0), (colours[-1][0], 1.0, 0.5, 0.0))
    outside = {
        key: _colour(preset.get(f"{word}RangeColor"), name) if preset.get(f"Use{word}RangeColor") else None
        for word, key in OUTSIDE
    }
    space = str(preset.get("ColorSpace", "RGB"))
    if space == PROLAB:
        colours, space = prolab.between(colours, SAMPLES, log), "RGB"
    return {
        "colours": colours,
        "opacities": opacities,
        "unit_distance": unit,
        "name": name,
        "space": {"CIELAB": "Lab", "LAB": "Lab"}.get(space, space),
        "hsv_wrap": bool(preset.get("HSVWrap")),
        "log_scale": log,
        "below": outside["below"],
        "above": outside["above"],
        "log_opacity": bool(preset.get("OpacityUseLogScale", log)),
        "placed": placed,
    }


def fields_of_colours(colour: vtkColorTransferFunction, spaces: Sequence[str]) -> ColourFields:
    """Return the fields about colours of a function of VTK's; ``spaces`` are the names of VTK's colour spaces."""
    plain = vtkColorTransferFunction()  # ParaView's own class looks up discrete colours, which volumes do not show
    plain.AllowDuplicateScalarsOn()
    plain.DeepCopy(colour)
    nodes = []
    for i in range(plain.GetSize()):
        plain.GetNodeValue(i, node := [0.0] * 6)
        nodes.append(node)
    points: Points = tuple(tuple(node[:4]) for node in nodes)
    log = bool(plain.GetScale())
    number, straight = plain.GetColorSpace(), all(node[4:] == [0.5, 0.0] for node in nodes)
    if number >= len(spaces) or not straight:
        low, high = plain.GetRange()
        between = np.geomspace if log and low > 0 else np.linspace
        middles = [a[0] + a[4] * (b[0] - a[0]) for a, b in pairwise(nodes) if a[5] > 0.0]  # a sharp one is a jump
        near = [np.nextafter(value, value + side) for value in middles for side in (-1.0, 1.0)]
        values = np.unique(
            np.clip([*(v for v, *_ in points), *between(low, high, SAMPLES), *middles, *near], low, high)
        )
        points, number = tuple((float(v), *plain.GetColor(float(v))) for v in values), 0
    outside: dict[str, Colour | None] = dict.fromkeys(("below", "above"))
    for word, key in OUTSIDE:
        if getattr(colour, f"GetUse{word}RangeColor")():
            outside[key] = tuple(getattr(colour, f"Get{word}RangeColor")())
    if not colour.GetClamping():
        outside = dict.fromkeys(outside, (0.0, 0.0, 0.0))
    return {
        "colours": points, "space": spaces[number], "hsv_wrap": bool(plain.GetHSVWrap()), "log_scale": log,
        "below": outside["below"], "above": outside["above"],
    }  # fmt: skip


def _colour(colour: object, name: str) -> Colour:
    """Return a colour beyond the range; raises BadInput if the colour is not one of three numbers."""
    if not isinstance(colour, Sequence) or isinstance(colour, str) or len(colour) != 3:
        raise BadInput(f"The colours of '{name}' above and below its range need three numbers, not {colour}.")
    return tuple(float(number_in(level, f"A colour of '{name}'")) for level in colour)


def _quadruples(numbers: object, key: str, name: str) -> Points:
    """Convert a flat list, as in a preset, to points of four numbers."""
    if not isinstance(numbers, Sequence) or not numbers or len(numbers) % 4:
        raise BadInput(f"{key} of '{name}' must be a list of numbers, four for each point.")
    return tuple(tuple(numbers[i : i + 4]) for i in range(0, len(numbers), 4))
