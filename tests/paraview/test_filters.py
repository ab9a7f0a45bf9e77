"""The filters in the real ParaView: their outputs, the results that they keep, and the inputs that they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]

from svv.fields.scene.scene import Scene
from svv.io.views.view_meta import known
from svv.io.views.viewset import ViewSet


@pytest.fixture(scope="module")
def trained(pvpython, tmp_path_factory) -> Path:
    """A folder with a scene that StyleRF Train made, its views, and what the panel said."""
    folder = tmp_path_factory.mktemp("trained")
    pvpython(
        VOLUME
        + """
folder = sys.argv[1]
volume, display = shown()
display.ScalarOpacityUnitDistance = 2.5
display.Shade = 1
views = small(StyleRFViews(Input=volume, TestViews=2, Folder=folder + "/views"))
dimensions, arrays = image(views)
said = {"views": status(views), "unit": views.OpacityUnitDistance, "shade": views.Shade, "scalars": list(views.Scalars),
        "dimensions": dimensions, "arrays": {k: v.shape for k, v in arrays.items()},
        "last": views.SMProxy.GetProperty("ShownView").FindDomain("vtkSMIntRangeDomain").GetMaximum(0),
        "cameras": OutputPort(views, 1).GetDataInformation().GetNumberOfPoints()}
views.ShownView = 5
assert (image(views)[1]["RGBA"] != arrays["RGBA"]).any() and status(views) == said["views"], "not another view"
more = "reconstruct.iterations=200; reconstruct.rays=1024; recolour.iterations=100"
train = StyleRFTrain(Input=views, Preset="draft", Settings=more, SceneFile=folder + "/scene.svv")
train.UpdatePipeline()
table = sm.Fetch(train)
said |= {"train": status(train), "rows": table.GetNumberOfRows(),
         "columns": [table.GetColumnName(i) for i in range(table.GetNumberOfColumns())]}
json.dump(said, open(folder + "/said.json", "w"))
""",
        folder,
    )
    return folder


def test_views_and_training_take_what_the_view_shows(trained: Path) -> None:
    said = json.loads((trained / "said.json").read_text())
    assert (said["unit"], said["shade"], said["scalars"]) == (2.5, 1, ["POINTS", "RTData"])
    assert said["views"].startswith("8 views")
    assert (said["dimensions"], said["arrays"]) == ([64, 64, 1], {"RGBA": [4096, 4]})
    assert (said["last"], said["cameras"]) == (7, 8)
    scene = Scene.load(trained / "scene.svv")
    assert said["rows"] == len(scene.regions) >= 1
    assert said["columns"] == ["Region", "Colour", "Share", "Part Of", "Values", "Opacity", "Lighting", "Name", "Style"]
    views = ViewSet.read(trained / "views", "train")
    assert len(views) == 8 and len(ViewSet.read(trained / "views", "test")) == 2
    assert known(views.meta.tf, "tf")["ScalarOpacityUnitDistance"] == 2.5
    assert known(views.meta.shading, "shading").on


def test_a_scene_is_edited_rendered_saved_and_kept_in_a_state(trained: Path, pvpython, tmp_path) -> None:
    pvpython(
        VOLUME
        + """
import numpy as np
folder, out = sys.argv[1:3]
reader = OpenDataFile(folder + "/scene.svv")
edit = StyleRFEdit(Input=reader)
render = StyleRFRender(Input=edit, ImageSize=[60, 40])
dimensions, first = image(render, 90)
assert dimensions == (60, 40, 1) and set(first) == {"RGBA", "Depth", "Region"}
assert first["RGBA"].dtype == np.uint8 and first["Depth"].dtype == np.float32 and first["Region"].dtype == np.int16
alpha = first["RGBA"][:, 3]
assert alpha.max() > 100 and np.array_equal(np.isnan(first["Depth"]), alpha == 0)
assert (first["Region"][alpha == 0] == -1).all()
assert not np.array_equal(image(render, 20)[1]["RGBA"], first["RGBA"]), "the orbit stands still"

region = np.bincount(first["Region"][alpha > 150]).argmax()  # how many there are hangs on how far training came
def change(**values):
    for name, value in values.items():
        setattr(edit, f"Region{region}{name}", value)
change(Recolour=1, Colour=[1.0, 0.0, 1.0])
magenta = image(render, 90)[1]["RGBA"]
seen = (first["Region"] == region) & (alpha > 150)
assert (magenta[seen, 1] < first["RGBA"][seen].max(1)).mean() > 0.9 and np.array_equal(magenta[:, 3], alpha)
change(Recolour=0, Opacity=0.0)
hidden = image(render, 90)[1]["RGBA"]
assert hidden[:, 3].astype(int).sum() < alpha.astype(int).sum(), "a hidden region still hides what lies behind"
change(Opacity=1.0)
assert np.array_equal(image(render, 90)[1]["RGBA"], first["RGBA"]), "an edit that was taken back left a trace"

