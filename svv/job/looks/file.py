"""Looks as JSON files: data alone, whose every value is checked, with the pictures inside."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np

from svv.core.colour.light import Lamp
from svv.core.geometry.cameras import NOMINAL_FOV, Camera
from svv.core.json_values import (
    Json,
    list_in,
    needed,
    number_in,
    object_in,
    pair_in,
    parsed,
    switch_in,
    text_in,
    vector_in,
    whole_in,
)
from svv.errors import BadInput
from svv.fields.scene.scene_validation import values_of
from svv.io.files.atomic import write_json
from svv.io.pictures.picture_data import as_data, mask_as_data
from svv.job.looks.look_content import Laid, LookContent, LookRegion, style_in
from svv.job.looks.look_validation import validate_region_edits
from svv.job.looks.offered import offered
from svv.options.described import Described, described
from svv.options.figures import FigureOptions
from svv.options.making import LEAST_STROKE, MOST_STROKE, AskedHandName
from svv.train.paint.ink import Ink, StyleInput, ink_named

VERSION = 1
"""Version of the format, to be raised when an older program can no longer read a newer file."""

KEY = "svv_look"
"""Key of the version, which tells a look from other JSON files."""

MOST_BYTES, MOST_REGIONS, LONGEST_TITLE = 64 << 20, 256, 200
"""Largest size of a file, number of regions, and number of characters in a title."""

MANNERS = ("auto", "strokes", "pieces", "ink", "matched")


def write(look: LookContent, path: str | Path) -> None:
    """Write a look to a JSON file, whole or not at all; raises BadInput if it cannot be written."""
    write_json(path, to_json(look))


def read(path: str | Path) -> LookContent:
    """Read a look from a JSON file, or take one that ships, ``gallery:NAME``.

    Raises BadInput if there is no such look, it is of a newer version, a value in it is out of range or unknown, or one
    of its pictures is broken or a path.
    """
    if (ships := offered(str(path))) is not None:
        return from_json(ships, str(path))
    file = Path(path)
    try:
        if file.stat().st_size > MOST_BYTES:
            raise BadInput(f"{file} is larger than {MOST_BYTES >> 20} MB, so it is no look.")
        content = parsed(file.read_bytes())
    except FileNotFoundError as error:
        raise BadInput(f"There is no look {file}; make one with svv look save, or take gallery:NAME.") from error
    except OSError as error:
        raise BadInput(f"The look {file} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"The look {file} is not JSON: {error}.") from error
    return from_json(content, str(file))


def to_json(look: LookContent) -> dict[str, Any]:
    """Return a look as plain values."""
    content: dict[str, object] = {KEY: VERSION}
    if look.title:
        content["title"] = look.title
    content["regions"] = [_region_to_json(region) for region in look.regions]
    content["styles"] = {name: _style_to_json(style) for name, style in look.styles.items()}
    if look.lamp is not None:
        content["lamp"] = look.lamp.to_json()
    if look.camera is not None:
        camera = look.camera
        told: dict[str, object] = {"camera_to_world": camera.camera_to_world.tolist()}
        told |= {"width": camera.width, "height": camera.height}
        lens = {"fov": float(np.degrees(camera.fov_x))} if camera.span_x is None else {"span_x": camera.span_x}
        content["camera"] = told | lens | ({} if camera.centre is None else {"centre": camera.centre})
    if look.figure:
        content["figure"] = dict(look.figure)
    return content


def _region_to_json(region: LookRegion) -> dict[str, object]:
    told: dict[str, object] = {"edits": dict(region.edits)}
    told |= {key: value for key in ("colour", "values", "style") if (value := getattr(region, key)) is not None}
    return told if region.laid == Laid() else {**told, "laid": vars(region.laid)}


def _style_to_json(style: StyleInput) -> dict[str, str]:
    if isinstance(style.style, Ink):
        return {"ink": style.style.kind}
    masks = {"mask": style.measured, "part": style.mask} if style.divided else {"mask": style.mask}
    told = {kind: mask_as_data(mask) for kind, mask in masks.items() if mask is not None}
    return {"picture": as_data(style.style), **told}


def from_json(content: object, name: str) -> LookContent:
    """Return the look that :func:`to_json` made plain values of; raises BadInput, with a file's name, as `read`."""
    if not isinstance(content, Mapping) or KEY not in content:
        raise BadInput(f"{name} is not a look; make one with svv look save.")
    version = content[KEY]
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise BadInput(f"{name} is a damaged look: its version is {version!r}; save it again with svv look save.")
    if version > VERSION:
        raise BadInput(
            f"{name} is a look of version {version}, but this program reads version {VERSION}: update svv, or save the "
            "look again with this one."
        )
    _known(content, (KEY, "title", "regions", "styles", "lamp", "camera", "figure"), name)
    title = text_in(content.get("title", ""), f"{name}: title")
    if len(title) > LONGEST_TITLE or not title.isprintable():
        raise BadInput(f"The title of {name} must be one line of at most {LONGEST_TITLE} characters: shorten it.")
    told = needed(content, "regions", name)
    if not isinstance(told, list) or not 1 <= len(told) <= MOST_REGIONS:
        raise BadInput(f"{name} must have a list of 1 to {MOST_REGIONS} regions; save it again with svv look save.")
    styles = {
        key: _style_in(object_in(style, f"{name}: the style '{key}'"), key, name)
        for key, style in object_in(content.get("styles", {}), f"{name}: styles").items()
    }
    regions = tuple(_region_in(one, styles, f"{name}, region {number}") for number, one in enumerate(told))
    used = {region.style for region in regions}
    return LookContent(
        regions, {key: style for key, style in styles.items() if key in used}, _lamp_in(content, name),
        None if "camera" not in content else _camera_in(content["camera"], f"{name}, camera"),
        figure_in(content.get("figure", {}), f"{name}, figure"), title,
    )  # fmt: skip


