#!/usr/bin/env bash
# ITK's HDF5 (SimpleITK 2.5.7): the matrix Directions in the file is the transpose of the one that the image has.
#
# Each row of the file is an axis of the image, while GetDirection, NIfTI and NRRD have an axis a column. Read as it
# looks, a volume turned by a quarter is turned the other way.
#
# Seen: both matrices of one image.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check SimpleITK==2.5.7 h5py==3.16.0 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import h5py
import numpy as np
import SimpleITK

image = SimpleITK.GetImageFromArray(np.zeros((3, 4, 5), np.uint8))
image.SetDirection((0, -1, 0, 1, 0, 0, 0, 0, 1))
SimpleITK.WriteImage(image, "turned.h5")
with h5py.File("turned.h5") as file:
    print("in the file:", (file["ITKImage/0/Directions"][()] + 0.0).tolist())
print("GetDirection:", (np.reshape(image.GetDirection(), (3, 3)) + 0.0).tolist())
PY
diff - seen <<'SEEN'
in the file: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
GetDirection: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
SEEN
echo "as described"
