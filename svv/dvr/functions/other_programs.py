"""Transfer functions of Inviwo (``.itf``), Voreen (``.tfi``) and yt, and colour tables of ImageJ (``.lut``).

Inviwo's opacities apply to 1/150, Voreen's to 1/200 of the volume's side: their ray casters count in texture
coordinates, so the sides of a volume that is no cube count differently there; here, their geometric mean does. Those of
yt are extinctions per depth of its camera.

Sources: ``field_interpolation_tables.pxd`` and ``lens.py`` of yt, ``compositing.glsl`` and ``transferfunction.cpp`` of
Inviwo, ``mod_compositing.frag`` and ``transfunc1dkeys.cpp`` of Voreen, and
https://imagej.net/ij/docs/menus/image.html (LUTs).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from svv.core.xml_values import parsed_xml
from svv.dvr.functions.scales import Points
from svv.errors import BadInput

DAMAGED = "{name} is not a transfer function of {program} as {program} writes it: {why}."

PARTS = 16.0
"""Parts of yt's largest extinction that an opacity stands for: so few that it is nearly straight between two places."""

Key = tuple[float, tuple[float, ...]]
"""A value, and red, green, blue and opacity in [0, 1]."""


def parsed_itf(content: bytes, name: str) -> dict[str, Any]:
    """Return the fields of a transfer function in Inviwo's file, whose places are parts of the data's range.

    Raises BadInput if the file is damaged, or its points lie at values.
    """
    root = _root(content, name, "Inviwo")
    if _number(root.find("type"), "content", 0.0):
        raise BadInput(f"{name} has points at absolute values of other data: make it relative in Inviwo.")
    try:
        keys = [
            (float(_child(point, "pos")["content"]), tuple(float(_child(point, "rgba")[axis]) for axis in "xyzw"))
            for point in root.iter("Point")
        ]
    except (KeyError, ValueError) as error:
        raise BadInput(DAMAGED.format(name=name, program="Inviwo", why="a point lacks pos or rgba")) from error
    shown = tuple(_number(root.find(word), "content", usual) for word, usual in (("maskMin", 0.0), ("maskMax", 1.0)))
    return {**_fields(sorted(keys, key=lambda key: key[0]), shown, name, "Inviwo"), "slabs": 150.0}


def parsed_tfi(content: bytes, name: str) -> dict[str, Any]:
    """Return the fields of a transfer function in Voreen's file, whose places are parts of its domain.

    Raises BadInput if the file is damaged, has two dimensions, a gamma, or another mode of opacity.
    """
    root = _root(content, name, "Voreen")
    if root.find(".//Keys") is None:
        raise BadInput(DAMAGED.format(name=name, program="Voreen", why="it has no keys of one dimension"))
    for word, usual in (("gammaValue", 1.0), ("alphaMode", 1.0)):
        if _number(root.find(f".//{word}"), "value", usual) != usual:
            raise BadInput(f"{name} has {word} other than {usual:g}, which is not drawn: save it without.")
    try:
        keys: list[Key] = []
        for key in root.iter("key"):
            value, is_split = float(_child(key, "intensity")["value"]), _child(key, "split")["value"] == "true"
            for side in ("colorL", "colorR") if is_split else ("colorL",):
                keys.append((value, tuple(float(_child(key, side)[part]) / 255.0 for part in "rgba")))
    except (KeyError, ValueError) as error:
        raise BadInput(DAMAGED.format(name=name, program="Voreen", why="a key lacks a value or a colour")) from error
    threshold, domain = (root.find(f".//{word}") for word in ("threshold", "domain"))
    shown = _number(threshold, "x", 0.0), _number(threshold, "y", 1.0)
    low, high = _number(domain, "x", 0.0), _number(domain, "y", 1.0)
    fields = {**_fields(sorted(keys, key=lambda key: key[0]), shown, name, "Voreen"), "slabs": 200.0}
    if (low, high) != (0.0, 1.0):
        if not low < high:
            raise BadInput(DAMAGED.format(name=name, program="Voreen", why="its domain is no range"))
        for part in ("colours", "opacities"):
            fields[part] = tuple((low + (high - low) * value, *rest) for value, *rest in fields[part])
        fields["placed"] = True
    return fields


def parsed_lut(content: bytes, name: str) -> dict[str, Any]:
    """Return the fields of a function with the colours of an ImageJ table, whose opacity is a ramp.

    Raises BadInput if it is neither 256 colours nor a text of them.
    """
    if len(content) in (768, 800):
        table = np.frombuffer(content[-768:], np.uint8).reshape(3, 256).T
    else:
        try:
            rows = [line.split() for line in content.decode("ascii").replace(",", " ").splitlines() if line.strip()]
            table = np.array([[float(word) for word in row[-3:]] for row in rows if row[0][0].isdigit()])
            if table.shape != (256, 3) or table.min() < 0 or table.max() > 255:
                raise ValueError
        except (UnicodeDecodeError, ValueError) as error:
            raise BadInput(DAMAGED.format(name=name, program="ImageJ", why="it needs 256 colours")) from error
    places = np.linspace(0.0, 1.0, 256)
    colours = tuple((value, *(rgb / 255.0)) for value, rgb in zip(places.tolist(), table.astype(float)))
    ramp = ((0.0, 0.0, 0.5, 0.0), (1.0, 1.0, 0.5, 0.0))
    return {"colours": colours, "opacities": ramp, "name": name, "placed": False}


