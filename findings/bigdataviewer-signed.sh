#!/usr/bin/env bash
# BigDataViewer's HDF5 (npy2bdv 1.1.0, as Fiji writes it): values are stored as signed numbers and meant as unsigned
# ones.
#
# 40000 stands in the file as -25536, and nothing in the file says so, nor how large a voxel is; that is in the .xml
# beside it. A reader that takes HDF5 for what it says draws the brightest cells as the darkest.
#
# Seen: type and value that the file holds for 40000, its attributes; whether the .xml has the voxel size.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check npy2bdv==1.1.0 h5py==3.16.0 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import h5py
import npy2bdv
import numpy as np

writer = npy2bdv.BdvWriter("cells.h5", overwrite=True)
writer.append_view(np.full((4, 8, 8), 40000, np.uint16), voxel_size_xyz=(1.5, 2.0, 3.0))
writer.write_xml()
writer.close()
with h5py.File("cells.h5") as file:
    found = file["t00000/s00/0/cells"]
    print("stored:", found.dtype, found[0, 0, 0], dict(found.attrs), dict(file["s00"].attrs))
with open("cells.xml") as file:
    print("1.5 2.0 3.0" in file.read())
PY
diff - seen <<'SEEN'
stored: int16 -25536 {} {}
True
SEEN
echo "as described"
