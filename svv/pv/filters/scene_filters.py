"""The filters under Filters > StyleRF that learn anew of a scene: its palette and its paintings.

Each class is a list of properties and a few calls into :mod:`svv.pv.filters.editing`,
:mod:`svv.pv.filters.style_masks`, :mod:`svv.pv.filters.styling` and :mod:`svv.pv.filters.engine`. ParaView shows its
docstring as help.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from paraview.util.vtkAlgorithm import smproperty, smproxy
from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.errors import BadInput
from svv.io.files.keyed_results import digest
from svv.options.described import chosen
from svv.options.making import PaintOptions, PaletteOptions
from svv.pv.filters.base import set_image_information
from svv.pv.filters.edit_filters import SceneOutput, save_properties
from svv.pv.filters.unfinished import mark_unfinished
from svv.pv.filters.vtk_data import finished_scene_of, key_of_views, put_image, views_of
from svv.pv.live.beside import Beside
from svv.pv.live.handed import hand_over_scene
from svv.pv.live.ordered import Ordered
from svv.pv.panel.groups import (
    ADDED,
    NO_GALLERY,
    OFFERED,
    PALETTE,
    PICTURES,
    REGIONS,
    added_properties,
    correction_properties,
    device,
    learning_properties,
    menu,
    point_properties,
    preview_file,
    style_properties,
    takes_scene,
)
from svv.pv.panel.live_properties import live
from svv.pv.panel.option_panel import options_in, properties_of
from svv.pv.panel.properties import (
    Property,
    button,
    choice,
    file,
    files,
    integer,
    kept_as,
    number,
    panel,
    status,
    switch,
    text,
)
from svv.pv.results.cached import FOUND
from svv.pv.results.keys import digest_of_edits, digest_of_scene, digest_of_views, settings_in
from svv.pv.results.time_steps import Moment
from svv.pv.vtk_types import Data, InInfo, OutInfo, Request

PAINTING = "painting "
"""Prefix of the slots in which StyleRF Stylize keeps paintings; the painting's name follows."""

__all__ = ["StyleRFPalette", "StyleRFStylize"]


@smproxy.filter(label="StyleRF Palette", support_reload=False)
@menu
@panel(
    Property("Views", '''<InputProperty name="Views" label="Views" command="SetInputConnection" port_index="1">
        <ProxyGroupDomain name="groups"><Group name="sources"/><Group name="filters"/></ProxyGroupDomain>
        <DataTypeDomain name="input_type"><DataType value="vtkDataSet"/></DataTypeDomain>
        <Documentation>The views that the scene was trained on: StyleRF Views, or a folder of views.</Documentation>
        <Hints><Optional/></Hints></InputProperty>''', None, {}),
    file("ViewsFile", "json", "Views",
         "If no views are connected: transforms_train.json in the folder of views that the scene was trained on."),
    text("Points", "Places in a scene learned from views alone, each with the region that is there, or another place "
         "of the same region: x,y,z=1; x,y,z=x,y,z. Click Part of StyleRF Edit writes what is clicked on into Parts, "
         "from where it can be copied. The number after the last region is a new one."),
    text("Merge", "Regions to merge into one, such as 0, 1. Separate several groups by semicolons: 0, 1; 2, 3."),
    *(p for region in range(PALETTE) for p in correction_properties(region)),
    *(p for number in range(ADDED) for p in added_properties(number)),
    *learning_properties(PaletteOptions()),
    device(),
    button("TrainAgain", "Train again, even if nothing has changed."),
    button("ResetPalette", "Reset this panel, so that the scene passes through unchanged."),
    *save_properties(),
    *kept_as(),
    status(),
)  # fmt: skip
@takes_scene
class StyleRFPalette(SceneOutput):
    """Correct a scene's palette by hand: set, add, merge, remove and split colours, and train its regions again. The
    base network is kept; paintings are dropped, because they belong to the old regions.
    """

    button = "Train Again"

    def __init__(self) -> None:
        super().__init__(2, 1, "vtkTable")

    def FillInputPortInformation(self, port: int, info: Request) -> int:
        """Make both inputs optional: the scene, and the views."""
        info.Set(self.INPUT_IS_OPTIONAL(), port)
        return super().FillInputPortInformation(port, info)

    def TrainAgain(self) -> None:
        """Train again."""
        self.forget("corrected")
        self.make_anew()

    def ResetPalette(self) -> None:
        """Do nothing: the client handles this button, in :mod:`svv.pv.panel.undo`."""

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.pv.filters.editing import correct, correction_in

        scene, correction = finished_scene_of(inputs[0]), correction_in(self.values)
        if not correction:
            self.give(scene, outputs[0])
            return "The palette is unchanged: set, add, merge, remove or split a colour, or point at places."
        base = digest_of_scene(scene)
        source = key_of_views(inputs[1]) or self._file_key()
        settings = digest(vars(correction), chosen(options_in(PaletteOptions, self.values)))
        key = (base, source, settings)

        def make() -> Any:
            with self.training() as progress:
                return correct(scene, views_of(inputs[1]) or self._views_in_file(), self.values, progress)

        def get() -> Any:
            now = Moment(settings, source, digest(base, digest_of_edits(scene)))
            found, name = self.found_or_made("corrected", "palette", now, make)
            self.gives(corrected=name)
            return found

        stated = self.stated().get("corrected", "")
        if self.last("corrected") is None and settings_in(stated, "palette") == settings:
            before = self.kept_as(stated, "palette")
            if before is not None and before.made.get("of") == base:
                self.kept("corrected", key, lambda: before)
                self.gives(corrected=stated)
                self.note = FOUND
        result = self.kept("corrected", key, get)
        self.give(result, outputs[0])
        report = result.made["corrected"][-1]
        return f"{'; '.join(report['notes'][:-1])}; trained in {report['seconds']['total']:.0f} s.{self.note}"

    def _file_key(self) -> str:
        return digest_of_views(self._views_in_file()) if self.values["ViewsFile"] else ""

    def _views_in_file(self) -> Any:
        """Return the views that the panel names; they are read again only if the file has changed."""
        from svv.pv.filters.editing import views_in_file

        file = Path(self.values["ViewsFile"])
        changed = file.stat().st_mtime_ns if file.is_file() else 0
        return self.kept("views in the file", (file, changed), lambda: views_in_file(self.values, self.progress))


