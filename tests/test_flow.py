"""Flow between cameras, splatting and the forward-backward check: their laws, and cases known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.cameras import Camera, look_at, orbit_cameras
from svv.errors import BadInput
from svv_bench.styles.flow import camera_flow, estimated_flow, is_consistent, is_motion_boundary, sampled, splatted

SIZE = 24
EXACT = 1e-9
"""Pixels by which float64 may miss a closed form."""


def plane_depth(camera: Camera, z: float) -> np.ndarray:
    """Distance along each ray to the world plane at that z, in front of the camera."""
    origins, directions = camera.rays()
    return (z - origins[..., 2]) / directions[..., 2]


def ahead(position: tuple[float, float, float], size: int = SIZE) -> Camera:
    """A camera that looks along -z."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    return Camera(matrix, np.radians(40), size, size)


@given(st.floats(0.1, 100), st.integers(0, 180))
def test_the_same_camera_has_no_flow(depth: float, frame: int) -> None:
    camera = orbit_cameras(181, size=SIZE, frames=[frame])[0]
    flow = camera_flow(camera, camera, np.full((SIZE, SIZE), depth))
    np.testing.assert_allclose(flow, 0.0, atol=EXACT)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.5, 20), st.sampled_from([1e-9, 1.0, 1e6]))
def test_a_plane_moves_by_focal_length_over_depth(x: float, y: float, z: float, unit: float) -> None:
    """A camera that moves by t parallel to its image sees a plane at distance z move by -f t / z."""
    camera, moved = ahead((0, 0, 0)), ahead((x * unit, y * unit, 0))
    flow = camera_flow(camera, moved, plane_depth(camera, -z * unit))
    expected = np.array([-x, y]) * camera.focal / z
    np.testing.assert_allclose(flow, np.broadcast_to(expected, flow.shape), atol=1e-7)


