"""The tutorial does in ParaView's window what its page says, step by step, by the words of the page."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.screenshots import LISTENER, PAGE, Page, Window, follow
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


def differ(window: Window, step: str) -> tuple[float, float]:
    """Parts of the left and the right view that are in colour."""
    picture = window.gui.screenshot(window.folder / f"{step}.png")
    pixels = np.asarray(Image.open(picture).convert("RGB"), np.int16)
    colourful = (pixels.max(axis=2) - pixels.min(axis=2)) > 60
    return float(colourful[200:980, 310:780].mean()), float(colourful[200:980, 800:1270].mean())


@pytest.mark.slow
def test_the_tutorial_is_true(gui: Callable, tmp_path: Path) -> None:
    (tmp_path / "first").mkdir()
    generate(tmp_path / "first", 32)
    page = Page(PAGE.read_text())
    script = f"import os\nos.chdir({str(tmp_path)!r})\n{LISTENER}"
    running = gui(script, aloud=True)
    window = Window(running, tmp_path)
    steps = follow(window, page, HURRY + LOOK)
    until = lambda step: next(one for one in steps if one == step)  # noqa: E731
    now = lambda: json.loads(window.do(NOW))  # noqa: E731

    until("opened")
    assert window.do("answer = list(reader.PointData.keys())[0] if (reader := GetActiveSource()) else ''") == "wave"
    until("volume")
    display = "GetRepresentation(GetActiveSource(), view)"
    assert window.do(f"answer = {display}.Representation, {display}.ColorArrayName[1], {display}.Shade") == (
        "('Volume', 'wave', 1)"
    )
    assert float(window.do("answer = max(GetOpacityTransferFunction('wave').Points[1::4])")) > 0.5, "not the demo's"
    greyed = {one.name for one in window.screen.widgets() if "StyleRF" in one.within and not one.enabled}
    assert not greyed

    until("menu")
    enabled = {one.name: one.enabled for one in window.screen.widgets() if one.within[-1:] == ("StyleRF",)}
    assert enabled["StyleRF Stylized View"] and not enabled["StyleRF Edit"] and not enabled["StyleRF Figure"]

    until("painted")
    painted = now()
    assert painted["shown"] == [["XMLImageDataReader"], ["StyleRFStylizedView"]], "the layout is not split"
    assert painted["image"] == painted["camera"], "the painting has another camera"
    assert min(differ(window, "painted")) > 0.01
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
    scene = Scene.load(tmp_path / "first" / "painted.svv")
    assert [region.hidden for region in scene.regions].index(True) == 0 and scene.styled is not None
    assert list(steps) == ["state"]
    page.end()
    assert set(page.sections) == {"1. Prepare the data and start ParaView", "Where to go from here"}

    # The state has the painting.
    running.process.terminate()
    running.process.wait(60)
    again = Window(
        gui(f"import os\nos.chdir({str(tmp_path)!r})\n{LISTENER}", aloud=True, environ=running.environ), tmp_path
    )
    again.screen.choose("File", "Load State")
    again.screen.choose_file("Load State File", tmp_path / "first" / "painted.pvsm")
    again.screen.press("OK")
    again.until("FindSource('StyleRFStylizedView1') is not None")
    again.do(f"painting = FindSource('StyleRFStylizedView1')\n{LOOK}\npainting.UpdatePipeline()")
    assert "Learning" not in json.loads(again.do(NOW))["told"]
    assert os.path.exists(tmp_path / "first" / "painted.svv")
