"""The filters under Filters > StyleRF that change a scene at once. ParaView shows the classes' docstrings as help."""

from __future__ import annotations

from paraview.util.vtkAlgorithm import smproxy

from svv.pv.panel.first_screen import few_first
from svv.pv.panel.groups import (
    edit_properties,
    menu,
    part_properties,
    save_properties,
    scene_bounds,
    takes_scene,
    takes_scenes,
)
from svv.pv.panel.properties import button, integer, panel, status, switch, text
from svv.pv.vtk_types import Data, OutInfo, Request
from svv.pv.work.bounded import Bounded
from svv.pv.work.cached import SceneOutput
from svv.pv.work.picking import Click, Picking, point_seen
from svv.pv.work.vtk_data import finished_scene_of, key_of_scene, scene_of

__all__ = ["StyleRFEdit", "StyleRFJoin"]


@smproxy.filter(label="StyleRF Edit", support_reload=False)
@menu
@panel(*few_first(
    (*(f"Region{k}{what}" for k in range(3) for what in ("Recolour", "Opacity", "Hide")), "Say", "Strength",
     "SaveFile"),
    button("UndoEdit", "Undo the last change that was applied."),
    button("RedoEdit", "Redo the last change that was undone."),
    button("ResetEdits", "Reset this panel, so that the scene passes through unchanged."),
    *part_properties(),
    *edit_properties(),
    scene_bounds(),
    switch("ShowHidden", False, "Show regions that were hidden before this filter."),
    text("Variant", "Name of the painting to show; empty: the one that the scene came with."),
    integer("Undo", 0, "Undo this many of the edits that the scene came with, before applying those above.", 0, 50,
            True),
    switch("AsTrained", False, "Undo all edits that the scene came with, before applying those above.", True),
    *save_properties(),
    status(),
))  # fmt: skip
@takes_scene
class StyleRFEdit(SceneOutput, Picking, Bounded):
    """Edit a scene at once, without training. The rows of the input's table are the regions."""

    def UndoEdit(self) -> None:
        """Do nothing: the client handles this button, in :mod:`svv.pv.panel.undo`."""

    RedoEdit = ResetEdits = ClickPart = UndoEdit

    def answer(self, seen: Click) -> str:
        scene = self.last("given")
        return "" if scene is None else point_seen(scene, seen)

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.pv.work.editing import as_edited, describe_edits

        scene, understood = as_edited(scene_of(inputs[0]), self.values, self.progress)
        self.give(scene, outputs[0])
        return " ".join([*(f"Understood: {line}." for line in understood), describe_edits(scene)])


@smproxy.filter(label="StyleRF Join", support_reload=False)
@menu
@panel(*save_properties(), status())
@takes_scenes
class StyleRFJoin(SceneOutput):
    """Join scenes of several arrays or transfer functions of one volume, or of members of an ensemble: select all of
    them, then add this filter. Their regions become regions of one scene, in the order of the inputs, and extinctions
    add.
    """

    def FillInputPortInformation(self, port: int, info: Request) -> int:
        """Accept several scenes."""
        info.Set(self.INPUT_IS_REPEATABLE(), 1)
        return super().FillInputPortInformation(port, info)

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.fields.scene.joined import joined, members, named, relit
        from svv.pv.work.editing import describe_edits

        given = [self.GetInputDataObject(0, number) for number in range(self.GetNumberOfInputConnections(0))]
        scenes = [finished_scene_of(data) for data in given]
        arrays = [scene.made.get("source", {}).get("volume") for scene in scenes]
        if None not in arrays and len(set(arrays)) == len(arrays):
            scenes = [named(scene, array) for scene, array in zip(scenes, arrays, strict=True)]
        scene = self.get_or_make("joined", tuple(map(key_of_scene, given)), lambda: joined(scenes))
        self.give(scene, outputs[0])
        counts = " + ".join(str(len(member.regions)) for member in members(scene))
        dark = "".join(f" Input {number + 1} gets the light of the others." for number in relit(scenes))
        return f"{counts} regions.{dark} {describe_edits(scene)}"
