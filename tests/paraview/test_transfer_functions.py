"""Transfer functions against ParaView's own: the colours of all its presets, and pictures of a ramp of values."""

from __future__ import annotations

SAME = 0.5
"""Largest mean difference of colours and opacities, in levels of 255."""

PRESETS = """
from paraview.modules.vtkRemotingViews import vtkSMTransferFunctionPresets
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
known = getattr(vtkSMTransferFunctionPresets, "GetInstance", vtkSMTransferFunctionPresets)()
numbers = filter(known.IsPresetBuiltin, range(known.GetNumberOfPresets()))
presets = [json.loads(known.GetPresetAsString(number)) for number in numbers]
lut = GetColorTransferFunction("any")
said.update(off={}, refused=[], compared=0, whole=len(presets))
for low, high in ((-1000.0, 1000.0), (101325.0, 101326.0), (0.2, 0.7)):
    values = np.linspace(low, high, 501)
    for preset in presets:
        try:
            ours = TransferFunction.from_dict(preset).fitted(low, high)
        except BadInput as error:
            said["refused"].append(str(error))
            continue
        lut.RGBPoints = [low, 0, 0, 0, high, 1, 1, 1]
        lut.ApplyPreset(preset["Name"], True)
        table = [0.0] * 1503
        vtkColorTransferFunction.GetTable(lut.SMProxy.GetClientSideObject(), low, high, 501, table)
        off = 255 * np.abs(ours.colour_at(values) - np.reshape(table, (501, 3))).mean()
        ramp = 255 * np.abs(ours.opacity_at(values) - (values - low) / (high - low)).mean()
        said["off"][f"{preset['Name']} {low}"] = float(off + ramp)
        said["compared"] += 1
"""

