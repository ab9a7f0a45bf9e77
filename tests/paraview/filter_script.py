"""Beginning of the filter tests' scripts: a volume on display, small filters for it, and functions to query them.

And what runs a script of ``paraview_scripts`` in little.
"""

from __future__ import annotations

VOLUME = """
import json, os, sys, tempfile
from paraview.simple import *
from paraview import servermanager as sm

# Steps, not seconds: what is learned is the same on slow and busy machines.
FEW = "reconstruct.iterations=60; reconstruct.rays=512; recolour.iterations=40; recolour.rays=512"

def shown(extent=12):
    wavelet = Wavelet(WholeExtent=[-extent, extent] * 3)
    view = CreateView("RenderView")
    display = Show(wavelet, view)
    display.SetRepresentationType("Volume")
    ColorBy(display, ("POINTS", "RTData"))
    points = [37, 0, 0.5, 0, 200, 0, 0.5, 0, 220, 1, 0.5, 0, 277, 1, 0.5, 0]  # the less is seen, the faster is the test
    GetOpacityTransferFunction("RTData").Points = points
    return wavelet, display

def small(filter):
    filter.Views, filter.ViewSize = 8, 64
    return filter

def trained(volume, **values):
    filter = small(StyleRFTrain(Input=volume, Preset="draft", Settings=FEW, **values))
    filter.UpdatePipeline()
    return filter

def status(filter):
    filter.UpdatePropertyInformation()
    return filter.Status

def image(filter, frame=None, time=0.0):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    if frame is not None:
        filter.Frame = frame
    filter.UpdatePipeline(time)
    data = sm.Fetch(filter)
    arrays = data.GetPointData()
    return data.GetDimensions(), {arrays.GetArrayName(i): vtk_to_numpy(arrays.GetArray(i)).copy() for i in range(arrays.GetNumberOfArrays())}

def scene(filter):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    array = sm.Fetch(filter).GetFieldData().GetArray("StyleRF Scene")
    return None if array is None else vtk_to_numpy(array).tobytes()
"""  # noqa: E501

LITTLE = """
import os, runpy, sys
from dataclasses import replace
from svv.train.run import config
draft = config.PRESETS["draft"]
config.PRESETS["draft"] = replace(
    draft, reconstruct=replace(draft.reconstruct, iterations=150, rays=1024),
    recolour=replace(draft.recolour, iterations=60, rays=1024),
    stylize=replace(draft.stylize, style_views=6, style_size=96))
del sys.argv[0]
sys.path[0] = os.path.dirname(sys.argv[0])
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Runs a script whose draft is learned in few steps. Steps, not seconds: the same on slow and busy machines."""