def fields_of_yt(tf: Any, depth: float, name: str) -> dict[str, Any]:
    """Return the fields of a colour transfer function of yt; see :meth:`.TransferFunction.from_yt`."""
    if not (np.isfinite(depth) and depth > 0.0):
        raise BadInput(f"The depth of yt's camera (width[2]) must be a positive number of world units, not {depth}.")
    try:
        places = np.array(tf.alpha.x, np.float64)
        colours = np.stack([np.array(part.y, np.float64) for part in (tf.red, tf.green, tf.blue)], axis=1)
        alphas, grey = np.array(tf.alpha.y, np.float64), bool(tf.grey_opacity)
    except (AttributeError, TypeError, ValueError) as error:
        raise BadInput(f"'{name}' is no yt.ColorTransferFunction: {error}.") from error
    if not grey:
        raise BadInput(
            f"The channels of '{name}' have opacities of their own, which no other program draws: make it with "
            "grey_opacity=True in yt."
        )
    if len(places) != len(alphas) or not (np.isfinite(alphas).all() and alphas.min() >= 0.0):
        raise BadInput(f"The alphas of '{name}' must be numbers that are not negative, one for each place.")
    shown = np.convolve(alphas > 0.0, [1, 1, 1], "same") > 0
    if colours[shown].size and colours[shown].max() > 1.0:
        raise BadInput(f"'{name}' has colours up to {colours[shown].max():g}: divide them by that, 1 is the most here.")
    unit = depth / PARTS / (alphas.max() or 1.0)
    opacities = [(float(v), float(-np.expm1(-a * unit / depth)), 0.5, 0.0) for v, a in zip(places, alphas)]
    first, last = opacities[0][0], opacities[-1][0]
    return {
        "colours": tuple((float(v), *rgb) for v, rgb in zip(places, np.clip(colours, 0.0, 1.0).tolist())),
        "opacities": ((first, 0.0, 0.5, 0.0), *opacities, (last, 0.0, 0.5, 0.0)),
        "name": name, "unit_distance": float(unit),
    }  # fmt: skip


PROGRAMS: dict[str, Callable[[bytes, str], dict[str, Any]]] = {
    ".itf": parsed_itf, ".tfi": parsed_tfi, ".lut": parsed_lut,
}  # fmt: skip
"""Readers of files by their endings."""


def _root(content: bytes, name: str, program: str) -> Element:
    try:
        return parsed_xml(content)
    except ValueError as error:
        raise BadInput(DAMAGED.format(name=name, program=program, why=f"it is no XML ({error})")) from error


def _child(element: Element, name: str) -> dict[str, str]:
    """Return the attributes of a child; raises KeyError if there is none."""
    found = element.find(name)
    if found is None:
        raise KeyError(name)
    return found.attrib


def _number(element: Element | None, key: str, usual: float) -> float:
    """Return a number of an element; the usual one without it, or if it is none."""
    try:
        return usual if element is None else float(element.get(key, usual))
    except ValueError:
        return usual


def _fields(keys: Sequence[Key], shown: Sequence[float], name: str, program: str) -> dict[str, Any]:
    """Return colours and opacities from end to end, of which those outside ``shown`` are 0."""
    if not keys:
        raise BadInput(DAMAGED.format(name=name, program=program, why="it has no points"))
    whole = [*keys]
    if keys[0][0] > 0.0:
        whole.insert(0, (0.0, keys[0][1]))
    if keys[-1][0] < 1.0:
        whole.append((1.0, keys[-1][1]))
    colours: Points = tuple((value, *colour[:3]) for value, colour in whole)
    opacities = [(value, colour[3], 0.5, 0.0) for value, colour in whole]
    low, high = shown
    places, levels = [point[0] for point in opacities], [point[1] for point in opacities]
    if low > 0.0:
        begins = [(0.0, 0.0), (low, 0.0), (low, float(np.interp(low, places, levels)))]
        opacities = [*((*point, 0.5, 0.0) for point in begins), *(point for point in opacities if point[0] > low)]
    if high < 1.0:
        ends = [(high, float(np.interp(high, places, levels))), (high, 0.0), (1.0, 0.0)]
        opacities = [*(point for point in opacities if point[0] < high), *((*point, 0.5, 0.0) for point in ends)]
    return {"colours": colours, "opacities": tuple(opacities), "name": name, "placed": False}
