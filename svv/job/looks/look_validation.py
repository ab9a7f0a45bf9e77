"""Edits of regions that a look holds are checked as those that somebody makes by hand."""

from __future__ import annotations

import numpy as np

from svv.core.colour.light import COEFFICIENTS, validate_coefficients
from svv.core.images.outlines import Pen
from svv.core.json_values import object_in
from svv.errors import BadInput
from svv.fields.scene import stroke_edits
from svv.fields.scene.history import edits_of, with_edits
from svv.fields.scene.matcap_pictures import read_matcap, validate_matcap
from svv.fields.scene.region import Region, validate_name
from svv.fields.scene.scene_validation import values_of

RANGES = {
    "opacity": (0.0, np.inf),
    "lighting": (0.0, np.inf),
    "occlusion": (0.0, 1.0),
    "strength": (0.0, 1.0),
    "paint_light": (0.0, 1.0),
    "stroke_opacity": (-1.0, 1.0),
}
"""Bounds of edits that are numbers; other edits are checked where they are made."""


def validate_region_edits(edits: object, name: str) -> dict[str, object]:
    """Return a region's edits from plain values; raises BadInput if one is unknown, of another type or out of range."""
    try:
        given = values_of(Region, object_in(edits, f"{name}, edits"))
        region = with_edits(Region((0.5, 0.5, 0.5), 1.0), given)
    except (BadInput, KeyError, TypeError, ValueError) as error:
        raise BadInput(f"An edit of {name} is not valid: {str(error).rstrip('.')}; save the look again.") from error
    for field, (low, high) in RANGES.items():
        if not low <= getattr(region, field) <= high:
            raise BadInput(f"{name}: {field} must lie between {low:g} and {high:g}, not {getattr(region, field):g}.")
    colours = [c for c in (region.edited_colour, region.outline_colour) if c is not None]
    if not all(0.0 <= value <= 1.0 for colour in colours for value in colour):
        raise BadInput(f"{name}: colours must have red, green and blue between 0 and 1.")
    validate_coefficients({key: getattr(region, key) for key in COEFFICIENTS})
    Pen(region.outline, region.outline_width, region.outline_colour)
    if region.matcap is not None:
        read_matcap(region.matcap)
        if region.matcap != validate_matcap(region.matcap):
            raise BadInput(f"{name}: the MatCap must be a name or a picture inside the file.")
    if region.name is not None:
        try:
            validate_name(region.name)
        except BadInput as error:
            raise BadInput(f"{name}: {error}") from error
    stroke_edits.validate_stroke_edits(None, None, region.stroke_light, region.stroke_palette or None)
    return {key: value for key, value in edits_of(region).items() if key in given} | {
        key: value for key, value in given.items() if key == "paint_light"
    }
