"""Saved states in the real ParaView: opened in another process, they show the same picture without training again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]
from PIL import Image

from tests.cube import cube_scene

START = (
    VOLUME
    + """
import numpy as np
from dataclasses import replace
from svv.train.run import config
out, files = sys.argv[1:3]
draft = config.PRESETS["draft"]
config.PRESETS["draft"] = replace(draft, reconstruct=replace(draft.reconstruct, iterations=60, rays=512),
    recolour=replace(draft.recolour, iterations=40, rays=512),
    stylize=replace(draft.stylize, style_size=48))  # a test is no painting
worked = []
import svv.dvr.draw.views, svv.train.pipeline, svv.train.correct
for module, name in ((svv.dvr.draw.views, "make_views"), (svv.train.pipeline, "train_scene"),
                     (svv.train.pipeline, "stylize_scene"), (svv.train.correct, "correct_palette")):
    def counted(*args, _work=getattr(module, name), _name=name, **options):
        worked.append(_name)
        return _work(*args, **options)
    setattr(module, name, counted)

def ours():
    found = {f.SMProxy.GetXMLName().removeprefix("StyleRF"): f for f in GetSources().values()}
    order = ("Views", "Train", "Palette", "Edit", "Stylize", "Render", "StylizedView")
    return {kind: found[kind] for kind in order if kind in found}

def told(name):
    ends = list(ours().values())
    _, arrays = image(ends[-1])
    np.savez(f"{out}/{name}.npz", **arrays)
    with open(f"{out}/{name}.json", "w") as file:
        json.dump({"worked": worked, "status": {kind: status(f) for kind, f in ours().items()}}, file)
"""
)

SAVE = """
front = GetActiveView()
Show(list(ours().values())[-1], front)
Render(front)
told("first")
worked.clear()
told("again")
SaveState(out + "/state.pvsm")
from paraview import smstate
with open(out + "/state.py", "w") as file:  # SaveState writes XML under any name before 5.12
    file.write(smstate.get_state())
"""

LOAD = """
state = sys.argv[3]
if state.endswith(".py"):
    exec(compile(open(out + "/" + state).read(), state, "exec"))
else:
    LoadState(out + "/" + state)
