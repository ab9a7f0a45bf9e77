#!/usr/bin/env bash
# ome-zarr 0.18.0: write_image does not write the voxel sizes that it is given.
#
# coordinate_transformations is accepted, and so are units in axes; the file says 1 x 1 x 1 and no unit, without a
# warning about either. A volume of 3 x 2 x 1.5 micrometres is then drawn with the wrong shape.
#
# Seen: the scale of the first data set, and the units.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check ome-zarr==0.18.0 zarr==3.1.6 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import json

import numpy as np
from ome_zarr.writer import write_image

sizes = [[{"type": "scale", "scale": [3.0, 2.0 * 2**k, 1.5 * 2**k]}] for k in range(5)]
axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
write_image(np.zeros((8, 64, 64), np.uint8), "image.zarr", axes=axes, coordinate_transformations=sizes)
with open("image.zarr/zarr.json") as file:
    image = json.load(file)["attributes"]["ome"]["multiscales"][0]
print(image["datasets"][0]["coordinateTransformations"][0]["scale"])
print([axis.get("unit") for axis in image["axes"]])
PY
diff - seen <<'SEEN'
[1.0, 1.0, 1.0]
[None, None, None]
SEEN
echo "as described"
