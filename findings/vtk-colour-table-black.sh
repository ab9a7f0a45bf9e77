#!/usr/bin/env bash
# VTK 9.7.2: vtkColorTransferFunction.GetTable gives black for an entry that lies exactly on its two points of one
# value.
#
# A doubled point is how a colour beyond the range is written for a function that ends there. GetColor gives the
# first of the two at that value; the table that the ray casters use has (0, 0, 0), which is neither.
#
# Seen: at 0, 50 and 100, the colours of GetColor and of a table of three entries.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check vtk==9.7.2
venv/bin/python - >seen 2>/dev/null <<'PY'
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

colour = vtkColorTransferFunction()
colour.AllowDuplicateScalarsOn()
colour.AddRGBPoint(50, 1, 0, 1)
colour.AddRGBPoint(50, 0, 0, 1)
table = [0.0] * 9
colour.GetTable(0, 100, 3, table)
for k, value in enumerate((0, 50, 100)):
    print(value, "GetColor", colour.GetColor(value), "GetTable", tuple(table[3 * k : 3 * k + 3]))
PY
diff - seen <<'SEEN'
0 GetColor (1.0, 0.0, 1.0) GetTable (1.0, 0.0, 1.0)
50 GetColor (1.0, 0.0, 1.0) GetTable (0.0, 0.0, 0.0)
100 GetColor (0.0, 0.0, 1.0) GetTable (0.0, 0.0, 1.0)
SEEN
echo "as described"
