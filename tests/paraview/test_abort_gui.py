"""The Abort button next to ParaView's progress bar, and the window while a filter is working."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.pv.launch import programs

SCRIPT = """
from paraview.simple import *

wavelet = Wavelet(WholeExtent=[-12, 12] * 3)
view = GetActiveViewOrCreate("RenderView")
display = Show(wavelet, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "RTData"))
ResetCamera(view)
Render(view)
train = StyleRFTrain(Input=wavelet, Preset="draft", TimeLimit=LIMIT, Views=8, ViewSize=64)
algorithm = train.GetClientSideObject()
first, begun, told = view.GetActiveCamera().GetDistance(), False, False

def progress(*_):
    global told  # it learns, and the time limit says when it ends
    if not told and "base NeRF" in (algorithm.GetProgressText() or "") and algorithm.GetProgress() > 0.2:
        told = True
        done("working")

def begin(*_):
    global begun
    if not begun:
        begun = True
        interactor.DestroyTimer(timer)
        train.UpdatePipeline()
        train.UpdatePropertyInformation()
        done(f"{view.GetActiveCamera().GetDistance() < first} {train.Status}")

algorithm.AddObserver("ProgressEvent", progress)
interactor = view.GetInteractor()
interactor.AddObserver("TimerEvent", begin)
timer = interactor.CreateRepeatingTimer(5000)  # when the window has been moved
done("ready")
"""


def abort_button(picture: Path) -> tuple[int, int] | None:
    """Where the cross stands in the bar at the bottom; None while it is grey."""
    shown = np.asarray(Image.open(picture).convert("RGB"), np.int16)[990:, 200:620]
    red = (shown[..., 0] > 150) & (shown[..., 1:].max(axis=2) < 90)
    rows, columns = np.nonzero(red)
    return (200 + int(columns.mean()), 990 + int(rows.mean())) if len(rows) > 10 else None


@pytest.mark.slow
def test_abort_stops_a_training_where_the_version_can(gui: Callable, tmp_path: Path) -> None:
    # 6.1 is the first that handles events while a filter of its own process works.
    alive = programs.find().version >= (6, 1)
    running = gui(SCRIPT.replace("LIMIT", "200.0" if alive else "15.0"))
    assert running.first == "ready"
    assert running.wait() == "working"
    button = abort_button(running.screenshot(tmp_path / "working.png"))
    if not alive:
        assert button is None, "this version has an Abort button after all"
        said = running.wait()
        assert "regions" in said, said
        return
    assert button is not None, "the Abort button is not enabled"
    running.xdotool("mousemove", 800, 600, "click", 4)  # the volume comes nearer
    time.sleep(5)
    assert abort_button(running.screenshot(tmp_path / "alive.png")) == button, "it did not go on working"
    # One click does not come through: ParaView filters the press out before the window hands it to the button.
    running.xdotool("mousemove", *button, "click", "--repeat", 2, "--delay", 80, 1)
    assert running.wait() == "True Stopped; the previous result is kept. Press Apply again to resume."
