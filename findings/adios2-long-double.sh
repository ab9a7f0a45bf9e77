#!/usr/bin/env bash
# openPMD-api 0.17.1.post4 and adios2 2.12.1.1001: the place of a mesh in its cells cannot be read by the file's own library.
#
# openPMD-api's Python writes the attribute "position" as long double, and adios2's Python cannot return an array of these
# with NumPy 2 ("Unable to avoid copy"). Half a voxel is lost by a reader that takes what it cannot read for missing. The
# list of attributes has the numbers as a text.
#
# Seen: the type of the attribute, the end of reading it, and the text.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check openpmd-api==0.17.1.post4 adios2==2.12.1.1001 numpy==2.3.5
cat >look.py <<'PY'
import adios2
import numpy as np
import openpmd_api as openpmd

series = openpmd.Series("a.bp", openpmd.Access.create)
mesh = series.write_iterations()[0].meshes["rho"]
values = np.zeros((2, 3, 4), np.float32)
component = mesh[openpmd.Mesh_Record_Component.SCALAR]
component.reset_dataset(openpmd.Dataset(values.dtype, values.shape))
component.position = [0.5, 0.5, 0.5]
component.store_chunk(values)
series.close()

with adios2.FileReader("a.bp") as opened:
    told = opened.available_attributes()
    name = next(name for name in told if name.endswith("/position"))
    print(told[name]["Type"])
    try:
        print(opened.read_attribute(name))
    except ValueError as error:
        print(str(error)[:20])
    print(told[name]["Value"])
PY
venv/bin/python look.py 2>said >seen || { cat said; exit 1; }
diff - seen <<'SEEN'
long double
Unable to avoid copy
{ 0.5, 0.5, 0.5 }
SEEN
echo "as described"