@smproxy.filter(label="StyleRF Stylize", support_reload=False)
@menu
@smproperty.xml('<OutputPort name="Scene" index="0"/><OutputPort name="Mask" index="1"/>')
@panel(
    files("StyleFiles", PICTURES, "Pictures", "Style pictures for the regions."),
    *live(),
    choice("Gallery", (NO_GALLERY, *OFFERED), NO_GALLERY,
           "One more style: a picture from the built-in gallery, or a drawing in ink, which needs no picture."),
    choice("Mapping", ("in turn", "by colour"), "in turn",
           "How pictures are assigned to regions: in turn, or to each region the picture whose mean colour is closest "
           "to the region's. A region's own row takes precedence."),
    number("Strength", 1.0, "How strongly the painting shows: 0 gives the palette's colours, 1 the full painting. "
        "Needs no training.", 0.0, 1.0),
    *properties_of(PaintOptions()),
    preview_file(),
    switch("PreviewOnly", False, "Show the masks without painting."),
    integer("ShownMask", 0, "Region whose picture and mask the second output shows.", 0, REGIONS - 1),
    *point_properties(),
    *(p for region in range(REGIONS) for p in style_properties(region)),
    integer("PictureParts", 0, "Divide pictures into 2 to 32 parts of similar appearance; 0: do not divide.", 0, 32),
    file("MaskFolder", "", "",
         "Folder to which the masks are also written: region-K.png, each with a file of its points."),
    switch("Continue", False, "Paint on the last painting if pictures or masks have changed: regions that stay "
        "as they are keep its paint. Otherwise, painting starts afresh."),
    text("Variant", "Name of the painting; a new name adds a painting to the same scene."),
    text("ShowVariant", "Name of the painting to show; empty: the one named above."),
    device(),
    button("PaintAgain", "Paint again: from the start, or on the last painting if Continue is on."),
    button("ResetStyle", "Return to the scene before painting; Paint Again paints it."),
    *save_properties(),
    *kept_as(),
    status(),
)  # fmt: skip
@takes_scene
class StyleRFStylize(SceneOutput, Beside):
    """Paint the regions of a scene in the style of pictures, consistently from all directions. The second output shows
    a picture and the part of it that a region learns from.
    """

    button = "Paint Again"
    headers = False  # paintings of several names are put together here
    nothing = "The scene is shown as it was."

    def __init__(self) -> None:
        super().__init__(1, 2, "vtkTable")
        self._reset, self._round = False, 0

    def FillOutputPortInformation(self, port: int, info: Request) -> int:
        """Declare the outputs: a scene's table, and an image."""
        info.Set(vtkDataObject.DATA_TYPE_NAME(), ("vtkTable", "vtkImageData")[port])
        return 1

    def RequestInformation(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Report the size of the picture that the second output shows."""
        try:
            height, width = self._preview()[0].shape[:2]
        except (BadInput, ImportError):  # RequestData reports it
            height, width = 1, 1
        set_image_information(self, out_info, width, height, 1)
        return 1

    def PaintAgain(self) -> None:
        """Paint again."""
        self._reset, self._round = False, self._round + 1
        self.make_anew()

    def ResetStyle(self) -> None:
        """Return to the scene before painting."""
        self._reset = True
        self.Modified()

    def result(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.pv.filters.engine import style_key
        from svv.pv.filters.style_masks import write_masks
        from svv.pv.filters.styling import Painting, goes_on, painted, paintings_on

        scene, values = finished_scene_of(inputs[0]), self.values
        base = digest_of_scene(scene)  # edits before this filter do not change what is painted, only how it is shown
        if self._reset:
            self.give(scene, outputs[0])
            return "The scene as it was before painting."
        style, name = style_key(values), values["Variant"]
        picture, overlay, taken, size = self._preview()
        rows, columns = np.mgrid[: taken.shape[0], : taken.shape[1]]
        shown = np.array(taken.shape[::-1])
        pixels = (2 * np.stack([columns, rows], axis=2) + 1) * size // (2 * shown)  # of the file
        put_image(outputs[1], {"RGBA": overlay, "Picture": picture, "Mask": taken, "Pixel": pixels.astype(np.int32)})
        if values["MaskFolder"]:
            folder = Path(values["MaskFolder"])
            self.kept("masks", (style, folder), lambda: write_masks(scene, values, folder, self.progress))
        said = f"{taken.astype(bool).mean():.0%} of the picture is used; nothing was painted."
        self._begin_with_paintings(scene, base)
        if not values["PreviewOnly"]:
            slot, given = f"{PAINTING}{name}", digest(base, digest_of_edits(scene))
            before = self.last(slot)

            def paint() -> Any:
                with self.training() as progress:
                    return painted(scene, before, values, progress)

            def make() -> Any:
                self.wants(Moment(digest(), "", given), digest(style, name))
                now = Moment(style, digest(*goes_on(scene, before, values)), given)
                result, kept = self.found_or_made(slot, "painting", now, paint)
                return Painting(base, result.on(scene.device), kept)

            painting = self.kept(slot, (base, style, self._round), make)
            self.gives(**{slot: painting.name})
            said = painting.told() + self.note
        if not self.shows:
            return said
        there = {key.removeprefix(PAINTING): value[1] for key, value in self._kept.items() if key.startswith(PAINTING)}
        result = paintings_on(scene, there, values["ShowVariant"], "" if values["PreviewOnly"] else name)
        self.give(result.with_strength(values["Strength"]) if result.styled is not None else result, outputs[0])
        return said

    def handed(self, values: dict[str, Any]) -> tuple[dict[str, Any], Callable[[Path], None]]:
        """Return the values for the process that paints, and what writes the scene to a new folder."""
        data = self._data
        assert data is not None
        return values, lambda folder: hand_over_scene(data, folder)

    def release(self) -> None:
        super().release()
        for slot in [slot for slot in self._kept if slot.startswith(PAINTING)]:
            del self._kept[slot]

    def meanwhile(self, inputs: list[Any], outputs: list[Data], learner: Ordered) -> None:
        if not self.put_newest(outputs[0]):
            self.before(outputs)
            if not outputs[0].GetNumberOfRows():
                outputs[0].ShallowCopy(inputs[0])
            mark_unfinished(outputs[0])

    def _begin_with_paintings(self, scene: Any, base: str) -> None:
        """Restore the paintings that a saved state refers to."""
        from svv.pv.filters.styling import Painting

        for slot, name in self.stated().items():
            if not slot.startswith(PAINTING) or self.last(slot) is not None:
                continue
            found = self.kept_as(name, "painting")
            if found is not None and digest_of_scene(found) == base:
                key = (base, settings_in(name, "painting"), 0)
                self.kept(slot, key, lambda: Painting(base, found.on(scene.device), name))  # noqa: B023
                self.gives(**{slot: name})
                self.note = FOUND

    def ClickInside(self) -> None:
        """Do nothing: the client handles this button, in :mod:`svv.pv.client.mask_points`."""

    ClickOutside = ClickRemove = ClickInside

    def GetPictureSize(self) -> str:
        """Return width and height of the picture in the second output, then those of its file; empty without one."""
        if self.last("preview") is None:
            return ""
        _, _, taken, size = self.last("preview")
        return " ".join(map(str, (*taken.shape[::-1], *size)))

    def _preview(self) -> Any:
        from svv.pv.filters.engine import style_key
        from svv.pv.filters.style_masks import preview

        key = (style_key(self.values), self.values["ShownMask"])
        return self.kept("preview", key, lambda: preview(self.values, self.progress))
