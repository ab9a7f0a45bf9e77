#!/usr/bin/env bash
# ngff-zarr 0.18.2: with zarr 3.1.6, to_ngff_zarr cannot write the version of OME-Zarr that is its default.
#
# Version 0.4 passes an argument to zarr that zarr 3 no longer takes. version="0.5" works, and keeps the voxel size.
#
# Seen: the error; the scale that is read back from version 0.5.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check ngff-zarr==0.18.2 zarr==3.1.6 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import ngff_zarr
import numpy as np

image = ngff_zarr.to_ngff_image(
    np.zeros((4, 8, 8), np.uint8), dims=("z", "y", "x"), scale={"z": 3.0, "y": 2.0, "x": 1.5}
)
scales = ngff_zarr.to_multiscales(image)
try:
    ngff_zarr.to_ngff_zarr("default.zarr", scales)
except TypeError as error:
    print(error)
ngff_zarr.to_ngff_zarr("five.zarr", scales, version="0.5")
print(ngff_zarr.from_ngff_zarr("five.zarr").images[0].scale)
PY
diff - seen <<'SEEN'
create_array() got an unexpected keyword argument 'dimension_separator'
{'z': 3.0, 'y': 2.0, 'x': 1.5}
SEEN
echo "as described"
