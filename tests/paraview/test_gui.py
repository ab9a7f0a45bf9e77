"""A user's way through the windows: a volume on screen, Filters > StyleRF > Stylized View, a picture, Apply."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from svv.dvr.demo_volume import demo_transfer_function, demo_volume
from svv.io.output import write_png
from svv.train.textures import style_picture

SCRIPT = """
import json, sys
from paraview import servermanager as sm
from paraview.simple import *

volume, preset, style, quick = sys.argv[1:5]
LoadPalette("WhiteBackground")
reader = OpenDataFile(volume)
view = GetActiveViewOrCreate("RenderView")
display = Show(reader, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "scalars"))
ImportPresets(preset)
lut = GetColorTransferFunction("scalars")
function = json.load(open(preset))[0]
lut.RGBPoints = function["RGBPoints"]
GetOpacityTransferFunction("scalars").Points = function["Points"]
display.ScalarOpacityUnitDistance = function.get("ScalarOpacityUnitDistance", 1.0)
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
        done("made " + str(filter.TransferFunction is not None and filter.Shade == 1))
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
    import json

    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    image = demo_volume(resolution)
    image.GetPointData().GetScalars().SetName("scalars")
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(folder / "volume.vti"))
    writer.SetInputData(image)
    assert writer.Write()
    (folder / "tf.json").write_text(json.dumps([demo_transfer_function().to_dict()]))
    write_png(folder / "style.png", style_picture("brush strokes"))
    return folder / "volume.vti", folder / "tf.json", folder / "style.png"


def test_a_newcomer_paints_a_volume_from_the_menu(gui: Callable, tmp_path: Path) -> None:
    # SVV_SCREENSHOT names a file for the README's picture: then everything is done in full.
    picture = os.environ.get("SVV_SCREENSHOT")
    files = write_input(tmp_path, 128 if picture else 48)
    running = gui(SCRIPT, *files, "full" if picture else "quick")
    assert running.first == "ready"
    running.fill_screen()
    running.screenshot(tmp_path / "start.png")
    running.xdotool("key", "ctrl+space")  # ParaView's search over all filters of its menu
    running.screenshot(tmp_path / "search.png")
    running.xdotool("type", "StyleRF Stylized")
    running.screenshot(tmp_path / "found.png")
    running.xdotool("key", "Return")
    assert running.wait() == "made True"
    running.screenshot(tmp_path / "made.png")
    running.xdotool("key", "alt+a")  # Apply
    said = running.wait(1500.0 if picture else 300.0)
    assert said.startswith("painted: ") and "regions" in said, said
    shown = running.screenshot(tmp_path / "painted.png")
    if picture:
        shutil.copy(shown, picture)
    # Right of the volume there is an image now, with colours that the volume's view does not have.
    pixels = np.asarray(Image.open(shown).convert("RGB"), np.int16)
    right = pixels[200:900, 900:1270]
    coloured = (right.max(2) - right.min(2)) > 40
    assert coloured.mean() > 0.02, "nothing is painted in the right view"
