#!/usr/bin/env bash
# VTK 9.7.2, vtkMRCReader (as in ParaView): the words of an MRC map that say which axis is which are not looked at,
# and signed bytes are read as unsigned ones.
#
# A map whose columns run along z and whose sections run along x (MAPC, MAPR, MAPS = 3, 2, 1; 5 x 4 x 3 voxels of
# 1.5 x 2 x 3) becomes one of 3 x 4 x 5 voxels, with the sizes at the wrong axes: the molecule is mirrored. Values
# of mode 0 are signed by the standard of 2014; -5 becomes 251.
#
# Seen: dimensions and spacing along x, y and z, the least x; type and values.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check mrcfile==1.5.4 vtk==9.7.2 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import mrcfile
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOImage import vtkMRCReader

values = np.zeros((5, 4, 3), np.int8)  # sections along x, rows along y, columns along z
values[1, 2, 0] = -5
with mrcfile.new("map.mrc", data=values) as file:
    file.header.mapc, file.header.mapr, file.header.maps = 3, 2, 1
    file.header.mx, file.header.my, file.header.mz = 5, 4, 3
    file.header.cella = (5 * 1.5, 4 * 2.0, 3 * 3.0)
    file.header.nxstart = 10
reader = vtkMRCReader()
reader.SetFileName("map.mrc")
reader.Update()
image = reader.GetOutput()
numbers = vtk_to_numpy(image.GetPointData().GetScalars())
print("x, y, z:", image.GetDimensions(), image.GetSpacing(), "from", image.GetBounds()[0])
print(numbers.dtype, sorted(set(numbers.tolist())))
PY
diff - seen <<'SEEN'
x, y, z: (3, 4, 5) (1.5, 2.0, 3.0) from 15.0
uint8 [0, 251]
SEEN
echo "as described"
