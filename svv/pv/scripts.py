"""What the scripts of ``paraview_scripts`` share: a volume as ParaView shows it, as the source of views.

For pvpython and pvbatch, whose data are in the same process.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svv.core.cameras import Camera
from svv.ending import end_with
from svv.errors import BadInput
from svv.job.source import Drawn


@dataclass(frozen=True)
class ShownVolume(Drawn):
    """A volume with the transfer function and the shading with which a representation shows it.

    ``values`` are those of :func:`svv.pv.capture.shown_as`, the function as VTK's object.
    """

    data: Any
    values: Mapping[str, Any]
    label: str

    @property
    def name(self) -> str:
        """The array's."""
        return self.label

    def identity(self) -> dict[str, Any]:
        """A hash of data, function and shading.

        Raises:
            BadInput: no image, or one that shows nothing.
        """
        from svv.pv.work import views_key, volume_of

        # Number and size of views are at their defaults here: the job knows them itself.
        return {"shown": views_key(volume_of(self.data), self.values)}

    def image(self) -> Any:
        """The volume, checked."""
        from svv.dvr.grids import as_volume
        from svv.pv.work import volume_of

        return as_volume(volume_of(self.data), self.values["Scalars"], "The volume")

    def how(self) -> dict[str, Any]:
        """Function and shading, as they are shown."""
        from svv.pv.work import shading_of, transfer_function_of

        return {"tf": transfer_function_of(self.values), "shading": shading_of(self.values), "rescale": False}


def shown_volume(display: Any) -> ShownVolume:
    """What a representation shows.

    Raises:
        BadInput: a way of showing it that cannot be learned.
    """
    from paraview import simple

    from svv.pv.capture import shown_as

    source = display.Input
    source.UpdatePipeline(simple.GetTimeKeeper().Time)  # as the view shows it
    values = shown_as(display)
    array = values["Scalars"][1]
    table = values["TransferFunction"]
    table.SMProxy.UpdateVTKObjects()
    values = {**values, "Scalars": array, "TransferFunction": table.SMProxy.GetClientSideObject()}
    data = source.SMProxy.GetClientSideObject().GetOutputDataObject(source.Port)
    return ShownVolume(data, values, array)


