"""Images beside the 3D view in ParaView's window: where they appear, what they follow, and what is left of them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from docs.screenshots import LISTENER, Window
from svv.pv.launch import programs
from tests.cube import cube_scene
from tests.paraview.conftest import Gui

SHOWN = """
import json
wavelet = Wavelet(WholeExtent=[-1, 1] * 3)
display = Show(wavelet, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "RTData"))
display.SetScalarBarVisibility(view, False)
ResetCamera(view)
view.GetActiveCamera().Azimuth(30)
scene = OpenDataFile("cube.svv")
scene.UpdatePipeline()
SetActiveSource(scene)
Render(view)

def camera(of):
    live = of.GetActiveCamera()
    return [*live.GetPosition(), *live.GetFocalPoint(), *live.GetViewUp(), live.GetViewAngle()]

def images():
    return [source for source in GetSources().values() if source.SMProxy.GetXMLName() == "StyleRFRender"]

def inputs(of):
    return [d.Input.SMProxy.GetXMLName() for d in of.Representations if hasattr(d, "Input") and d.Visibility]

def fits():
    # Whether the image has the form of the view, and not that which it had before it was split.
    (width, height), (columns, rows) = view.ViewSize, images()[0].ImageSize
    return abs(columns * height - rows * width) < 0.02 * columns * height

def state():
    views = GetRenderViews()
    (image,) = images()
    return json.dumps({
        "views": len(views), "shown": [inputs(one) for one in sorted(views, key=lambda one: one != view)],
        "camera": camera(view), "follows": image.FollowCamera, "same": list(image.Camera) == camera(view),
        "bars": sum(d.SMProxy.GetXMLName() == "ScalarBarWidgetRepresentation" and d.Visibility
                    for one in views for d in one.Representations),
    })
"""

CLOSE = """
(other,) = [one for one in GetRenderViews() if one != view]
layout = GetLayout(other)
cell = layout.GetViewLocation(other.SMProxy)
Delete(other)
del other
layout.Collapse(cell)
"""
"""What the cross above the image's view does."""

PANEL = slice(540, 990), slice(0, 290)
"""Rows and columns of the screen where the panel's properties are."""


def add_render(window: Window) -> None:
    """Choose StyleRF Render in the menu."""
    window.do("SetActiveSource(scene)")
    window.screen.choose("Filters", "StyleRF", "StyleRF Render")
    window.until("len(images()) == 1", 60.0)


def applied(window: Window, condition: str) -> dict[str, Any]:
    """Press Apply and wait; returns what is shown."""
    window.gui.xdotool("windowfocus", window.gui.fill_screen(), "sleep", "1", "key", "alt+a")
    return when(window, f"images()[0].GetDataInformation().GetNumberOfPoints() and {condition}")


def when(window: Window, condition: str) -> dict[str, Any]:
    """What is shown once a condition holds."""
    window.until(condition, 60.0)
    time.sleep(1.0)
    state: dict[str, Any] = json.loads(window.do("answer = state()"))
    return state


def panel(gui: Gui, picture: Path) -> np.ndarray:
    return np.asarray(Image.open(gui.screenshot(picture)).convert("RGB"), np.int16)[PANEL]


def scrolls(gui: Gui, folder: Path, button: int) -> bool:
    """Whether the mouse's wheel moves the panel: 7 to the right, 5 down; it is turned back."""
    gui.xdotool("mousemove", 18, 700, "sleep", "1")
    before = panel(gui, folder / "before.png")
    gui.xdotool("click", "--repeat", 4, button, "sleep", "1")
    after = panel(gui, folder / "after.png")
    gui.xdotool("click", "--repeat", 8, button - 1, "sleep", "1")
    return bool((np.abs(after - before).max(axis=2) > 30).mean() > 0.01)


def colourful(gui: Gui, picture: Path) -> float:
    """Part of the right view that is in colour."""
    shown = np.asarray(Image.open(gui.screenshot(picture)).convert("RGB"), np.int16)[200:980, 800:1270]
    return float(((shown.max(axis=2) - shown.min(axis=2)) > 60).mean())


