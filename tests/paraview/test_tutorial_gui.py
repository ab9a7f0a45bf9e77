"""The tutorial does in ParaView's window what its page says, step by step, by the words of the page."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.screenshots import LISTENER, PAGE, SHARP, Page, Window, follow
from svv.fields.scene.scene import Scene
from svv.job.demo import generate

HURRY = "painting.Views, painting.ViewSize, painting.ImageSize, painting.Preset = 12, 64, [96, 96], 'draft'"
"""Sizes that only the test has."""

LOOK = """
import json
import numpy as np
from paraview import servermanager as sm
from vtkmodules.util.numpy_support import vtk_to_numpy

def camera(of):
    live = of.GetActiveCamera()
    return [*live.GetPosition(), *live.GetFocalPoint(), *live.GetViewUp(), live.GetViewAngle()]

def seen():
    data = sm.Fetch(painting).GetPointData()
    opaque = vtk_to_numpy(data.GetArray("RGBA"))[:, 3] > 30
    return sorted(set(vtk_to_numpy(data.GetArray("Region"))[opaque].tolist()))

def state():
    views = sorted(GetRenderViews(), key=lambda one: one != view)
    shown = [[d.Input.SMProxy.GetXMLName() for d in one.Representations if hasattr(d, "Input") and d.Visibility]
             for one in views]
    told = str(painting.UpdatePropertyInformation() or painting.Status)
    return {"shown": shown, "camera": camera(view), "image": list(painting.Camera), "told": told}
"""
NOW = "answer = json.dumps(state())"


def colourful(window: Window, step: str) -> tuple[float, float]:
    """Parts of the left and the right view that are in colour."""
    picture = window.gui.screenshot(window.folder / f"{step}.png")
    pixels = np.asarray(Image.open(picture).convert("RGB"), np.int16)
    bright = (pixels.max(axis=2) - pixels.min(axis=2)) > 60
    return float(bright[200:980, 310:780].mean()), float(bright[200:980, 800:1270].mean())


@pytest.mark.slow
def test_the_tutorial_is_true(gui: Callable, tmp_path: Path) -> None:
    (tmp_path / "first").mkdir()
    generate(tmp_path / "first", 32)
    page = Page(PAGE.read_text())
    script = (
        f"import os\nos.environ['SVV_CACHE'] = {str(tmp_path / 'cache')!r}\nos.chdir({str(tmp_path)!r})\n{LISTENER}"
    )
    running = gui(script, aloud=True)
    window = Window(running, tmp_path)
    steps = follow(window, page, HURRY + LOOK)
    until = lambda step: next(one for one in steps if one == step)  # noqa: E731
    now = lambda: json.loads(window.do(NOW))  # noqa: E731

    until("opened")
    assert window.do("answer = list(GetActiveSource().PointData.keys())") == "['wave']"
    until("volume")
    display = "GetRepresentation(GetActiveSource(), view)"
    assert window.do(f"answer = {display}.Representation, {display}.ColorArrayName[1], {display}.Shade") == (
        "('Volume', 'wave', 1)"
    )
    assert float(window.do("answer = max(GetOpacityTransferFunction('wave').Points[1::4])")) > 0.5, "not the demo's"
    until("menu")
    enabled = {one.name: one.enabled for one in window.screen.widgets() if one.name.startswith("StyleRF ")}
    assert enabled["StyleRF Stylized View"] and not enabled["StyleRF Edit"] and not enabled["StyleRF Figure"]

    until("painted")
    painted = now()
    assert painted["shown"] == [["XMLImageDataReader"], ["StyleRFStylizedView"]], "the layout is not split"
    assert painted["image"] == painted["camera"], "the painting has another camera"
    assert min(colourful(window, "painted")) > 0.01
    regions = json.loads(window.do("answer = json.dumps(seen())"))

    until("turned")
    turned = now()
    assert turned["image"] == turned["camera"] != painted["camera"]

    hidden = {}
    for step in ("hidden", "other hidden"):
        until(step)
        hidden[step] = set(regions) - set(json.loads(window.do("answer = json.dumps(seen())")))
        assert "Learning" not in now()["told"]
    assert hidden["hidden"] == {0} and hidden["other hidden"] == {1}
    until("saved")
    scene_file = tmp_path / "first" / "painted.svv"
    scene = Scene.load(scene_file)
    assert [region.hidden for region in scene.regions].index(True) == 0 and scene.styled is not None
    assert list(steps) == ["state"]
    page.end()
    assert set(page.sections) == {"1. Prepare the data and start ParaView", "Where to go from here"}

    for command, *small in (("render", "--size", "48"), ("figure",)):
        line = [sys.executable, "-m", "svv", command, scene_file, *small, "--out", tmp_path / f"{command}.png"]
        subprocess.run(line, check=True, capture_output=True, timeout=300)
        assert (tmp_path / f"{command}.png").exists()

    # Another window has the painting when it has loaded the state, and learns nothing.
    running.process.terminate()
    running.process.wait(60)
    again = Window(gui(script, aloud=True), tmp_path)
    again.screen.choose("File", "Load State")
    again.screen.choose_file("Load State File", tmp_path / "first" / "painted.pvsm")
    again.screen.press("OK")
    again.until("FindSource('StyleRFStylizedView1') is not None")
    again.do(f"painting = FindSource('StyleRFStylizedView1')\n{LOOK}\npainting.UpdatePipeline()")
    again.until(SHARP)
    assert "Learning" not in json.loads(again.do(NOW))["told"]
    assert set(json.loads(again.do("answer = json.dumps(seen())"))) == set(regions) - {0}


def test_the_panel_has_the_words_of_the_page_and_dialogs_take_new_files(inside: Callable) -> None:
    said = inside("""
from paraview.simple import *
view = StyleRFStylizedView(Input=Wavelet())
said["all"] = list(view.ListProperties())
seen = lambda name: view.GetProperty(name).SMProperty.GetPanelVisibility() == "default"
said["shown"] = [name for name in said["all"] if seen(name)]
said["hints"] = {}
for filter in (view, StyleRFTrain(Input=Wavelet())):
    for name in ("SaveFile", "SceneFile", "PreviewFile", "StyleFiles"):
        if name in filter.ListProperties():
            hints = filter.GetProperty(name).SMProperty.GetHints()
            said["hints"][name] = hints.FindNestedElementByName("AcceptAnyFile") is not None
""")
    page = Page(PAGE.read_text())
    page.turn_to("8. Hide a region")
    regions = [word for word in page.left if word.startswith("Region ")]
    assert len(regions) == 2
    for words in (*regions, "Style Files", "Preset", "Follow Camera", "Save File", "Save Scene", "Stop Here", "Go On"):
        assert f"*{words}*" in " ".join(PAGE.read_text().split()), words
        assert words.replace(" ", "") in said["shown"], words
    for words in ("Opacity", "Recolour", "Name", "Lighting"):
        assert page.says(words) and f"Region0{words}" in said["all"]
    assert said["hints"] == {"SaveFile": True, "SceneFile": True, "PreviewFile": True, "StyleFiles": False}