from paraview.simple import *
RenderAllViews()
told(state)
"""

STEPS = """
volume, display = shown()
views = small(StyleRFViews(Input=volume))
train = StyleRFTrain(Input=views, Preset="draft", Settings=FEW)
edit = StyleRFEdit(Input=train, Region0Lighting=0.5)
paint = StyleRFStylize(Input=edit, StyleFiles=[files], Preset="draft")
StyleRFRender(Input=paint, ImageSize=[40, 30], Frame=20)
"""

ONE_STEP = """
volume, display = shown()
small(StyleRFStylizedView(Input=volume, StyleFiles=[files], Preset="draft", Settings=FEW, ImageSize=[40, 30]))
"""

Run = Callable[..., dict[str, Any]]


@pytest.fixture
def run(pvpython, tmp_path: Path) -> Run:
    """Run a part of a script in a process of its own; returns what it told under a name, with its image's arrays."""
    picture = tmp_path / "halves.png"
    halves = np.zeros((64, 64, 3), np.uint8)
    halves[:, :32, 0] = halves[::4, 32:, 2] = 220
    Image.fromarray(halves).save(picture)

    def run(script: str, name: str, *arguments: str, **environ: str) -> dict[str, Any]:
        variables = {"SVV_CACHE": str(tmp_path / "cache"), **environ}
        result = pvpython(START + script, tmp_path, picture, *arguments, environ=variables)
        with np.load(tmp_path / f"{name}.npz") as arrays:
            found = {**json.loads((tmp_path / f"{name}.json").read_text()), "arrays": dict(arrays)}
        return {**found, "said": result.stdout + result.stderr}

    return run


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two runs gave the same image to the bit."""
    a, b = one["arrays"], other["arrays"]
    return a.keys() == b.keys() and len(a) >= 3 and all(a[k].tobytes() == b[k].tobytes() for k in a)


def clear(cache: Path) -> None:
    for path in sorted(cache.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()


@pytest.mark.parametrize(
    "pipeline", [pytest.param(STEPS, id="steps", marks=pytest.mark.slow), pytest.param(ONE_STEP, id="one step")]
)
@pytest.mark.slow
def test_a_state_shows_its_picture_in_another_process(run: Run, tmp_path: Path, pipeline: str) -> None:
    first = run(pipeline + SAVE, "first")
    assert first["worked"] == ["make_views", "train_scene", "stylize_scene"], first["status"]
    assert (first["arrays"]["RGBA"][:, 3] > 0).any()
    again = json.loads((tmp_path / "again.json").read_text())
    assert again["worked"] == [], "the name that was filled in started the work again"
    for state in ("state.pvsm", "state.py"):
        opened = run(LOAD, state, state)
        assert opened["worked"] == [], opened["status"]
        assert same(opened, first), opened["status"]
    clear(tmp_path / "cache")
    button = "ours()['StylizedView'].TakeAsEdited()" if pipeline == ONE_STEP else (
        "ours()['Views'].TakeAsEdited(); ours()['Train'].TakeAsEdited(); ours()['Stylize'].PaintAgain()"
    )  # fmt: skip
    gone = run(LOAD + f"\n{button}\ntold('anew')\n", "state.pvsm", "state.pvsm")
    assert gone["worked"] == [] and gone["arrays"] == {}, gone["status"]
    sentence = (
        f"The scene that this state was saved with is missing from {tmp_path / 'cache'}: call "
        "TakeWhatIsShownNow() of the filter"
    )
    assert gone["status"]["Train" if pipeline == STEPS else "StylizedView"].startswith(sentence)
    assert sentence in gone["said"] and "Traceback" not in gone["said"], gone["said"]
    anew = json.loads((tmp_path / "anew.json").read_text())
    assert anew["worked"] == ["make_views", "train_scene", "stylize_scene"], anew["status"]
    with np.load(tmp_path / "anew.npz") as arrays:
        assert (arrays["RGBA"][:, 3] > 0).any()


@pytest.mark.slow
def test_a_state_shows_what_was_shown_and_not_what_the_panel_would_give_now(run: Run, tmp_path: Path) -> None:
    variants = """
volume, display = shown()
train = small(StyleRFTrain(Input=volume, Preset="draft", Settings=FEW))
paint = StyleRFStylize(Input=train, StyleFiles=[files], Preset="draft", Variant="one")
StyleRFRender(Input=paint, ImageSize=[40, 30])
told("first")
paint.Variant, paint.Seed, paint.ShowVariant = "two", 1, "one"
table = GetColorTransferFunction("RTData")
table.RGBPoints = [*table.RGBPoints[:-3], 0.1, 0.8, 0.2]  # of what is seen, and not taken as edited
"""
    first = run(variants + SAVE.replace('told("first")', 'told("second")'), "first")
    second = json.loads((tmp_path / "second.json").read_text())
    assert second["worked"] == ["make_views", "train_scene", "stylize_scene", "stylize_scene"], second["status"]
    change = """
paint = ours()["Stylize"]
paint.ShowVariant = "two"
told("two")
paint.Seed = 2
told("changed")
ours()["Train"].TakeAsEdited()
told("taken")
"""
    opened = run(LOAD + change, "state.pvsm", "state.pvsm")
    assert opened["worked"] == [] and same(opened, first)
    assert "The transfer function has been edited since" in opened["status"]["Train"]
    two, changed, taken = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("two", "changed", "taken"))
    assert two["worked"] == [], two["status"]
    assert changed["worked"] == ["stylize_scene"], changed["status"]
    assert taken["worked"] == ["stylize_scene", "make_views", "train_scene", "stylize_scene"], taken["status"]


@pytest.mark.slow
def test_what_cannot_be_kept_is_said_and_a_scene_file_of_views_is_read_again(run: Run, tmp_path: Path) -> None:
    script = """
