#!/usr/bin/env bash
# Pillow 13.0.0: values of a TIFF in which white is 0 are turned round if they have 8 bits, and are not if they have
# 16.
#
# tifffile and SimpleITK give the values as stored, in both. A volume of slices that is opened by Pillow is inside
# out for one type and right for the other.
#
# Seen: what three libraries read of the stored value 10.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check tifffile==2026.3.3 pillow==13.0.0 SimpleITK==2.5.7 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import numpy as np
import SimpleITK
import tifffile
from PIL import Image

for kind in (np.uint8, np.uint16):
    tifffile.imwrite("white.tif", np.full((4, 4), 10, kind), photometric="miniswhite")
    read = {
        "tifffile": tifffile.imread("white.tif"),
        "SimpleITK": SimpleITK.GetArrayFromImage(SimpleITK.ReadImage("white.tif")),
        "Pillow": np.asarray(Image.open("white.tif")),
    }
    print(kind.__name__, {name: int(values[0, 0]) for name, values in read.items()})
PY
diff - seen <<'SEEN'
uint8 {'tifffile': 10, 'SimpleITK': 10, 'Pillow': 245}
uint16 {'tifffile': 10, 'SimpleITK': 10, 'Pillow': 10}
SEEN
echo "as described"
