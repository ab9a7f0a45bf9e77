"""Edits in the panel of StyleRF Stylized View, of what the filter itself has painted.

Without an edit, nothing is loaded that draws: with Live, ParaView's own process does not.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from svv.errors import BadInput, Progress, silent
from svv.pv.panel.groups import EDITS
from svv.pv.panel_values import Values, by_name, with_names
from svv.pv.results.stored import Stored
from svv.pv.work.unfinished import mark_unfinished
from svv.pv.work.vtk_data import put_scene, put_stored

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkTable

    from svv.fields.scene.scene import Scene


ROW = re.compile(r"Region(\d+)")
"""Beginning of the names of a region's properties."""

NOT_YET = " Not in the sketch: {reason}"


def edits_of(values: Values) -> Values:
    """Return the values of the panel of StyleRF Stylized View that edit what it has painted; empty if none does."""
    held = by_name(values)
    chosen = {name: _plain(held[name]) for name in EDITS}
    if not chosen["CutOpen"]:
        chosen["CutOpenBy"] = EDITS["CutOpenBy"]  # ParaView has one as soon as there is a panel
    if chosen == EDITS and not values["Variant"]:
        return {}
    return with_names({**chosen, "Variant": values["Variant"]})


def _plain(value: object) -> object:
    """Return a value as the panel holds it, though it came as JSON."""
    return tuple(value) if isinstance(value, list) else value


def painted_as_edited(scene: Scene, edits: Values, progress: Progress = silent) -> tuple[Scene, str]:
    """Return a scene with edits of :func:`edits_of`, and what to say about them; raise as ``as_edited``."""
    if not edits:
        return scene, ""
    from svv.pv.work.editing import as_edited

    edited, understood = as_edited(scene, edits, progress)
    steps = edited.history.past[len(scene.history.past) :]
    told = [*(f"Understood: {line}." for line in understood), *(f"Edited: {step.what}." for step in steps)]
    return edited, "".join(f" {line}" for line in told)


def sketch_as_edited(scene: Scene, edits: Values) -> tuple[Scene, str]:
    """Return a scene that is still being learned with those edits that it can have, and what to say, after a space.

    Regions may be missing that it will have when it is finished: edits of the others are shown nevertheless.
    """
    try:
        return painted_as_edited(scene, edits)
    except BadInput as reason:
        told = NOT_YET.format(reason=reason)
        left = {
            name: EDITS[name] if (row := ROW.match(name)) and int(row[1]) >= len(scene.regions) else value
            for name, value in by_name(edits).items()
        }
    try:
        return painted_as_edited(scene, with_names({**left, "Say": ""}))[0], told
    except BadInput:
        return scene, told


def put_edited(file: Path, edits: Values, table: vtkTable, sketch: bool = False) -> None:
    """Fill a table with the scene, or sketch, in a file, edited; without edits, only the file's header is read."""
    if not edits:
        put_stored(*Stored.and_content(file), table)
    else:
        from svv.fields.scene.scene import Scene

        scene = Scene.load(file)
        scene, _ = sketch_as_edited(scene, edits) if sketch else painted_as_edited(scene, edits)
        put_scene(scene, table)
    if sketch:
        mark_unfinished(table)