volume, display = shown()
views = small(StyleRFViews(Input=volume))
train = StyleRFTrain(Input=views, Preset="draft", Settings=FEW, SceneFile=out + "/own.svv")
StyleRFRender(Input=train, ImageSize=[40, 30])
told("plain")
"""
    (tmp_path / "file").write_text("no folder")
    nowhere = str(tmp_path / "file" / "cache")
    first = run(script, "plain", SVV_CACHE=nowhere)
    assert first["worked"] == ["make_views", "train_scene"]
    for kind in ("Views", "Train"):
        assert f"It could not be kept for saved states: Cannot write into {nowhere}" in first["status"][kind] or (
            f"Cannot write {nowhere}" in first["status"][kind]
        ), first["status"]
    assert (tmp_path / "own.svv").exists()
    again = run(script, "plain", SVV_CACHE=nowhere)
    assert again["worked"] == ["make_views"] and same(again, first), again["status"]


@pytest.mark.slow
def test_a_server_tells_its_client_under_which_name_it_keeps_the_scene(pvpython, pvserver) -> None:
    pvpython(
        VOLUME
        + """
Connect("127.0.0.1", int(sys.argv[1]))
volume, display = shown()
train = trained(volume)
first = scene(train)
assert json.loads(train.KeptAs)["scene"].startswith("scene-"), train.KeptAs
other = small(StyleRFTrain(Input=volume, Preset="draft", Settings=FEW))
assert scene(other) == first and other.KeptAs == train.KeptAs and "found in the cache" in status(other)
""",
        pvserver,
    )


EDITED = """
volume, display = shown()
train = small(StyleRFTrain(Input=volume, Preset="draft", Settings=FEW))
paint = StyleRFStylize(Input=train, StyleFiles=[files], Preset="draft")
edit = StyleRFEdit(Input=paint, Region0Lighting=0.5)
StyleRFRender(Input=edit, ImageSize=[40, 30], Frame=20)
"""


@pytest.mark.slow
def test_what_a_state_lacks_is_said_by_all_filters_that_need_it(run: Run, pvpython, tmp_path: Path) -> None:
    first, picture, cache = run(EDITED + SAVE, "first"), tmp_path / "halves.png", tmp_path / "cache"

    def opened(then: str = "", load: str = LOAD) -> tuple[int, dict[str, Any], str]:
        done = pvpython(
            START + load + then, tmp_path, picture, "state.pvsm", environ={"SVV_CACHE": str(cache)}, check=False
        )
        with np.load(tmp_path / "state.pvsm.npz") as arrays:
            told = {**json.loads((tmp_path / "state.pvsm.json").read_text()), "arrays": dict(arrays)}
        return done.returncode, told, done.stdout + done.stderr

    content = picture.read_bytes()
    picture.unlink()
    lost = f"There is no style picture {picture}: choose another under Style Files."
    # The painting is in the cache: it is shown, and the picture that is gone is told.
    for state in ("state.pvsm", "state.py"):
        kept = run(LOAD, state, state)
        assert kept["worked"] == [] and same(kept, first), kept["status"]
        assert f"{lost} Until then, the painting that was made with it is shown" in kept["status"]["Stylize"]
    # It cannot be painted anew; what is shown is an earlier result, and all filters behind say so.
    code, told, said = opened("\nours()['Stylize'].PaintAgain()\ntold('state.pvsm')")
    assert code == 2 and same(told, first) and told["worked"] == [], said
    assert told["status"]["Stylize"] == lost
    behind = f"StyleRF Stylize before this filter failed: {lost}"
    for kind in ("Edit", "Render"):
        assert told["status"][kind].endswith(f"This shows an earlier result: {behind}"), told["status"]
    # The picture is found in another folder, if ParaView is told which.
    (tmp_path / "moved").mkdir()
    (tmp_path / "moved" / picture.name).write_bytes(content)
    load = LOAD.replace('LoadState(out + "/" + state)', 'LoadState(out + "/" + state, out + "/moved")')
    assert load != LOAD
    code, told, said = opened(load=load)
    assert code == 0 and same(told, first) and told["worked"] == [] and "There is no" not in str(told["status"]), said
    # Neither the picture nor the painting: nothing is shown, not even the scene without paint.
    for painting in cache.glob("painting-*"):
        painting.unlink()
    code, told, said = opened()
    assert code == 2 and told["arrays"] == {} and told["worked"] == [], said
    too = f"What was made with it is missing from {cache}, too."
    assert told["status"]["Stylize"] == f"{lost} {too}"
    assert {told["status"][kind] for kind in ("Edit", "Render")} == {f"{behind} {too}"}
    assert said.count(behind) >= 3 and said.rstrip().endswith(f"svv: {behind} {too}"), said
    # With the picture back, one button repairs everything.
    picture.write_bytes(content)
    code, told, said = opened("\nours()['Stylize'].PaintAgain()\ntold('state.pvsm')")
    assert code == 0 and told["worked"] == ["stylize_scene"] and same(told, first), said
    # Without a cache, all say what to do.
    clear(cache)
    code, told, said = opened()
    assert code == 2 and told["arrays"] == {} and told["worked"] == [], said
    missing = f"The scene that this state was saved with is missing from {cache}: call "
    missing += "TakeWhatIsShownNow() of the filter, and it"
    assert told["status"]["Train"].startswith(missing)
    for kind in ("Stylize", "Edit", "Render"):
        assert told["status"][kind].startswith(f"StyleRF Train before this filter failed: {missing}"), told["status"]


FILES = """
import json, sys
from paraview.simple import *
out, step = sys.argv[1:]
here = f"{out}/here"
if step == "save":
    scene = StyleRFScene(FileName=here + "/two.svv")
    StyleRFViewsFolder(FileName=here + "/views/transforms_train.json")
    StyleRFLook(Input=scene, LookFile=here + "/look.json")
    StyleRFPalette(Input=scene, ViewsFile=here + "/views/transforms_train.json", SaveFile=here + "/new.svv")
    StyleRFStylize(Input=scene, StyleFiles=[here + "/a.png", here + "/more/b.png"], Region0Mask=here + "/mask.png")
    StyleRFRender(Input=scene, ImageSize=[16, 16])
    SaveState(out + "/state.pvsm")
