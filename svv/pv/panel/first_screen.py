"""Panels that show few controls at first, and the others as advanced, under headings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from xml.sax.saxutils import quoteattr

from svv.options.making import PaintOptions, ViewOptions
from svv.pv.panel import groups
from svv.pv.panel.live_properties import live
from svv.pv.panel.option_panel import properties_of
from svv.pv.panel.properties import Property, cached_names_property, files, group, status

MEANINGS = {"draft": "Sketch", "fast": "Good", "balanced": "Better", "best": "Best", "paper": "hours"}
"""What the panel says of each preset, behind its name; long words would widen the panel."""

BESIDE = re.compile(r'type="GenericDecorator" mode="visibility" property="(\w+)"')
"""The property whose value lets another one appear."""

VISIBLE = re.compile(r'panel_visibility="default"')


def stylized_view_properties() -> list[Property]:
    """Return the properties of StyleRF Stylized View: first the few that choose how the painting looks."""
    training = groups.training_properties("fast", skip=("ignore_fixed",))  # nothing stands still in views that it draws
    image, volume = groups.image_properties(400), groups.volume_properties(ViewOptions(test=0))
    edits = ("Say", "Strength", *(f"Region{k}Hide" for k in range(3)), "SaveFile")
    return [
        files("StyleFiles", groups.PICTURES, "Pictures", "Style pictures for the volume."),
        *map(with_meanings, picked(training, "Preset")),
        *picked(properties_of(PaintOptions()), "StrokeSize"),
        *picked(volume, "Shade"),
        *picked(image, "FollowCamera"),
        *live(),
        *groups.take_buttons(),
        *few_first(edits, *groups.edit_properties(), *groups.save_properties()),
        status(),
        *titled("Training", [*without(training, "Preset"), groups.preview_file()]),
        *titled("Image", without(image, "FollowCamera")),
        *titled("Volume", without(volume, "Shade")),
        *cached_names_property(),
    ]


def with_meanings(preset: Property) -> Property:
    """Return the property of the preset such that its entries, whose names scripts use, say what they mean."""
    told = lambda found: f"{found[0]} info={quoteattr(MEANINGS[found[1]])}"  # noqa: E731
    return replace(preset, xml=re.sub(r'<Entry value="\d+" text="(\w+)"', told, preset.xml))


def advanced(properties: Sequence[Property]) -> list[Property]:
    """Return the properties such that the panel shows them only with its advanced ones."""
    return [replace(one, xml=_hidden(one.xml)) for one in properties]


def few_first(names: Sequence[str], *properties: Property) -> list[Property]:
    """Return the properties such that the panel shows those of these names at first, and the others as advanced.

    Status, buttons, and what appears only beside one of these stay as they are.
    """

    def stays(one: Property) -> bool:
        beside = BESIDE.search(one.xml)
        return one.name in ("", "Status", *names) or one.xml.startswith("<Property ") or (beside and beside[1]) in names

    return [one if stays(one) else advanced([one])[0] for one in properties]


def titled(label: str, properties: Sequence[Property]) -> list[Property]:
    """Return the properties as advanced ones under a common heading; groups, which follow theirs, keep their own."""
    grouped = {name for one in properties if not one.name for name in re.findall(r'<Property name="(\w+)"', one.xml)}
    shown = [one for one in properties if one.name and one.name not in grouped and 'visibility="never"' not in one.xml]
    others = [one for one in properties if one not in shown]
    return [*group(label, advanced(shown)), *advanced(others)]


def picked(properties: Sequence[Property], *names: str) -> list[Property]:
    """Return the properties of these names, in this order."""
    by_name = {one.name: one for one in properties}
    return [by_name[name] for name in names]


def without(properties: Sequence[Property], *names: str) -> list[Property]:
    """Return the properties but those of these names."""
    return [one for one in properties if one.name not in names]


def _hidden(xml: str) -> str:
    """Return the XML of a property, or of a group, whose element says that it is advanced."""
    if VISIBLE.search(xml):
        return VISIBLE.sub('panel_visibility="advanced"', xml)
    if "panel_visibility=" in xml or xml.startswith("<PropertyGroup"):
        return xml
    return re.sub(r"^(<\w+)", r'\1 panel_visibility="advanced"', xml)