def open_volume(path: Path, tf: Path | None = None, array: str | None = None) -> tuple[Any, Any]:
    """Show a volume in a 3D view, as a user would after *File > Open*.

    Args:
        path: A volume that ParaView reads, or a state (.pvsm) with one.
        tf: Transfer function, a ParaView preset (JSON); by default as ParaView or the state shows the volume.
        array: Name of the array, where the file has several.

    Returns:
        Representation and view, as ParaView's Python has them.

    Raises:
        BadInput: no such file, nothing that ParaView can read, no volume in it, or no such array.
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


def _display_in_state(path: Path) -> tuple[Any, Any]:
    from paraview import simple

    for view in simple.GetRenderViews():
        for display in view.Representations:
            if getattr(display, "Representation", "") == "Volume" and display.Visibility:
                return display, view
    raise BadInput(f"{path} shows nothing as a volume: save the state with the representation Volume in its view.")


def _display_of_file(path: Path, array: str | None) -> tuple[Any, Any]:
    from paraview import simple

    try:
        reader = simple.OpenDataFile(str(path))
    except RuntimeError:
        reader = None  # ParaView asks which reader to take, and there is nobody to answer
    if reader is None:
        raise BadInput(f"ParaView knows no reader for {path}; name it by its format, or save a state (.pvsm) with it.")
    reader.UpdatePipeline()
    arrays = [("POINTS", name) for name in reader.PointData.keys()] + [("CELLS", n) for n in reader.CellData.keys()]
    chosen = [pair for pair in arrays if array in (None, pair[1])]
    if not chosen:
        names = ", ".join(name for _, name in arrays) or "none"
        raise BadInput(f"{path} has no array '{array}'; it has: {names}." if array else f"{path} holds no array.")
    view = simple.CreateView("RenderView")
    display = simple.Show(reader, view)
    try:
        display.SetRepresentationType("Volume")
    except ValueError:
        kind = reader.GetDataInformation().GetDataSetTypeAsString()
        raise BadInput(f"{path} is {kind}, which is not shown as a volume; save it as an image (.vti) first.") from None
    simple.ColorBy(display, chosen[0])
    simple.ResetCamera(view)
    return display, view


def _show_with(display: Any, tf: Path) -> None:
    """Give a display a transfer function of a preset, at the values that the preset names, if the data has them."""
    from svv.dvr.grids import as_volume, to_array
    from svv.dvr.transfer_functions import TransferFunction
    from svv.pv.work import volume_of

    shown = shown_volume(display)
    values = to_array(as_volume(volume_of(shown.data), shown.values["Scalars"], "The volume"))
    function = TransferFunction.read(tf).fitted(float(values.min()), float(values.max()))
    table = display.LookupTable
    table.RGBPoints = [number for point in function.colours for number in point]
    table.ScalarOpacityFunction.Points = [number for point in function.opacities for number in point]
    display.ScalarOpacityFunction = table.ScalarOpacityFunction
    if function.unit_distance:
        display.ScalarOpacityUnitDistance = function.unit_distance


def update(filter: Any) -> None:
    """Bring a StyleRF filter up to date, at the time that ParaView is at.

    Raises:
        BadInput: it could not do its work; the sentence is its own.
    """
    from paraview import simple

    filter.UpdatePipeline(simple.GetTimeKeeper().Time)
    filter.UpdatePropertyInformation()
    information = filter.GetDataInformation()
    if not information.GetNumberOfPoints() + information.GetNumberOfRows():
        raise BadInput(filter.Status)


def table_of(filter: Any) -> list[dict[str, Any]]:
    """The rows of the table that a filter gives out, {column: value}; raises BadInput as :func:`update` does."""
    update(filter)
    table = filter.SMProxy.GetClientSideObject().GetOutputDataObject(0)
    names = [table.GetColumnName(column) for column in range(table.GetNumberOfColumns())]
    return [
        {name: table.GetValue(row, column).ToString() for column, name in enumerate(names)}
        for row in range(table.GetNumberOfRows())
    ]


def camera_of_view(view: Any, width: int, height: int) -> Camera:
    """The camera of a 3D view, for images of a size in pixels."""
    from svv.pv.data import camera_of
    from svv.pv.follow import camera_numbers

    return camera_of(camera_numbers(view), width, height)


def parser(description: str, *examples: str) -> argparse.ArgumentParser:
    """A parser whose help ends with commands to copy."""
    lines = "\n".join(f"  {example}" for example in examples)
    return argparse.ArgumentParser(
        description=description, epilog=f"examples:\n{lines}", formatter_class=argparse.RawDescriptionHelpFormatter
    )


def interpreter() -> str:
    """The program that runs this script, for another process of the same kind; in pvpython Python does not know."""
    itself = Path("/proc/self/exe")
    if itself.exists() and itself.resolve().name.startswith(("pvpython", "pvbatch")):
        return str(itself.resolve())
    if "paraview" not in sys.modules:
        return sys.executable
    from svv.pv import start

    return str(start.find().program("pvpython"))


def run(work: Callable[[], object], script: str) -> None:
    """Do a script's work; its end is that of the command ``svv``: a sentence, and exit code 2 or 130."""
    try:
        end_with(work, Path(script).name)
    except SystemExit as ended:
        if ended.code:
            _close_windows()
            raise
        # A script that comes to its end by itself lets pvpython close its windows in order.


def _close_windows() -> None:
    """Views that are open when a program is left by ``exit`` end it with an error of the display instead."""
    if "paraview.simple" in sys.modules:
        from paraview import simple

        for view in simple.GetViews():
            simple.Delete(view)
