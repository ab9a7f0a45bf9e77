#!/usr/bin/env bash
# A plane of VTK 9.7.2 that is moved says so before its own function knows, and "axis aligned" turns it around.
#
# vtkPlane got an offset and AxisAligned, for which it keeps a second origin and normal. They are computed after
# ModifiedEvent has been sent, so an observer, such as a filter that follows a handle in a view, evaluates the plane that
# was there before; 9.4.2 evaluates the new one. With AxisAligned, the normal becomes the positive axis: a plane that
# faces -x then faces +x, and one halfway between two axes has a normal of length 1.41 along both.
#
# Seen: the value at (1, 0, 0) during and after the move, and of an axis aligned plane that faces -x, and (1, 1, 0).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cat >look.py <<'PY'
from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkCommonDataModel import vtkPlane

plane = vtkPlane()
plane.SetNormal(1.0, 0.0, 0.0)
told = []
plane.AddObserver("ModifiedEvent", lambda *_: told.append(plane.EvaluateFunction(1.0, 0.0, 0.0)))
plane.SetOrigin(10.0, 0.0, 0.0)
print(vtkVersion.GetVTKVersion(), "during", told, "after", plane.EvaluateFunction(1.0, 0.0, 0.0))
if hasattr(vtkPlane, "SetAxisAligned"):
    plane = vtkPlane()
    plane.SetNormal(-3.0, 1.0, 0.0)
    plane.SetAxisAligned(True)
    print("facing -x:", plane.EvaluateFunction(1.0, 0.0, 0.0))
    plane.SetNormal(1.0, 1.0, 0.0)
    print("facing x and y:", plane.EvaluateFunction(1.0, 0.0, 0.0), plane.EvaluateFunction(0.0, 1.0, 0.0))
PY
for version in 9.4.2 9.7.2; do
    python3 -m venv "venv-$version"
    "venv-$version/bin/pip" install -q --disable-pip-version-check "vtk==$version" numpy==2.2.6
    "venv-$version/bin/python" look.py >>seen
done
diff - seen <<'SEEN'
9.4.2 during [-9.0] after -9.0
9.7.2 during [1.0] after -9.0
facing -x: 1.0
facing x and y: 1.0 1.0
SEEN
echo "as described"