RAMP = """
from paraview import simple
from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
simple._DisableFirstRenderCameraReset()
COUNT, DEEP = 301, 20

def ramp(low, high):
    source = ProgrammableSource(OutputDataSetType="vtkImageData")
    source.ScriptRequestInformation = f'''
executive = self.GetExecutive()
executive.GetOutputInformation(0).Set(executive.WHOLE_EXTENT(), (0, {COUNT - 1}, 0, 20, 0, {DEEP}), 6)
'''
    source.Script = f'''
import numpy
from vtkmodules.util.numpy_support import numpy_to_vtk
output = self.GetImageDataOutput()
output.SetDimensions({COUNT}, 21, {DEEP + 1})
line = numpy.linspace({low}, {high}, {COUNT})
array = numpy_to_vtk(numpy.tile(line, 21 * {DEEP + 1}), deep=1)
array.SetName("v")
output.GetPointData().SetScalars(array)
'''
    return source

def row(view):
    grab = vtkWindowToImageFilter()
    grab.SetInput(view.GetRenderWindow())
    grab.ReadFrontBufferOff()
    grab.Update()
    width, height, _ = grab.GetOutput().GetDimensions()
    pixels = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars()).reshape(height, width, -1)
    return pixels[height // 2].astype(float)

def compare(name, low, high, colours, opacities, **how):
    source, view = ramp(low, high), CreateView("RenderView")
    view.ViewSize, view.OrientationAxesVisibility, view.UseColorPaletteForBackground = [COUNT, 41], 0, 0
    view.Background, view.CameraParallelProjection = [0, 0, 0], 1
    shown = Show(source, view)
    shown.SetRepresentationType("Volume")
    ColorBy(shown, ("POINTS", "v"), True)
    lut, opacity = shown.LookupTable, shown.ScalarOpacityFunction
    shown.Shade, shown.ScalarOpacityUnitDistance = 0, DEEP
    log = how.pop("log_opacity", 0)
    lut.RGBPoints, opacity.Points, opacity.UseLogScale = colours, opacities, log
    for key, value in {"ColorSpace": "RGB", "Discretize": 0, **how}.items():
        setattr(lut, key, value)
    middle = (COUNT - 1) / 2
    view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [middle, 10, 500], [middle, 10, 10], [0, 1, 0]
    view.CameraParallelScale = 20.5
    Render(view)
    drawn = row(view)
    lut.UpdateVTKObjects()
    opacity.UpdateVTKObjects()
    objects = [proxy.SMProxy.GetClientSideObject() for proxy in (lut, opacity)]
    values = np.linspace(low, high, COUNT)
    try:
        shown_as = TransferFunction.from_vtk(*objects)
        assert TransferFunction.from_dict(shown_as.to_dict()) == shown_as
        tf = shown_as.fitted(low, high, rescale=False)
        ours = 255 * tf.colour_at(values) * tf.opacity_at(values)[:, None]
        said[name] = float(np.abs(ours - drawn)[2:-2].mean())
    except BadInput as error:
        said[name] = [str(error), float(drawn.max())]
    Delete(view)
    Delete(source)

RAINBOW, UP = [1, 0, 0, 1, 30, 0, 1, 0, 1000, 1, 0, 0], [1, 0.2, 0.5, 0, 1000, 1, 0.5, 0]
compare("plain", 1, 1000, RAINBOW, UP)
compare("eight colours", 1, 1000, RAINBOW, UP, Discretize=1, NumberOfTableValues=8)
compare("categories", 1, 1000, RAINBOW, UP, InterpretValuesAsCategories=1, Annotations=["1", "a", "500", "b"],
        IndexedColors=[1, 0, 0, 0, 1, 0])
compare("hue", 1, 1000, [1, 0, 0, 1, 1000, 1, 0, 0], UP, ColorSpace="HSV")
compare("hue, the short way", 1, 1000, [1, 0, 0, 1, 1000, 1, 0, 0], UP, ColorSpace="HSV", HSVWrap=1)
compare("beyond", 1, 1000, [200, 0, 0, 1, 800, 1, 0, 0], UP, UseBelowRangeColor=1, BelowRangeColor=[1, 0, 1],
        UseAboveRangeColor=1, AboveRangeColor=[1, 1, 0])
compare("log", 1, 1000, RAINBOW, UP, UseLogScale=1)
compare("log of another range", 10, 500, RAINBOW, UP, UseLogScale=1)
compare("log with colours beyond", 1, 1000, [20, 0, 0, 1, 300, 1, 0, 0], UP, UseLogScale=1, UseBelowRangeColor=1,
        BelowRangeColor=[1, 0, 1], UseAboveRangeColor=1, AboveRangeColor=[1, 1, 0])
compare("log in Lab", 1, 1000, RAINBOW, UP, UseLogScale=1, ColorSpace="Lab")
compare("log opacity", 1, 1000, RAINBOW, UP, log_opacity=1)
compare("log opacity of a shaped curve", 2, 900, RAINBOW, [1, 0, 0.3, 0.2, 50, 1, 0.5, 0, 1000, 0.2, 0.5, 0],
        log_opacity=1)
compare("log from a point at 0", 1, 1000, [0, 0, 0, 1, 30, 0, 1, 0, 1000, 1, 0, 0], UP, UseLogScale=1)
compare("log, data from 0", 0, 1000, RAINBOW, [0, 0.2, 0.5, 0, 1000, 1, 0.5, 0], UseLogScale=1)
compare("log opacity from 0", 0, 1000, RAINBOW, [0, 0.2, 0.5, 0, 1000, 1, 0.5, 0], log_opacity=1)
"""


def test_presets_have_the_colours_that_paraview_gives_them(inside) -> None:
    """Stretched over the data, as *Use preset range* off does; those for categories are refused."""
    said = inside(PRESETS)
    assert said["compared"] >= 3 * 128 and said["compared"] + len(said["refused"]) == 3 * said["whole"]
    assert max(said["off"].values()) <= SAME, sorted(said["off"].items(), key=lambda item: -item[1])[:5]
    assert all("categories only (IndexedColors)" in sentence for sentence in said["refused"])


def test_functions_look_as_paraview_draws_them(inside) -> None:
    said = inside(RAMP)
    black, no_picture = said.pop("log, data from 0"), said.pop("log opacity from 0")
    assert len(said) == 13 and max(said.values()) <= SAME, said
    assert "smallest value is 0" in black[0] and black[1] == 0.0  # what ParaView draws
    assert "a point at 0" in no_picture[0]
