#!/usr/bin/env bash
# VTK 9.7.2, vtkNetCDFCFReader: a grid of longitudes and latitudes is a sphere by default, its values belong to
# cells, and axes may fall.
#
# A variable of 3 x 2 x 2 points becomes a structured grid of 36 points with 12 cells around them. Without spherical
# coordinates it is a rectilinear grid of 12 points, whose latitudes fall as stored, and whose depths, which the
# file says are positive downwards, are negative and fall, too: most filters and the ray casters expect coordinates
# that rise.
#
# Seen: type, points and arrays by default and without spherical coordinates; the coordinates of y and z of the
# latter.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check netCDF4==1.7.5.1 vtk==9.7.2 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import netCDF4
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIONetCDF import vtkNetCDFCFReader

with netCDF4.Dataset("sea.nc", "w", format="NETCDF3_CLASSIC") as file:
    places = {"depth": ([0, 10, 20], "m"), "lat": ([50, 40], "degrees_north"), "lon": ([0, 1], "degrees_east")}
    for name, (values, unit) in places.items():
        file.createDimension(name, len(values))
        variable = file.createVariable(name, "f8", (name,))
        variable[:] = values
        variable.units = unit
    file["depth"].setncatts({"positive": "down", "axis": "Z"})
    file.createVariable("t", "f4", tuple(places))[:] = np.arange(12).reshape(3, 2, 2)
for spherical in (True, False):
    reader = vtkNetCDFCFReader()
    reader.SetFileName("sea.nc")
    if not spherical:
        reader.SphericalCoordinatesOff()
    reader.Update()
    grid = reader.GetOutputDataObject(0)
    arrays = grid.GetPointData().GetNumberOfArrays(), grid.GetCellData().GetNumberOfArrays()
    print(grid.GetClassName(), grid.GetNumberOfPoints(), "points; arrays of points, of cells:", *arrays)
print([(vtk_to_numpy(axis) + 0.0).tolist() for axis in (grid.GetYCoordinates(), grid.GetZCoordinates())])
PY
diff - seen <<'SEEN'
vtkStructuredGrid 36 points; arrays of points, of cells: 0 1
vtkRectilinearGrid 12 points; arrays of points, of cells: 1 0
[[50.0, 40.0], [0.0, -10.0, -20.0]]
SEEN
echo "as described"
