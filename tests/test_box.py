"""The box in which everything is trained, at any scale of the world."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.errors import BadInput


@given(st.floats(1e-9, 1e6), st.floats(-1e6, 1e6), st.integers(0, 1000))
def test_box_round_trip_at_any_scale(scale: float, shift: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    low = rng.random(3) * scale + shift * scale
    high = low + (0.1 + rng.random(3)) * scale
    box = Box.of_bounds(low, high)
    assert max(box.extent) == 1.0
    points = low + rng.random((10, 3)) * (high - low)
    inside = box.to_box(points)
    assert inside.min() >= -1e-6
    assert (inside <= np.asarray(box.extent) + 1e-6).all()
    np.testing.assert_allclose(box.to_world(inside), points, rtol=1e-9, atol=1e-9 * scale)


@pytest.mark.parametrize("high", [(0, 1, 1), (1, np.nan, 1), (-1, 1, 1)])
def test_box_that_encloses_nothing(high: tuple[float, ...]) -> None:
    with pytest.raises(BadInput):
        Box.of_bounds((0, 0, 0), high)
