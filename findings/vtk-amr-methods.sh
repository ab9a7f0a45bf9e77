#!/usr/bin/env bash
# VTK 9.7.2 warns about the only method that tells how many grids a level of an AMR data set has in VTK 9.4.2 and before.
#
# GetNumberOfDataSets(level) is deprecated since 9.6, and its successor, GetNumberOfBlocks(level), is missing before. A
# program in which warnings are errors needs one or the other; NewIterator with GetCurrentLevel works in both.
#
# Seen: what either method does, by version.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cat >look.py <<'PY'
import warnings

from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkCommonDataModel import vtkOverlappingAMR

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    amr = vtkOverlappingAMR()
    amr.Initialize(1, [1])
for name in ("GetNumberOfDataSets", "GetNumberOfBlocks"):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        try:
            told = str(getattr(amr, name)(0))
        except AttributeError:
            told = "missing"
    print(vtkVersion.GetVTKVersion(), name, told, *(one.category.__name__ for one in found))
iterator = amr.NewIterator()
iterator.SkipEmptyNodesOff()
iterator.InitTraversal()
print("level", iterator.GetCurrentLevel())
PY
for version in 9.4.2 9.7.2; do
    python3 -m venv "venv-$version"
    "venv-$version/bin/pip" install -q --disable-pip-version-check "vtk==$version" numpy==2.2.6
    "venv-$version/bin/python" look.py >>seen
done
diff - seen <<'SEEN'
9.4.2 GetNumberOfDataSets 1
9.4.2 GetNumberOfBlocks missing
level 0
9.7.2 GetNumberOfDataSets 1 DeprecationWarning
9.7.2 GetNumberOfBlocks 1
level 0
SEEN
echo "as described"
