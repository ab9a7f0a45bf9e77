#!/usr/bin/env bash
# PyVista 0.49.1: an XDMF file without <Time> cannot be read, though VTK's reader, which it uses, reads it.
#
# The element is optional. pyvista.read asks the reader for its time steps, gets None, and raises a TypeError.
#
# Seen: the error; the spacing that vtkXdmfReader reads from the same file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check pyvista==0.49.1 vtk==9.7.2 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import pyvista
from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

with open("grid.xdmf", "w") as file:
    file.write(
        '<?xml version="1.0"?><Xdmf Version="3.0"><Domain><Grid Name="g">'
        '<Topology TopologyType="3DCoRectMesh" Dimensions="2 2 2"/><Geometry GeometryType="ORIGIN_DXDYDZ">'
        '<DataItem Dimensions="3" Format="XML">0 0 0</DataItem><DataItem Dimensions="3" Format="XML">3 2 1.5</DataItem>'
        '</Geometry><Attribute Name="rho" AttributeType="Scalar" Center="Node">'
        '<DataItem Dimensions="2 2 2" Format="XML">0 1 2 3 4 5 6 7</DataItem></Attribute></Grid></Domain></Xdmf>'
    )
try:
    pyvista.read("grid.xdmf")
except TypeError as error:
    print("PyVista:", error)
reader = vtkXdmfReader()
reader.SetFileName("grid.xdmf")
reader.Update()
print("VTK:", reader.GetOutputDataObject(0).GetSpacing())
PY
diff - seen <<'SEEN'
PyVista: 'NoneType' object is not iterable
VTK: (1.5, 2.0, 3.0)
SEEN
echo "as described"
