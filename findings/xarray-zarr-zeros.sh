#!/usr/bin/env bash
# xarray 2026.9.0: zeros of a Zarr array of version 2 are read as missing.
#
# The fill value of Zarr, which says what chunks hold that were not written, is taken for the missing value of CF.
# zarr's own default is 0. So all background of a label volume becomes NaN, and uint8 becomes float32. The same
# array in version 3 is read as it is.
#
# Seen: type and values of 0, 1, 0, 3.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check xarray==2026.9.0 zarr==3.1.6 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import xarray
import zarr

for version in (2, 3):
    names = {"dimension_names": ["x"]} if version == 3 else {}
    group = zarr.open_group(f"{version}.zarr", mode="w", zarr_format=version)
    labels = group.create_array("labels", shape=(4,), dtype="u1", fill_value=0, **names)
    labels[:] = [0, 1, 0, 3]
    if version == 2:
        labels.attrs["_ARRAY_DIMENSIONS"] = ["x"]
    read = xarray.open_zarr(f"{version}.zarr", consolidated=False)["labels"]
    print(version, read.dtype, read.values.tolist())
PY
diff - seen <<'SEEN'
2 float32 [nan, 1.0, nan, 3.0]
3 uint8 [0, 1, 0, 3]
SEEN
echo "as described"
