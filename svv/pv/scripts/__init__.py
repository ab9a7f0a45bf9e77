"""Common functions of the scripts in ``paraview_scripts``, for pvpython and pvbatch, which have the data."""

from __future__ import annotations

import argparse
import atexit
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData, vtkTable

from svv.core.geometry.cameras import Camera
from svv.dvr.parallel.ranks import ranks_here
from svv.ending import end_with
from svv.errors import BadInput, Progress, silent
from svv.io.views.drawn_views import DrawnViews
from svv.io.views.view_meta import ViewMeta, known
from svv.io.views.viewset import ViewSet
from svv.job.source import Drawn
from svv.options.making import ViewOptions
from svv.pv.panel_values import Values, with_names
from svv.pv.paraview_types import Display, Proxy, View

Result = TypeVar("Result")


@dataclass(frozen=True)
class ShownVolume(Drawn):
    """A volume with the transfer function and the shading with which a representation shows it."""

    data: vtkDataObject
    values: Values
    """Values of :func:`svv.pv.client.capture.shown_as`, with the transfer function as a VTK object."""
    label: str
    """Name of the array."""

    @property
    def name(self) -> str:
        """Name of the array."""
        return self.label

    def identity(self) -> dict[str, object]:
        """Return a hash of data, transfer function and shading; raise BadInput if the data is no grid, or empty."""
        from svv.pv.work.engine import views_key, volume_of

        # Number and size of the views have their defaults here, because the job records them itself.
        return {"shown": views_key(volume_of(self.data, self.values), self.values)}

    def image(self, mapper: str = "cpu", memory: float | None = None, progress: Progress = silent) -> vtkImageData:
        """Return the volume after checking it; it is in memory already."""
        from svv.pv.display.shown import volume_shown
        from svv.pv.work.engine import volume_of

        return volume_shown(volume_of(self.data, self.values), self.values, "The volume")

    def how(self) -> dict[str, object]:
        """Return transfer function and shading as they are shown."""
        from svv.pv.work.engine import shading_of, transfer_function_of

        return {"tf": transfer_function_of(self.values), "shading": shading_of(self.values), "rescale": False}

    def draw(self, options: ViewOptions, progress: Progress, kept: DrawnViews) -> tuple[ViewSet, ViewSet | None]:
        """Draw the training and test views, with all ranks that have a part of the volume."""
        from svv.pv.work.engine import draw_views
        from svv.pv.work.parallel import crew_of

        if crew_of(self.data) is None:
            return super().draw(options, progress, kept)
        return draw_views(self.data, self.values, options, progress)

    def render(self, meta: ViewMeta, cameras: Sequence[Camera], progress: Progress) -> NDArray[np.uint8]:
        """Render the volume as views were drawn, with all ranks that have a part of it."""
        from svv.dvr.functions.transfer_functions import TransferFunction
        from svv.dvr.parallel.crew_views import render_crew_views
        from svv.pv.work.parallel import crew_of

        crew = crew_of(self.data)
        if crew is None:
            return super().render(meta, cameras, progress)
        tf, shading = TransferFunction.from_dict(known(meta.tf, "tf")), known(meta.shading, "shading")
        return render_crew_views(crew, tf, cameras, shading, progress)


def shown_volume(display: Display) -> ShownVolume:
    """Return the volume that a representation shows; raise BadInput if it does in a way that is not supported."""
    from paraview import simple

    from svv.pv.client.capture import shown_as

    source = display.Input
    source.UpdatePipeline(simple.GetTimeKeeper().Time)  # as the view shows it
    values, table = with_names(shown_as(display)), display.LookupTable
    kind, array = display.ColorArrayName[0], display.ColorArrayName[1]
    table.SMProxy.UpdateVTKObjects()
    values["Scalars"], values["ScalarsOnCells"] = array, kind == "CELLS"
    values["TransferFunction"] = table.SMProxy.GetClientSideObject()
    data = source.SMProxy.GetClientSideObject().GetOutputDataObject(source.Port)
    return ShownVolume(data, values, array)


def with_volume(display: Display, work: Callable[[ShownVolume], Result]) -> Result:
    """Do work on the volume that a representation shows, which all ranks draw; raise BadInput if they cannot."""
    from paraview import simple

    from svv.pv.display.shown import DIVIDED, chosen_of
    from svv.pv.work.parallel import on_all_ranks

    volume = shown_volume(display)
    if ranks_here() is None:
        return work(volume)
    time = simple.GetTimeKeeper().Time
    if chosen_of(volume.values):
        raise BadInput(DIVIDED)
    kind = display.ColorArrayName[0]
    return on_all_ranks(display.Input, (kind, volume.name), time, lambda data: work(replace(volume, data=data)))


def open_volume(path: Path, tf: Path | None = None, array: str | None = None) -> tuple[Display, View]:
    """Show a volume, or load a state (.pvsm) that shows one; return proxies of its representation and 3D view.

    It is shown with a preset (JSON) if one is given, otherwise as ParaView shows it; ``array`` names one of several.
    Raises BadInput if there is no such file, ParaView cannot read it, or it has no volume or no such array.
    """
    from paraview import simple

    if not path.exists():
        raise BadInput(f"There is no file {path}; check the path.")
    if path.suffix == ".pvsm":
        simple.LoadState(str(path))
        display, view = _display_in_state(path)
    else:
        display, view = _display_of_file(path, array)
    if tf is not None:
        _show_with(display, tf)
    return display, view


def _display_in_state(path: Path) -> tuple[Display, View]:
    from paraview import simple

    for view in simple.GetRenderViews():
        for display in view.Representations:
            if getattr(display, "Representation", "") == "Volume" and display.Visibility:
                return display, view
    raise BadInput(f"{path} shows no volume: save the state with the representation Volume in its view.")


