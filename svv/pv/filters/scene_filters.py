"""The filters under Filters > StyleRF that learn anew of a scene. ParaView shows the classes' docstrings as help."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from paraview.util.vtkAlgorithm import smproperty, smproxy
from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.errors import BadInput, Progress
from svv.io.files.keyed_results import digest
from svv.options.described import chosen
from svv.options.making import PaintOptions, PaletteOptions
from svv.pv.filters.retuned import tuned_like
from svv.pv.live.handed import file_of_views
from svv.pv.live.scene_beside import SceneBeside
from svv.pv.panel import groups
from svv.pv.panel.first_screen import few_first, picked, titled, without
from svv.pv.panel.live_properties import live
from svv.pv.panel.option_panel import options_in, properties_of
from svv.pv.panel.properties import (
    Property,
    button,
    cached_names_property,
    choice,
    file,
    files,
    integer,
    number,
    panel,
    status,
    switch,
    text,
)
from svv.pv.panel_values import Values
from svv.pv.results.keys import digest_of_edits, digest_of_listed, digest_of_scene, name_of, settings_in, source_of
from svv.pv.results.time_steps import Moment
from svv.pv.vtk_types import Data, InInfo, OutInfo, Request
from svv.pv.work.base import set_image_information
from svv.pv.work.cached import FILE, FOUND, LOST
from svv.pv.work.picking import Pointing
from svv.pv.work.vtk_data import finished_scene_of, key_of_views, put_image, views_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet

PAINTING = "painting "
"""Prefix of the slots in which StyleRF Stylize keeps paintings; the painting's name follows."""

__all__ = ["StyleRFPalette", "StyleRFStylize"]


