"""ParaView's filters make the scenes that the same request makes through other doors (`tests/test_request.py`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from svv.io.pictures.output import write_png
from svv.styles.gallery.textures import style_picture
from tests.nightly import nightly
from tests.paraview.filter_script import VOLUME

SAME = """
import numpy as np
import svv
from svv.core.colour.shading import Shading
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.fields.scene.scene import Scene

folder = sys.argv[1]
wavelet, display = shown()
few = tuple(FEW.split("; "))
asked = dict(Preset="draft", Settings=FEW, Device="cpu", Seed=3)
wants = dict(StyleFiles=[f"{folder}/brush.png"], StrokeSize=2.0)

def saved(filter, name):
    filter.SaveFile = f"{folder}/{name}.svv"
    filter.UpdatePipeline()
    filter.SMProxy.InvokeCommand("SaveScene")
    return tables(Scene.load(f"{folder}/{name}.svv"))

def tables(scene):
    return Scene.from_bytes(scene.to_bytes()).to_arrays()[1]

# In one filter or in two, and by Python from the volume that ParaView shows.
if FILTERS == 1:
    last = small(StyleRFStylizedView(Input=wavelet, ImageSize=[32, 32], **asked, **wants))
else:
    last = StyleRFStylize(Input=small(StyleRFTrain(Input=wavelet, **asked)), **asked, **wants)
whole = saved(last, "whole")
lut = GetColorTransferFunction("RTData").GetClientSideObject()
tf = TransferFunction.from_vtk(lut, lut.GetScalarOpacityFunction(), display.ScalarOpacityUnitDistance)
light = Shading(bool(display.Shade), display.Ambient, display.Diffuse, display.Specular, display.SpecularPower)
script = tables(svv.paint(
    sm.Fetch(wavelet), f"{folder}/brush.png", tf=tf, shading=light, n=8, size=64, preset="draft", change=few,
    device="cpu", seed=3, stroke_size=2.0, tell=lambda said: None))
assert {"styled", "pcn"} <= {name.split(".")[0] for name in whole}
assert script.keys() == whole.keys(), (sorted(script), sorted(whole))
for name, values in script.items():
    assert np.array_equal(values, whole[name]), name
"""


@pytest.mark.parametrize("filters", nightly([1, 2], 2))
def test_filters_make_what_python_makes(pvpython: Callable, tmp_path: Path, filters: int) -> None:
    write_png(tmp_path / "brush.png", style_picture("brush strokes"))
    pvpython(f"FILTERS = {filters}\n{VOLUME}{SAME}", tmp_path, own=True)
