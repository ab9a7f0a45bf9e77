"""Figures for papers, drawn by the Python that started ParaView: matplotlib must not be loaded into ParaView's."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress
from svv.io.files.atomic import write_json
from svv.io.files.temporary import work_folder
from svv.options.figures import FigureOptions
from svv.pv.display.linked_camera import camera_numbers, parallel_scale_of, upstream
from svv.pv.launch.programs import PYTHON
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values
from svv.pv.paraview_types import Proxy, View
from svv.pv.work.shown_scene import KEY
from svv.pv.work.vtk_data import camera_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene


PIXELS = 800
"""Width and height of the camera's picture, of which a figure shows what is visible."""

KINDS = (".pdf", ".svg", ".png", ".tif", ".tiff")


def options_of(values: Values) -> FigureOptions:
    """Return the settings of a figure that the panel asks for."""
    background = tuple(values["BackgroundColour"]) if values["Background"] else None
    return options_in(FigureOptions, values, background=background)


def camera_in(values: Values) -> Camera | None:
    """Return the panel's camera; None if it is all zeros, for the front of the scene."""
    if not any(values["Camera"][:6]):
        return None
    return camera_of(values["Camera"], PIXELS, PIXELS, values["ParallelScale"])


def pixels_of(scene: Scene, values: Values, progress: Progress) -> tuple[NDArray[np.uint8], str]:
    """Return a figure of a scene, straight RGBA (height, width, 4), and what to know of it; raise as :func:`write`."""
    from PIL import Image

    with work_folder() as folder:
        file = folder / "figure.png"
        said = write(scene, values, file, progress)
        with Image.open(file) as picture:
            return np.array(picture.convert("RGBA")), said


def write(scene: Scene, values: Values, out: Path, progress: Progress) -> str:
    """Write a figure of a scene to a file, and return what users should know of it; raise as :func:`run_outside`."""
    from svv.job.figure_program import request

    if out.suffix.lower() not in KINDS:
        raise BadInput(f"A figure is a .pdf, .svg, .png or .tiff, not '{out.name}': choose another name.")
    with work_folder() as folder:
        scene.save(folder / "scene.svv")
        volume = [file for file in (values["VolumeFile"],) if file] if values["VolumeRendering"] else None
        asked = request(folder / "scene.svv", camera_in(values), options_of(values), out.absolute(), volume)
        write_json(folder / "request.json", asked)
        return run_outside(["-m", "svv.job.figure_program", str(folder / "request.json")], progress)


def run_outside(words: Sequence[str], progress: Progress, folders: Sequence[Path] = ()) -> str:
    """Run a program that draws a figure in the Python that started ParaView; return what it says, as one line.

    ``words`` are Python's arguments, ``folders`` hold further packages. Raises BadInput with its last line if it
    failed, and Cancelled if the user pressed Abort, which ends it.
    """
    python = os.environ.get(PYTHON) or (sys.executable if "python" in Path(sys.executable or "").name.lower() else "")
    if not python:
        raise BadInput("Figures are drawn by the Python that starts ParaView: start it with `svv paraview`.")
    hidden = ("PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "LD_PRELOAD")
    environ = {name: value for name, value in os.environ.items() if name not in hidden}
    environ["PYTHONPATH"] = os.pathsep.join(map(str, [Path(__file__).resolve().parents[3], *folders]))
    try:
        process = subprocess.Popen(
            [python, *words],
            env=environ,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
    except OSError as error:
        raise BadInput(f"{python} cannot draw the figure: {error.strerror}.") from error
    try:
        while process.poll() is None:
            progress(0.5, "drawing the figure")
            time.sleep(0.1)
    finally:
        if process.poll() is None:
            process.terminate()
        said, errors = process.communicate()
    if process.returncode == 0:
        return " ".join(said.split())
    last = (errors.strip().splitlines() or ["it gave no reason"])[-1]
    if last.startswith("svv: "):
        raise BadInput(last.removeprefix("svv: "))
    raise BadInput(
        f"The Python at {python} cannot draw the figure ({last}): install svv there with its extra 'figure'."
    )


def _file_of(source: Proxy) -> str:
    """Return the file of a reader whose output is no scene, and the first of several; '' for anything else."""
    file = next((getattr(source, name) for name in ("FileName", "FileNames") if name in source.ListProperties()), "")
    if source.GetDataInformation().GetDataClassName() == "vtkTable":
        return ""
    return str(file if isinstance(file, str) else next(iter(file), ""))


def _is_scene(source: Proxy) -> bool:
    """Return whether a source's output is a scene, or an image of one."""
    told = source.GetDataInformation()
    of_scene = told.GetFieldDataInformation().GetArrayInformation(KEY) is not None
    return told.GetDataClassName() == "vtkTable" or of_scene


def add_figure(source: Proxy | None = None, view: View | None = None) -> Proxy:
    """Add StyleRF Figure to a scene, or an image of one, as a view sees it; return its proxy, not applied yet.

    Source and view are by default the active ones. Raises BadInput if the source is no scene.
    """
    from paraview import simple

    source = source or simple.GetActiveSource()
    if source is None or not _is_scene(source):
        raise BadInput(
            "Select a scene in the Pipeline Browser first: StyleRF Scene, Train, Edit, Stylize or Stylized View."
        )
    figure = simple.StyleRFFigure(Input=source)
    figure.VolumeFile = next(filter(None, map(_file_of, upstream(source))), "")
    view = view or simple.GetActiveView()
    if view is not None and view.GetXMLName() == "RenderView":
        figure.Camera, figure.ParallelScale = camera_numbers(view), parallel_scale_of(view)
    simple.SetActiveSource(figure)
    return figure
