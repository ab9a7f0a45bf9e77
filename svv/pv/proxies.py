"""The filters under Filters > StyleRF that look at a volume or draw a scene; those that change scenes: scene_filters.

Each class is a list of properties and a few calls into :mod:`svv.pv.work`. Its docstring is what ParaView shows as
help.
"""

from __future__ import annotations

from typing import Any

from paraview.util.vtkAlgorithm import smproperty, smproxy

from svv.errors import part
from svv.pv.data import put_image, put_scene, scene_of
from svv.pv.filters import Filter, ImageOutput, ViewsOutput, set_image_information, time_asked_for
from svv.pv.panels import (
    PICTURES,
    TAKE_HELP,
    device,
    image_properties,
    keep_input_visible,
    menu,
    preview_file,
    takes_scene,
    takes_volume,
    training_properties,
    volume_properties,
)
from svv.pv.properties import button, file, files, panel, shown_view, status
from svv.pv.steps import Moment, Steps

__all__ = [
    "StyleRFStylizedView", "StyleRFViews", "StyleRFTrain", "StyleRFRender",
]  # fmt: skip


@smproxy.filter(label="StyleRF Views", support_reload=False)
@menu
@keep_input_visible
@smproperty.xml('<OutputPort name="View" index="0"/><OutputPort name="Cameras" index="1"/>')
@panel(
    *volume_properties(92, 16, 800),
    button("TakeAsEdited", TAKE_HELP),
    file("Folder", "", "", "Where to write the views too, as a set that `svv` and other programs read."),
    *shown_view(),
    status(),
)
@takes_volume
class StyleRFViews(ViewsOutput):
    """Draw views of a volume from all around it, as training needs them. The first output shows one of them, the second
    has the cameras. Connect StyleRF Train, or name a folder to keep them in."""

    def __init__(self) -> None:
        super().__init__(1, 2, "vtkImageData")

    def RequestInformation(self, request: Any, in_info: Any, out_info: Any) -> int:
        set_image_information(self, out_info, self.values["ViewSize"], self.values["ViewSize"])
        self.last_view = self.values["Views"] - 1
        return 1

    def work(self, inputs: list[Any], outputs: list[Any], out_info: Any) -> str:
        from svv.pv.work import draw_views, moment_of, volume_of

        now, folder = moment_of(inputs[0], self.values, time_asked_for(self)), self.values["Folder"]

        def make() -> Any:
            with self.training() as progress:
                return draw_views(volume_of(inputs[0]), self.values, part(progress, 0.0, 0.9))

        train, test = self.steps.get(now, make)
        if folder:
            write = lambda: _write(train, test, folder, part(self.progress, 0.9, 1.0))  # noqa: E731
            self.kept("written", (self.steps.made, folder), write)
        self.show(train, outputs)
        said = f"{len(train)} views, drawn in {train.meta['seconds']:.0f} s by the {train.meta['mapper']} ray caster."
        return said + self.steps.told(now, "Drawn", "draws them again")

    def before(self, outputs: list[Any]) -> None:
        if self.steps.result is not None:
            self.show(self.steps.result[0], outputs)


def _write(train: Any, test: Any, folder: str, progress: Any) -> bool:
    train.write(folder, "train", part(progress, 0.0, 0.8))
    if test is not None:
        test.write(folder, "test", part(progress, 0.8, 1.0))
    return True