def _known(content: Json, keys: tuple[str, ...], name: str) -> Json:
    """Return an object that has no keys but these; raises BadInput otherwise."""
    if unknown := sorted(set(content) - set(keys)):
        raise BadInput(
            f"{name} has '{unknown[0]}', which this version of svv does not know: leave it out, or update svv."
        )
    return content


def _region_in(told: object, styles: Mapping[str, StyleInput], name: str) -> LookRegion:
    content = _known(object_in(told, name), ("edits", "colour", "values", "style", "laid"), name)
    style = None if content.get("style") is None else text_in(content["style"], f"{name}, style")
    if style is not None and style not in styles:
        raise BadInput(f"{name} has the style '{style}', whose picture is not in the look: save the look again.")
    colour = None if content.get("colour") is None else vector_in(content["colour"], f"{name}, colour")
    if colour is not None and not all(0.0 <= c <= 1.0 for c in colour):
        raise BadInput(f"{name}: the colour must have red, green and blue between 0 and 1.")
    values = None if content.get("values") is None else pair_in(content["values"], f"{name}, values")
    edits, laid = validate_region_edits(content.get("edits", {}), name), _laid_in(content.get("laid", {}), name)
    return LookRegion(edits, colour, values, style, laid)


def _laid_in(told: object, name: str) -> Laid:
    content = _known(object_in(told, f"{name}, laid"), ("manner", "hand", "stroke_size"), name)
    manner = text_in(content.get("manner", "auto"), f"{name}, manner")
    hand = text_in(content.get("hand", "auto"), f"{name}, hand")
    size = number_in(content.get("stroke_size", 1.0), f"{name}, stroke_size")
    if manner not in MANNERS or hand not in get_args(AskedHandName):
        raise BadInput(f"{name} is laid in the manner '{manner}' by the hand '{hand}', which svv does not know.")
    if not LEAST_STROKE <= size <= MOST_STROKE:
        raise BadInput(f"{name}: the stroke size must lie between {LEAST_STROKE} and {MOST_STROKE:g}, not {size:g}.")
    return Laid(manner, hand, float(size))


def _style_in(content: Json, key: str, name: str) -> StyleInput:
    """Return a style: an ink, a picture of the gallery that ships, or a picture inside the file."""
    _known(content, ("ink", "gallery", "picture", "mask", "part"), f"{name}: the style '{key}'")
    if "ink" in content:
        ink = ink_named("ink:" + text_in(content["ink"], f"{name}: the ink '{key}'"))
        assert ink is not None
        return StyleInput(ink)
    if "gallery" in content:
        from svv.styles.gallery import gallery_picture

        return StyleInput(gallery_picture(text_in(content["gallery"], f"{name}: the style '{key}'")), key)
    return style_in(content, key, f"{name}: the", key)


def _lamp_in(content: Json, name: str) -> Lamp | None:
    if content.get("lamp") is None:
        return None
    try:
        return Lamp(**values_of(Lamp, content["lamp"]))
    except BadInput:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"The light of {name} is damaged ({error}); save the look again.") from error


def _camera_in(told: object, name: str) -> Camera:
    content = _known(object_in(told, name), ("camera_to_world", "fov", "span_x", "width", "height", "centre"), name)
    rows = [list_in(row, 4, name) for row in list_in(needed(content, "camera_to_world", name), 4, name)]
    matrix = np.array([[number_in(value, name) for value in row] for row in rows], np.float64)
    width, height = (whole_in(content.get(key, 800), f"{name}, {key}") for key in ("width", "height"))
    span = None if content.get("span_x") is None else float(number_in(content["span_x"], f"{name}, span_x"))
    fov = NOMINAL_FOV if span is not None else np.radians(number_in(needed(content, "fov", name), f"{name}, fov"))
    centre = None if content.get("centre") is None else pair_in(content["centre"], f"{name}, centre")
    return Camera(matrix, float(fov), width, height, span, centre)


def figure_in(told: object, name: str) -> dict[str, Any]:
    """Return settings of figures by name; raises BadInput for an unknown one, or a value of another type."""
    fields = {field.name: field for field in described(FigureOptions) if field.setting.result}
    content = _known(object_in(told, name), tuple(fields), name)
    return {key: _setting_in(fields[key], value, f"{name}, {key}") for key, value in content.items()}


READERS: dict[object, Callable[[object, str], object]] = {
    bool: switch_in, int: whole_in, float: number_in, str: text_in
}  # fmt: skip
"""Type of a setting -> what checks and reads it."""


def _setting_in(field: Described, value: object, name: str) -> object:
    if value is None and field.optional:
        return None
    if field.choices:
        if value not in field.choices:
            raise BadInput(f"{name} must be one of {', '.join(field.choices)}, not {value!r}.")
        return value
    if get_origin(field.kind) is tuple:
        if get_args(field.kind)[0] is float:
            return vector_in(value, name)
        return tuple(text_in(one, name) for one in list_in(value, len(value) if isinstance(value, list) else 0, name))
    return READERS[field.kind](value, name)