@pytest.mark.slow
def test_the_image_appears_beside_the_volume_and_follows_its_camera(gui: Callable, tmp_path: Path) -> None:
    cube_scene().save(tmp_path / "cube.svv")
    running = gui(f"import os\nos.chdir({str(tmp_path)!r})\n{LISTENER}", aloud=True)
    window = Window(running, tmp_path)
    window.do(SHOWN)
    before = json.loads(window.do("answer = json.dumps(camera(view))"))
    add_render(window)
    first = applied(window, "len(GetRenderViews()) == 2 and fits()")
    beside = [["RTAnalyticSource"], ["StyleRFRender"]]
    assert (first["views"], first["shown"], first["bars"]) == (2, beside, 0)
    assert first["follows"] and first["same"] and first["camera"] == before, "the volume's camera is touched"

    # The panel fits its dock, whichever view is the active one.
    window.do("SetActiveSource(images()[0])")
    for active in (0, 1):
        window.do(f"SetActiveView(sorted(GetRenderViews(), key=lambda one: one != view)[{active}])")
        assert scrolls(running, tmp_path, 5), "the wheel does not reach the panel"
        assert not scrolls(running, tmp_path, 7), "the panel is wider than its dock"
    window.do("SetActiveView(view); SetActiveSource(wavelet)")
    if programs.find().version < (5, 12):  # in which ParaView's own panel of a volume is too wide
        assert scrolls(running, tmp_path, 7), "a panel that is wider than its dock is not noticed"

    # Turned off, the image is one like others; the next image comes into the view that it leaves.
    window.do("images()[0].FollowCamera = 0; view.GetActiveCamera().Azimuth(20); Render(view)")
    still = when(window, "True")
    assert not still["follows"] and not still["same"] and still["shown"] == beside
    window.do("SetActiveView(view); Delete(images()[0])")
    add_render(window)
    window.do("images()[0].FollowCamera = 0")
    ordinary = applied(window, "sum(len(inputs(one)) for one in GetRenderViews()) == 2")
    assert (ordinary["views"], ordinary["shown"], ordinary["follows"]) == (2, beside, 0), "the layout was split again"
    assert colourful(running, tmp_path / "ordinary.png") > 0.01, "the image's view is not drawn"
    window.do("images()[0].FollowCamera = 1")
    assert when(window, "list(images()[0].Camera) == camera(view)")["shown"] == beside

    # Its view closed, it has none until it is to follow again.
    window.do(CLOSE)
    window.do("images()[0].Frame = 1; images()[0].UpdatePipeline()")
    closed = when(window, "not images()[0].FollowCamera")
    assert closed["views"] == 1 and closed["shown"] == beside[:1]
    window.do("images()[0].FollowCamera = 1")
    assert when(window, "sum(len(inputs(one)) for one in GetRenderViews()) == 2")["shown"] == beside

    # From a view that shows the image itself, it goes, and the camera is that of what stays.
    window.do("images()[0].FollowCamera = 0; Show(images()[0], view); ResetCamera(view); Render(view)")
    far = json.loads(window.do("answer = json.dumps(camera(view))"))
    window.do("images()[0].FollowCamera = 1")
    near = when(window, "inputs(view) == ['RTAnalyticSource']")
    assert np.linalg.norm(near["camera"][:3]) < 0.2 * np.linalg.norm(far[:3]), "the volume is left far away"

    # A view with nothing in it looks at the scene.
    window.do("Delete(images()[0]); Delete(wavelet)")
    window.do("view.CameraPosition, view.CameraFocalPoint = [900, 0, 0], [901, 0, 0]")
    add_render(window)
    alone = applied(window, "list(images()[0].Camera) == camera(view)")
    assert (alone["views"], alone["shown"]) == (2, [[], ["StyleRFRender"]])
    assert colourful(running, tmp_path / "alone.png") > 0.01, "the camera sees nothing of the scene"
