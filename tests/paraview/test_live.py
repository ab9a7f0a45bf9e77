"""Stylized View as the window has it: learning goes on in a process of its own, and the filter shows what there is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from svv.io.pictures.output import write_png
from svv.styles.gallery.textures import style_picture
from tests.paraview.live_script import LIVE


@pytest.fixture
def live(pvpython: Callable, tmp_path: Path) -> Callable[[str], None]:
    """Run a script after the beginning above."""
    for name, texture in (("brush", "brush strokes"), ("other", "stippling")):
        write_png(tmp_path / f"{name}.png", style_picture(texture))
    return lambda script: pvpython(LIVE + script, tmp_path, own=True)


# A script's filter, and one in the window with Live off.
@pytest.mark.parametrize(
    ("window", "on", "paint"),
    [(0, 1, False), *(pytest.param(*how, True, marks=pytest.mark.slow) for how in ((0, 1), (1, 0)))],
)
def test_what_is_learned_beside_the_window_is_what_a_script_waits_for(
    live: Callable, tmp_path: Path, window: int, on: int, paint: bool
) -> None:
    live(
        f"window, on = {window}, {on}\nSTYLES = {{}} if {paint} else dict(StyleFiles=[])"
        + """
os.environ["SVV_CACHE"] = f"{folder}/one"
filter = make(**FEW, **STYLES)
filter.UpdatePipeline()
assert "The volume is shown as it is" in status(filter), status(filter)
size, first = image(filter)
assert size == (64, 64, 1) and first["RGBA"][:, 3].any() and (first["Region"] == -1).all()
assert len(workers()) == 1
until(filter, sketched)
told = until(filter, sharp)
assert "cache" not in told, told
result = image(filter)[1]
assert loaded() == [], loaded()
names = filter.KeptAs or filter.SMProxy.GetProperty("Kept").GetElement(0)
SaveState(f"{folder}/state.pvsm")
last.clear()
Delete(filter)
del filter
assert workers() == [], workers()

os.environ["SVV_CACHE"] = f"{folder}/two"
filter = make(window=window, Live=on, **FEW, **STYLES)
filter.UpdatePipeline()
assert is_done(status(filter)), status(filter)
assert workers() == []
for name, values in image(filter)[1].items():
    assert np.array_equal(values, result[name], equal_nan=name == "Depth"), name
Delete(filter)
"""
    )
    assert "InWindow" not in (tmp_path / "state.pvsm").read_text()


@pytest.mark.slow
def test_a_finished_scene_is_drawn_beside_the_window(live: Callable) -> None:
    live("""
import signal
filter = make(**FEW)
filter.UpdatePipeline()
until(filter, sharp)
first = image(filter)[1]

# Another frame is waited for, as an animation needs it, unless the client says that it asks again.
filter.Frame = 30
turned = image(filter)[1]
assert sharp(status(filter)) and (turned["RGBA"] != first["RGBA"]).any()
filter.Frame, filter.ImageSize = 60, [1600, 1600]  # larger than can be drawn while it is looked for
linked_camera.may_be_late(filter.SMProxy)
filter.UpdatePipeline()
assert "sharper" in status(filter), status(filter)
until(filter, sharp)
assert image(filter)[0] == (1600, 1600, 1)
filter.Moving, filter.ImageSize = 1, [32, 32]
filter.UpdatePipeline()
assert image(filter)[0] == (32, 32, 1)
filter.Moving, filter.ImageSize, filter.Frame = 0, [64, 64], 0
for name, values in image(filter)[1].items():
    assert np.array_equal(values, first[name], equal_nan=name == "Depth"), name
filter.SeenWith = "grey print"
grey = image(filter)[1]["RGBA"]
assert (grey[..., 0] == grey[..., 1]).all()
filter.SeenWith = "normal"

# What cannot be drawn is said, and can be mended.
filter.Variant = "nothing"
filter.UpdatePipeline()
assert "nothing" in status(filter) and not sharp(status(filter)), status(filter)
filter.Variant = ""
filter.UpdatePipeline()
assert sharp(status(filter)), status(filter)

# The process that draws is started again; a scene that has left the cache is made again.
def drawers():
    return workers("svv.pv.live.drawer")
(drawer,) = drawers()
os.kill(drawer, signal.SIGKILL)
filter.Frame = 10
filter.UpdatePipeline()
until(filter, sharp)
assert drawers() != [drawer] and len(drawers()) == 1
(drawer,) = drawers()
os.kill(drawer, signal.SIGKILL)
for entry in os.scandir(os.environ["SVV_CACHE"]):
    os.remove(entry)
