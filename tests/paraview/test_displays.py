"""Displays in the real ParaView: what changes its picture is reproduced, or refused in a sentence that names it."""

from __future__ import annotations

from typing import Any

import pytest

from svv.pv.display.display_table import COLOURS, NO_EFFECT, OPACITIES, REFUSED, REPRESENTATION, REPRODUCED

VOLUME = """
import json, sys
import numpy as np
from paraview.simple import *
from paraview import servermanager as sm
from svv.pv.display.display_table import name_in
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkUniformGrid
from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

SHAPE, SIZE = (20, 16, 12), 96  # (z, y, x)
z, y, x = np.indices(SHAPE)
balls = (((5, 5, 4), 4.0, 200), ((12, 10, 7), 5.0, 120), ((15, 4, 6), 3.0, 160))
field = np.max([top * np.exp(-((z - a) ** 2 + (y - b) ** 2 + (x - c) ** 2) / r**2) for (a, b, c), r, top in balls], 0)
field = field.astype(np.float32)

def named(name, values):
    array = numpy_to_vtk(np.ascontiguousarray(values).ravel(), deep=True)
    array.SetName(name)
    return array

def image(values=field, cells=False, kind=vtkImageData, spacing=(1, 1, 1), origin=(0, 0, 0)):
    made = kind()
    made.SetDimensions(*(n + cells for n in values.shape[::-1]))
    made.SetSpacing(spacing)
    made.SetOrigin(origin)
    (made.GetCellData() if cells else made.GetPointData()).AddArray(named("s", values))
    return made

def source(data):
    producer = TrivialProducer()
    producer.GetClientSideObject().SetOutput(data)
    producer.UpdatePipeline()
    return producer

view = CreateView("RenderView")
view.ViewSize = [SIZE, SIZE]
view.OrientationAxesVisibility = view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]

for corner in (-99, 99):  # ParaView clips a volume that its display scales as if it were not scaled
    white = Show(Sphere(Center=[corner] * 3, Radius=0.01), view)
    white.AmbientColor = white.DiffuseColor = [1, 1, 1]

def show(input, association="POINTS", array="s", shade=0, **properties):
    display = Show(input, view)
    display.SetRepresentationType("Volume")
    ColorBy(display, (association, array))
    display.Shade = shade
    table, opacities = GetColorTransferFunction(array), GetOpacityTransferFunction(array)
    table.AutomaticRescaleRangeMode, table.ColorSpace = "Never", "RGB"
    table.HSVWrap = table.UseLogScale = table.UseBelowRangeColor = table.UseAboveRangeColor = opacities.UseLogScale = 0
    table.RGBPoints = [0, 0, 0, 1, 60, .1, .3, 1, 100, .1, .9, .2, 150, 1, .8, .1, 200, 1, .1, .1]
    opacities.Points = [0, 0, .5, 0, 25, 0, .5, 0, 45, .35, .5, 0, 200, .6, .5, 0]
    for name, value in properties.items():
        setattr(display, name_in(display, name) or name, value)
    return display

def drawn():
    Render(view)
    window = vtkWindowToImageFilter()
    window.SetInput(view.GetRenderWindow())
    window.ReadFrontBufferOff()
    window.Update()
    return vtk_to_numpy(window.GetOutput().GetPointData().GetScalars()).reshape(SIZE, SIZE, 3).astype(float)

def views_of(input, caster="cpu"):
    made = StyleRFViews(Input=input, Views=4, ViewSize=SIZE, RayCaster=caster)
    made.UpdatePipeline()
    made.UpdatePropertyInformation()
    return made

def difference(input, caster="cpu"):
    "Mean difference of our views from ParaView's pictures, levels of 255; the status if there are no views."
    from svv.pv.work.vtk_data import views_of as in_memory
    made = views_of(input, caster)
    views = in_memory(made.GetClientSideObject().GetOutputDataObject(0))
    if views is None:
        return str(made.Status)
    ResetCamera(view)
    found = []
    for camera, pixels in zip(views.cameras, views.images):
        matrix = camera.camera_to_world
        view.CameraPosition = camera.position.tolist()
        view.CameraFocalPoint = (camera.position - 50 * matrix[:3, 2]).tolist()
        view.CameraViewUp = matrix[:3, 1].tolist()
        view.CameraViewAngle = float(np.degrees(camera.fov_x))
        alpha = pixels[..., 3:] / 255.0
        ours = alpha * pixels[..., :3] + 255.0 * (1.0 - alpha)
        found.append(np.abs(ours - drawn()[::-1]).mean())
    Delete(made)
    return float(np.mean(found))

said = {}
"""
END = """
json.dump(said, open(sys.argv[1] + "/said.json", "w"))
"""

