"""The panels of Edit and Stylize in ParaView's window, with their previews."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.cli.options import parse_colour
from svv.io.pictures.mask_pictures import WANTED
from svv.io.pictures.output import write_png
from svv.pv.launch import programs
from svv.styles.gallery import gallery_picture
from tests.cube import cube_scene

SCRIPT = """
from paraview.simple import *
from svv.pv.display.linked_camera import busy, fit, show_image

scene, style = ARGUMENTS
LoadPalette("WhiteBackground")
reader = OpenDataFile(scene)
RenameSource("scene", reader)
edit = StyleRFEdit(Input=reader, Region0Recolour=1, Region0Colour=[0.1, 0.6, 0.5], Region0Opacity=1.5)
RenameSource("edits", edit)
from svv.fields.scene.scene import Scene
rig = Scene.load(scene).rig
(x, y, z), radius = rig.centre, rig.radius
image = StyleRFRender(Input=edit, ImageSize=[400, 400], Show="numbered regions",
                      Camera=[x + 0.2 * radius, y - 0.5 * radius, z + 0.2 * radius, x, y, z, 0, 0, 1, 30])
RenameSource("regions", image)
paint = StyleRFStylize(Input=edit, StyleFiles=[style], PreviewOnly=1, Gallery="mosaic", Region0Style="picture 0",
                       Region0Positive="250,260", Region0Negative="80,180; 470,480")
RenameSource("painting", paint)
for filter in (edit, image, paint):
    filter.UpdatePipeline()
left = GetActiveViewOrCreate("RenderView")
right = CreateView("RenderView")
layout = GetLayout(left)
AssignViewToLayout(view=right, layout=layout, hint=layout.SplitViewVertical(left, 0.5))
mask = OutputPort(paint, 1)
for shown, view in ((image, left), (mask, right)):
    show_image(shown, view)
    size = shown.GetDataInformation().GetExtent()
    fit(view, size[1] + 1, size[3] + 1)
SetActiveView(left)
SetActiveSource(edit)
RenderAllViews()
edit.Region0Opacity = 2.0
RenderAllViews()
ticks = 0

def told():
    paint.UpdatePropertyInformation()
    done("edit " + paint.Status)

def paint_shown():
    global ticks
    ticks = 0
    done(f"reset {edit.Region0Opacity}")
    SetActiveSource(paint)
    SetActiveView(right)

# What is waited for, and what is done then.
steps = [
    (lambda: ticks > 30, told),
    (lambda: edit.Region0Opacity == 1.5, lambda: done("undone")),
    (lambda: edit.Region0Opacity == 2.0, lambda: done("redone")),
    (lambda: edit.Region0Recolour == 0, paint_shown),
    (lambda: ticks > 5, lambda: done("painting")),
    (lambda: paint.Region0Positive.count(";"), lambda: done("points " + paint.Region0Positive)),
]

def tick(*_):
    global ticks
    if busy():  # 6.1 comes here in the midst of an update too, and takes no clicks then
        return
    ticks += 1
    if steps and steps[0][0]():
        steps.pop(0)[1]()

interactor = left.GetInteractor()
interactor.AddObserver("TimerEvent", tick)
timer = interactor.CreateRepeatingTimer(250)
done("ready")
"""

COLUMN = 138
"""Where the panel's buttons are, from the left."""
ROWS = {(5, 11): (612, 641, 670), (5, 13): (633, 659, 685), (6, 1): (630, 656, 681)}
"""Of each version from which on they hold: rows of the buttons Undo Edit, Redo Edit and Reset Edits."""
SEARCH = 62
"""How far the field that searches for properties is above the first of them."""
FLOWER = 920, 760
"""A place in the picture of the painting, at the right."""


def pixels(picture: Path) -> np.ndarray:
    return np.asarray(Image.open(picture).convert("RGB"), np.int16)


@pytest.mark.slow
def test_the_panels_stand_beside_their_previews(gui: Callable, tmp_path: Path) -> None:
    # SVV_SCREENSHOT names a folder for the pictures of the documentation, SVV_SCENE a scene to show in them.
    kept, scene = os.environ.get("SVV_SCREENSHOT"), os.environ.get("SVV_SCENE")
    if scene is None:
        scene = str(tmp_path / "cube.svv")
        cube_scene().save(scene)
    write_png(tmp_path / "impasto.png", gallery_picture("impasto"))
    buttons = ROWS[max(version for version in ROWS if version <= programs.find().version)]
    running = gui(f"ARGUMENTS = {[str(Path(scene).resolve()), str(tmp_path / 'impasto.png')]!r}\n{SCRIPT}")
    assert running.first == "ready"
    said = running.wait()
    assert "nothing was painted" in said, said
    edit = running.screenshot(tmp_path / "edit.png")
    for row, expected in zip(buttons, ("undone", "redone", "reset 1.0"), strict=True):
        running.xdotool("mousemove", COLUMN, row, "click", 1)
        assert running.wait() == expected
    assert running.wait() == "painting"
    # The button is further down than the panel shows: searched for, it is the first.
    search = ("mousemove", COLUMN, buttons[0] - SEARCH, "click", 1, "sleep", "1")
    running.xdotool("windowfocus", running.fill_screen(), "sleep", "1", *search, "type", "Click Inside")
    running.xdotool("sleep", "3", "mousemove", COLUMN, buttons[0], "click", 1, "sleep", "1")
    running.xdotool(*search, "key", "ctrl+a", "key", "Delete", "sleep", "2", "mousemove", *FLOWER, "click", 1)
    assert running.wait().startswith("points 250,260; ")
    stylize = running.screenshot(tmp_path / "stylize.png")
    # The mark of the new point is where the click was, so it is the right pixel.
    marks = np.abs(pixels(stylize) - to_levels(parse_colour(WANTED))).max(axis=2) <= 40
    x, y = FLOWER
    rows, columns = np.nonzero(marks[y - 12 : y + 13, x - 12 : x + 13])
    assert len(rows) > 20 and abs(rows.mean() - 12) < 2 and abs(columns.mean() - 12) < 2
    shown = pixels(edit)
    # Both views show something in colour, and the panel at the left has the colour that the region was given.
    colourful = (shown.max(axis=2) - shown.min(axis=2)) > 60
    assert colourful[100:500, 500:].mean() > 0.02 and colourful[560:1000, 500:].mean() > 0.02
    button = np.abs(shown[:, :420] - to_levels((0.1, 0.6, 0.5))).max(axis=2) <= 3
    assert button.sum() > 50, "the panel shows no button in the region's colour"
    assert (np.abs(pixels(stylize)[:, :420] - shown[:, :420]).max(axis=2) > 30).mean() > 0.01
    if kept:
        shutil.copy(edit, Path(kept) / "paraview-panel.png")
        shutil.copy(stylize, Path(kept) / "paraview-panel-stylize.png")


def to_levels(colour: tuple[float, float, float]) -> np.ndarray:
    return np.rint(np.array(colour) * 255).astype(np.int16)
