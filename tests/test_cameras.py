"""Cameras: rotations, rays, geodesic spheres and the orbit, against their definitions and published numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.geometry.cameras import (
    Camera,
    CameraRig,
    look_at,
    orbit_cameras,
    sphere_cameras,
)
from svv.core.geometry.directions import geodesic_class, geodesic_directions
from svv.errors import BadInput
from tests.any_json import any_json

GEODESIC = (12, 32, 42, 72, 92, 122, 132, 162, 192, 212, 252, 312, 492)
finite = st.floats(-1e3, 1e3, allow_nan=False)


def is_rotation(matrix: np.ndarray) -> bool:
    return bool(np.allclose(matrix.T @ matrix, np.eye(3), atol=1e-12) and np.linalg.det(matrix) > 0)


def angles_to_nearest(directions: np.ndarray) -> np.ndarray:
    cosines = directions @ directions.T
    np.fill_diagonal(cosines, -1)
    return np.degrees(np.arccos(np.clip(cosines.max(axis=1), -1, 1)))


@pytest.mark.parametrize("n", GEODESIC)
def test_geodesic_counts_are_10t_plus_2(n: int) -> None:
    h, k = geodesic_class(n) or (0, 0)
    assert 10 * (h * h + h * k + k * k) + 2 == n
    directions = geodesic_directions(n)
    assert directions.shape == (n, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=1e-12)
    # Second moments of an even spread are those of the sphere, exactly so for icosahedral symmetry.
    np.testing.assert_allclose(directions.T @ directions / n, np.eye(3) / 3, atol=1e-12)


def test_geodesic_92_has_the_published_spacing() -> None:
    """The 92 views published with StyleRF-VolVis: nearest neighbours 20.077 to 23.800 degrees apart."""
    nearest = angles_to_nearest(geodesic_directions(92))
    assert nearest.min() == pytest.approx(20.07675, abs=1e-4)
    assert nearest.max() == pytest.approx(23.80018, abs=1e-4)


@settings(max_examples=40, deadline=None)
@given(n=st.integers(3, 700))
def test_any_count_spreads_evenly(n: int) -> None:
    directions = geodesic_directions(n)
    assert directions.shape == (n, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    # The best packing of n caps has a spacing of about sqrt(8 pi / (sqrt(3) n)) radians.
    best = np.degrees(np.sqrt(8 * np.pi / (np.sqrt(3) * n)))
    assert angles_to_nearest(directions).min() > 0.5 * best


@pytest.mark.parametrize("n", [-1, 0, 2])
def test_fewer_than_three_views_are_refused(n: int) -> None:
    with pytest.raises(BadInput, match="At least 3 views"):
        geodesic_directions(n)


def test_not_every_n_is_geodesic() -> None:
    assert [n for n in range(3, 134) if geodesic_class(n)] == [12, 32, 42, 72, 92, 122, 132]


@settings(max_examples=60, deadline=None)
@given(eye=st.tuples(finite, finite, finite), target=st.tuples(finite, finite, finite))
def test_look_at_is_a_rotation_that_looks_at_its_target(eye: tuple, target: tuple) -> None:
    if np.linalg.norm(np.subtract(eye, target)) < 1e-6:
        return
    matrix = look_at(eye, target)
    assert is_rotation(matrix[:3, :3])
    np.testing.assert_array_equal(matrix[:3, 3], eye)
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    np.testing.assert_allclose(-matrix[:3, 2], forward, atol=1e-9)
    assert matrix[1, 1] >= -1e-9  # y up stays up


@pytest.mark.parametrize("axis", [(0, 5, 0), (0, -5, 0)])
def test_looking_along_up_is_still_a_rotation(axis: tuple) -> None:
    assert is_rotation(look_at(axis, (0, 0, 0))[:3, :3])


def test_orbit_follows_the_published_formula() -> None:
    """phi = -90 ... 90 in 1-degree steps, theta = 2 phi; the poles are kept 0.01 degree off."""
    for index, camera in enumerate(orbit_cameras(181, (1.0, 2.0, 3.0), 4.0311, np.pi / 6, 8)):
        phi = np.radians(index - 90.0)
        theta = 2 * phi
        direction = np.array([np.cos(phi) * np.cos(theta), np.sin(phi), -np.cos(phi) * np.sin(theta)])
        away = (camera.position - (1.0, 2.0, 3.0)) / 4.0311
        np.testing.assert_allclose(away, direction, atol=1e-12 if 0 < index < 180 else 2e-4)
        np.testing.assert_allclose(camera.camera_to_world[:3, 2], away, atol=1e-12)
        assert is_rotation(camera.camera_to_world[:3, :3])


def test_frames_of_the_orbit_are_those_of_the_whole() -> None:
    whole, frames = orbit_cameras(7, size=8), orbit_cameras(7, size=8, frames=[6, 2])
    for camera, frame in zip(frames, (6, 2), strict=True):
        assert np.array_equal(camera.camera_to_world, whole[frame].camera_to_world)


def test_orbit_starts_like_the_published_one() -> None:
    """First frame of the published test path: right is z, up is -x, back is -y (0.01 degree off)."""
    rotation = orbit_cameras()[0].camera_to_world[:3, :3]
    np.testing.assert_allclose(rotation, [[0, -1, -1.745e-4], [0, 1.745e-4, -1], [1, 0, 0]], atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(scale=st.sampled_from([1e-9, 1e-3, 1.0, 1e6]), centre=st.tuples(finite, finite, finite))
def test_cameras_keep_their_distance_at_any_scale(scale: float, centre: tuple) -> None:
    middle = np.array(centre) * scale
    for camera in sphere_cameras(12, middle, 3 * scale, 0.5, 4):
        assert np.linalg.norm(camera.position - middle) == pytest.approx(3 * scale, rel=1e-9)
        assert is_rotation(camera.camera_to_world[:3, :3])


@settings(max_examples=30, deadline=None)
@given(width=st.integers(1, 12), height=st.integers(1, 12), fov=st.floats(0.05, 2.5))
def test_rays_are_those_of_a_pinhole(width: int, height: int, fov: float) -> None:
    pose = look_at((3.0, 1.0, 2.0), (0.5, 0.0, 0.0))
    origins, directions = Camera(pose, fov, width, height).rays()
    assert origins.shape == directions.shape == (height, width, 3)
    np.testing.assert_array_equal(origins, np.broadcast_to(pose[:3, 3], origins.shape))
    # Project a point of each ray back with the focal length: it must fall on its pixel's centre.
    local = (directions * 7.0) @ pose[:3, :3]
    focal = 0.5 * width / np.tan(0.5 * fov)
    column = local[..., 0] / -local[..., 2] * focal + 0.5 * width
    row = 0.5 * height - local[..., 1] / -local[..., 2] * focal
    np.testing.assert_allclose(column, np.arange(width)[None] + 0.5 + 0 * row, atol=1e-8)
    np.testing.assert_allclose(row, np.arange(height)[:, None] + 0.5 + 0 * row, atol=1e-8)


@given(centre=st.tuples(finite, finite, finite), radius=st.floats(0.1, 100.0), fov=st.floats(0.1, 2.0))
def test_the_rig_of_a_sphere_of_cameras_is_the_sphere(
    centre: tuple[float, float, float], radius: float, fov: float
) -> None:
    rig = CameraRig.of(sphere_cameras(12, centre, radius, fov, 8))
    np.testing.assert_allclose(rig.centre, centre, atol=1e-8)
    assert rig.radius == pytest.approx(radius, abs=1e-8)
    assert rig.fov_x == pytest.approx(fov) and rig.size == (8, 8)
    for again, first in zip(rig.sphere(12, 8), sphere_cameras(12, centre, radius, fov, 8), strict=True):
        np.testing.assert_allclose(again.camera_to_world, first.camera_to_world, atol=1e-6)


def test_what_a_camera_of_a_rig_sees_at_the_centre_is_as_wide_as_said() -> None:
    rig = CameraRig((1.0, 2.0, 3.0), 4.0, 0.7)
    camera = rig.orbit(3, 101)[1]
    origin, direction = (part[50, [0, -1]] for part in camera.rays())  # the first and the last pixel of the middle row
    forward = np.subtract(rig.centre, camera.position) / 4.0
    seen = origin + direction * (4.0 / (direction @ forward))[:, None]
    assert np.linalg.norm(seen[1] - seen[0]) * 101 / 100 == pytest.approx(rig.view_width)


@given(
    centre=st.tuples(finite, finite, finite),
    radius=st.floats(0.0, 1e9),
    fov=st.floats(1e-3, 3.1),
    size=st.none() | st.tuples(st.integers(1, 4096), st.integers(1, 4096)),
)
def test_a_rig_is_the_same_after_json(
    centre: tuple[float, float, float], radius: float, fov: float, size: tuple[int, int] | None
) -> None:
    rig = CameraRig(centre, radius, fov, size)
    assert CameraRig.from_json(json.loads(json.dumps(rig.to_json()))) == rig


@given(
    any_json
    | st.fixed_dictionaries(
        {"centre": st.lists(any_json, min_size=2, max_size=4) | any_json, "radius": any_json, "fov_x": any_json},
        optional={"size": any_json},
    )
)
def test_any_json_is_a_rig_or_is_refused(content: object) -> None:
    try:
        rig = CameraRig.from_json(content)
    except BadInput:
        return
    assert CameraRig.from_json(rig.to_json()) == rig


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"centre": [0.0, 1.0]}, "centre must be a list of 3"),
        ({"radius": -1.0}, "radius .* at least 0"),
        ({"radius": 10**400}, "radius must be a finite number"),
        ({"fov_x": 3.2}, "fov_x .* between 0 and pi"),
        ({"fov_x": True}, "fov_x must be a finite number"),
        ({"size": [8]}, "size must be a list of 2"),
    ],
)
def test_a_broken_rig_is_refused_by_name(change: dict[str, object], said: str) -> None:
    whole = {"centre": [0.0, 0.0, 0.0], "radius": 1.0, "fov_x": 0.5, "size": [8, 8]}
    assert CameraRig.from_json(whole) == CameraRig((0.0, 0.0, 0.0), 1.0, 0.5, (8, 8))
    with pytest.raises(BadInput, match=said):
        CameraRig.from_json({**whole, **change})
    for key in ("centre", "radius", "fov_x"):
        with pytest.raises(BadInput, match=key):
            CameraRig.from_json({k: v for k, v in whole.items() if k != key})


def test_resizing_keeps_the_picture() -> None:
    camera = Camera(look_at((0, 0, 5), (0, 0, 0)), 0.6, 80, 60)
    small = camera.resized(20, 15)
    assert (small.width, small.height, small.fov_x) == (20, 15, 0.6)
    # A pixel of the small image covers 4 x 4 of the large one.
    np.testing.assert_allclose(
        small.rays()[1][3, 7], np.mean(camera.rays()[1][12:16, 28:32].reshape(-1, 3), axis=0), atol=1e-3
    )


def test_noise_in_the_matrix_is_taken() -> None:
    pose = look_at((0, -4, 1), (0, 0, 0)) + 1e-8
    camera = Camera(pose, 0.5, 4, 4)
    np.testing.assert_array_equal(camera.camera_to_world[3], (0, 0, 0, 1))
    np.testing.assert_array_equal(camera.camera_to_world[:3], pose[:3])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: np.vstack([m[:3] * 2, m[3:]]),  # scaled
        lambda m: m @ np.diag([1, 1, -1, 1.0]),  # mirrored
        lambda m: m + 0.1 * np.eye(4)[[1, 0, 2, 3]],  # sheared
        lambda m: np.full((4, 4), np.nan),
        lambda m: m[:3],
    ],
)
def test_a_camera_that_is_no_rotation_is_refused(spoil: object) -> None:
    with pytest.raises(BadInput, match="camera matrix"):
        Camera(spoil(look_at((0, -4, 1), (0, 0, 0))), 0.5, 4, 4)  # type: ignore[operator]


@pytest.mark.parametrize(("fov", "width"), [(0.0, 4), (np.pi, 4), (np.nan, 4), (0.5, 0)])
def test_impossible_angles_and_sizes_are_refused(fov: float, width: int) -> None:
    with pytest.raises(BadInput, match="camera"):
        Camera(np.eye(4), fov, width, 4)