def test_a_camera_that_turns_sees_everything_move_alike_at_any_depth() -> None:
    """Turning by an angle a about the vertical moves the middle by f tan a, whatever is there."""
    camera = ahead((0, 0, 0), SIZE + 1)  # odd: a pixel lies in the very middle
    angle = np.radians(5)
    turned = Camera(look_at((0, 0, 0), (np.sin(angle), 0, -np.cos(angle))), camera.fov_x, SIZE + 1, SIZE + 1)
    flows = [camera_flow(camera, turned, np.full((SIZE + 1, SIZE + 1), depth)) for depth in (1.0, 50.0)]
    np.testing.assert_allclose(flows[0], flows[1], atol=EXACT)
    np.testing.assert_allclose(flows[0][SIZE // 2, SIZE // 2], [-camera.focal * np.tan(angle), 0], atol=EXACT)


def test_what_is_unknown_or_behind_has_no_flow() -> None:
    camera, back = ahead((0, 0, 0)), ahead((0, 0, -10))
    depth = np.full((SIZE, SIZE), 4.0)
    assert np.isnan(camera_flow(camera, back, depth)).all()  # 6 units behind it
    depth[3, 5] = np.nan
    assert np.argwhere(np.isnan(camera_flow(camera, camera, depth)).all(-1)).tolist() == [[3, 5]]
    with pytest.raises(BadInput, match="render it again"):
        camera_flow(camera, camera, depth[1:])


@given(st.integers(0, 170))
def test_there_and_back_on_a_plane_is_nowhere(frame: int) -> None:
    """Seen from both sides of the check: on a plane nothing is hidden, so what stays in the image is consistent."""
    camera = ahead((0.02 * (frame % 13), 0.01 * (frame % 7), 0.01 * frame))
    other = ahead((0, 0, 0))
    forward = camera_flow(camera, other, plane_depth(camera, -5.0))
    backward = camera_flow(other, camera, plane_depth(other, -5.0))
    stays = np.isfinite(sampled(backward, forward)).all(-1)
    np.testing.assert_allclose((forward + sampled(backward, forward))[stays], 0.0, atol=1e-6)
    np.testing.assert_array_equal(is_consistent(forward, backward), stays)
    assert stays.sum() > SIZE  # the check is not met by leaving everything out


@given(st.integers(-30, 30), st.integers(-30, 30))
def test_whole_steps_move_pixels_as_they_are(dx: int, dy: int) -> None:
    values = np.random.default_rng(0).random((SIZE, SIZE, 3))
    flow = np.broadcast_to([dx, dy], (SIZE, SIZE, 2)).astype(float)
    moved, arrived = splatted(values, flow, np.zeros((SIZE, SIZE)))
    expected = np.full_like(values, np.nan)
    for row in range(SIZE):
        for column in range(SIZE):
            if 0 <= row + dy < SIZE and 0 <= column + dx < SIZE:
                expected[row + dy, column + dx] = values[row, column]
    np.testing.assert_allclose(moved, expected)
    np.testing.assert_array_equal(arrived, np.isfinite(expected[..., 0]))


@given(st.integers(0, 2**32 - 1), st.floats(0, 30))
def test_splatting_conserves_pixels_and_normalises_colours(seed: int, spread: float) -> None:
    """What stays in the image arrives whole; a constant stays constant, and nothing leaves the range of the values."""
    rng = np.random.default_rng(seed)
    middle = slice(SIZE // 4, -SIZE // 4)
    flow = np.full((SIZE, SIZE, 2), np.nan)
    flow[middle, middle] = rng.uniform(-4, 4, (SIZE // 2, SIZE // 2, 2))
    values = np.concatenate([np.full((SIZE, SIZE, 1), 0.37), rng.random((SIZE, SIZE, 1))], axis=-1)
    moved, arrived = splatted(values, flow, spread * rng.random((SIZE, SIZE)))
    assert arrived.sum() == pytest.approx((SIZE // 2) ** 2)
    seen = np.isfinite(moved[..., 0])
    np.testing.assert_array_equal(seen, arrived > 0)
    np.testing.assert_allclose(moved[seen, 0], 0.37)
    assert moved[seen, 1].min() >= -EXACT and moved[seen, 1].max() <= 1 + EXACT


def test_the_important_pixel_wins_and_equals_are_averaged() -> None:
    """Against the formula: two pixels meet, with importances Z apart, and share e^Z : 1."""
    values = np.zeros((1, 3, 1))
    values[0, 2] = 1.0
    flow = np.array([[[1.0, 0.0], [np.nan, np.nan], [-1.0, 0.0]]])
    for z in (0.0, 1.0, 3.0, 2000.0):
        moved, arrived = splatted(values, flow, np.array([[0.0, 0.0, z]]))
        assert moved[0, 1, 0] == pytest.approx(1 / (1 + np.exp(-z)))
        assert arrived[0, 1] == 2.0


@pytest.mark.parametrize("estimator", ["tvl1", "ilk"])
def test_an_estimator_finds_a_known_shift(estimator: str) -> None:
    """A soft pattern that moves by (3, -2) pixels, away from the rim."""
    row, column = np.mgrid[0:64, 0:64].astype(float)

    def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.5 + 0.2 * np.sin(0.31 * x + 0.12 * y) + 0.2 * np.cos(0.23 * y - 0.17 * x)

    flow = estimated_flow(pattern(column, row), pattern(column - 3, row + 2), estimator)
    middle = flow[16:-16, 16:-16]
    np.testing.assert_allclose(middle, np.broadcast_to([3.0, -2.0], middle.shape), atol=0.3)


def test_nothing_to_splat_leaves_nothing() -> None:
    moved, arrived = splatted(np.ones((2, 2, 1)), np.full((2, 2, 2), np.nan), np.zeros((2, 2)))
    assert np.isnan(moved).all() and not arrived.any()


def test_motion_boundaries_are_jumps_and_rims_of_the_unknown() -> None:
    """A smooth turn of the whole image is none; where two halves part, the two columns that meet are."""
    row, column = np.mgrid[0:SIZE, 0:SIZE].astype(float)
    turn = 0.02 * np.stack([row + 40, -column - 40], axis=-1)
    assert not is_motion_boundary(turn).any()
    parted = np.where((column < 10)[..., None], [1.0, 0.0], [-1.0, 0.0])
    np.testing.assert_array_equal(is_motion_boundary(parted), (column == 9) | (column == 10))
    unknown = turn.copy()
    unknown[5, 5] = np.nan
    found = np.argwhere(is_motion_boundary(unknown)).tolist()
    assert found == [[4, 5], [5, 4], [5, 5], [5, 6], [6, 5]]


def test_what_is_hidden_is_masked() -> None:
    """A square before a wall: the strip of wall that the square covers for the other camera fails, and no other."""
    camera, other = ahead((0, 0, 0), 64), ahead((0.6, 0, 0), 64)

    def depth_of(view: Camera) -> np.ndarray:
        near, far = plane_depth(view, -4.0), plane_depth(view, -8.0)
        origins, directions = view.rays()
        point = origins + near[..., None] * directions
        return np.where((np.abs(point[..., :2]) < 0.5).all(-1), near, far)

    forward = camera_flow(camera, other, depth_of(camera))
    backward = camera_flow(other, camera, depth_of(other))
    origins, directions = camera.rays()
    point = origins + depth_of(camera)[..., None] * directions
    # Brute force: walk from the other camera to the point, and see whether the square stands in between.
    at_square = other.position + (point - other.position) * (-4.0 / point[..., 2])[..., None]
    wall = point[..., 2] < -6
    hidden = wall & (np.abs(at_square[..., :2]) < 0.5).all(-1)
    inside = np.isfinite(sampled(np.zeros((64, 64, 1)), forward))[..., 0]
    wrong = is_consistent(forward, backward) != (inside & ~hidden)
    rim = np.abs(np.abs(at_square[..., :2]) - 0.5).min(-1) * camera.focal / 4.0 < 1.5  # edges of a pixel mix both
    rim |= np.abs(np.abs(point[..., :2]) - 0.5).min(-1) * camera.focal / 4.0 < 1.5
    assert hidden.sum() > 50
    assert not (wrong & ~rim).any()