# The camera of a view, as ParaView has it: twice as far away, everything is half as large.
scale = lambda: np.sqrt((image(render)[1]["RGBA"][:, 3] > 0).sum())
centre, far = [0.0, 0.0, 0.0], 110.0
render.ImageSize = [240, 160]
render.Camera = [0, 0, far, *centre, 0, 1, 0, 30.0]
near = scale()
render.Camera = [0, 0, 2 * far, *centre, 0, 1, 0, 30.0]
assert abs(near / scale() - 2.0) < 0.15, near / scale()
render.ImageSize = [60, 40]

edit.Region0Lighting = 0.5
SaveData(out + "/edited.svv", proxy=edit)
again = OpenDataFile(out + "/edited.svv")
again.UpdatePipeline()
assert scene(again) == scene(edit)
SaveState(out + "/state.pvsm")
before = image(render)[1]["RGBA"]
ResetSession()
LoadState(out + "/state.pvsm")
restored = [s for s in GetSources().values() if s.SMProxy.GetXMLName() == "StyleRFRender"][0]
assert np.array_equal(image(restored)[1]["RGBA"], before)
""",
        trained,
        tmp_path,
    )
    assert Scene.load(tmp_path / "edited.svv").regions[0].lighting == 0.5


def test_nothing_is_learned_twice(pvpython, tmp_path) -> None:
    pvpython(
        VOLUME
        + """
volume, display = shown()
file = sys.argv[1] + "/kept.svv"
train = trained(volume, SceneFile=file)
first = scene(train)
assert first is not None, status(train)
train.TakeAsEdited()
train.UpdatePipeline()
assert scene(train) == first, "trained again, though nothing had changed"
other = trained(volume, SceneFile=file)
assert scene(other) == first, "trained again, though the scene file was there"
lut = GetColorTransferFunction("RTData")
lut.RGBPoints = [*lut.RGBPoints[:1], 1.0, 0.0, 0.0, *lut.RGBPoints[4:]]
train.UpdatePipeline()
assert scene(train) == first, "editing the transfer function began minutes of work by itself"
train.TakeAsEdited()
train.UpdatePipeline()
assert scene(train) != first, "the edited transfer function was not taken"
""",
        tmp_path,
    )


def test_bad_input_is_one_sentence_and_no_crash(trained: Path, pvpython, tmp_path) -> None:
    result = pvpython(
        VOLUME
        + """
import numpy as np
folder = sys.argv[1]
def said(name, filter):
    filter.UpdatePipeline()
    print("SAID", name, "|", status(filter))
wavelet, display = shown()  # the Programmable Filter imports a function 'volume' into __main__
hidden = Wavelet(WholeExtent=[-5, 5] * 3)
said("no volume", small(StyleRFTrain(Input=hidden)))
vectors = small(StyleRFViews(Input=Gradient(Input=wavelet, ScalarArray=["POINTS", "RTData"])))
vectors.TransferFunction = GetColorTransferFunction("RTData")
vectors.Scalars = ["POINTS", "RTDataGradient"] if "RTDataGradient" in vectors.Input.PointData.keys() else ["POINTS", "Gradient"]
said("vectors", vectors)
cells = small(StyleRFViews(Input=Tetrahedralize(Input=wavelet)))
cells.TransferFunction = GetColorTransferFunction("RTData")
said("unstructured", cells)
source = ProgrammableSource(OutputDataSetType="vtkRectilinearGrid", Script="self.GetOutput().SetDimensions(3, 3, 3)")
said("rectilinear", small(StyleRFViews(Input=source)))
said("composite", small(StyleRFViews(Input=GroupDatasets(Input=[wavelet, hidden]))))
said("empty", small(StyleRFViews(Input=ProgrammableSource(OutputDataSetType="vtkImageData", Script="pass"))))
nan = ProgrammableFilter(Input=wavelet, Script="import numpy\\nv = inputs[0].PointData['RTData'].copy(); v[5] = numpy.nan; output.PointData.append(v, 'RTData')")
nan = small(StyleRFViews(Input=nan))
nan.TransferFunction = GetColorTransferFunction("RTData")
nan.Scalars = ["POINTS", "RTData"]
said("nan", nan)
view = small(StyleRFStylizedView(Input=wavelet, StyleFiles=["/nowhere/style.png"], Preset="draft", Settings=FEW))
said("style", view)
said("no scene", StyleRFEdit(Input=StyleRFStylize(Input=PlotOverLine(Input=wavelet))))
reader = StyleRFScene(FileName=folder + "/scene.svv")
said("region", StyleRFEdit(Input=reader, Region7Opacity=0.5))
said("no style", StyleRFStylize(Input=reader))
said("table", StyleRFViews(Input=reader))
said("network", StyleRFRender(Input=reader, Network="styled"))
said("camera", StyleRFRender(Input=reader, Camera=[0, 0, 5, 0, 0, 0, 0, 1, 0, 400]))
said("no file", StyleRFScene(FileName="/nowhere/scene.svv"))
""",  # noqa: E501
        trained,
        check=False,
    )
    assert result.returncode == 2, result.stderr  # one of the filters is behind another that failed
    said = dict(line[5:].split(" | ", 1) for line in result.stdout.splitlines() if line.startswith("SAID "))
    expected = {
        "no volume": "no transfer function",
        "vectors": "3 components",
        "unstructured": "vtkUnstructuredGrid, was resampled to 25 x 25 x 25 points",
        "rectilinear": "has no scalars",
        "composite": "no transfer function",
        "empty": "The input is empty",
        "nan": "has no value (NaN, infinite or missing) at 1 voxels",
        "style": "no style picture",
        "no scene": "is not a scene",
        "region": "no region 7",
        "no style": "at least one picture",
        "table": "a scene, and this filter needs a volume: connect the one that it was learned from",
        "network": "no network 'styled'",
        "camera": "angle of view",
        "no file": "no scene file",
    }
    assert {name: words in said[name] for name, words in expected.items()} == dict.fromkeys(expected, True), said
    assert "Traceback" not in result.stderr
    assert result.stderr.count("StyleRFStylize: Choose at least one picture") == 1  # though it has two outputs


def test_what_filters_kept_goes_with_them(trained: Path, pvpython) -> None:
    pvpython(
        VOLUME
        + """
