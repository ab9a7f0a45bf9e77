"""Beginning and end of the panel tests' scripts: small paintings, and functions to query filters."""

from __future__ import annotations

START = """
import json, os, sys
import numpy as np
from paraview.simple import *
from paraview import servermanager as sm
from vtkmodules.util.numpy_support import vtk_to_numpy
folder = sys.argv[1]
os.chdir(folder)
said = {}

from dataclasses import replace
from svv.train.run import config
FEW = "reconstruct.iterations=60; reconstruct.rays=512; recolour.iterations=40; recolour.rays=512"
draft = config.PRESETS["draft"]
config.PRESETS["draft"] = replace(draft, recolour=replace(draft.recolour, iterations=40, rays=512),
                                  stylize=replace(draft.stylize, style_size=48))  # a test is no painting

def status(filter):
    filter.UpdatePipeline()
    filter.UpdatePropertyInformation()
    return filter.Status

def arrays(filter, port=0):
    filter.UpdatePipeline()
    data = sm.Fetch(filter, idx=port)
    width, height, _ = data.GetDimensions()
    found = data.GetPointData()
    return {found.GetArrayName(i): vtk_to_numpy(found.GetArray(i)).reshape(height, width, -1)[::-1]
            for i in range(found.GetNumberOfArrays())}

def column(filter, name):
    filter.UpdatePipeline()
    return vtk_to_numpy(sm.Fetch(filter).GetColumnByName(name)).tolist()
"""
END = """
json.dump(said, open("said.json", "w"))
"""
