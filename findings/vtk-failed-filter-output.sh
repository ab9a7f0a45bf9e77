#!/usr/bin/env bash
# VTK 9.7.2 (as in ParaView): a filter whose RequestData fails still passes on the field data of its input, and its
# error code stays 0.
#
# The pipeline copies field data before RequestData is called. A filter behind, which finds what it needs in field
# data, works with the input of the one that failed, and cannot tell.
#
# Seen: error code and arrays of the output of a filter that returns 0 at once.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check vtk==9.7.2 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkIntArray
from vtkmodules.vtkCommonDataModel import vtkPolyData


class Failing(VTKPythonAlgorithmBase):
    """A filter that fails before it has made anything."""

    def __init__(self):
        super().__init__(nInputPorts=1, nOutputPorts=1, outputType="vtkPolyData")

    def RequestData(self, request, inputs, outputs):
        return 0


data, array = vtkPolyData(), vtkIntArray()
array.SetName("settings")
array.InsertNextValue(7)
data.GetFieldData().AddArray(array)
filter_ = Failing()
filter_.SetInputDataObject(data)
filter_.Update()
output = filter_.GetOutputDataObject(0)
print("error code", filter_.GetErrorCode(), "arrays", [output.GetFieldData().GetArrayName(k) for k in range(output.GetFieldData().GetNumberOfArrays())])
PY
diff - seen <<'SEEN'
error code 0 arrays ['settings']
SEEN
echo "as described"
