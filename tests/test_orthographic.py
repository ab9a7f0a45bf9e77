"""Orthographic cameras and principal points off the centre, against their definitions."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.cameras import Camera, CameraRig, look_at
from svv.errors import BadInput

POSE = look_at((3.0, 1.0, 2.0), (0.5, 0.0, 0.0))
sizes = st.integers(1, 12)
points = st.tuples(st.floats(-20, 20), st.floats(-20, 20))


@given(width=sizes, height=sizes, span=st.floats(0.1, 50.0))
def test_orthographic_rays_are_parallel_and_as_far_apart_as_said(width: int, height: int, span: float) -> None:
    camera = Camera.orthographic(POSE, span, width, height)
    origins, directions = camera.rays()
    np.testing.assert_allclose(directions, np.broadcast_to(-POSE[:3, 2], directions.shape), atol=1e-15)
    local = (origins - POSE[:3, 3]) @ POSE[:3, :3]
    np.testing.assert_allclose(local[..., 2], 0.0, atol=1e-12)
    pixel = span / width
    edges = np.linspace(-0.5 * span, 0.5 * span, width + 1)
    expected = 0.5 * (edges[1:] + edges[:-1])[None]
    np.testing.assert_allclose(local[..., 0], np.broadcast_to(expected, (height, width)), atol=1e-12 * span)
    np.testing.assert_allclose(local[:-1, :, 1] - local[1:, :, 1], pixel, rtol=1e-9)  # row 0 is at the top
    assert camera.pixel_at(0.1) == camera.pixel_at(7.0) == pytest.approx(pixel)


@given(
    width=sizes, height=sizes, span=st.none() | st.floats(0.1, 50.0), centre=st.none() | points, t=st.floats(0.1, 9.0)
)
def test_points_on_a_ray_project_onto_its_pixel(
    width: int, height: int, span: float | None, centre: tuple[float, float] | None, t: float
) -> None:
    camera = Camera(POSE, 0.7, width, height, span, centre)
    origins, directions = camera.rays()
    column, row, ahead = camera.project(origins + t * directions)
    np.testing.assert_allclose(column, np.broadcast_to(np.arange(width) + 0.5, column.shape), atol=1e-6)
    np.testing.assert_allclose(row, np.broadcast_to(np.arange(height)[:, None] + 0.5, row.shape), atol=1e-6)
    np.testing.assert_allclose(ahead, t * (directions @ -POSE[:3, 2]), atol=1e-9)


@pytest.mark.parametrize("span", [None, 5.0])
def test_an_off_centre_camera_is_a_crop_of_a_larger_one(span: float | None) -> None:
    large = Camera(POSE, 0.9, 60, 40, span)
    fov = 2 * np.arctan(0.5 * 20 / large.focal)  # of 20 of the 60 columns
    crop = Camera(POSE, fov, 20, 16, span and span * 20 / 60, (0.5 * 60 - 33, 0.5 * 40 - 7))
    for part, whole in zip(crop.rays(), large.rays(), strict=True):
        np.testing.assert_allclose(part, whole[7:23, 33:53], atol=1e-14)


@given(centre=points, span=st.none() | st.just(3.0))
def test_resizing_keeps_what_is_off_centre(centre: tuple[float, float], span: float | None) -> None:
    camera = Camera(POSE, 0.6, 8, 6, span, centre)
    large = camera.resized(24, 18)
    for part, whole in zip(camera.rays(), large.rays(), strict=True):
        np.testing.assert_allclose(part, whole[1::3, 1::3], atol=1e-12)  # the middle one of 3 x 3 pixels


def test_a_centre_in_the_middle_is_none_at_all() -> None:
    plain, said = Camera(POSE, 0.6, 8, 5), Camera(POSE, 0.6, 8, 5, None, (4.0, 2.5))
    assert said.centre is None and said.identity[1:] == plain.identity[1:]
    assert replace(plain, centre=(4.0, 2.0)).identity[1:] != plain.identity[1:]
    assert replace(plain, span_x=1.0).identity[1:] != plain.identity[1:]


def test_a_rig_of_orthographic_cameras_is_orthographic() -> None:
    rig = CameraRig((1.0, 2.0, 3.0), 4.0, 0.5, (8, 8), 2.5)
    cameras = rig.sphere(12, 8)
    assert all(c.span_x == 2.5 for c in [*cameras, *rig.orbit(5, 8)])
    again = CameraRig.of(cameras)
    np.testing.assert_allclose(again.centre, rig.centre, atol=1e-9)
    assert again.span_x == again.view_width == 2.5 and again.radius == pytest.approx(4.0)
    assert CameraRig.from_json(json.loads(json.dumps(again.to_json()))) == again
    assert "span_x" not in CameraRig((0.0, 0.0, 0.0), 1.0, 0.5).to_json()


def test_views_of_one_side_have_a_rig() -> None:
    """Parallel lines of sight meet nowhere: the rig is the mean of the cameras' lines."""
    poses = [look_at((x, 0.0, 5.0), (x, 0.0, 0.0)) for x in (-1.0, 0.0, 1.0)]
    rig = CameraRig.of([Camera.orthographic(pose, 2.0, 8, 8) for pose in poses])
    assert rig.centre[0] == pytest.approx(0.0) and rig.span_x == 2.0


@pytest.mark.parametrize("span", [0.0, -1.0, np.nan, np.inf])
def test_impossible_widths_are_refused(span: float) -> None:
    with pytest.raises(BadInput, match=r"span_x of a camera.* positive"):
        Camera.orthographic(POSE, span, 4, 4)
    with pytest.raises(BadInput, match=r"camera_rig.*span_x"):
        CameraRig.from_json({"centre": [0, 0, 0], "radius": 1, "fov_x": 0.5, "span_x": span})


def test_an_impossible_principal_point_is_refused() -> None:
    with pytest.raises(BadInput, match="principal point"):
        Camera(POSE, 0.5, 4, 4, None, (np.nan, 0.0))