CASES = """
def compare(name, data, caster="cpu", **how):
    input = source(data)
    show(input, **how)
    said[name] = difference(input, caster)
    Hide(input, view)
    Delete(input)
    return said[name]

def ghosts(data, flags, cells=False):
    (data.GetCellData() if cells else data.GetPointData()).AddArray(named("vtkGhostType", flags.astype(np.uint8)))
    return data

compare("as it is", image())
compare("array of the points", image(cells=False))
both = image(200 - field)
both.GetCellData().AddArray(named("s", field[:-1, :-1, :-1]))
compare("array of the cells that points have, too", both, association="CELLS")
compare("blank points", ghosts(image(), 2 * (z > 9)))
compare("blank points, on the GPU", ghosts(image(), 2 * (z > 9)), "gpu")
compare("blank cells", ghosts(image(), 32 * ((x < 6) & (z > 4))[:-1, :-1, :-1], True))
compare("blank cells, array of cells", ghosts(image(cells=True), 32 * (y < 8), True), association="CELLS")
grid = image(kind=vtkUniformGrid)
for point in range(0, 900):
    grid.BlankPoint(point)
compare("uniform grid", grid)
compare("moved", image(origin=(3, 4, 5)), Position=[5, 6, 7], Orientation=[20, 30, 40], Origin=[1, 2, 3])
compare("scaled alike", image(), Scale=[3, 3, 3])
compare("scaled", image(spacing=(1, 0.7, 1.3)), Scale=[1, 2, 0.5], Orientation=[0, 0, 60], Origin=[9, 9, 9])
compare("mirrored", image(), Scale=[-1, 1, 2])
compare("cropped", image(origin=(-2, 1, 3)), UseCropping=1, CroppingScale=[0.7, 0.9, 0.8], CroppingOrigin=[1, 0.3, 2.2])
compare("cropped cells", image(cells=True), association="CELLS", UseCropping=1, CroppingScale=[1, 1, 0.53])
part = dict(UseCropping=1, CroppingScale=[0.7, 0.8, 0.6], CroppingOrigin=[0, 3, 2])
later = image(origin=(-2, 1, 3), spacing=(1, 0.7, 1.3))
later.SetExtent(3, 14, -2, 13, 1, 20)
compare("cropped, later extent", later, **part, Position=[3, 4, 5], Orientation=[10, 20, 30])
placed = image(cells=True, origin=(4, -2, 3), spacing=(1, 2, 0.5))
compare("cropped cells, elsewhere", placed, association="CELLS", **part)
compare("nearest", image(), InterpolationType="Nearest")
compare("linear", image(), InterpolationType="Linear")
compare("unit distance", image(), ScalarOpacityUnitDistance=9.0)
compare("opacity of surfaces", image(), Opacity=0.3)
view.UseLight, headlight = 0, AddLight(view=view)
headlight.Coords = "Headlight"
compare("shaded by a headlight", image(), shade=1, caster="gpu", Diffuse=0.8, Ambient=0.4, Specular=0.3)
view.UseLight, headlight.Enable = 1, 0
compare("all", ghosts(image(spacing=(1, 0.7, 1.3)), 2 * (x * y % 11 == 0)), Scale=[1, 2, 0.5], Position=[1, 2, 3],
        Orientation=[0, 0, 60], UseCropping=1, CroppingScale=[0.9, 1, 0.8], InterpolationType="Nearest")
z, y, x = np.indices((24, 24, 24))
radius = np.sqrt((x - 11.5) ** 2 + (y - 11.5) ** 2 + (z - 11.5) ** 2)
ball = image((200 * np.clip(radius / 11, 0, 1)).astype(np.float32))
ball.GetPointData().AddArray(named("r", radius))
part = Threshold(Input=source(ball), Scalars=["POINTS", "r"], LowerThreshold=0, UpperThreshold=11)
part.ThresholdMethod = "Between"
whole = ResampleToImage(Input=part, SamplingDimensions=[30, 30, 30])
whole.UpdatePipeline()
show(whole)
GetOpacityTransferFunction("s").Points = [0, 0.5, 0.5, 0, 100, 0.02, 0.5, 0, 200, 0.3, 0.5, 0]
said["Resample To Image"] = difference(whole)
"""


@pytest.fixture(scope="module")
def drawn(pvpython, tmp_path_factory) -> dict[str, Any]:
    """The differences of all cases from ParaView's pictures."""
    return _said(pvpython, tmp_path_factory.mktemp("drawn"), CASES)


def _said(pvpython: Any, folder: Any, script: str, *arguments: str, **options: Any) -> dict[str, Any]:
    import json

    done = pvpython(VOLUME + script + END, folder, *arguments, **options)
    said: dict[str, Any] = json.loads((folder / "said.json").read_text())
    said["stderr"] = done.stderr
    return said


