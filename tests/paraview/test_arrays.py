"""Several arrays of a volume as layers of one scene, made in the real ParaView."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import vtkmodules.vtkIOXML as xml
from filter_script import VOLUME  # type: ignore[import-not-found]
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkDataSetAttributes, vtkImageData

from svv.fields.scene.joined import members
from svv.fields.scene.scene import Scene
from tests.cube import cube_scene

SIDE = 21
MACRO = Path(__file__).resolve().parents[2] / "plugin" / "macros" / "StyleRF add layer.py"


def put(data: vtkDataSetAttributes, name: str, values: np.ndarray) -> None:
    array = numpy_to_vtk(values.ravel(), deep=1)
    array.SetName(name)
    data.AddArray(array)


def storm(path: Path) -> None:
    """A ball of bytes at the left, one of doubles at the right, and one of integers, on cells, above."""
    z, y, x = np.mgrid[-1 : 1 : SIDE * 1j, -1 : 1 : SIDE * 1j, -1 : 1 : SIDE * 1j]
    image = vtkImageData()
    image.SetDimensions(SIDE, SIDE, SIDE)
    image.SetSpacing(0.1, 0.1, 0.1)
    image.SetOrigin(-1.0, -1.0, -1.0)
    near = lambda a, b: np.clip(1.0 - np.sqrt((x - a) ** 2 + (y - b) ** 2 + z**2) / 0.5, 0.0, 1.0)  # noqa: E731
    put(image.GetPointData(), "cloud", (200 * near(-0.5, 0.0)).astype(np.uint8))
    put(image.GetPointData(), "updraft", 0.01 * near(0.5, 0.0))
    put(image.GetCellData(), "rain", (9000 * near(0.0, 0.5)).astype(np.int32)[:-1, :-1, :-1])
    writer = xml.vtkXMLImageDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    assert writer.Write()


@pytest.mark.slow
def test_each_array_is_a_layer_with_its_function_style_and_opacity(pvpython: Callable, tmp_path: Path) -> None:
    storm(tmp_path / "storm.vti")
    cube_scene().save(tmp_path / "cube.svv")
    pvpython(
        VOLUME
        + f"""
import runpy
from svv.errors import BadInput
from svv.pv.client.layers import add_layer
volume = OpenDataFile(sys.argv[1] + "/storm.vti")
view = CreateView("RenderView")
display = Show(volume, view)
display.SetRepresentationType("Volume")

def refused(*given):
    try:
        add_layer(*given)
    except BadInput as error:
        return str(error)

said = {{}}
for kind, name, top in (("POINTS", "cloud", 200.0), ("POINTS", "updraft", 0.01), ("CELLS", "rain", 9000.0)):
    ColorBy(display, (kind, name))
    points = [(0.0, 0.0), (0.3 * top, 0.0), (0.4 * top, 0.7), (top, 0.7)]
    GetOpacityTransferFunction(name).Points = [v for x, y in points for v in (x, y, 0.5, 0.0)]
    colours = dict(cloud=(0.9, 0.1, 0.1), updraft=(0.1, 0.8, 0.1), rain=(0.1, 0.2, 0.9))[name]
    GetColorTransferFunction(name).RGBPoints = [0.0, *colours, top, *colours]
    if name == "cloud":
        train = small(add_layer(volume))
        train.Preset, train.Settings = "draft", FEW
    else:
        SetActiveSource(volume)
        runpy.run_path({str(MACRO)!r})
assert GetActiveSource() == volume
said["again"] = refused()
said["hidden"] = refused(Wavelet())
(join,) = [one for one in GetSources().values() if one.SMProxy.GetXMLName() == "StyleRFJoin"]
paint = StyleRFStylize(Input=join, Region0Style="ink:hatching", Region1Style="ink:stippling", Region2Style="as it is")
edit = StyleRFEdit(Input=paint, Region0Opacity=0.5, SaveFile=sys.argv[1] + "/storm.svv")
edit.UpdatePipeline()
edit.SaveScene()
said["join"], said["paint"] = status(join), status(paint)
said["trained"] = [[*one.Scalars, one.ViewSize] for one in join.Input]

# Members of an ensemble are scenes of their own.
readers = [OpenDataFile(sys.argv[1] + "/cube.svv") for _ in range(12)]
many = StyleRFJoin(Input=readers)
many.UpdatePipeline()
said["many"] = status(many)
many.Input = readers[:8]
many.UpdatePipeline()
said["eight"] = status(many)
json.dump(said, open(sys.argv[1] + "/said.json", "w"))
""",
        tmp_path,
    )
    said = json.loads((tmp_path / "said.json").read_text())
    assert said["again"].startswith("rain is a layer already: colour the volume by another array.")
    assert said["hidden"].startswith("No view shows the input as a volume")
    assert said["trained"] == [["POINTS", "cloud", 64], ["POINTS", "updraft", 64], ["CELLS", "rain", 64]]
    assert "region 0 is cloud; region 1 is updraft; region 2 is rain" in said["join"], said["join"]
    assert said["many"].startswith("Give 2 to 8 scenes to join, not 12")
    assert "24 regions" in said["eight"] and "region 0 is" not in said["eight"]
    whole = Scene.load(tmp_path / "storm.svv")
    assert [r.name for r in whole.regions] == ["cloud", "updraft", "rain"]
    assert "Painted" in said["paint"], said["paint"]
    assert [r.style for r in whole.regions] == ["ink:hatching", "ink:stippling", None]
    assert [r.opacity for r in whole.regions] == [0.5, 1.0, 1.0] and len(members(whole)) == 3
    assert [int(np.argmax(r.colour)) for r in whole.regions] == [0, 1, 2]
    shown = whole.render(whole.rig.orbit(5, 48)[1]).region
    assert set(np.unique(shown)) == {-1, 0, 1, 2}
