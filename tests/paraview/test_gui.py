"""A user's way through the windows: a volume on screen, Filters > StyleRF > Stylized View, a picture, Apply."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from svv.dvr.demo_volume import demo_transfer_function, demo_volume
from svv.io.output import write_png
from svv.train.textures import style_picture

SCRIPT = """
from paraview.simple import *

volume, preset, style, quick = ARGUMENTS
LoadPalette("WhiteBackground")
reader = OpenDataFile(volume)
RenameSource("volume", reader)
view = GetActiveViewOrCreate("RenderView")
display = Show(reader, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "concentration"))
import json
function = json.load(open(preset))[0]
GetColorTransferFunction("concentration").RGBPoints = function["RGBPoints"]
GetOpacityTransferFunction("concentration").Points = function["Points"]
display.Shade = 1
display.SetScalarBarVisibility(view, False)
ResetCamera(view)
view.GetActiveCamera().Azimuth(30)
view.GetActiveCamera().Elevation(15)
Render(view)
SetActiveSource(reader)
stage = "shown"

def tick(*_):
    global stage
    made = [s for s in GetSources().values() if s.SMProxy.GetXMLName() == "StyleRFStylizedView"]
    if stage == "shown" and made:
        stage = "made"
        filter = made[0]
        filter.StyleFiles = [style]
        if quick == "quick":
            filter.Preset, filter.TimeLimit, filter.Views, filter.ViewSize = "draft", 4.0, 12, 128
        done(f"made {filter.TransferFunction is not None} {filter.Shade}")
    elif stage == "made" and made and made[0].GetDataInformation().GetNumberOfPoints() > 0:
        stage = "painted"
        interactor.DestroyTimer(timer)
        from svv.pv.follow import follow
        follow(made[0], view)
        made[0].UpdatePropertyInformation()
        done("painted: " + made[0].Status)

interactor = view.GetInteractor()
interactor.AddObserver("TimerEvent", tick)
timer = interactor.CreateRepeatingTimer(300)
done("ready")
"""


def write_input(folder: Path, resolution: int) -> tuple[Path, Path, Path]:
    """A volume, its transfer function and a style picture, as the demo generates them."""
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(folder / "volume.vti"))
    writer.SetInputData(demo_volume(resolution))
    assert writer.Write()
    (folder / "tf.json").write_text(json.dumps([demo_transfer_function().to_dict()]))
    write_png(folder / "style.png", style_picture("brush strokes"))
    return folder / "volume.vti", folder / "tf.json", folder / "style.png"


def press(running: Any, folder: Path, *action: object) -> None:
    """Do something with mouse or keyboard, and wait until the screen shows it."""
    before = pixels(running.screenshot(folder / "before.png"))
    running.xdotool(*action)
    until = time.monotonic() + 60.0
    while np.array_equal(pixels(running.screenshot(folder / "after.png")), before):
        assert time.monotonic() < until, f"nothing happened on screen after {action}\n{running.log()}"


def pixels(picture: Path) -> np.ndarray:
    return np.asarray(Image.open(picture).convert("RGB"), np.int16)


def test_a_newcomer_paints_a_volume_from_the_menu(gui: Callable, tmp_path: Path) -> None:
    # SVV_SCREENSHOT names a folder for the pictures of the documentation: then everything is done in full.
    kept = os.environ.get("SVV_SCREENSHOT")
    files = write_input(tmp_path, 128 if kept else 48)
    running = gui(f"ARGUMENTS = {[*map(str, files), 'full' if kept else 'quick']!r}\n{SCRIPT}")
    assert running.first == "ready"
    running.xdotool("mousemove", 215, 10)  # Filters
    press(running, tmp_path, "click", 1)
    press(running, tmp_path, "key", "Up")  # from below: Temporal,
    press(running, tmp_path, "key", "Up")  # StyleRF,
    press(running, tmp_path, "key", "Right")  # and its filters, of which the first three need a scene
    running.xdotool("key", "Down", "sleep", "0.5", "key", "Down", "sleep", "0.5")
    press(running, tmp_path, "key", "Down")
    menu = running.screenshot(tmp_path / "menu.png")
    running.xdotool("key", "Return")
    assert running.wait() == "made True 1", "the filter did not take how the volume is shown"
    running.screenshot(tmp_path / "made.png")
    running.xdotool("key", "alt+a")  # Apply
    said = running.wait(1500.0 if kept else 300.0)
    assert said.startswith("painted: ") and "regions" in said, said
    shown = running.screenshot(tmp_path / "painted.png")
    if kept:
        shutil.copy(menu, Path(kept) / "paraview-menu.png")
        shutil.copy(shown, Path(kept) / "paraview.png")
    # Right of the volume there is an image now, with colours.
    right = pixels(shown)[200:900, 820:1270]
    assert ((right.max(2) - right.min(2)) > 40).mean() > 0.02, "nothing is painted in the right view"
