"""Images converted to VTK data, tested without ParaView."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.pv.data import digest_of, put_image

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