filter.Frame = 20
filter.UpdatePipeline()
until(filter, sharp)
assert loaded() == []

# With Live off, ParaView draws itself what it has; and on again.
filter.Live, filter.Frame = 0, 0
for name, values in image(filter)[1].items():
    assert np.array_equal(values, first[name], equal_nan=name == "Depth"), name
assert loaded() == ["torch", "numba"] and drawers() == workers() == []
filter.Live = 1
filter.UpdatePipeline()
until(filter, sharp)
assert np.array_equal(image(filter)[1]["RGBA"], first["RGBA"])
""")


TRAIN = """
def table(filter):
    data = sm.Fetch(filter)
    fields = data.GetFieldData()
    return data.GetNumberOfRows(), scene(filter), bool(fields.HasArray("StyleRF Unfinished"))

def settled(filter):
    return until(filter, lambda told: told.endswith("s.") and "learned from" in told)
"""


@pytest.mark.slow
def test_train_gives_what_there_is_to_the_filters_behind_it(live: Callable, tmp_path: Path) -> None:
    live(f"""{TRAIN}
few = {{name: value for name, value in FEW.items() if name != "Settings"}}
train = StyleRFTrain(Input=wavelet, Settings=FEW["Settings"], **few)
in_window(train)
render = StyleRFRender(Input=train, ImageSize=[64, 64])
render.UpdatePipeline()
assert table(train) == (0, None, True) and status(train).startswith("Learning"), status(train)
assert "as soon as there is something" in status(render), status(render)
until(train, sketched)
rows, sketch, unfinished = table(train)
assert rows > 0 and sketch and unfinished and loaded() == []
assert image(render)[1]["RGBA"][:, 3].any() and "still being learned" in status(render), status(render)
edit = StyleRFEdit(Input=train, Region0Opacity=0.5, SaveFile=f"{{folder}}/sketch.svv")
stylize = StyleRFStylize(Input=edit, StyleFiles=[f"{{folder}}/brush.png"], Preset="draft", Device="cpu")
stylize.UpdatePipeline()
assert "still being learned" in status(stylize) and "still being learned" in status(edit)
press(edit, "SaveScene")
assert "save it when it is there" in status(edit) and not os.path.exists(f"{{folder}}/sketch.svv")
SaveState(f"{{folder}}/training.pvsm")
settled(train)
rows, trained, unfinished = table(train)
assert rows > 0 and trained != sketch and not unfinished
render.UpdatePipeline()
assert "still" not in status(render), status(render)
drawn = image(render)[1]["RGBA"].copy()
stylize.UpdatePipeline()  # it has not been made by the window, so it is done when this returns
assert "Painted" in status(stylize), status(stylize)
open(f"{{folder}}/drawn.npy", "wb").write(drawn.tobytes())
""")
    # A script that loads the state saved meanwhile has finished filters; there is nothing in its cache.
    live("""
LoadState(f"{folder}/training.pvsm")
render, train = (next(s for s in GetSources().values() if s.SMProxy.GetXMLName() == kind)
                 for kind in ("StyleRFRender", "StyleRFTrain"))
render.UpdatePipeline()
assert workers() == [] and "learned from" in status(train) and "still" not in status(render), status(train)
assert open(f"{folder}/drawn.npy", "rb").read() == image(render)[1]["RGBA"].tobytes()
""")


@pytest.mark.slow
def test_stylize_paints_beside_the_window(live: Callable) -> None:
    live(f"""{TRAIN}
train = small(StyleRFTrain(Input=wavelet, Preset="draft", TimeLimit=2.0, Device="cpu"))
train.UpdatePipeline()
values = dict(Input=train, StyleFiles=[f"{{folder}}/brush.png"], Preset="draft", Device="cpu")
stylize = StyleRFStylize(**values)
in_window(stylize)
render = StyleRFRender(Input=stylize, ImageSize=[64, 64])
render.UpdatePipeline()
assert "shown as it was" in status(stylize) and table(stylize)[2], status(stylize)
plain = image(render)[1]["RGBA"].copy()
until(stylize, lambda told: "broad strokes" in told)
assert table(stylize)[2] and (image(render)[1]["RGBA"] != plain).any()
told = until(stylize, lambda told: told.startswith("Painted"))
assert "cache" not in told and not table(stylize)[2], told
painted = image(render)[1]["RGBA"].copy()