def _display_of_file(path: Path, array: str | None) -> tuple[Display, View]:
    from paraview import simple

    try:
        reader = simple.OpenDataFile(str(path))
    except RuntimeError:
        reader = None  # ParaView asks the user to choose a reader, which is not possible here
    if reader is None:
        raise BadInput(
            f"ParaView has no reader for {path}: give it the file extension of its format, or save a state (.pvsm) "
            "with it."
        )
    reader.UpdatePipeline()
    arrays = [("POINTS", name) for name in reader.PointData.keys()] + [("CELLS", n) for n in reader.CellData.keys()]
    chosen = [pair for pair in arrays if array in (None, pair[1])]
    if not chosen:
        names = ", ".join(name for _, name in arrays) or "none"
        raise BadInput(f"{path} has no array '{array}'; it has: {names}." if array else f"{path} has no arrays.")
    view = simple.CreateView("RenderView")
    display = simple.Show(reader, view)
    try:
        display.SetRepresentationType("Volume")
    except ValueError:
        kind = reader.GetDataInformation().GetDataSetTypeAsString()
        raise BadInput(
            f"{path} is of the type {kind}, which cannot be shown as a volume: save it as an image (.vti) first."
        ) from None
    simple.ColorBy(display, chosen[0])
    simple.ResetCamera(view)
    return display, view


def _show_with(display: Display, tf: Path) -> None:
    """Give a display a preset's transfer function, at the preset's own values if the data contains them."""
    from svv.dvr.functions.transfer_functions import TransferFunction

    kind, name = display.ColorArrayName
    source = display.Input
    arrays = source.CellData if kind == "CELLS" else source.PointData
    low, high = arrays[name].GetRange()  # of all ranks
    function = TransferFunction.read(tf).fitted(low, high)
    if function.slabs is not None:
        raise BadInput(
            f"{tf} counts opacities by the volume's size, as displays of ParaView do not: give it to svv views."
        )
    table = display.LookupTable
    table.UseLogScale = table.ScalarOpacityFunction.UseLogScale = 0  # the function is on linear scales
    table.ColorSpace, table.HSVWrap = function.space, int(function.hsv_wrap)
    table.RGBPoints = [number for point in function.colours for number in point]
    for word, colour in (("Below", function.below), ("Above", function.above)):
        setattr(table, f"Use{word}RangeColor", int(colour is not None))
        setattr(table, f"{word}RangeColor", list(colour or (0.0, 0.0, 0.0)))
    table.ScalarOpacityFunction.Points = [number for point in function.opacities for number in point]
    display.ScalarOpacityFunction = table.ScalarOpacityFunction
    if function.unit_distance:
        display.ScalarOpacityUnitDistance = function.unit_distance


def update(filter: Proxy) -> None:
    """Update a StyleRF filter at ParaView's current time; raise BadInput with its own message if it failed."""
    from paraview import simple

    filter.UpdatePipeline(simple.GetTimeKeeper().Time)
    filter.UpdatePropertyInformation()
    information = filter.GetDataInformation()
    if not information.GetNumberOfPoints() + information.GetNumberOfRows():
        raise BadInput(filter.Status)


def table_of(filter: Proxy) -> list[dict[str, str]]:
    """Return the rows of a filter's output table as {column: value}; raise BadInput as :func:`update` does."""
    update(filter)
    table = filter.SMProxy.GetClientSideObject().GetOutputDataObject(0)
    return rows_of(table)


def rows_of(table: vtkTable) -> list[dict[str, str]]:
    """Return the rows of a VTK table as {column: value}."""
    names = [table.GetColumnName(column) for column in range(table.GetNumberOfColumns())]
    return [
        {name: table.GetValue(row, column).ToString() for column, name in enumerate(names)}
        for row in range(table.GetNumberOfRows())
    ]


def camera_of_view(view: View, width: int, height: int) -> Camera:
    """Return the camera of a 3D view, for images of the given width and height in pixels."""
    from svv.pv.display.linked_camera import camera_numbers, parallel_scale_of
    from svv.pv.work.vtk_data import camera_of

    return camera_of(camera_numbers(view), width, height, parallel_scale_of(view))


def parser(description: str, *examples: str) -> argparse.ArgumentParser:
    """Return a parser whose help ends with example commands."""
    lines = "\n".join(f"  {example}" for example in examples)
    return argparse.ArgumentParser(
        description=description, epilog=f"examples:\n{lines}", formatter_class=argparse.RawDescriptionHelpFormatter
    )


def interpreter() -> str:
    """Return the program that runs this script, to start another such process; in pvpython, Python does not know it."""
    itself = Path("/proc/self/exe")
    if itself.exists() and itself.resolve().name.startswith(("pvpython", "pvbatch")):
        return str(itself.resolve())
    if "paraview" not in sys.modules:
        return sys.executable
    from svv.pv.launch import programs

    return str(programs.find().program("pvpython"))


def run(work: Callable[[], object], script: str) -> None:
    """Do a script's work, and report errors as the command ``svv`` does: one sentence, and exit code 2 or 130."""
    try:
        end_with(work, Path(script).name)
    except SystemExit as ended:
        if ended.code:
            _close_windows()
            raise
        # After a script that ends normally, pvpython closes its windows in the right order.


def _close_windows() -> None:
    """Close all views: if any are open when ``exit`` is called, the program ends with an error of the display."""
    if "paraview.simple" in sys.modules:
        from paraview import simple

        for view in simple.GetViews():
            simple.Delete(view)
        # Variables of a failed function may still hold a view; the session stays usable until the program ends.
        if ranks_here() is None:  # other ranks would leave the session now, and again at the end, where 6.1 waits
            atexit.register(simple.Disconnect)
