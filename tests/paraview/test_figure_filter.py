"""StyleRF Figure inside ParaView: an image with everything in it, and a file; and the simulation in other panels."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.core.colour.colour_vision import simulated
from svv.fields.scene.scene import Scene
from svv.options.figures import VISIONS
from tests.cube import cube_scene

HEAD = """
import sys, json
import numpy as np
from paraview.simple import *
import paraview.servermanager as sm
from vtkmodules.util.numpy_support import vtk_to_numpy

def image(filter):
    filter.UpdatePipeline()
    filter.UpdatePropertyInformation()
    data = sm.Fetch(filter)
    width, height, _ = data.GetDimensions()
    array = data.GetPointData().GetArray("RGBA")
    return vtk_to_numpy(array).reshape(height, width, 4)[::-1]

def status(filter):
    filter.UpdatePropertyInformation()
    return filter.Status
scene = StyleRFScene(FileName=sys.argv[1])
"""


@pytest.mark.slow
def test_a_figure_is_an_image_and_a_file(pvpython, tmp_path: Path) -> None:
    cube_scene().edited(0, name="bone").save(tmp_path / "scene.svv")
    pvpython(
        HEAD
        + """
figure = StyleRFFigure(Input=scene, Dpi=50, Width=60.0, Legend="right")
pixels = image(figure)
said = f"{pixels.shape[1]} x {pixels.shape[0]} pixels. Regions look alike: "
assert status(figure).startswith(said), status(figure)
np.save(sys.argv[2] + "/figure.npy", pixels)
figure.SeenWith = "grey print"
grey = image(figure)
assert (grey[..., 0] == grey[..., 2]).all() and grey.shape == pixels.shape
figure.SeenWith = "normal"
figure.FigureFile = sys.argv[2] + "/figure.svg"
figure.SMProxy.InvokeCommand("SaveFigure")
assert status(figure).startswith("Saved as"), status(figure)
figure.FigureFile = sys.argv[2] + "/figure.xyz"
figure.SMProxy.InvokeCommand("SaveFigure")
assert "A figure is a .pdf, .svg, .png or .tiff" in status(figure), status(figure)
figure.VolumeRendering = 1
both = image(figure)
assert "Panel a shows the palette network, not the volume rendering, because" in status(figure), status(figure)
assert both.shape != pixels.shape
figure.VolumeFile = sys.argv[2] + "/none.vti"
figure.UpdatePipeline()
assert "There is no volume" in status(figure), status(figure)
figure.VolumeRendering = 0
figure.Width = 5.0
figure.UpdatePipeline()
assert "must lie between 20 and 1000 mm" in status(figure), status(figure)

from svv.pv.filters.figures import _file_of, add_figure
SaveData(sys.argv[2] + "/volume.vti", Wavelet())
read = XMLImageDataReader(FileName=[sys.argv[2] + "/volume.vti"])
assert _file_of(read).endswith("/volume.vti"), "the volume of a pipeline's scene"
assert [_file_of(source) for source in (scene, Sphere())] == ["", ""]
view = CreateView("RenderView")
SetActiveSource(scene)
scene.UpdatePipeline()
view.CameraPosition, view.CameraFocalPoint = [3.0, 0.0, 0.0], [0.0, 0.0, 0.0]
added = add_figure()
assert list(added.Camera)[:3] == [3.0, 0.0, 0.0], list(added.Camera)
SetActiveSource(added)
try:
    add_figure(Sphere())
except ValueError as error:
    assert "Select a scene" in str(error)
else:
    raise AssertionError("a sphere is no scene")
""",
        tmp_path / "scene.svv", tmp_path,
    )  # fmt: skip
    pixels = np.load(tmp_path / "figure.npy")
    assert pixels.shape[1] == round(60 / 25.4 * 50) and len(np.unique(pixels.reshape(-1, 4), axis=0)) > 100
    assert ">bone<" in (tmp_path / "figure.svg").read_text()
    Image.fromarray(pixels).save(tmp_path / "figure.png")


def test_an_image_is_shown_as_others_see_it(pvpython, tmp_path: Path) -> None:
    cube_scene().save(tmp_path / "scene.svv")
    pvpython(
        HEAD
        + """