@pytest.mark.slow
def test_what_a_display_does_is_in_the_views(drawn: dict[str, Any]) -> None:
    differences = {name: value for name, value in drawn.items() if name != "stderr"}
    assert len(differences) == 23
    assert {name: value for name, value in differences.items() if not (isinstance(value, float) and value <= 0.5)} == {}


def test_the_tables_are_complete(pvpython, tmp_path) -> None:
    said = _said(
        pvpython,
        tmp_path,
        """
prototype = sm.ProxyManager().GetPrototypeProxy("representations", "UniformGridVolumeRepresentation")
names = prototype.NewPropertyIterator()
names.Begin()
said["representation"] = []
while not names.IsAtEnd():
    said["representation"].append(names.GetKey())
    names.Next()
said["colours"] = GetColorTransferFunction("s").ListProperties()
said["opacities"] = GetOpacityTransferFunction("s").ListProperties()
""",
    )
    for kind, table in (("representation", REPRESENTATION), ("colours", COLOURS), ("opacities", OPACITIES)):
        assert said[kind] and set(said[kind]) - set(table) == set(), "properties of which nobody has thought"
    rows = [row for table in (REPRESENTATION, COLOURS, OPACITIES) for row in table.values()]
    assert {row.becomes for row in rows} == {REPRODUCED, NO_EFFECT, REFUSED}
    for row in rows:
        assert row.why
        if row.becomes == REFUSED:
            assert row.why.startswith("The volume is ") and row.why.endswith(".") and ": " in row.why


@pytest.mark.slow
def test_properties_without_effect_have_none(pvpython, tmp_path) -> None:
    said = _said(
        pvpython,
        tmp_path,
        """
from svv.pv.display.display_table import COLOURS, NO_EFFECT, OPACITIES, REPRESENTATION
display = show(source(image()), shade=1)
Render(view)
view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [35, 30, 50], [6, 8, 10], [0, 1, 0]
table, opacities = GetColorTransferFunction("s"), GetOpacityTransferFunction("s")

def others(property):
    "Other values that a property could have."
    now = property.GetData()
    domains = property.SMProperty.NewDomainIterator()
    domains.Begin()
    while not domains.IsAtEnd():
        domain = domains.GetDomain()
        if domain.IsA("vtkSMEnumerationDomain"):
            return [domain.GetEntryText(k) for k in range(domain.GetNumberOfEntries())]
        if domain.IsA("vtkSMBooleanDomain"):
            return [0, 1]
        domains.Next()
    if isinstance(now, (int, float)):
        return [0.7 * now + 0.3] if isinstance(now, float) else [0, 1, 5]
    if hasattr(now, "__len__") and not isinstance(now, str) and len(now) and all(isinstance(v, float) for v in now):
        return [[0.6 * v + 0.2 for v in now]]
    return []

before, said["changed"], said["tried"] = drawn(), [], 0
for proxy, rows in ((display, REPRESENTATION), (table, COLOURS), (opacities, OPACITIES)):
    for name, row in rows.items():
        if row.becomes != NO_EFFECT or name not in proxy.ListProperties() or name == "Visibility":
            continue
        try:
            property = proxy.GetProperty(name)
            now = property.GetData()
        except (AttributeError, TypeError):
            continue  # a button, or something that no script can set
        for value in others(property):
            try:
                setattr(proxy, name, value)
            except (AttributeError, TypeError, ValueError):
                continue
            said["tried"] += 1
            if np.abs(drawn() - before).max() > 1:
                said["changed"].append([name, value])
            setattr(proxy, name, list(now) if hasattr(now, "__len__") and not isinstance(now, str) else now)
assert np.abs(drawn() - before).max() <= 1
display.Scale = [1, 1, 2]
said["scale"] = float(np.abs(drawn() - before).mean())
""",
    )
    assert said["changed"] == [] and said["tried"] > 25 and said["scale"] > 1.0


REFUSALS = {
    "BlendMode": ("Isosurface", "blend mode Isosurface"),
    "UseSeparateOpacityArray": (1, "separate opacity array"),
    "UseTransfer2D": (1, "2D transfer function"),
    "MapScalars": (0, "Map Scalars"),
    "MultiComponentsMapping": (1, "Multi Components Mapping"),
    "VolumetricScatteringBlending": (0.5, "Volumetric Scattering Blending"),
    "VolumeRenderingMode": ("Ray Cast Only", "Volume Rendering Mode Ray Cast Only"),
    "ScalarOpacityUnitDistance": (0.0, "Unit Distance 0, at which all that is visible is opaque"),
}