press(stylize, "PaintAgain")
stylize.UpdatePipeline()
assert status(stylize).startswith("Learning"), status(stylize)
until(stylize, lambda told: told.startswith("Painted"))
assert (image(render)[1]["RGBA"] == painted).all()
stylize.Variant, stylize.StyleFiles = "second", [f"{{folder}}/other.png"]
stylize.UpdatePipeline()
until(stylize, lambda told: told.startswith("Painted"))
assert (image(render)[1]["RGBA"] != painted).any()
assert len(workers()) == 1
stylize.StyleFiles = [f"{{folder}}/nothing.png"]
stylize.UpdatePipeline()
assert "There is no style picture" in status(stylize)

os.environ["SVV_CACHE"] = f"{{folder}}/alone"
waits = StyleRFStylize(**values)
waits.UpdatePipeline()
assert status(waits).startswith("Painted"), status(waits)
assert (image(StyleRFRender(Input=waits, ImageSize=[64, 64]))[1]["RGBA"] == painted).all()
""")


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
until(filter, lambda told: told.startswith("Stopped") and not news(filter).endswith("*"))
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


@pytest.mark.slow
def test_fifty_starts_and_stops_leave_nothing(live: Callable) -> None:
    live("""
import tempfile
from svv.io.files.worker import PREFIX
from svv.pv.live.ordered import Ordered

def handles():
    return len(os.listdir("/proc/self/fd"))

tempfile.tempdir = folder
for number in range(50):
    ordered = Ordered("StyleRFStylizedView", True)
    ordered.start()
    pids, patience = [], 200
    while len(pids) < 2 and patience:  # a process that has just been started has no command line for a moment
        pids, patience = workers() + workers("svv.pv.live.drawer"), patience - 1
        len(pids) < 2 and time.sleep(0.05)
    assert len(pids) == 2, pids
    if number % 10 == 1:  # some have loaded a part of what they take
        time.sleep(2)
    ordered.end()
    left = [pid for pid in pids if os.path.exists(f"/proc/{pid}")]
    assert not left and not glob.glob(f"{folder}/{PREFIX}*"), left
    if number == 0:
        before = handles()
assert handles() == before
""")


def test_the_panel_begins_with_few_controls(pvpython: Callable) -> None:
    pvpython("""
from paraview.simple import *
wavelet = Wavelet()
filter = StyleRFStylizedView(Input=wavelet)
filter.UpdatePropertyInformation()
assert filter.Status.startswith("On this machine: draft (a sketch) about "), filter.Status
assert "balanced (better) about" in filter.Status
widget = filter.SMProxy.GetProperty("Status").GetHints().FindNestedElementByName("Widget")
assert widget.GetAttribute("type") == "one_liner_wrapped"  # it shows a long sentence whole
shown, buttons, iterator = [], [], filter.SMProxy.NewPropertyIterator()
iterator.Begin()
while not iterator.IsAtEnd():
    found, name = iterator.GetProperty(), iterator.GetKey()
    if found.GetPanelVisibility() == "default" and not found.GetInformationOnly() and name != "Input":
        (buttons if found.GetPanelWidget() == "command_button" else shown).append(name)
        help = found.GetDocumentation().GetDescription().strip()
        assert help.endswith(".") and ". " not in help, (name, help)
        assert len(found.GetXMLLabel()) <= 24, name
    iterator.Next()
paints = {"FollowCamera", "Live", "Preset", "Shade", "StrokeSize", "StyleFiles"}
edits = {"Region0Hide", "Region1Hide", "Region2Hide", "SaveFile", "Say", "Strength"}
assert set(shown) == paints | edits and len(shown) == 12, shown
assert sorted(buttons) == ["GoOn", "Pause", "SaveScene", "StopHere", "TakeWhatIsShownNow"], buttons
label = filter.SMProxy.GetProperty("TakeWhatIsShownNow").GetXMLLabel()
assert label == "Take What Is Shown Now" and filter.KeptAs == ""
filter.TakeAsEdited(), filter.TakeWhatIsShownNow()  # scripts know the older name
presets = filter.SMProxy.GetProperty("Preset").FindDomain("vtkSMEnumerationDomain")
told = {presets.GetEntryText(k): presets.GetInfoText(k) for k in range(presets.GetNumberOfEntries())}
assert told == {"draft": "Sketch", "fast": "Good", "balanced": "Better", "best": "Best", "paper": "hours"}, told
filter.TimeLimit, filter.Camera, filter.Views = 3.0, [1.0] * 10, 12  # the others are there, for scripts and experts
groups = [filter.SMProxy.GetPropertyGroup(k) for k in range(filter.SMProxy.GetNumberOfPropertyGroups())]
assert {"Training", "Image", "Volume"} <= {group.GetXMLLabel() for group in groups}
""")