@smproxy.filter(label="StyleRF Palette", support_reload=False)
@groups.menu
@panel(*few_first(
    (*(f"Region{k}{what}" for k in range(3) for what in ("SetColour", "Remove")), "ViewsFile", "PointRegion", "Points",
     "Colour0Add", "Live", "SaveFile"),
    Property("Views", '''<InputProperty name="Views" label="Views" command="SetInputConnection" port_index="1">
        <ProxyGroupDomain name="groups"><Group name="sources"/><Group name="filters"/></ProxyGroupDomain>
        <DataTypeDomain name="input_type"><DataType value="vtkDataSet"/></DataTypeDomain>
        <Documentation>The views that the scene was trained on: StyleRF Views, or a folder of views.</Documentation>
        <Hints><Optional/></Hints></InputProperty>''', None, {}),
    file("ViewsFile", "json", "Views",
         "If no views are connected: transforms_train.json of the views that the scene was trained on."),
    *groups.pointing_properties(),
    text("Merge", "Regions to merge, such as 0, 1; 2, 3 for two groups."),
    *(p for region in range(groups.PALETTE) for p in groups.correction_properties(region)),
    *(p for number in range(groups.ADDED) for p in groups.added_properties(number)),
    *live(),
    *groups.learning_properties(PaletteOptions()),
    groups.device(),
    button("TrainAgain", "Train again, even if nothing has changed."),
    button("UndoPalette", "Undo the last change that was applied, such as a click."),
    button("RedoPalette", "Redo the last change that was undone."),
    button("ResetPalette", "Reset this panel, so that the scene passes through unchanged."),
    *groups.save_properties(),
    *cached_names_property(),
    status(),
))  # fmt: skip
@groups.takes_scene
class StyleRFPalette(SceneBeside, Pointing):
    """Correct a scene's palette by hand: set, add, merge, remove and split colours, and train its regions again. The
    base network is kept; paintings are dropped, because they belong to the old regions.
    """

    button = "Train Again"
    slots = ("corrected",)

    ports = (2, 1, "vtkTable")

    def __init__(self) -> None:
        super().__init__()
        self._views: Data | None = None

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

    UndoPalette = RedoPalette = ResetPalette

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        self._views = inputs[1]
        return super().work(inputs, outputs, out_info)

    def result(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.job.request import learn
        from svv.pv.work.editing import correction_in
        from svv.pv.work.requests import correcting

        scene, correction = finished_scene_of(inputs[0]), correction_in(self.values)
        self.get_or_make("before", object(), lambda: scene)
        if not correction:
            self._learner.stop_here()
            self._learner.forget()
            self.give(scene, outputs[0])
            return "The palette is unchanged: set, add, merge, remove or split a colour, or point at places."
        base = digest_of_scene(scene)
        source = self.values.get("KeyOfViews") or key_of_views(inputs[1]) or self._file_key()
        settings = digest(vars(correction), chosen(options_in(PaletteOptions, self.values)))
        key = (base, source, settings)

        def read(progress: Progress) -> ViewSet:
            return views_of(inputs[1]) or self._views_in_file(progress)

        def make() -> Scene:
            with self.training() as progress:
                return learn(correcting(scene, read, self.values), progress)[0]

        def get() -> Scene:
            given = digest(base, digest_of_edits(scene))
            now = Moment(settings, source, given)
            # An order with another correction has the same input.
            self.wants(name_of("scene", source_of(now), digest()), name_of("palette", source_of(now), settings))
            found, name = self.found_or_made("corrected", "palette", now, make)
            self.gives(corrected=name)
            return found

        stated = self.stated().get("corrected", "")
        if self.last("corrected") is None and settings_in(stated, "palette") == settings:
            before = self.load_cached(stated, "palette")
            if before is not None and before.made.get("of") == base:
                self.get_or_make("corrected", key, lambda: before)
                self.gives(corrected=stated)
                self.note = FOUND
        result = tuned_like(self.get_or_make("corrected", key, get), scene)
        self.give(result, outputs[0])
        report = result.made["corrected"][-1]
        return f"{'; '.join(report['notes'][:-1])}; trained in {report['seconds']['total']:.0f} s.{self.note}"

    def handed(self, values: Values) -> tuple[Values, Callable[[Path], None]]:
        """Return the values for the process that trains, with the file of the views, and what writes the scene."""
        own = key_of_views(self._views)
        file = self.values["ViewsFile"] if own is None else str(file_of_views(self._views))
        return super().handed({**values, "ViewsFile": file, "KeyOfViews": own or self._file_key()})

    def _lives(self) -> bool:
        """Views that are only in the memory of this process, because the cache is full, are learned from here."""
        return super()._lives() and (key_of_views(self._views) is None or file_of_views(self._views) is not None)

    def _file_key(self) -> str:
        file = self._file()
        changed = file.stat().st_mtime_ns if file.is_file() else 0
        return self.get_or_make("key of the file", (file, changed), lambda: digest_of_listed(file))

    def _views_in_file(self, progress: Progress) -> ViewSet:
        """Return the views that the panel names; they are read again only if the file has changed."""
        from svv.io.views.transforms import split_of
        from svv.io.views.viewset import ViewSet

        file, key = self._file(), self._file_key()
        return self.get_or_make("views in the file", key, lambda: ViewSet.read(file.parent, split_of(file), progress))

    def _file(self) -> Path:
        if not self.values["ViewsFile"]:
            from svv.pv.work.requests import NO_VIEWS

            raise BadInput(NO_VIEWS)
        return Path(self.values["ViewsFile"])


@smproxy.filter(label="StyleRF Stylize", support_reload=False)
@groups.menu
@smproperty.xml('<OutputPort name="Scene" index="0"/><OutputPort name="Mask" index="1"/>')
@panel(*few_first(
    ("StyleFiles", "Live", "Gallery", "Mapping", "StrokeSize", "Strength", "PreviewOnly", "ShownMask", "Region0Style",
     "Region1Style", "Region2Style", "SaveFile"),
    files("StyleFiles", groups.PICTURES, "Pictures", "Style pictures for the regions."),
    *live(),
    choice("Gallery", (groups.NO_GALLERY, *groups.OFFERED), groups.NO_GALLERY,
           "One more style, from the gallery or in ink."),
    choice("Mapping", ("in turn", "by colour"), "in turn",
           "Which pictures regions get that name none: in turn, or that of the closest mean colour."),
    *picked(properties_of(PaintOptions()), "StrokeSize"),
    number("Strength", 1.0, "How strongly the painting shows: 0 gives the palette's colours, 1 the paint.", 0.0, 1.0),
    *titled("Painting", [
        *without(properties_of(PaintOptions()), "StrokeSize"), groups.preview_file(), groups.device(),
    ]),
    switch("PreviewOnly", False, "Show the masks without painting."),
    integer("ShownMask", 0, "Region whose picture and mask the second output shows.", 0, groups.REGIONS - 1),
    *groups.point_properties(),
    *(p for region in range(groups.REGIONS) for p in groups.style_properties(region)),
    *titled("Masks", [
        integer("PictureParts", 0, "Divide pictures into 2 to 32 parts of similar appearance; 0: do not divide.",
                0, 32),
        file("MaskFolder", "", "",
             "Folder for the masks: region-K.png, each with a file of its points."),
    ]),
    *titled("Several Paintings", [
        switch("Continue", False, "Keep the paint of regions whose pictures and masks stay as they are."),
        text("Variant", "Name of the painting; a new name adds one."),
        text("ShowVariant", "Name of the painting to show; empty: the one named above."),
    ]),
    button("PaintAgain", "Paint again: from the start, or on the last painting if Continue is on."),
    button("ResetStyle", "Return to the scene before painting; Paint Again paints it."),
    *groups.save_properties(),
    *cached_names_property(),
    status(),
))  # fmt: skip
@groups.takes_scene
class StyleRFStylize(SceneBeside):
    """Paint the regions of a scene in the style of pictures, consistently from all directions. The second output shows
    a picture and the part of it that a region learns from.
    """

    button = "Paint Again"
    slots = (PAINTING,)

    ports = (1, 2, "vtkTable")

    def __init__(self) -> None:
        super().__init__()
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
        from svv.job.request import paint as painted
        from svv.pv.work.requests import painting as request_of
        from svv.pv.work.style_files import files_of, lost_file, style_key
        from svv.pv.work.style_masks import write_masks
        from svv.pv.work.styling import Painting, goes_on, paintings_on, starts_from

        scene, values = finished_scene_of(inputs[0]), self.values
        base = digest_of_scene(scene)  # edits before this filter do not change what is painted, only how it is shown
        if self._reset:
            self.give(scene, outputs[0])
            return "The scene as it was before painting."
        style, name = style_key(values, self.known_files()), values["Variant"]
        self.lost, said = lost_file(values), ""
        if not self.lost:
            said = self._show_picture(outputs[1])
            if values["MaskFolder"]:
                folder = Path(values["MaskFolder"])
                self.get_or_make("masks", (style, folder), lambda: write_masks(scene, values, folder, self.progress))
        elif values["PreviewOnly"]:
            raise BadInput(self.lost)
        self._begin_with_paintings(scene, base)
        if not values["PreviewOnly"]:
            slot, given = f"{PAINTING}{name}", digest(base, digest_of_edits(scene))
            before = self.last(slot)

            def paint() -> Scene:
                if self.lost:
                    raise BadInput(self.lost)
                start, go_on = starts_from(scene, before, values)
                with self.training() as progress:
                    return painted(request_of(start, values, go_on), start, progress)[0]

            def make() -> Painting:
                now = Moment(style, digest(*goes_on(scene, before, values)), given)
                of = name_of("scene", source_of(Moment(digest(), "", given)), digest())
                self.wants(of, name_of("painting", source_of(now), style), name)
                result, kept = self.found_or_made(slot, "painting", now, paint)
                return Painting(base, result.on(scene.device), kept)

            painting = self.get_or_make(slot, (base, style, self._round), make)
            self.gives(**{slot: painting.name, **{f"{FILE}{file}": key for file, key in files_of(values).items()}})
            said = painting.describe() + (LOST.format(lost=self.lost) if self.lost else self.note)
        there = {key.removeprefix(PAINTING): value[1] for key, value in self._kept.items() if key.startswith(PAINTING)}
        result = paintings_on(scene, there, values["ShowVariant"], "" if values["PreviewOnly"] else name)
        if any(layer.styled is not None for layer in result.every_layer):
            result = result.with_strength(values["Strength"])
        self.give(result, outputs[0])
        return said

    def _show_picture(self, image: Data) -> str:
        """Output a picture and the part of it that a region learns from; return what to say if nothing is painted."""
        picture, overlay, taken, size = self._preview()
        rows, columns = np.mgrid[: taken.shape[0], : taken.shape[1]]
        shown = np.array(taken.shape[::-1])
        pixels = (2 * np.stack([columns, rows], axis=2) + 1) * size // (2 * shown)  # of the file
        put_image(image, {"RGBA": overlay, "Picture": picture, "Mask": taken, "Pixel": pixels.astype(np.int32)})
        return f"{taken.astype(bool).mean():.0%} of the picture is used; nothing was painted."

    def _begin_with_paintings(self, scene: Scene, base: str) -> None:
        """Restore the paintings that a saved state refers to."""
        from svv.pv.work.styling import Painting

        for slot, name in self.stated().items():
            if not slot.startswith(PAINTING) or self.last(slot) is not None:
                continue
            found = self.load_cached(name, "painting")
            if found is not None and digest_of_scene(found) == base:
                key = (base, settings_in(name, "painting"), 0)
                self.get_or_make(slot, key, lambda: Painting(base, found.on(scene.device), name))  # noqa: B023
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

    def _preview(self) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.integer], tuple[int, int]]:
        from svv.pv.work.style_files import style_key
        from svv.pv.work.style_masks import preview

        key = (style_key(self.values), self.values["ShownMask"])
        return self.get_or_make("preview", key, lambda: preview(self.values, self.progress))
