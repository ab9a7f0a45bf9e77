#!/usr/bin/env bash
# VTK 9.3.1, 9.4.2 and 9.5.2: the module that gives NumPy's functions to VTK's arrays cannot be imported with NumPy
# 2.4.
#
# vtkmodules.numpy_interface.algorithms, on which the Python Calculator and Programmable Filter of ParaView of the
# same age rest, wraps numpy.in1d, which NumPy 2.4 has removed. The wheels of VTK ask for no upper bound, so pip
# installs the two together.
#
# Seen: whether the module can be imported.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 9.3.1 9.5.2 9.7.2; do
    python3 -m venv "$version"
    "$version/bin/pip" install -q --disable-pip-version-check "vtk==$version" numpy==2.4.6
done
for version in 9.3.1 9.5.2 9.7.2; do
    "$version/bin/python" - "$version" >>seen <<'PY'
import sys

try:
    import vtkmodules.numpy_interface.algorithms
except AttributeError as error:
    print(sys.argv[1], error)
else:
    print(sys.argv[1], "is imported")
PY
done
diff - seen <<'SEEN'
9.3.1 module 'numpy' has no attribute 'in1d'
9.5.2 module 'numpy' has no attribute 'in1d'
9.7.2 is imported
SEEN
echo "as described"
