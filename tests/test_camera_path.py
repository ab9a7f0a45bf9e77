"""Paths of cameras through key frames: what they pass, what they keep, and what they never do."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from svv.core.geometry.camera_path import camera_path
from svv.core.geometry.cameras import Camera, look_at, orbit_cameras
from svv.errors import BadInput

CENTRE = np.array([3.0, -2.0, 7.0])


def around(azimuth: float, elevation: float = 0.0, distance: float = 4.0, fov: float = 30.0) -> Camera:
    """Return a camera that looks at the centre; angles in degrees."""
    a, e = np.radians((azimuth, elevation))
    away = distance * np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    return Camera(look_at(CENTRE + away, CENTRE), np.radians(fov), 60, 40)


def same(one: Camera, other: Camera, atol: float = 1e-7) -> None:
    np.testing.assert_allclose(one.camera_to_world, other.camera_to_world, atol=atol)
    assert (one.fov_x, one.span_x) == pytest.approx((other.fov_x, other.span_x))
    np.testing.assert_allclose(one.principal_point, other.principal_point, atol=1e-9)


key_frames = st.lists(
    st.builds(around, st.floats(-80, 80), st.floats(-80, 80), st.floats(1.0, 20.0), st.floats(5.0, 90.0)),
    min_size=2, max_size=5,
)  # fmt: skip


@given(key_frames, st.integers(1, 7))
@settings(deadline=None)
def test_a_path_goes_through_its_key_frames_and_back_the_same_way(keys: list[Camera], steps: int) -> None:
    angles = [
        (Rotation.from_matrix(b.camera_to_world[:3, :3]) * Rotation.from_matrix(a.camera_to_world[:3, :3]).inv())
        for a, b in pairwise(keys)
    ]
    assume(all(turn.magnitude() < 3.1 for turn in angles))
    path = camera_path(keys, 1 + steps * (len(keys) - 1), CENTRE)
    assert len(path) == 1 + steps * (len(keys) - 1)
    for key, passed in zip(keys, path[::steps], strict=True):
        same(key, passed)
    for one, other in zip(path, reversed(camera_path(keys[::-1], len(path), CENTRE)), strict=True):
        same(one, other, 1e-6)
    for camera in path:  # it keeps looking at the centre, from no nearer and no farther than the key frames
        column, row, ahead = camera.project(CENTRE)
        assert (column, row) == pytest.approx((30.0, 20.0), abs=1e-5)
        distances = [np.linalg.norm(key.position - CENTRE) for key in keys]
        assert min(distances) / 1.2 <= ahead <= max(distances) * 1.2


def test_a_turn_is_a_circle_at_constant_speed() -> None:
    path = camera_path([around(0.0), around(90.0)], 31)
    for number, camera in enumerate(path):
        same(camera, around(3.0 * number), 1e-9)


def test_key_frames_of_an_orbit_give_the_orbit() -> None:
    orbit = orbit_cameras(181, CENTRE, 5.0)[30:151]  # away from the poles, where the camera spins
    for ours, true in zip(camera_path(orbit[::10], 121), orbit, strict=True):
        assert np.linalg.norm(ours.position - true.position) < 0.02
        assert np.linalg.norm(ours.position - CENTRE) == pytest.approx(5.0, abs=1e-3)


def test_a_path_has_no_corners_and_rests_between_equal_frames() -> None:
    keys = [around(0.0), around(50.0, 10.0, 2.0), around(50.0, 10.0, 2.0), around(80.0, -30.0, 6.0), around(40.0, 0.0)]
    positions = np.stack([camera.position for camera in camera_path(keys, 4001, CENTRE)])
    velocity = np.diff(positions, axis=0) * 1000.0
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() < 0.05  # per thousandth of a segment
    np.testing.assert_allclose(positions[1000:2001], positions[[1000]].repeat(1001, 0), atol=1e-9)


def test_a_zoom_changes_by_equal_factors() -> None:
    path = camera_path([around(0.0, distance=1.0), around(0.0, distance=16.0)], 5, CENTRE)
    assert [np.linalg.norm(c.position - CENTRE) for c in path] == pytest.approx([1, 2, 4, 8, 16])
    keys = [Camera.orthographic(np.eye(4), span, 60, 40) for span in (1.0, 9.0)]
    assert [c.span_x for c in camera_path(keys, 3)] == pytest.approx([1, 3, 9])


def test_a_moved_and_scaled_path_is_the_path_moved_and_scaled() -> None:
    keys = [around(0.0), around(50.0, 10.0, 2.0), around(80.0, -30.0, 6.0)]
    turn, scale, shift = Rotation.from_rotvec((0.3, -1.0, 0.4)).as_matrix(), 100.0, np.array([5.0, 6.0, 7.0])

    def moved(camera: Camera) -> Camera:
        pose = camera.camera_to_world.copy()
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] = scale * turn @ pose[:3, 3] + shift
        return replace(camera, camera_to_world=pose)

    for one, other in zip(camera_path([moved(key) for key in keys], 20), camera_path(keys, 20), strict=True):
        same(one, moved(other), 1e-6)


def test_cameras_that_look_away_from_the_centre_move_straight() -> None:
    ahead = np.array([1.0, 0.0, 0.0])
    away = [Camera(look_at(CENTRE + x * ahead, CENTRE + (x + 1) * ahead), 1.0, 60, 40) for x in (1.0, 3.0)]
    middle = camera_path(away, 3, CENTRE)[1]
    np.testing.assert_allclose(middle.position, CENTRE + 2.0 * ahead, atol=1e-12)


@pytest.mark.parametrize(
    ("keys", "frames", "told"),
    [
        ([around(0.0)], 9, "at least two"),
        ([around(0.0), around(9.0)], 1, "2 to 65536 frames"),
        ([around(0.0), around(180.0)], 9, "half a turn apart"),
        ([around(0.0), Camera.orthographic(np.eye(4), 1.0, 60, 40)], 9, "perspective or all of parallel"),
    ],
)
def test_a_path_that_is_none(keys: list[Camera], frames: int, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        camera_path(keys, frames)
