#!/usr/bin/env bash
# netCDF-4 (netCDF4 1.7.5.1) seen as HDF5 (h5py 3.16.0): a dimension without coordinates has a scale that is full of
# zeros.
#
# Whoever reads places from the scales of an HDF5 file puts all planes at 0. The scale's attribute NAME says that it
# is a placeholder. The dimensions' labels, where one would look for the names of the axes, are empty; the names are
# those of the attached scales.
#
# Seen: label, scale, its values, and the start of its NAME.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check netCDF4==1.7.5.1 h5py==3.16.0 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import h5py
import netCDF4

with netCDF4.Dataset("model.nc", "w") as file:
    for name, size in zip("zyx", (3, 4, 5)):
        file.createDimension(name, size)
    file.createVariable("rho", "f4", ("z", "y", "x"))[:] = 1
with h5py.File("model.nc") as file:
    for dimension in file["rho"].dims:
        scale = dimension[0]
        print([dimension.label], scale.name, scale[:].tolist(), scale.attrs["NAME"][:52].decode())
PY
diff - seen <<'SEEN'
[''] /z [0.0, 0.0, 0.0] This is a netCDF dimension but not a netCDF variable
[''] /y [0.0, 0.0, 0.0, 0.0] This is a netCDF dimension but not a netCDF variable
[''] /x [0.0, 0.0, 0.0, 0.0, 0.0] This is a netCDF dimension but not a netCDF variable
SEEN
echo "as described"