else:
    LoadState(out + "/state.pvsm", *([out + "/there"] if step == "there" else []))
found = {source.SMProxy.GetXMLName(): source for source in GetSources().values()}
names = ("FileName", "LookFile", "ViewsFile", "SaveFile", "StyleFiles", "Region0Mask")
told = [source.GetProperty(name).GetData() for _, source in sorted(found.items()) for name in names
        if source.SMProxy.GetProperty(name)]
flat = [str(file) for one in told for file in ([one] if isinstance(one, str) else one) if file]
render = found["StyleRFRender"]
render.UpdatePipeline()
render.UpdatePropertyInformation()
with open(f"{out}/{step}.json", "w") as file:
    json.dump([flat, render.GetPropertyValue("Status")], file)
"""


def test_files_of_a_state_are_found_in_another_folder_and_a_lost_scene_is_said_behind_its_reader(
    pvpython, tmp_path: Path
) -> None:
    here = tmp_path / "here"
    for folder in ("views", "more"):
        (here / folder).mkdir(parents=True)
    cube_scene().save(here / "two.svv")
    files = {"two.svv", "views/transforms_train.json", "look.json", "a.png", "more/b.png", "mask.png"}
    for name in files - {"two.svv"}:
        (here / name).write_bytes(b"here")

    def run(step: str, check: bool = True) -> tuple[set[str], str, int]:
        done = pvpython(FILES, tmp_path, step, check=check)
        found, said = json.loads((tmp_path / f"{step}.json").read_text())
        return set(found), said, done.returncode

    written = str(here / "new.svv")
    found, said, _ = run("save")
    assert found == {written, *(str(here / name) for name in files)} and said == "16 x 16 pixels."
    here.rename(tmp_path / "there")
    found, said, _ = run("there")
    assert found == {written, *(str(tmp_path / "there" / name) for name in files)} and said == "16 x 16 pixels."
    _, said, code = run("gone", check=False)
    assert code == 2 and said.startswith("StyleRF Scene Reader before this filter failed: ") and "two.svv" in said
