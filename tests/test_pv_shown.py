"""A volume as a display shows it, tested without ParaView."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.read.appearance import Appearance
from svv.dvr.read.grids import from_array, index_to_world, set_geometry, to_array
from svv.errors import BadInput
from svv.pv.display import shown
from svv.pv.display.shown import PLAIN, chosen_of, scale_of, volume_shown
from svv.pv.panel_values import Values, with_names


def given(**more: object) -> Values:
    """Values of a panel: as a display gives them, which has lists where panels have tuples."""
    return with_names({"Scalars": "scalars", "ScalarsOnCells": False, **more})


def field() -> np.ndarray:
    return np.random.default_rng(0).random((4, 5, 6)).astype(np.float32)


def test_a_plain_display_changes_nothing() -> None:
    as_lists = {name: list(value) if isinstance(value, tuple) else value for name, value in PLAIN.items()}
    for plain in ({}, PLAIN, as_lists, {**as_lists, "InterpolationType": "Cubic", "UseCropping": 0}):
        assert chosen_of(given(**plain)) == {}
    assert chosen_of(given(CroppingScale=[0.5, 1, 1])) == {}  # cropping is off
    assert chosen_of(given(Scale=[1, 1, 2])) == {"Scale": (1, 1, 2)}
    image = volume_shown(from_array(field()), given())
    assert np.array_equal(to_array(image), field()) and Appearance.of(image).plain
    assert np.array_equal(index_to_world(image), np.eye(4))


def test_it_is_placed_in_the_world() -> None:
    values = given(Position=[5, 0, 0], Orientation=[0, 0, 90], Scale=[1, 2, 4])
    image = volume_shown(from_array(field(), origin=(1.0, 0.0, 0.0)), values)
    expected = np.array([[0.0, -2, 0, 5], [1, 0, 0, 1], [0, 0, 4, 0], [0, 0, 0, 1]])
    assert np.allclose(index_to_world(image), expected)
    assert scale_of(values) == pytest.approx(2.0)
    assert np.allclose(Appearance.of(image).stretch, [0.5, 1.0, 2.0])
    assert Appearance.of(volume_shown(from_array(field()), given(Scale=[3, 3, 3]))).plain


def test_cells_reach_to_their_outermost_faces() -> None:
    cells = vtkImageData()
    cells.SetDimensions(7, 6, 5)
    array = numpy_to_vtk(field().ravel(), deep=True)
    array.SetName("scalars")
    cells.GetCellData().AddArray(array)
    image = volume_shown(cells, given())
    assert np.array_equal(to_array(image), np.pad(field(), 1, mode="edge"))
    crop = Appearance.of(image).crop
    world = index_to_world(image)
    assert crop is not None and np.allclose(crop @ world[:3, :3].T + world[:3, 3], [[0, 0, 0], [6, 5, 4]])
    half = {"UseCropping": 1, "CroppingScale": [0.5, 1, 1], "CroppingOrigin": [1, 0, 0]}
    crop = Appearance.of(volume_shown(cells, given(**half))).crop
    assert crop is not None and np.allclose(crop @ world[:3, :3].T + world[:3, 3], [[1, 0, 0], [4, 5, 4]])


@pytest.mark.parametrize("indices", [False, True])
def test_cropping_scales_the_bounds_or_since_5_13_the_extent(indices: bool, monkeypatch) -> None:
    monkeypatch.setattr(shown, "CROPS_INDICES", indices)
    image = from_array(field(), origin=(2.0, 0.0, 0.0), spacing=(2.0, 1.0, 1.0))  # x from 2 to 12, extent 0 to 5
    half = {"UseCropping": 1, "CroppingScale": [0.5, 1, 1], "CroppingOrigin": [4, 0, 0]}
    crop = Appearance.of(volume_shown(image, given(**half))).crop
    # As ParaView draws it: the ends are 4 + 12 / 2 or 4 + 5 / 2, and outermost points are edges of texels.
    end = (4.0 + 0.5 * (5.0 if indices else 12.0) - 2.0) / 2.0
    assert crop is not None and crop[1, 0] == pytest.approx(end * 6 / 5 - 0.5)


def test_what_cannot_be_placed_is_said() -> None:
    turned = from_array(field())
    set_geometry(turned, np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]), np.zeros(3))
    with pytest.raises(BadInput, match="shears it: give Scale three equal numbers"):
        volume_shown(turned, given(Scale=[1, 2, 1]))
    assert volume_shown(turned, given(Scale=[2, 2, 2])).GetNumberOfPoints() == 120
    with pytest.raises(BadInput, match="turn Use Cropping off"):
        volume_shown(turned, given(UseCropping=True))
    with pytest.raises(BadInput, match="no number of Scale may be 0"):
        volume_shown(from_array(field()), given(Scale=[1, 0, 1]))
