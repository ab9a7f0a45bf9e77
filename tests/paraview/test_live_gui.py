"""ParaView's window while a filter learns beside it: what it shows, how long it is held up, and what is left."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.ending import has_ended
from tests.paraview.test_gui import write_input

SCRIPT = """
import json, sys, time
from paraview.simple import *
from svv.pv.live import sharpening
from svv.pv.display.linked_camera import busy

volume, preset, style, settings = ARGUMENTS
LoadPalette("WhiteBackground")
reader = OpenDataFile(volume)
view = GetActiveViewOrCreate("RenderView")
display = Show(reader, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "concentration"))
function = json.load(open(preset))[0]
GetColorTransferFunction("concentration").RGBPoints = function["RGBPoints"]
GetOpacityTransferFunction("concentration").Points = function["Points"]
display.Shade = 1
display.SetScalarBarVisibility(view, False)
ResetCamera(view)
Render(view)
filter = StyleRFStylizedView(Input=reader, StyleFiles=[style], FollowCamera=1, **settings)
RenameSource("painting", filter)
sharpening.in_window(filter)  # as for a filter that the menu makes
begun, beats, seen, blocks, applied, over = time.perf_counter(), 0, {}, [], None, False
cpu = time.thread_time()

def beat(*_):
    global beats, applied, last, cpu, over
    if busy() or over:
        return
    beats += 1
    if applied is None:
        if time.perf_counter() - begun > WARM:
            applied = time.perf_counter()
            filter.UpdatePipeline()
            seen["apply"] = time.perf_counter() - applied
            Show(filter) if not filter.FollowCamera else None
            last, cpu = time.perf_counter(), time.thread_time()
            done("applied")
        return
    now, used = time.perf_counter(), time.thread_time()
    blocks.append((round(used - cpu, 3), round(now - last, 3), round(now - applied, 1)))  # on a busy machine, the first
    last, cpu = now, used
    told, state = filter.Status, filter.SMProxy.GetProperty("LiveState").GetElement(0)
    drawn = state and not state.endswith(" 0~*")
    for what in ("finer sketch", "broad strokes"):
        if what in told:
            seen.setdefault(what, now - applied)
    if "sketch is shown" in told and drawn and "sketch" not in seen:
        seen["sketch"] = now - applied
        done("sketch")
    elif "regions" in told and "result" not in seen:
        seen["result"] = now - applied
    elif "regions" in told and "sharper" not in told:
        over, seen["sharp"] = True, now - applied
        seen["loaded"] = [name for name in ("torch", "numba") if name in sys.modules]
        longest = sorted(blocks, reverse=True)[:8]
        done(json.dumps({**seen, "longest": longest, "beats": beats}))
    elif told and not any(word in told for word in ("On this machine", "Learning", "regions")):
        over = True
        done("failed: " + str(told))

interactor = view.GetInteractor()
interactor.AddObserver("TimerEvent", beat)
timer = interactor.CreateRepeatingTimer(20)
done("ready")
"""

QUICK = {"Preset": "draft", "Views": 12, "ViewSize": 128, "Device": "cpu"}


def script(folder: Path, settings: dict[str, object], warm: float = 3.0, opaque: bool = True) -> str:
    """The script with a volume and a picture in a folder."""
    files = [str(file) for file in write_input(folder, 48 if opaque else 128, opaque=opaque)]
    return f"ARGUMENTS = {[*files, settings]!r}\nWARM = {warm}\n{SCRIPT}"


def workers_of(process: int) -> list[int]:
    """The processes that learn and draw whose parent is this one."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and b"svv.pv.live." in (entry / "cmdline").read_bytes():
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
                found += [int(entry.name)] if parent == process else []
        except OSError:  # it has just ended
            continue
    return found


def assert_end(processes: list[int]) -> None:
    """The processes end by themselves; how soon is printed."""
    begun = time.monotonic()
    assert all(map(has_ended, processes)), "a process outlives the window"
    print(f"The processes beside the window ended {time.monotonic() - begun:.2f} s after it.")


@pytest.mark.slow
def test_the_window_shows_a_sketch_and_then_the_painting(gui: Callable, tmp_path: Path) -> None:
    # SVV_SCREENSHOT names a folder for pictures of the window and figures: then everything is done in full.
    kept = os.environ.get("SVV_SCREENSHOT")
    settings = {} if kept else QUICK
    running = gui(script(tmp_path, settings, 12.0 if kept else 3.0, opaque=not kept))
    assert running.wait() == "applied"
    begun = time.monotonic()
    both = workers_of(running.process.pid)
    assert len(both) == 2
    first = [] if kept else [running.screenshot(tmp_path / "applied.png")]
    for second in (0, 2, 5, 10, 20, 60) if kept else ():
        time.sleep(max(0.0, begun + second - time.monotonic()))
        shutil.copy(running.snapshot(tmp_path / f"at-{second}.png"), Path(str(kept)))
    assert running.wait() == "sketch"
    sketch = running.screenshot(tmp_path / "sketch.png")
    figures = json.loads(running.wait(900.0 if kept else 300.0))
    print(figures)
    assert figures["loaded"] == [], "ParaView's own process has loaded what draws"
    painted = running.screenshot(tmp_path / "painted.png")
    pictures = [np.asarray(Image.open(file).convert("RGB"), np.int16) for file in (*first, sketch, painted)]
    shown = [picture[200:900, 850:1270] for picture in pictures]
    assert all((one.min(2) < 215).mean() > 0.02 for one in shown), "the right view is empty"
    assert all((np.abs(a - b).max(2) > 30).mean() > 0.005 for a, b in itertools.pairwise(shown))
    if kept:
        shutil.copy(painted, Path(kept) / "at-the-end.png")
        (Path(kept) / "live.json").write_text(json.dumps(figures))
    running.process.send_signal(signal.SIGKILL)
    assert_end(both)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["killed", "closed"])
def test_a_window_that_ends_leaves_no_process_and_the_next_one_resumes(gui: Callable, tmp_path: Path, how: str) -> None:
    cache = tmp_path / "cache"
    text = f"import os\nos.environ['SVV_CACHE'] = {str(cache)!r}\n{script(tmp_path, QUICK)}"
    running = gui(text)
    assert running.wait() == "applied"
    both = workers_of(running.process.pid)
    assert len(both) == 2
    until = time.monotonic() + 300.0
    while not list(cache.glob(".scene-*-checkpoint")):
        assert time.monotonic() < until, running.log()
        time.sleep(0.1)
    if how == "killed":
        running.process.kill()
    else:
        running.xdotool("windowfocus", running.fill_screen(), "sleep", "1", "key", "ctrl+q")
        running.process.wait(60.0)
    assert_end(both)
    again = gui(text)
    assert again.wait() == "applied"
    assert again.wait() == "sketch"
    assert "result" in json.loads(again.wait())
    assert not list(cache.glob(".scene-*-checkpoint")), "the next start did not take the checkpoint"