render = StyleRFRender(Input=scene, ImageSize=[48, 48], Background=1)
for vision in json.loads(sys.argv[3]):
    render.SeenWith = vision
    np.save(f"{sys.argv[2]}/{vision}.npy", image(render))
edit = StyleRFEdit(Input=scene, Region0MatCap="jade")
jade = image(StyleRFRender(Input=edit, ImageSize=[48, 48], Background=1))
np.save(sys.argv[2] + "/jade.npy", jade)
edit.Region0MatCap = "granite"
edit.UpdatePipeline()
assert "no MatCap 'granite'" in status(edit), status(edit)
""",
        tmp_path / "scene.svv", tmp_path, json.dumps(VISIONS),
    )  # fmt: skip
    normal = np.load(tmp_path / "normal.npy")
    for vision in VISIONS[1:]:
        expected = simulated(normal[..., :3] / 255.0, vision)
        assert np.abs(np.load(tmp_path / f"{vision}.npy")[..., :3] / 255.0 - expected).max() < 1.01 / 255
    assert np.abs(np.load(tmp_path / "jade.npy").astype(int) - normal).max() > 20


def test_words_edit_a_scene_and_what_is_not_understood_is_said(pvpython, tmp_path: Path) -> None:
    cube_scene().edited(0, name="core").save(tmp_path / "scene.svv")
    pvpython(
        HEAD
        + """
edit = StyleRFEdit(Input=scene, SaveFile=sys.argv[2] + "/said.svv", Region1Opacity=0.5, Occlusion=0.3)
edit.Say = "make the core pale jade, thinner, hide region 2"
edit.UpdatePipeline()
understood = "Understood: core: colour pale jade (#9ad5b6). Understood: core: thinner. Understood: Region 2: hide."
assert understood in status(edit), status(edit)
edit.SMProxy.InvokeCommand("SaveScene")
wrong = {"make the shell red": "shell", "the core in oil": "takes painting", "red": "names no region"}
for words, answer in wrong.items():
    edit.Say = words
    edit.UpdatePipeline()
    assert answer in status(edit) and "Understood" not in status(edit), status(edit)
""",
        tmp_path / "scene.svv", tmp_path,
    )  # fmt: skip
    scene = Scene.load(tmp_path / "said.svv")
    assert [(r.opacity, r.hidden, r.occlusion) for r in scene.regions] == [
        (0.5, False, 0.3), (0.5, False, 0.3), (1.0, True, 0.3)
    ]  # fmt: skip
    assert len(scene.history.past) == 2, "its name, and all that was asked for at once"


def test_a_scene_takes_over_a_look_and_gives_its_own(pvpython, tmp_path: Path) -> None:
    cube_scene().edited(0, name="bone", opacity=0.5).edited(1, matcap="jade").save(tmp_path / "scene.svv")
    cube_scene(1).edited(2, name="Bone").save(tmp_path / "other.svv")
    pvpython(
        HEAD
        + """
look = StyleRFLook(Input=scene, SaveLookFile=sys.argv[2] + "/look.json")
look.UpdatePipeline()
assert status(look) == "Choose a look.", status(look)
look.SMProxy.InvokeCommand("SaveLook")
assert status(look).startswith("Saved as"), status(look)
other = StyleRFScene(FileName=sys.argv[2] + "/other.svv")
same = StyleRFLook(Input=other, LookFile=sys.argv[2] + "/look.json", SaveFile=sys.argv[2] + "/same.svv")
same.UpdatePipeline()
assert "Region 2 (bone) looks like bone: the same name" in status(same), status(same)
same.SMProxy.InvokeCommand("SaveScene")
same.Pairs = "a=b"
same.UpdatePipeline()
assert "must be regions" in status(same), status(same)
same.Pairs, same.Look = "", "museum"
same.UpdatePipeline()
assert status(same).count("in turn") == 2, status(same)
open(sys.argv[2] + "/look.json", "w").write("{}")
same.Look = "the file below"
same.UpdatePipeline()
assert "is not a look" in status(same), status(same)
""",
        tmp_path / "scene.svv", tmp_path,
    )  # fmt: skip
    regions = Scene.load(tmp_path / "same.svv").regions
    assert (regions[2].name, regions[2].opacity) == ("bone", 0.5) and "jade" in [r.matcap for r in regions]
