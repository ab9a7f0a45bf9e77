"""The style pictures of paintings, which a scene keeps so that its look can be saved and applied to other scenes.

They belong to the record of how a painting was made: ``made["kept"]["styles"]`` holds each style's picture and mask as
data URIs, by its name, and of a divided picture the ``part``, a mask as well; ``made["kept"]["laid"]`` says how the
paint of each region was laid. In a file they are arrays, each once, however many paintings share it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.json_values import each_in, number_in, object_in, text_in
from svv.io.files.keyed_results import digest
from svv.io.pictures.picture_data import as_text, content_of

KEPT = "kept"
"""Key of a painting's record under which its styles are kept."""

DIVIDED = "divided"
"""Key under which it says which part of a picture painted each region (:mod:`svv.train.paint.dividing`)."""

PREFIX = "picture."
"""Start of the names of their arrays in a file."""

CODE = re.compile("#[0-9a-f]{6}")

Arrays = dict[str, NDArray[np.generic]]


def drop_styles(made: Mapping[str, object]) -> dict[str, object]:
    """Return the record of how a scene was made without the styles that it keeps, for people to read."""
    painted = made.get("stylized")
    if not isinstance(painted, Mapping) or KEPT not in painted:
        return dict(made)
    return {**made, "stylized": {key: value for key, value in painted.items() if key != KEPT}}


def put_apart(painted: Any, tensors: Arrays) -> Any:
    """Return the record of a painting with names of arrays, without :data:`PREFIX`, in place of pictures.

    The arrays are added to ``tensors``.
    """
    if not isinstance(painted, Mapping) or KEPT not in painted:
        return painted
    styles: dict[str, dict[str, str]] = {}
    for name, style in painted[KEPT]["styles"].items():
        styles[name] = {}
        for key, text in style.items():
            content = np.frombuffer(content_of(text), np.uint8)
            styles[name][key] = digest(content)
            tensors[PREFIX + styles[name][key]] = content
    return {**painted, KEPT: {**painted[KEPT], "styles": styles}}


def put_back(painted: Any, tensors: Mapping[str, NDArray[np.generic]]) -> Any:
    """Invert :func:`put_apart`; raises KeyError, TypeError or ValueError if the content does not fit."""
    if isinstance(painted, Mapping) and DIVIDED in painted:
        painted = {**painted, DIVIDED: _parts_in(painted[DIVIDED])}
    if not isinstance(painted, Mapping) or KEPT not in painted:
        return painted
    kept = object_in(painted[KEPT], KEPT)
    styles: dict[str, dict[str, str]] = {}
    for name, told in object_in(kept["styles"], "styles").items():
        arrays = {key: tensors[PREFIX + text_in(array, key)] for key, array in object_in(told, "style").items()}
        styles[name] = {key: as_text(array.astype(np.uint8).tobytes()) for key, array in arrays.items()}
    laid: dict[str, dict[str, object]] = {}
    for region, value in object_in(kept["laid"], "laid").items():
        how = object_in(value, "laid")
        laid[str(int(region))] = {key: text_in(how[key], key) for key in ("style", "manner", "hand")}
        laid[str(int(region))]["stroke_size"] = number_in(how["stroke_size"], "stroke_size")
    return {**painted, KEPT: {"styles": styles, "laid": laid}}


def made_in(told: object, tensors: Mapping[str, NDArray[np.generic]]) -> dict[str, Any]:
    """Return the record of how a painting was made, or a scene, whose record holds that of its painting."""
    inner = {name: put_back(value, tensors) for name, value in object_in(told, "made").items() if name != KEPT}
    return dict(put_back({**object_in(told, "made"), **inner}, tensors))


def _parts_in(told: object) -> dict[str, dict[str, object]]:
    """Return what a file says about the parts of divided pictures; raises as :func:`put_back` does."""
    found: dict[str, dict[str, object]] = {}
    for region, value in object_in(told, DIVIDED).items():
        one = object_in(value, DIVIDED)
        texts = {key: list(each_in(one[key], text_in, key)) for key in ("colours", "parts")}
        if not (region.isascii() and region.isdigit() and all(map(CODE.fullmatch, texts["colours"]))):
            raise ValueError(f"{DIVIDED} needs regions' numbers and colours such as #ff8800")
        plain = {key: text_in(one[key], key) for key in ("style", "part")}
        found[region] = {**plain, **texts, "share": number_in(one["share"], "share")}
    return found