import gc, weakref
from svv.fields.scene.scene import Scene
def scenes():
    return [weakref.ref(o) for o in gc.get_objects() if type(o) is Scene]
reader = StyleRFScene(FileName=sys.argv[1] + "/scene.svv")
render = StyleRFRender(Input=reader, ImageSize=[40, 40])
edit = StyleRFEdit(Input=reader)
for filter in (render, edit):
    filter.UpdatePipeline()
alive = scenes()
assert alive and all(ref() for ref in alive)
for filter in (edit, render, reader):
    Delete(filter)
del filter, edit, render, reader
assert not any(ref() for ref in alive)
""",
        trained,
    )


FOLLOWED = """
def others(view):
    return [v for v in GetRenderViews() if v != view]

def move(view, *position, event="EndInteractionEvent"):
    view.GetActiveCamera().SetPosition(*position)
    view.GetInteractor().InvokeEvent(event)
"""


@pytest.mark.slow
def test_the_image_follows_the_camera(trained: Path, pvpython, tmp_path) -> None:
    pvpython(
        VOLUME
        + FOLLOWED
        + """
volume, display = shown()
view = GetActiveView()
view.ViewSize = [200, 100]
reader = StyleRFScene(FileName=sys.argv[1] + "/scene.svv")
reader.UpdatePipeline()
render = StyleRFRender(Input=reader, ImageSize=[40, 30])
render.UpdatePipeline()
Render(view)
assert not others(view) and list(render.ImageSize) == [40, 30], "it follows without being told to"
render.FollowCamera = 1
(target,) = others(view)
assert list(render.ImageSize) == [800, 400]
assert GetLayout(view) == GetLayout(target) and GetActiveView() == view
move(view, 0.0, 90.0, 1.0, event="InteractionEvent")
assert list(render.ImageSize) == [320, 160] and list(render.Camera[:3]) == [0.0, 90.0, 1.0] and render.Moving == 1
for number in range(3):  # as large as the machine permits
    move(view, 0.0, 91.0 + number, 1.0, event="InteractionEvent")
width, height = render.ImageSize
assert 160 <= width <= 800 and abs(width - 2 * height) <= 1 and render.Moving == 1
move(view, 0.0, 90.0, 1.0)
assert list(render.ImageSize) == [800, 400] and render.Moving == 0
(shown_there,) = [d for d in target.Representations if getattr(d, "Input", None) == render]
assert shown_there.Representation == "Slice" and shown_there.Visibility
move(view, 0.0, 90.0, 1.0, event="InteractionEvent")
assert render.Moving == 1
render.FollowCamera = 0
assert render.Moving == 0, "an image that follows no more is made in a hurry for ever"
move(view, 0.0, 1.0, 90.0)
assert list(render.Camera[:3]) == [0.0, 90.0, 1.0], "it does not stand still"
render.FollowCamera = 1
assert others(view) == [target], "the layout was split again"
assert list(render.Camera[:3]) == [0.0, 1.0, 90.0]
# In a state all is as it was, and goes on.
SaveState(sys.argv[2])
ResetSession()
LoadState(sys.argv[2])
for loaded in GetRenderViews():
    Render(loaded)
