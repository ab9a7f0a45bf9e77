"""Filters > StyleRF that read a volume or draw a scene. ParaView shows the classes' docstrings as help."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from paraview.util.vtkAlgorithm import smhint, smproperty, smproxy

from svv.errors import BadInput, part
from svv.io.files.keyed_results import digest
from svv.job.orders import LEARNED
from svv.options.baking import BakeOptions
from svv.options.making import ViewOptions
from svv.pv.filters.retuned import as_edited_since
from svv.pv.live.beside import Beside, DrawnBeside
from svv.pv.live.ordered import SHARPENS, Ordered
from svv.pv.panel import groups
from svv.pv.panel.first_screen import stylized_view_properties
from svv.pv.panel.live_properties import live
from svv.pv.panel.option_panel import options_in, properties_of
from svv.pv.panel.properties import cached_names_property, file, panel, picked, shown_view, status, switch
from svv.pv.results.expected import expected
from svv.pv.results.keys import key_in, key_of, name_of, source_of
from svv.pv.results.stored import Stored, describe_parts
from svv.pv.results.time_steps import Moment, Steps
from svv.pv.vtk_types import Data, InInfo, OutInfo, Request
from svv.pv.work import vtk_data
from svv.pv.work.base import Filter, ImageOutput, ViewsOutput, VolumeOutput, set_image_information, time_asked_for
from svv.pv.work.bounded import Bounded
from svv.pv.work.cached import FILE, LOST, Keeping, SceneOutput, Views, views_in
from svv.pv.work.default_function import describe_default_function
from svv.pv.work.own_edits import edits_of, painted_as_edited, put_edited
from svv.pv.work.parallel import DividedInput
from svv.pv.work.picking import Clickable, Telling
from svv.pv.work.resampled import describe_resampled_input
from svv.pv.work.shown_scene import ShownScene, mark_scene, shown_in
from svv.pv.work.unfinished import mark_unfinished

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.render.baking.voxels import Grid

__all__ = [
    "StyleRFStylizedView", "StyleRFViews", "StyleRFTrain", "StyleRFRender", "StyleRFPlaceInView",
    "StyleRFVolume",
]  # fmt: skip


@smproxy.filter(label="StyleRF Views", support_reload=False)
@groups.menu
@groups.keep_input_visible
@smproperty.xml('<OutputPort name="View" index="0"/><OutputPort name="Cameras" index="1"/>')
@panel(
    *groups.volume_properties(ViewOptions()),
    *groups.take_buttons(),
    file("Folder", "", "", "Folder to which the views are also written, as a set that `svv` and other programs read."),
    *shown_view(),
    *cached_names_property(),
    status(),
)
@groups.takes_volume
class StyleRFViews(DividedInput, ViewsOutput, Keeping):
    """Draw views of a volume from all directions, for training. The first output shows one view, the second holds the
    cameras. Connect StyleRF Train, or choose a folder in which to keep the views.
    """

    ports = (1, 2, "vtkImageData")

    def RequestInformation(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        set_image_information(self, out_info, self.values["ViewSize"], self.values["ViewSize"])
        self.last_view = self.values["Views"] - 1
        return 1

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.io.views.viewset import write_splits
        from svv.pv.work.engine import draw_views, moment_of, volume_of

        now, folder = moment_of(inputs[0], self.values, time_asked_for(self)), self.values["Folder"]

        def make() -> Views:
            with self.training() as progress:
                image, options = volume_of(inputs[0], self.values), options_in(ViewOptions, self.values)
                train, test = draw_views(image, self.values, options, part(progress, 0.0, 0.9))
            known = {"key": key_of(now), "look": now.look, "data": now.data, "time": now.time}
            return replace(train, meta=replace(train.meta, other={**train.meta.other, **known})), test

        def own() -> Views | None:
            found = views_in(Path(folder), key_of(now), self.progress) if folder else None
            return found and self.get_or_make("written", (key_of(now), folder), lambda: found)

        def write() -> Views:
            train, test = views
            write_splits(Path(folder), train, test, part(self.progress, 0.9, 1.0))
            return views

        self.begin_with("views", "views", now)
        views, name = self.steps.get(now, lambda: self.found_or_made("views", "views", now, make, own))
        self.gives(views=name)
        train = views[0]
        if folder:
            self.get_or_make("written", (key_in(name), folder), write)
        self.show(train, outputs, key_in(name))
        said = f"{len(train)} views, drawn in {train.meta.seconds:.0f} s by the {train.meta.mapper} ray caster."
        said = " ".join(filter(None, [said, train.meta.assumed]))
        said += describe_resampled_input(inputs[0], self.values) + describe_default_function(inputs[0], self.values)
        return said + self.note + self.steps.describe_staleness(now, "Drawn", "draws them again")

    def before(self, outputs: list[Data]) -> None:
        if self.steps.result is not None:
            views, name = self.steps.result
            self.show(views[0], outputs, key_in(name))
        elif "views" in self.stated():  # results made from the views are found by this key
            vtk_data.put_no_views(key_in(self.stated()["views"]), *outputs)


@smproxy.filter(label="StyleRF Train", support_reload=False)
@groups.menu
@groups.keep_input_visible
@panel(
    *live(),
    *groups.training_properties("fast"),
    *groups.take_buttons(),
    file("SceneFile", "svv", "Scenes",
         "File for the scene, which is read again if the input is the same, so that a saved state need not train.",
         save=True),
    *groups.volume_properties(ViewOptions(test=0)),
    *cached_names_property(),
    status(),
)  # fmt: skip
@groups.takes_volume
class StyleRFTrain(DividedInput, Beside):
    """Train a scene on a volume as it is shown, or on the views from StyleRF Views or a folder. The result is a table
    with a row for each region. It is trained again only if something that it depends on has changed.
    """

    def result(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.pv.work.engine import describe_regions, followed, follows, training_moment
        from svv.pv.work.requests import learning

        present, file = training_moment(inputs[0], self.values, time_asked_for(self)), self.values["SceneFile"]
        now = self.settled(present)
        self.wants(name_of("scene", source_of(now), now.settings), more=file)

        def make() -> Scene:
            from svv.job.request import learn  # imports torch, which would delay the window

            with self.training() as progress:
                return learn(learning(inputs[0], self.values), progress)[0]

        def own() -> Scene | Stored | None:
            return self.found_in(Path(file), now) if file else None

        def get() -> tuple[Scene | Stored, str]:
            found = self.found_or_made("scene", "scene", now, make, own)
            if file and own() is None:  # found in the cache, not in the user's file
                found[0].save(file)
            return found

        self.begin_with("scene", "scene", now)
        scene, name = self.steps.get(now, get, self.values["TrainEachTimeStep"])
        self.gives(scene=name)
        whole, moved = scene, ""
        if not isinstance(whole, Stored) and follows(whole, inputs[0], self.steps.made, present):
            moved, key = f" Followed to time {present.time:g}.", (name, present.data)
            scene = self.get_or_make("followed", key, lambda: followed(whole, inputs[0], self.values, present))
        scene, told = as_edited_since(self, scene, name, present, moved)
        if isinstance(scene, Stored):
            vtk_data.put_stored(*Stored.and_content(scene.path), outputs[0])
        else:
            vtk_data.put_scene(scene, outputs[0])
        self.get_or_make("table", None, lambda: outputs[0].NewInstance()).ShallowCopy(outputs[0])
        said = f"{describe_regions(scene)}, trained in {scene.made['seconds']['total']:.0f} s."
        said = " ".join(
            [said, *scene.made.get("warnings", []), scene.made.get("source", {}).get("assumed") or ""]
        ).rstrip()
        said += describe_resampled_input(inputs[0], self.values) + describe_default_function(inputs[0], self.values)
        return said + self.note + told

    def meanwhile(self, inputs: list[Data], outputs: list[Data], learner: Ordered) -> None:
        if not self.put_newest(outputs[0]):
            self.before(outputs)
            mark_unfinished(outputs[0])

    def before(self, outputs: list[Data]) -> None:
        if self.last("table") is not None:
            outputs[0].ShallowCopy(self.last("table"))


@smproxy.filter(label="StyleRF Render", support_reload=False)
@groups.menu
@groups.keep_input_visible
@groups.shown_beside
@panel(*groups.image_properties(400), *groups.value_properties(), groups.device(), *picked(), status())
@groups.takes_scene
class StyleRFRender(ImageOutput, Telling):
    """Render an image of a scene: RGBA, depth, regions and the volume's values. Unless Camera is set, it shows one of
    the 181 frames of an orbit around the scene.
    """

    ports = (1, 1, "vtkImageData")

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.pv.work.engine import camera_for, draw, emptiness_of, with_values

        scene = vtk_data.scene_of(inputs[0])
        camera = camera_for(scene.rig, self.values)
        drawn, told = draw(scene, camera, self.values, self.progress), ""
        if self.values["WithValues"] and not self.values["Moving"]:
            added, told = with_values(scene, camera, self.values, self.progress)
            drawn |= added
        vtk_data.put_drawn(outputs[0], drawn, camera)
        self.framed = " ".join(f"{number:.9g}" for number in vtk_data.numbers_of(camera, scene.rig.centre))
        self.get_or_make("shown", vtk_data.key_of_scene(inputs[0]), lambda: shown_in(inputs[0])).mark(outputs[0])
        return f"{camera.width} x {camera.height} pixels.{emptiness_of(scene, drawn['Depth'])}{told}"


@smproxy.filter(label="StyleRF Place In View", support_reload=False)
@groups.menu
@panel(
    switch("Opaque", False,
           "Make pixels opaque, or leave them out below one half, so that the picture also hides volumes in the view, "
           "which ParaView otherwise draws over it."),
    status(),
)  # fmt: skip
@groups.takes_image
class StyleRFPlaceInView(Filter):
    """Place the image of StyleRF Render or StyleRF Stylized View in the 3D view, among everything else, as a surface at
    its pixels' depth. The image's Follow Camera is turned on, so that it is rendered for that view's camera.
    """

    ports = (1, 1, "vtkPolyData")

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.core.geometry.depth_mesh import depth_mesh

        drawn = vtk_data.drawn_in(inputs[0])
        mesh = depth_mesh(*drawn, self.values["Opaque"])
        vtk_data.put_mesh(mesh, outputs[0])
        vtk_data.put_camera(drawn[2], outputs[0])
        return f"{len(mesh.points)} points."


@smproxy.filter(label="StyleRF Volume", support_reload=False)
@groups.menu
@smhint.xml('<RepresentationType view="RenderView" type="Volume"/>')
@panel(*properties_of(BakeOptions()), *groups.cut_properties(), *picked(), status())
@groups.takes_scene
class StyleRFVolume(VolumeOutput, Clickable, Bounded):
    """Bake a scene, edited and painted, into a volume that ParaView draws in the 3D view among everything else, and
    that can be cut open.
    """

    ports = (1, 1, "vtkImageData")

    def grid_for(self, data: Data | None) -> Grid:
        from svv.fields.devices.gpu import device_named
        from svv.render.baking.baked import grid_for

        options, scene = options_in(BakeOptions, self.values), vtk_data.scene_of(data)
        device_named(options.device)
        return grid_for(scene, options)

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.fields.devices.gpu import device_named
        from svv.pv.work.engine import as_cut
        from svv.render.baking.baked import Baker

        options = options_in(BakeOptions, self.values)
        scene = vtk_data.scene_of(inputs[0]).on(device_named(options.device))
        baker: Baker = self.get_or_make("baker", options.device, Baker)
        key = vtk_data.key_of_scene(inputs[0]), options
        baked = self.get_or_make("baked", key, lambda: baker.bake(scene, options, self.progress))
        self.get_or_make("volume", object(), lambda: as_cut(baked, self.values))
        self.before(outputs)
        self.announce(out_info, self.last("volume").grid)
        return f"{self.last('volume').describe()}."

    def before(self, outputs: list[Data]) -> None:
        if self.last("volume") is not None:
            vtk_data.put_baked(self.last("volume"), outputs[0])


@smproxy.filter(label="StyleRF Stylized View", support_reload=False)
@groups.menu
@groups.keep_input_visible
@groups.shown_beside
@panel(*stylized_view_properties())
@groups.takes_volume
class StyleRFStylizedView(DividedInput, ImageOutput, DrawnBeside, SceneOutput):
    """Make a painted image of a volume in one step: choose a picture and press Apply. The volume is drawn as it is
    shown, and a scene trained, painted and rendered; a new camera or an edit needs no new training. The other StyleRF
    filters do this step by step, and take the image for its scene.
    """

    ports = (1, 1, "vtkImageData")

    def __init__(self) -> None:
        super().__init__()
        self._status = expected()

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        said = super().work(inputs, outputs, out_info)
        given: ShownScene | None = self.last("given")
        mark_scene(outputs[0]) if given is None else given.mark(outputs[0])
        self.get_or_make("image", None, lambda: outputs[0].NewInstance()).ShallowCopy(outputs[0])
        return said

    def result(  # long: one step after the other
        self, inputs: list[Data], outputs: list[Data], out_info: OutInfo
    ) -> str:
        from svv.pv.work import engine
        from svv.pv.work.requests import learning
        from svv.pv.work.style_files import files_of, lost_file, style_key

        values = self.values
        present, each = engine.training_moment(inputs[0], values, time_asked_for(self)), values["TrainEachTimeStep"]
        now = self.settled(present)
        styles = style_key(values, self.known_files()) if values["StyleFiles"] else ""
        self.lost = lost_file(values)
        todo = LEARNED if styles else 0.98

        def learn() -> Scene:
            from svv.job import request  # imports torch, which would delay the window

            with self.training() as progress:
                return request.learn(learning(inputs[0], values), part(progress, 0.0, todo))[0]

        def paint() -> Scene:
            from svv.job import request

            if self.lost:
                raise BadInput(self.lost)
            with self.training() as progress:
                return request.paint(learning(inputs[0], values), scene, part(progress, todo, 0.98))[0]

        def ours(scene: str) -> Moment:
            return Moment(look, "", key_in(scene))

        def wants(scene: str) -> None:
            self.wants(scene, name_of("painting", source_of(ours(scene)), look) if styles else "")

        paintings: Steps[tuple[Scene | Stored, str]] = self.get_or_make("paintings", None, Steps)
        look = digest(styles, now.settings)
        wants(name_of("scene", source_of(now), now.settings))
        if styles:
            self.begin_with_painting(now, look, paintings)
        self.begin_with("scene", "scene", now)
        scene, name = self.steps.get(now, lambda: self.found_or_made("scene", "scene", now, learn), each)
        self.gives(scene=name)
        wants(name)
        if styles:
            on = ours(name)
            painted, name = paintings.get(on, lambda: self.found_or_made("painted", "painting", on, paint), each)
            self.gives(painted=name, **{f"{FILE}{file}": key for file, key in files_of(values).items()})
            scene = painted
        hint = "" if styles else "; choose a picture under Style Files to paint them"
        note = LOST.format(lost=self.lost) if self.lost else self.note
        shown = describe_resampled_input(inputs[0], values) + describe_default_function(inputs[0], values)
        said = f"{engine.describe_regions(scene)}{hint}.{shown}{note}"
        said = " ".join(filter(None, [said, scene.made.get("source", {}).get("assumed"), describe_parts(scene)]))
        whole, made, moved = scene, self.steps.made, ""
        if isinstance(whole, Stored):
            return said + self._drawn(whole, name, present, (inputs[0], outputs[0]))
        camera = engine.camera_for(whole.rig, values)
        if made is not None and made.data == present.data:
            self.get_or_make(
                "moving", (name, made.data), lambda: engine.moving_from(whole, inputs[0], values, present, self.times)
            )
        if made is not None and engine.follows(whole, inputs[0], made, present):
            moving = self.get_or_make("moving", (name, made.data), lambda: None)
            make = partial(engine.followed, whole, inputs[0], values, present, moving)
            scene = self.get_or_make("followed", (name, present.data), make)
            moved = f" Followed to time {present.time:g}."
        scene, told = as_edited_since(self, scene, name, present, moved)
        assert not isinstance(scene, Stored)
        edits, plain = edits_of(values), scene
        key = id(plain), repr(edits)  # which the result holds
        _, scene, edited = self.get_or_make(
            "edited", key, lambda: (plain, *painted_as_edited(plain, edits, self.progress))
        )
        drawn = engine.draw(scene, camera, values, self.progress)
        vtk_data.put_drawn(outputs[0], drawn, camera)
        self.get_or_make("given", key, lambda: ShownScene(partial(vtk_data.put_scene, scene)))
        self.get_or_make("glance", None, lambda: None)  # no longer needed
        return said + told + edited + engine.emptiness_of(scene, drawn["Depth"])

    def _drawn(self, scene: Stored, name: str, present: Moment, put: tuple[Data, Data]) -> str:
        """Output an image of a scene that another process draws, for input and output; return what to say about it."""
        shown, told = as_edited_since(self, scene, name, present)
        assert isinstance(shown, Stored)
        drawn, sharp, edited = self._learner.result(shown, self.values, self.values["Late"])
        self.drawn_beside(*put, drawn)
        edits = edits_of(self.values)
        self.get_or_make("given", (shown.path, repr(edits)), lambda: ShownScene(partial(put_edited, shown.path, edits)))
        return told + edited + ("" if sharp else SHARPENS)

    def meanwhile(self, inputs: list[Data], outputs: list[Data], learner: Ordered) -> None:
        super().meanwhile(inputs, outputs, learner)
        mark_unfinished(outputs[0])
        state, edits = learner.state(), edits_of(self.values)
        if state is None:
            self.get_or_make("given", None, lambda: None)
            return
        key = state, state.stat().st_mtime_ns, repr(edits)
        self.get_or_make("given", key, lambda: ShownScene(partial(put_edited, state, edits, sketch=True)))

    def release(self) -> None:
        super().release()
        self._kept.pop("paintings", None)

    def before(self, outputs: list[Data]) -> None:
        if self.last("image") is not None:
            outputs[0].ShallowCopy(self.last("image"))
