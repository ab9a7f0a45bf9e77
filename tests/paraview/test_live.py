"""Stylized View as the window has it: learning goes on in a process of its own, and the filter shows what there is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from svv.io.pictures.output import write_png
from svv.styles.textures import style_picture
from tests.paraview.filter_script import VOLUME

LIVE = f"""{VOLUME}
import glob, time
import numpy as np
from svv.pv.live import sharpening
from svv.pv.live.sharpening import in_window
wavelet, display = shown()
last = {{}}
FEW = dict(Preset="draft", Views=8, ViewSize=64, Device="cpu",
           Settings="reconstruct.iterations=60; recolour.iterations=30; stylize.style_views=4")
LONG = {{**FEW, "Settings": "reconstruct.iterations=20000"}}
folder = sys.argv[1]

def make(style="brush", window=1, **values):
    filter = StyleRFStylizedView(Input=wavelet, StyleFiles=[f"{{folder}}/{{style}}.png"], ImageSize=[64, 64], **values)
    if window:
        in_window(filter)
    return filter

def news(filter):
    told = filter.SMProxy.GetProperty("Learned")
    filter.SMProxy.UpdatePropertyInformation(told)
    return told.GetElement(0)

def look(filter):
    # What the window's timer does.
    now = news(filter)
    if now != last.get(filter.SMProxy):
        last[filter.SMProxy] = now
        sharpening._show(filter.SMProxy, now)
    return status(filter)

def until(filter, test, within=250):
    end = time.monotonic() + within
    while True:
        told = look(filter)
        if test(told):
            return told
        assert time.monotonic() < end, told
        time.sleep(0.1)

def press(filter, button):
    filter.SMProxy.InvokeCommand(button)

def workers():
    found = []
    for file in glob.glob("/proc/[0-9]*/cmdline"):
        try:
            text, stat = open(file).read(), open(file.replace("cmdline", "stat")).read()
        except OSError:
            continue
        if "svv.pv.live.learner" in text and int(stat.rsplit(")", 1)[1].split()[1]) == os.getpid():
            found.append(int(file.split("/")[2]))
    return found

def is_done(told):
    return "regions, learned" in told

def sketched(told):
    return "A sketch is shown" in told
"""


@pytest.fixture
def live(pvpython: Callable, tmp_path: Path) -> Callable[[str], None]:
    """Run a script after the beginning above."""
    for name, texture in (("brush", "brush strokes"), ("other", "stippling")):
        write_png(tmp_path / f"{name}.png", style_picture(texture))
    return lambda script: pvpython(LIVE + script, tmp_path)


@pytest.mark.slow
def test_what_is_learned_beside_the_window_is_what_a_script_waits_for(live: Callable, tmp_path: Path) -> None:
    live("""
os.environ["SVV_CACHE"] = f"{folder}/one"
filter = make(**FEW)
filter.UpdatePipeline()
assert "The volume is shown as it is" in status(filter), status(filter)
size, first = image(filter)
assert size == (64, 64, 1) and first["RGBA"][:, 3].any() and (first["Region"] == -1).all()
assert len(workers()) == 1
until(filter, sketched)
told = until(filter, is_done)
assert "cache" not in told, told
result = image(filter)[1]
names = filter.KeptAs or filter.SMProxy.GetProperty("Kept").GetElement(0)
SaveState(f"{folder}/state.pvsm")
last.clear()
Delete(filter)
del filter
assert workers() == [], workers()

os.environ["SVV_CACHE"] = f"{folder}/two"
for window, on in ((0, 1), (1, 0)):  # a script's filter, and one in the window with Live off
    filter = make(window=window, Live=on, **FEW)
    filter.UpdatePipeline()
    assert is_done(status(filter)), status(filter)
    assert workers() == []
    for name, values in image(filter)[1].items():
        assert np.array_equal(values, result[name], equal_nan=name == "Depth"), name
    Delete(filter)
""")
    assert "InWindow" not in (tmp_path / "state.pvsm").read_text()


@pytest.mark.slow
def test_learning_pauses_stops_goes_on_and_survives_a_kill(live: Callable) -> None:
    live("""
import signal
filter = make(**LONG)
filter.UpdatePipeline()
until(filter, lambda told: "base NeRF" in told and sketched(told))
press(filter, "Pause")
until(filter, lambda told: told.startswith("Paused"))
time.sleep(1)
before = status(filter)
time.sleep(2)
assert status(filter) == before, (before, status(filter))
press(filter, "GoOn")
until(filter, lambda told: told.startswith("Learning") and told.split(":")[0] != before)
press(filter, "StopHere")
told = until(filter, lambda told: told.startswith("Stopped"))
assert not news(filter).endswith("*")
filter.Frame = 30  # another camera, and still no work
filter.UpdatePipeline()
assert status(filter).startswith("Stopped")
press(filter, "GoOn")
until(filter, lambda told: "base NeRF" in told)
(worker,) = workers()
os.kill(worker, signal.SIGKILL)
told = until(filter, lambda told: "has ended" in told)
assert "press Go On" in told
assert image(filter)[1]["RGBA"][:, 3].any(), "the picture is gone"
press(filter, "GoOn")
until(filter, lambda told: "base NeRF" in told)
(again,) = workers()
assert again != worker
last.clear()
Delete(filter)
del filter
assert workers() == []
""")


@pytest.mark.slow
def test_changes_act_on_what_is_being_learned(live: Callable) -> None:
    live("""
filter = make(**LONG)
filter.UpdatePipeline()
until(filter, lambda told: "base NeRF" in told and sketched(told))
(worker,) = workers()
before = image(filter)[1]["RGBA"].copy()
filter.StyleFiles = [f"{folder}/other.png"]
filter.UpdatePipeline()
until(filter, lambda told: "base NeRF" in told and (image(filter)[1]["RGBA"] != before).any())
assert workers() == [worker]

# Another transfer function: the old picture stays until there is a new sketch, of what is shown now.
GetOpacityTransferFunction("RTData").Points = [37, 0, 0.5, 0, 100, 0, 0.5, 0, 140, 1, 0.5, 0, 277, 1, 0.5, 0]
number = news(filter).split()[0]
filter.Frame = 5  # this makes the filter look at its input
filter.UpdatePipeline()
assert "base NeRF" in status(filter) and news(filter).split()[0] == number, "editing has started something by itself"
old = image(filter)[1]["RGBA"].copy()
press(filter, "TakeAsEdited")
filter.Settings = FEW["Settings"]
filter.UpdatePipeline()
assert (image(filter)[1]["RGBA"] == old).all()
until(filter, is_done)
assert workers() == [worker]
new = image(filter)[1]["RGBA"]
assert (new[:, 3] > 127).sum() > 1.2 * (old[:, 3] > 127).sum()  # more is opaque now

# When all is there, another style is sketched on what was learned.
filter.StyleFiles = [f"{folder}/brush.png"]
filter.UpdatePipeline()
assert status(filter).startswith("Learning")
until(filter, is_done)

filter.StyleFiles = [f"{folder}/nothing.png"]
filter.UpdatePipeline()
assert "There is no style picture" in status(filter)
assert (image(filter)[1]["RGBA"][:, 3] > 127).any()
""")


@pytest.mark.slow
def test_a_server_learns_beside_itself(live: Callable, pvserver: int) -> None:
    live(f"""
Connect("127.0.0.1", {pvserver})
wavelet, display = shown()
filter = make(**FEW)
filter.UpdatePipeline()
until(filter, sketched)
until(filter, is_done)
assert workers() == [], "the client learns"
""")