def test_the_rest_is_refused_in_a_sentence_that_names_it(pvpython, tmp_path) -> None:
    said = _said(
        pvpython,
        tmp_path,
        f"""
refusals = {REFUSALS!r}
input = source(image())
display = show(input, shade=1)
for name, (value, _) in refusals.items():
    before = display.GetProperty(name).GetData()
    setattr(display, name, value)
    said[name] = str(views_of(input).Status)
    setattr(display, name, before)
light = AddLight(view=view)
said["light"] = str(views_of(input).Status)
display.Shade = 0
said["light without shade"] = str(views_of(input).Status)
display.Shade, light.Enable = 1, 0
said["light turned off"] = str(views_of(input).Status)
view.UseLight, light.Enable, light.Coords = 0, 1, "Headlight"
said["headlight"] = str(views_of(input).Status)
light.Intensity = 0.5
said["weak headlight"] = str(views_of(input).Status)
view.UseLight, light.Enable = 1, 0
turned = image()
turned.SetDirectionMatrix(0, 0.6, 0.8, 1, 0, 0, 0, 0.8, -0.6)
show(source(turned), Scale=[1, 2, 3])
said["sheared"] = str(views_of(GetActiveSource() or FindSource("TrivialProducer1")).Status)
said["status"] = ""
made = StyleRFViews(Input=input, Views=4, ViewSize=32)
display.BlendMode = "Isosurface"
from svv.pv.client.capture import capture
from svv.errors import BadInput
try:
    capture(made)
except BadInput as error:
    said["capture"] = str(error)
made.UpdatePipeline(); made.UpdatePropertyInformation()
said["after"] = str(made.Status)
display.BlendMode = "Composite"
capture(made)
made.UpdatePipeline(); made.UpdatePropertyInformation()
said["again"] = str(made.Status)
""",
    )
    assert REFUSALS.keys() == {name for name, row in REPRESENTATION.items() if row.becomes == REFUSED} - {
        "CoordinateSystem"
    }
    for name, (_, words) in REFUSALS.items():
        assert words in said[name] and said[name].endswith("Then call TakeWhatIsShownNow() of the filter."), said[name]
    assert "other lights than the light kit" in said["light"] and "other lights" in said["weak headlight"]
    assert said["headlight"].startswith("4 views") and "Lit from" not in said["headlight"]
    assert "Lit from the camera" in said["light turned off"] and "Lit from" not in said["light without shade"]
    assert said["light without shade"].startswith("4 views") and said["light turned off"].startswith("4 views")
    assert "blend mode" in said["capture"] and "blend mode" in said["after"] and said["again"].startswith("4 views")
    assert "Traceback" not in said["stderr"]


def test_no_error_stops_the_next_filter(pvpython, tmp_path) -> None:
    said = _said(
        pvpython,
        tmp_path,
        """
wavelet = Wavelet(WholeExtent=[-8, 8] * 3)
mesh = AppendDatasets(Input=[wavelet])
bad = Show(mesh, view)
bad.SetRepresentationType("Volume")
ColorBy(bad, ("POINTS", "RTData"))
said["mesh"] = str(views_of(mesh).Status)
Hide(mesh, view)
input = source(image())
show(input)
said["after the mesh"] = str(views_of(input).Status)

from svv.pv.client import capture
from svv.pv.work import engine
real = capture.shown_as
capture.shown_as = lambda display: [][0]
said["capture failed"] = str(views_of(input).Status)
capture.shown_as = real
said["next filter"] = str(views_of(input).Status)
real = engine.moment_of
def broken(*_):
    raise TypeError("not what was expected")
engine.moment_of = broken
failing = views_of(input)
said["work failed"] = str(failing.Status)
said["empty"] = failing.GetDataInformation().GetNumberOfPoints()
engine.moment_of = real
said["filter after it"] = str(views_of(input).Status)
failing.Views = 5
failing.UpdatePipeline(); failing.UpdatePropertyInformation()
said["itself again"] = str(failing.Status)

failing.GetClientSideObject().RequestInformation = lambda *_: 1 / 0
failing.Views = 6
failing.UpdatePipelineInformation(); failing.UpdatePropertyInformation()
said["information"] = str(failing.Status)
""",
    )
    assert "vtkUnstructuredGrid" in said["mesh"] or said["mesh"].startswith("4 views")
    for name in ("after the mesh", "next filter", "filter after it"):
        assert said[name].startswith("4 views"), (name, said[name])
    assert said["itself again"].startswith("5 views")
    assert "could not be read (IndexError" in said["capture failed"]
    assert "TypeError: not what was expected in " in said["work failed"] and said["empty"] == 0
    assert "ZeroDivisionError" in said["information"]
    assert "This should not have failed" in said["stderr"]  # in Output Messages
    assert "Traceback" not in said["stderr"]
