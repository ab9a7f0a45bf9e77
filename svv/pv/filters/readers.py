"""ParaView's readers for scenes and view sets, and the writers of scenes and of their splats."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from paraview.util.vtkAlgorithm import smproperty, smproxy
from vtkmodules.vtkCommonCore import vtkOutputWindow
from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.errors import BadInput
from svv.options.splats import SplatOptions
from svv.pv.panel.groups import takes_scene
from svv.pv.panel.option_panel import options_in, properties_of
from svv.pv.panel.properties import file, panel, shown_view, status
from svv.pv.vtk_types import Data, InInfo, OutInfo, Request
from svv.pv.work.base import Filter, ViewsOutput, set_image_information
from svv.pv.work.vtk_data import finished_scene_of, put_scene

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet

__all__ = ["StyleRFSceneReader", "StyleRFSceneWriter", "StyleRFSplatsWriter", "StyleRFViewsReader"]


class Writer(Filter):
    """Base class of writers of scenes."""

    ports = (1, 0, "vtkTable")

    def Write(self) -> None:
        """Write the file; called by Save Data."""
        self.Modified()
        self.Update()


@smproxy.writer("StyleRF scenes", extensions="svv", support_reload=False)
@panel(file("FileName", "svv", "Scenes", "The file to write.", save=True))
@takes_scene
class StyleRFSceneWriter(Writer):
    """Write a scene to a file (.svv)."""

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> None:
        finished_scene_of(inputs[0]).save(self.values["FileName"])


@smproxy.writer("StyleRF splats", extensions=["ply", "spz", "glb", "usdz"], support_reload=False)
@panel(
    file("FileName", "ply spz glb usdz", "Gaussian splats", "The file to write.", save=True),
    *properties_of(SplatOptions()),
)
@takes_scene
class StyleRFSplatsWriter(Writer):
    """Fit splats to a scene, and write them to a file (.ply, .spz, .glb, .usdz)."""

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> None:
        from svv.job.splats import export_splats

        path, options = Path(self.values["FileName"]), options_in(SplatOptions, self.values)
        with self.training() as progress:
            said = export_splats(path, finished_scene_of(inputs[0]), options, progress)
        vtkOutputWindow.GetInstance().DisplayText(f"{path.name}: {said}\n")


@smproxy.reader("StyleRF scenes", extensions="svv", label="StyleRF Scene", support_reload=False)
@panel(file("FileName", "svv", "Scenes", "The scene file."), status())
class StyleRFSceneReader(Filter):
    """Read a scene (.svv) as a table with a row for each region, for StyleRF Edit, Stylize and Render. If the scene
    has time steps, it is the one of the time that ParaView shows.
    """

    ports = (0, 1, "vtkTable")

    def RequestInformation(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        info, executive = out_info.GetInformationObject(0), self.GetExecutive()
        info.Remove(executive.TIME_STEPS())
        info.Remove(executive.TIME_RANGE())
        try:
            times = self._times(self._read())
        except BadInput:
            return 1  # RequestData reports it
        if times:
            info.Set(executive.TIME_STEPS(), times, len(times))
            info.Set(executive.TIME_RANGE(), [times[0], times[-1]], 2)
        return 1

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.fields.following.followed_scene import at_step, step_at

        scene, told = self._read(), ""
        times, steps, executive = self._times(scene), scene.steps, self.GetExecutive()
        if times and steps is not None:
            info = out_info.GetInformationObject(0)
            asked = executive.UPDATE_TIME_STEP()
            step = step_at(steps, info.Get(asked)) if info.Has(asked) else steps.own
            whole, (file, _) = scene, self._kept["scene"]
            scene = self.get_or_make("step", (file, step), lambda: at_step(whole, step))
            outputs[0].GetInformation().Set(vtkDataObject.DATA_TIME_STEP(), times[step])
            told = f" time step {step} of {len(times)};"
        put_scene(scene, outputs[0])
        return f"{len(scene.regions)} regions;{told} networks {', '.join(scene.networks)}."

    @smproperty.doublevector(name="TimestepValues", information_only="1", si_class="vtkSITimeStepsProperty")
    def GetTimestepValues(self) -> list[float]:
        """Return the times of the scene's steps, for ParaView's animation."""
        try:
            return self._times(self._read())
        except BadInput:
            return []  # RequestData reports it

    def _read(self) -> Scene:
        from svv.fields.scene.scene import Scene

        name = self.values["FileName"]
        changed = Path(name).stat().st_mtime_ns if Path(name).exists() else 0
        return self.get_or_make("scene", (name, changed), lambda: Scene.load(name))

    @staticmethod
    def _times(scene: Scene) -> list[float]:
        """Return the times of a scene's steps; none if there is only one."""
        return [] if scene.steps is None or len(scene.steps) < 2 else list(scene.steps.times)


@smproxy.reader(
    "StyleRF views", filename_patterns="transforms*.json", label="StyleRF Views Folder", support_reload=False
)
@smproperty.xml('<OutputPort name="View" index="0"/><OutputPort name="Cameras" index="1"/>')
@panel(
    file("FileName", "json", "Views", "The file transforms_train.json or transforms.json of a set of views."),
    *shown_view(),
    status(),
)
class StyleRFViewsReader(ViewsOutput):
    """Read a set of views (a folder with transforms_train.json). The first output shows one view, the second holds the
    cameras. Connect StyleRF Train.
    """

    ports = (0, 2, "vtkImageData")

    def RequestInformation(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        try:
            views = self._read()
        except BadInput:
            return 1  # RequestData reports it
        set_image_information(self, out_info, views.cameras[0].width, views.cameras[0].height)
        self.last_view = len(views) - 1
        return 1

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        views = self._read()
        self.show(views, outputs, file=str(Path(self.values["FileName"]).absolute()))
        return f"{len(views)} views."

    def _read(self) -> ViewSet:
        from svv.io.views.transforms import split_of
        from svv.io.views.viewset import ViewSet

        path = Path(self.values["FileName"])
        changed = path.stat().st_mtime_ns if path.exists() else 0
        return self.get_or_make(
            "views", (path, changed), lambda: ViewSet.read(path.parent, split_of(path), self.progress)
        )
