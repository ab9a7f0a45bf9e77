"""Test of the installed plugin, which CTest runs in pvpython: check.py loads | views."""

import sys
from pathlib import Path

from paraview import simple

import svv

assert hasattr(simple, "StyleRFViews"), "ParaView has no filter StyleRF Views: the plugin was not loaded"
assert "stage" in Path(svv.__file__).parts, f"svv is not the installed one: {svv.__file__}"

if sys.argv[1] == "views":
    volume = simple.Wavelet(WholeExtent=[-8, 8] * 3)
    colours = simple.GetColorTransferFunction("RTData")
    colours.RescaleTransferFunction(40, 280)
    colours.ScalarOpacityFunction = simple.GetOpacityTransferFunction("RTData")
    colours.ScalarOpacityFunction.RescaleTransferFunction(40, 280)
    views = simple.StyleRFViews(Input=volume, Views=3, TestViews=0, ViewSize=64, RayCaster="cpu")
    views.TransferFunction = colours
    views.UpdatePipeline()
    alpha = views.PointData["RGBA"].GetRange(3)
    assert alpha[0] < alpha[1], f"the view is empty: alpha {alpha}"
    simple.Delete(views)
print("passed")
