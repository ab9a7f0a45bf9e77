"""The style pictures and masks that a painting was made with, and its key; a file that is gone is known by its hash."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from svv.errors import BadInput
from svv.io.files.keyed_results import digest, digest_of_file
from svv.options.described import chosen
from svv.options.making import DRAWN, PREFIX, PaintOptions
from svv.pv.panel.groups import REGIONS
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values, region_row
from svv.pv.results.keys import digest_of_mask


def files_of(values: Values) -> dict[str, str]:
    """Return the hashes of the style pictures and masks that the panel names and that are there, by their names."""
    found = {name: digest_of_file(name) for name in _pictures(values) if Path(name).is_file()}
    return found | {name: digest_of_mask(name) for name in _masks(values) if Path(name).is_file()}


def lost_file(values: Values) -> str:
    """Return a sentence on the first picture or mask that the panel names and that is not there; '' if all are."""
    for name in _pictures(values):
        if not Path(name).is_file():
            return f"There is no style picture {name}: choose another under Style Files."
    for region, name in enumerate(_masks(values)):
        if name and not Path(name).is_file():
            return f"There is no mask {name}: choose another in the row of region {region}."
    return ""


def _pictures(values: Values) -> list[str]:
    """Return the names of the style pictures that are files."""
    return [name for name in values["StyleFiles"] if not name.startswith((PREFIX, DRAWN))]


def _masks(values: Values) -> list[str]:
    """Return the name of each region's mask; '' if it has none."""
    return [region_row(values, region).get("Mask", "") for region in range(REGIONS)]


def style_key(values: Values, known: Mapping[str, str] | None = None) -> str:
    """Return a hash of everything but the scene that a painting depends on; files count by content and name.

    Known hashes (:func:`files_of`) stand for files that are gone; other missing files raise BadInput.
    """
    there = {**(known or {}), **files_of(values)}
    own = _pictures(values)
    if any(name not in there for name in own):
        raise BadInput(lost_file(values))
    files = [(Path(name).stem, there[name]) if name in own else (name, "") for name in values["StyleFiles"]]
    rows: list[object] = []
    for row in (region_row(values, k) for k in range(REGIONS)):
        mask = there.get(row.get("Mask", ""), row.get("Mask"))
        rows += [row.get("Style"), row.get("Positive"), row.get("Negative"), mask, row.get("Part")]
        rows += [("share", k, share) for k, share in enumerate([row.get("Share")]) if share]
    others = [values.get("Gallery"), values.get("Mapping"), values.get("PictureParts")]
    return digest(files, rows, others, chosen(options_in(PaintOptions, values)))