assert len(GetRenderViews()) == 2 and len(GetLayouts()) == 1, "a second split"
(render,) = [s for s in GetSources().values() if s.SMProxy.GetXMLName() == "StyleRFRender"]
(view,) = [v for v in GetRenderViews() if any(d.Representation == "Volume" and d.Visibility for d in v.Representations)]
move(view, 0.0, 80.0, 1.0)
assert list(render.Camera[:3]) == [0.0, 80.0, 1.0], "a state does not follow"
# Whatever is deleted, the mouse does no harm.
(target,) = others(view)
Delete(target)
move(view, 0.0, 70.0, 1.0)
Delete(render)
move(view, 0.0, 60.0, 1.0)
Delete(view)
""",
        trained, tmp_path / "state.pvsm",
    )  # fmt: skip


@pytest.mark.slow
def test_following_begins_with_the_first_image(trained: Path, pvpython, tmp_path) -> None:
    pvpython(
        VOLUME
        + FOLLOWED
        + """
volume, display = shown()
view = GetActiveView()
reader = StyleRFScene(FileName=sys.argv[1] + "/scene.svv")
render = StyleRFRender(Input=reader, FollowCamera=1)
Render(view)
assert not others(view), "there is no image yet"
render.UpdatePipeline()
Render(view)
(target,) = others(view)
move(view, 0.0, 90.0, 1.0)
assert list(render.Camera[:3]) == [0.0, 90.0, 1.0] and render.ParallelScale == 0.0

def seen():
    from vtkmodules.util.numpy_support import vtk_to_numpy
    image = render.SMProxy.GetClientSideObject().GetOutputDataObject(0)
    return (vtk_to_numpy(image.GetPointData().GetArray("RGBA"))[:, 3] > 20).sum()

# Parallel rays: the camera's distance does not matter, its scale does.
view.CameraParallelProjection, view.CameraParallelScale = 1, 60.0
move(view, 0.0, 90.0, 1.0)
assert render.ParallelScale == view.GetActiveCamera().GetParallelScale() == 60.0
pixels = seen()
move(view, 0.0, 180.0, 2.0)
assert abs(seen() - pixels) < 0.02 * pixels
view.GetActiveCamera().SetParallelScale(120.0)
move(view, 0.0, 180.0, 2.0)
assert abs(4 * seen() - pixels) < 0.1 * pixels
view.CameraParallelProjection = 0
move(view, 0.0, 90.0, 1.0)
assert render.ParallelScale == 0.0
# A view of its own that the image has already is used; a Python state makes its views in this order.
second = StyleRFRender(Input=reader, FollowCamera=1)
own = CreateView("RenderView")
Show(second, own)
Render(own)
assert len(GetRenderViews()) == 3, "a view was made though the image had one"
move(view, 0.0, 80.0, 1.0)
assert list(render.Camera[:3]) == list(second.Camera[:3]) == [0.0, 80.0, 1.0]
Delete(second)
from svv.pv.display.linked_camera import follower_of, followers, stop_following, view_to_follow
assert len(followers()) == 1 and follower_of(render) is not None
stop_following()
assert not render.FollowCamera and not followers()
SetActiveView(own)
assert view_to_follow(AppendDatasets(Input=[Sphere(), volume])) == view, "the volume is not found upstream"
""",
        trained,
    )


def test_an_image_is_shown_in_its_own_colours(trained: Path, pvpython, tmp_path) -> None:
    pvpython(
        VOLUME
        + """
render = StyleRFRender(Input=StyleRFScene(FileName=sys.argv[1] + "/scene.svv"), ImageSize=[40, 30])
render.UpdatePipeline()
display = Show(render, CreateView("RenderView"))
assert display.Representation == "Slice" and display.MapScalars == 0, (display.Representation, display.MapScalars)
assert list(display.ColorArrayName) == ["POINTS", "RGBA"], list(display.ColorArrayName)
display.MapScalars = 1
SaveState(sys.argv[2])
LoadState(sys.argv[2])
again = [d for view in GetRenderViews() for d in view.Representations if getattr(d, "Input", None)]
assert [d.MapScalars for d in again] == [1, 1][: len(again)] and again, "a state was overruled"
Show(Sphere(), CreateView("RenderView"))
assert all(d.MapScalars == 1 for d in again), "a state was overruled later"
""",
        trained, tmp_path / "state.pvsm",
    )  # fmt: skip
