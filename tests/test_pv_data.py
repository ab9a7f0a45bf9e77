"""Images converted to VTK data, tested without ParaView."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPolyData

from svv.pv.work.vtk_data import camera_of, digest_of, put_cameras, put_image

FLOATS = st.floats(-1e6, 1e6, width=32) | st.sampled_from([np.nan, np.inf, -np.inf])
IMAGES = hn.arrays(np.float32, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=FLOATS) | hn.arrays(
    st.sampled_from([np.uint8, np.int16]), st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(1, 4))
)


@given(IMAGES)
def test_the_ranges_that_come_with_an_image_are_those_that_vtk_finds(values: np.ndarray) -> None:
    image = vtkImageData()
    put_image(image, {"values": values})
    ours = image.GetPointData().GetArray(0)
    plain = numpy_to_vtk(np.ascontiguousarray(values.reshape(values.shape[0] * values.shape[1], -1)), deep=1)
    for component in range(-1, plain.GetNumberOfComponents()):
        assert ours.GetRange(component) == pytest.approx(plain.GetRange(component), rel=1e-6)
        assert ours.GetFiniteRange(component) == pytest.approx(plain.GetFiniteRange(component), rel=1e-6)


def test_changed_values_have_ranges_of_their_own() -> None:
    image = vtkImageData()
    put_image(image, {"values": np.zeros((2, 3), np.float32)})
    array = image.GetPointData().GetArray(0)
    array.SetValue(0, 5.0)
    array.Modified()
    assert array.GetRange() == array.GetFiniteRange() == (0.0, 5.0)


def test_an_array_is_known_by_its_content_until_it_is_modified() -> None:
    array, same = (numpy_to_vtk(np.arange(6.0), deep=1) for _ in range(2))
    first = digest_of(array)
    assert digest_of(array) == digest_of(same) == first
    array.SetValue(0, 5.0)
    array.Modified()
    assert digest_of(array) != first


VIEW = [4.0, 1.0, 2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0, 30.0]
"""Position, focal point, view up and angle of view."""


@given(st.floats(0.1, 9.0), st.integers(1, 9), st.integers(1, 9))
def test_a_parallel_view_shows_twice_its_scale_from_top_to_bottom(scale: float, width: int, height: int) -> None:
    camera = camera_of(VIEW, width, height, scale)
    assert camera.is_orthographic and not camera_of(VIEW, width, height).is_orthographic
    up = camera.camera_to_world[:3, 1]
    for side in (-1.0, 1.0):  # the edges of the image, at any depth
        _, row, _ = camera.project(np.array(VIEW[3:6]) + side * scale * up + 2.0 * camera.camera_to_world[:3, 2])
        assert row == pytest.approx(0.5 * height * (1.0 - side), abs=1e-9)


def test_points_of_cameras_tell_which_are_parallel() -> None:
    plain, parallel = camera_of(VIEW, 8, 6), camera_of(VIEW, 8, 6, 2.5)
    data = vtkPolyData()
    put_cameras([plain, parallel], data)
    angle, scale = (data.GetPointData().GetArray(name) for name in ("View Angle", "Parallel Scale"))
    assert [angle.GetValue(k) for k in (0, 1)] == pytest.approx([30.0, 0.0])
    assert [scale.GetValue(k) for k in (0, 1)] == pytest.approx([0.0, 2.5])
    put_cameras([plain], data)
    assert data.GetPointData().GetArray("Parallel Scale") is None
