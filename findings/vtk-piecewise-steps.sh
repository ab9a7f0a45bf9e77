#!/usr/bin/env bash
# VTK: what a step of an opacity function means has changed between 9.2 and 9.3.
#
# 1. A point of sharpness 1 makes a step at the midpoint up to 9.2 (and in ParaView 5.11); from 9.3 on it is a steep curve.
# 2. At the value of a doubled point, the opacity function has the left one of the two values up to 9.2, and the right
#    one from 9.3 on. The colour function has the left one in all versions, so that the two no longer agree: a label that
#    lies exactly on a step has the opacity of one side and the colour of the other.
#
# Seen: opacities at 0.25, 0.49, 0.51, 0.75 between 0.2 and 0.8 with sharpness 1; opacity and red at the doubled
# point.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 9.2.6 9.3.1 9.7.2; do
    python3 -m venv "$version"
    "$version/bin/pip" install -q --disable-pip-version-check "vtk==$version"
done
for version in 9.2.6 9.3.1 9.7.2; do
    "$version/bin/python" - "$version" >>seen <<'PY'
import sys

from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

sharp, opacity, colour = vtkPiecewiseFunction(), vtkPiecewiseFunction(), vtkColorTransferFunction()
sharp.AddPoint(0, 0.2, 0.5, 1.0)
sharp.AddPoint(1, 0.8)
opacity.AllowDuplicateScalarsOn()
colour.AllowDuplicateScalarsOn()
for value, level in ((0, 0.0), (3, 0.0), (3, 0.3), (7, 0.3)):
    opacity.AddPoint(value, level)
    colour.AddRGBPoint(value, level, 0, 0)
print(sys.argv[1], [round(sharp.GetValue(x), 2) for x in (0.25, 0.49, 0.51, 0.75)], opacity.GetValue(3), colour.GetColor(3)[0])
PY
done
diff - seen <<'SEEN'
9.2.6 [0.2, 0.2, 0.8, 0.8] 0.0 0.0
9.3.1 [0.2, 0.41, 0.59, 0.8] 0.3 0.0
9.7.2 [0.2, 0.41, 0.59, 0.8] 0.3 0.0
SEEN
echo "as described"
