"""What messages advise to do in ParaView is done there."""

from __future__ import annotations

import re

from svv.bricks.formats.source import REPLACE_THEM

SCRIPT = """
import numpy as np
from paraview.simple import *
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
values = np.arange(64.0)
values[[3, 5, 9]] = np.nan, -np.inf, np.inf
image = vtkImageData()
image.SetDimensions(4, 4, 4)
array = numpy_to_vtk(values, deep=True)
array.SetName("density")
image.GetPointData().SetScalars(array)
source = TrivialProducer()
source.GetClientSideObject().SetOutput(image)
calculator = PythonCalculator(Input=source, Expression={expression!r}, ArrayName="numbers")
made = vtk_to_numpy(servermanager.Fetch(calculator).GetPointData().GetArray("numbers"))
assert np.array_equal(made, np.where(np.isfinite(values), values, 0.0)), made
"""


def test_the_expression_replaces_what_are_no_numbers(pvpython, tmp_path) -> None:
    found = re.search(r"numpy\.nan_to_num\(.*?\)", REPLACE_THEM)
    assert found is not None
    pvpython(SCRIPT.format(expression=found[0].replace("values", "density")), tmp_path)
