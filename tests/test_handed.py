"""Volumes that one process hands to another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import (
    vtkCharArray,
    vtkIdTypeArray,
    vtkLongArray,
    vtkLongLongArray,
    vtkUnsignedLongArray,
)
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.read.appearance import GHOSTS
from svv.errors import BadInput
from svv.pv.live.handed import hand_over, taken
from svv.pv.work.vtk_data import time_of


def volume() -> vtkImageData:
    """A turned volume whose numbers no short decimal has, with arrays of points and cells; `pressure` is active."""
    image = vtkImageData()
    image.SetExtent(3, 6, -2, 1, 0, 4)
    image.SetSpacing(1 / 3, 0.1, np.pi)
    image.SetOrigin(-1e-7, 1e9 + 1 / 3, 2 / 7)
    image.SetDirectionMatrix((0, -1, 0, 1, 0, 0, 0, 0, 1))
    for data, count in ((image.GetPointData(), 80), (image.GetCellData(), 36)):
        for number, (name, kind) in enumerate((("heat", np.float32), ("pressure", np.int16), ("other", np.float64))):
            array = numpy_to_vtk((np.arange(count) * 7.3 + number).astype(kind), deep=1)
            array.SetName(name)
            data.AddArray(array)
        ghosts = numpy_to_vtk((np.arange(count) % 3).astype(np.uint8), deep=1)
        ghosts.SetName(GHOSTS)
        data.AddArray(ghosts)
    image.GetPointData().SetActiveScalars("pressure")
    return image


@pytest.mark.parametrize("time", [None, 0.1 + 0.2])
def test_a_volume_arrives_as_it_was(tmp_path: Path, time: float | None) -> None:
    image = volume()
    hand_over(image, {"Scalars": "heat"}, time, tmp_path / "volume")
    again = taken(tmp_path / "volume")
    for what in ("GetExtent", "GetDimensions", "GetSpacing", "GetOrigin"):
        assert getattr(again, what)() == getattr(image, what)()
    assert time_of(again) == time
    matrices = [m.GetDirectionMatrix() for m in (image, again)]
    assert all(matrices[0].GetElement(i, j) == matrices[1].GetElement(i, j) for i in range(3) for j in range(3))
    for one, two in ((image.GetPointData(), again.GetPointData()), (image.GetCellData(), again.GetCellData())):
        for name in ("heat", GHOSTS):
            assert two.GetArray(name).GetDataType() == one.GetArray(name).GetDataType()
            assert np.array_equal(vtk_to_numpy(two.GetArray(name)), vtk_to_numpy(one.GetArray(name)))
        assert two.GetArray("other") is None, "an array that nobody asked for was handed over"
    assert again.GetPointData().GetScalars().GetName() == "pressure"


@pytest.mark.parametrize("kind", [vtkCharArray, vtkIdTypeArray, vtkLongArray, vtkLongLongArray, vtkUnsignedLongArray])
def test_types_of_the_same_size_stay_apart(tmp_path: Path, kind: type) -> None:
    image, array = vtkImageData(), kind()
    image.SetDimensions(2, 2, 1)
    array.SetName("values")
    for value in (1, 2, 3, 100):
        array.InsertNextValue(chr(value) if kind is vtkCharArray else value)
    image.GetPointData().SetScalars(array)
    hand_over(image, {"Scalars": ""}, None, tmp_path / "volume")
    again = taken(tmp_path / "volume").GetPointData().GetScalars()
    assert again.GetDataTypeAsString() == array.GetDataTypeAsString()
    assert vtk_to_numpy(again).tolist() == [1, 2, 3, 100]


def test_a_volume_outlives_its_files(tmp_path: Path) -> None:
    hand_over(volume(), {"Scalars": "heat"}, None, tmp_path / "volume")
    image = taken(tmp_path / "volume")
    for file in (tmp_path / "volume").iterdir():
        file.unlink()
    assert vtk_to_numpy(image.GetPointData().GetArray("heat"))[-1] == np.float32(79 * 7.3)


def test_a_volume_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"Cannot write .*create it or choose another place"):
        hand_over(volume(), {"Scalars": ""}, None, tmp_path / "nowhere" / "volume")
