"""Stylized View edits what it has painted in its own panel, saves it, and gives it to the filters behind it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from svv.fields.scene.scene import Scene
from svv.io.pictures.output import write_png
from svv.styles.gallery.textures import style_picture
from tests.paraview.live_script import LIVE

EDITED = """
def seen(filter):
    arrays = image(filter)[1]
    return sorted(set(arrays["Region"][arrays["RGBA"][:, 3] > 30].tolist()))

def give(filter, **values):
    for name, value in values.items():
        setattr(filter, name, value)
    filter.UpdatePipeline()
    return status(filter)
"""

EDITS = """
first = image(view)[1]
shown_first = seen(view)
assert len(shown_first) >= 1, shown_first
top = shown_first[0]
learned = view.KeptAs or view.SMProxy.GetProperty("Kept").GetElement(0)
told = give(view, **{f"Region{top}Hide": 1, f"Region{top}Name": "wave", "SaveFile": f"{folder}/own.svv"})
assert f"hide {top}" in told and "Learning" not in told, told
assert top not in seen(view)
press(view, "SaveScene")
assert status(view).startswith("Saved as"), status(view)
# The filters behind it take the scene as it is shown.
edit = StyleRFEdit(Input=view, SaveFile=f"{folder}/behind.svv")
again = StyleRFRender(Input=edit, ImageSize=[64, 64])
assert top not in seen(again)
setattr(edit, f"Region{top}Opacity", 0.5)
edit.ShowHidden = 1
assert seen(again) == shown_first
press(edit, "SaveScene")
SaveData(f"{folder}/written.svv", proxy=view)
told = give(view, CutOpen=1)
assert "cut x > " in told and "Learning" not in told, told
told = give(view, CutOpen=0, **{f"Region{top}Hide": 0, f"Region{top}Name": ""})
for name, values in image(view)[1].items():
    assert np.array_equal(values, first[name], equal_nan=name == "Depth"), name
told = give(view, Region7Opacity=0.5)
assert "no region 7" in told, told
told = give(view, Region7Opacity=1.0, Say=f"hide region {top}")
assert "Understood:" in told and top not in seen(view), told
view.Say = ""
# A sketch, which may have fewer regions, has the edits that it can have, and what it cannot have is told.
from svv.fields.scene.scene import Scene
from svv.pv.panel.groups import EDITS
from svv.pv.work.own_edits import edits_of, sketch_as_edited
assert edits_of({**EDITS, "Variant": "", "CutOpenBy": "sphere:0,0,0:1"}) == {}, "a surface that cuts nothing"
asked = {**EDITS, "Variant": "", f"Region{top}Hide": True, "Region7Hide": True}
sketch, told = sketch_as_edited(Scene.load(f"{folder}/own.svv").shown(), asked)
assert sketch.regions[top].hidden and told.startswith(" Not in the sketch: There is no region 7"), told
assert sketch_as_edited(sketch, {**asked, "Region7Hide": False, "Say": "fly"})[1].startswith(" Not in the sketch:")
kept = view.KeptAs or view.SMProxy.GetProperty("Kept").GetElement(0)
assert kept == learned, "an edit has begun to learn"
Delete(again), Delete(edit)
del again, edit
"""


def check(folder: Path) -> None:
    """Check what the script above has saved."""
    own, behind, written = (Scene.load(folder / f"{name}.svv") for name in ("own", "behind", "written"))
    hidden = [r.hidden for r in own.regions]
    assert sum(hidden) == 1 and own.regions[hidden.index(True)].name == "wave" and own.styled is not None
    assert written.regions == own.regions
    assert not any(r.hidden for r in behind.regions) and behind.regions[hidden.index(True)].opacity == 0.5


@pytest.fixture
def live(pvpython: Callable, tmp_path: Path) -> Callable[[str], None]:
    """Run a script with what makes small filters as the window has them."""
    write_png(tmp_path / "brush.png", style_picture("brush strokes"))
    return lambda script: pvpython(LIVE + EDITED + script, tmp_path, own=True)


def test_a_painting_is_edited_saved_and_given_on_without_learning(live: Callable, tmp_path: Path) -> None:
    live(f"""
view = make(window=0, **FEW)
view.UpdatePipeline()
{EDITS}
# Another filter on the same volume finds the training, with no other setting than those of this one.
assert StyleRFTrain(Input=wavelet).Preset == StyleRFStylizedView(Input=wavelet).Preset == "fast"
train = StyleRFTrain(Input=wavelet, **FEW)
train.UpdatePipeline()
assert "found in the cache" in status(train), status(train)

# The scene goes with the filter that made it.
edit = StyleRFEdit(Input=view)
edit.UpdatePipeline()
SaveData(f"{{folder}}/image.vti", proxy=view)
assert os.path.getsize(f"{{folder}}/image.vti") < 200_000, "the image has the scene"
read = OpenDataFile(f"{{folder}}/image.vti")
first = StyleRFEdit(Input=read)
first.UpdatePipeline()
assert "regions" in status(first), status(first)
Delete(edit), Delete(first)
Delete(view)
del view, edit, first
gone = StyleRFEdit(Input=read)
gone.UpdatePipeline()
assert "no longer in memory" in status(gone), status(gone)
""")
    check(tmp_path)


@pytest.mark.slow
def test_an_edit_shows_at_once_where_another_process_draws(live: Callable, tmp_path: Path) -> None:
    live(f"""
view = make(**FEW)
view.UpdatePipeline()
view.SaveFile = f"{{folder}}/sketch.svv"
until(view, sketched)
press(view, "SaveScene")
assert not os.path.exists(f"{{folder}}/sketch.svv"), "half a scene has been saved"
until(view, sharp)
assert loaded() == []
give(view, Region0Hide=1)
assert loaded() == [], "ParaView's own process has loaded what draws"
give(view, Region0Hide=0)
{EDITS}
# What is still being learned is waited for.
other = make(**{{**FEW, "Views": 9}})
other.UpdatePipeline()
edit = StyleRFEdit(Input=other)
edit.UpdatePipeline()
assert "as soon as there is something" in status(edit), status(edit)

def given(told):
    edit.UpdatePipeline()
    return sm.Fetch(edit).GetNumberOfRows()

assert not is_done(until(other, given)) and "still being learned" in status(edit), status(edit)
""")
    check(tmp_path)
