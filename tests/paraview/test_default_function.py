"""A volume that is shown with the transfer function that ParaView gives every array: its filters say so."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

from tests.test_named import FILTERS

SCRIPT = """
from paraview.simple import *

wavelet = Wavelet(WholeExtent=[-8, 8] * 3)
view = CreateView("RenderView")
display = Show(wavelet, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "RTData"))
views = StyleRFViews(Input=wavelet, Views=12, ViewSize=16)
colours, opacities = display.LookupTable, display.ScalarOpacityFunction
low, high = wavelet.PointData["RTData"].GetRange()

def told(name):
    views.TakeWhatIsShownNow()
    views.UpdatePipeline()
    print("TOLD", name, "|", "The transfer function is ParaView's default" in views.Status)

told("untouched")
print("STATUS", views.Status)
opacities.Points = [low, 0, 0.5, 0, 100, 0.2, 0.5, 0, high, 1, 0.5, 0]
told("a point more")
opacities.Points = [low, 0, 0.5, 0, high, 0.8, 0.5, 0]
told("lower")
opacities.Points = [low, 0, 0.2, 0, high, 1, 0.5, 0]
told("bent")
opacities.Points = [low, 0, 0.5, 0, high, 1, 0.5, 0]
told("restored")
points = list(colours.RGBPoints)
colours.RGBPoints = [*points[:1], 0.9, *points[2:]]
told("another colour")
colours.RGBPoints = points
space, colours.ColorSpace = colours.GetProperty("ColorSpace").GetData(), "RGB"
told("another space")
colours.ColorSpace = space
for function in (colours, opacities):
    function.RescaleTransferFunction(50, 100)
told("another range")
display.RescaleTransferFunctionToDataRange(False, True)
told("range restored")
"""


def test_only_what_nobody_has_touched_is_called_the_default(pvpython: Callable) -> None:
    out = pvpython(SCRIPT).stdout
    said = dict(line[5:].split(" | ") for line in out.splitlines() if line.startswith("TOLD"))
    default = {"untouched", "restored", "range restored"}
    assert {name for name, is_default in said.items() if is_default == "True"} == default and len(said) == 9, said
    assert (
        "The transfer function is ParaView's default, a ramp over all values that shows most volumes as fog: set its "
        "colours and opacities, and then call TakeWhatIsShownNow() of the filter." in out
    )


def test_filters_of_paraview_that_sentences_name_are_there(
    pvpython: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    names = [name.replace(" ", "") for name in sorted(FILTERS)]
    script = f"from paraview import simple\nprint([name for name in {names} if not hasattr(simple, name)])"
    assert pvpython(script).stdout.strip().endswith("[]")