@smproxy.filter(label="StyleRF Train", support_reload=False)
@menu
@keep_input_visible
@panel(
    *training_properties("balanced"),
    device(),
    button("TakeAsEdited", TAKE_HELP),
    file("SceneFile", "svv", "Scenes",
         "Where to keep the scene. A scene that was trained here from the same input is read from it, so that a saved "
         "state need not train again; training that was stopped goes on.", save=True),
    *volume_properties(92, 0, 800),
    status(),
)  # fmt: skip
@takes_volume
class StyleRFTrain(Filter):
    """Learn a scene from a volume as it is shown, or from the views of StyleRF Views or a folder. The result is a table
    with a row for each region that was found, and carries the scene. It is not learned again before something that
    matters has changed."""

    def __init__(self) -> None:
        super().__init__(1, 1, "vtkTable")

    def work(self, inputs: list[Any], outputs: list[Any], out_info: Any) -> str:
        from svv.pv.work import train, training_moment

        now = training_moment(inputs[0], self.values, time_asked_for(self))

        def make() -> Any:
            with self.training() as progress:
                return train(inputs[0], self.values, progress)

        scene = self.steps.get(now, make, self.values["TrainEachTimeStep"])
        put_scene(scene, outputs[0])
        said = f"{len(scene.regions)} regions, learned in {scene.made['seconds']['total']:.0f} s."
        return said + self.steps.told(now)

    def before(self, outputs: list[Any]) -> None:
        if self.steps.result is not None:
            put_scene(self.steps.result, outputs[0])


@smproxy.filter(label="StyleRF Render", support_reload=False)
@menu
@keep_input_visible
@panel(*image_properties(400), device(), status())
@takes_scene
class StyleRFRender(ImageOutput):
    """An image of a scene: RGBA, depth and regions. Without a camera of its own it shows one of 181 frames of an
    orbit around the scene; the macro StyleRF play orbit lets Play and Save Animation show them all."""

    def __init__(self) -> None:
        super().__init__(1, 1, "vtkImageData")

    def work(self, inputs: list[Any], outputs: list[Any], out_info: Any) -> str:
        from svv.pv.work import camera_for, draw

        scene = scene_of(inputs[0])
        camera = camera_for(scene, self.values)
        put_image(outputs[0], draw(scene, camera, self.values, self.progress))
        return f"{camera.width} x {camera.height} pixels."


@smproxy.filter(label="StyleRF Stylized View", support_reload=False)
@menu
@keep_input_visible
@panel(
    files("StyleFiles", PICTURES, "Pictures", "Pictures in whose manner the volume is painted."),
    *training_properties("fast"),
    device(),
    button("TakeAsEdited", TAKE_HELP),
    preview_file(),
    *image_properties(400),
    *volume_properties(92, 0, 800),
    status(),
)
@takes_volume
class StyleRFStylizedView(ImageOutput):
    """A painted image of a volume, in one step: choose a picture and press Apply. Draws the volume as it is shown,
    learns a scene, paints it, and renders it; a new camera needs no new training. The other StyleRF filters do this
    step by step, with edits between."""

    def __init__(self) -> None:
        super().__init__(1, 1, "vtkImageData")

    def work(self, inputs: list[Any], outputs: list[Any], out_info: Any) -> str:
        from svv.pv.work import camera_for, draw, style_key, stylize, train, training_moment

        values = {**self.values, "SceneFile": ""}
        now, each = training_moment(inputs[0], values, time_asked_for(self)), values["TrainEachTimeStep"]
        styles = style_key(values) if values["StyleFiles"] else ""
        todo = 0.7 if styles else 0.98

        def learn() -> Any:
            with self.training() as progress:
                return train(inputs[0], values, part(progress, 0.0, todo))

        def paint() -> Any:
            with self.training() as progress:
                return stylize(scene, values, part(progress, todo, 0.98))

        scene = self.steps.get(now, learn, each)
        if styles:
            paintings: Steps[Any] = self.kept("paintings", None, Steps)
            scene = paintings.get(Moment(styles, "", repr(self.steps.made)), paint, each)
        camera = camera_for(scene, values)
        put_image(outputs[0], draw(scene, camera, values, self.progress))
        self.kept("image", None, lambda: outputs[0].NewInstance()).ShallowCopy(outputs[0])
        hint = "" if styles else "; choose a picture under Style Files to paint them"
        return f"{len(scene.regions)} regions{hint}.{self.steps.told(now)}"

    def before(self, outputs: list[Any]) -> None:
        if self.last("image") is not None:
            outputs[0].ShallowCopy(self.last("image"))
