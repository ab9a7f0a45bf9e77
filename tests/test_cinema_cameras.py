"""Cameras of Cinema databases: VTK's own, what files say, and what silhouettes say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vtkmodules.vtkRenderingCore import vtkCamera

from svv.core.geometry.cameras import Camera
from svv.core.geometry.phi_theta import ascent_rotations, paraview_rotations
from svv.core.view_checks.silhouettes import Silhouettes, Views, best_fov, differences
from svv.errors import BadInput
from svv.io.cinema.placing import first_of_each
from svv.io.cinema.shot import Shot, camera_of, read_shot
from tests.cinema_database import BALLS, cameras, picture, turns

EXACT = 1e-9


@settings(max_examples=60, deadline=None)
@given(phi=st.floats(0, 360), steps=st.integers(5, 36), data=st.data())
def test_rotations_are_paraviews(phi: float, steps: int, data: st.DataObject) -> None:
    """ParaView turns step by step and lets the view-up follow (vtkSMImageExtractWriterProxy)."""
    theta = data.draw(st.integers(0, steps - 1))
    camera = vtkCamera()
    camera.SetFocalPoint(1.0, -2.0, 3.0)
    camera.SetPosition(1.0, -2.0, 8.0)
    camera.SetViewUp(0.0, 1.0, 0.0)
    camera.Azimuth(phi)
    for _ in range(theta):
        camera.Elevation(360.0 / steps)
        camera.OrthogonalizeViewUp()
    view = camera.GetModelViewTransformMatrix()
    matrix = np.linalg.inv([[view.GetElement(i, j) for j in range(4)] for i in range(4)])
    rotation = paraview_rotations(phi, theta * 360.0 / steps)
    assert rotation == pytest.approx(matrix[:3, :3], abs=EXACT)
    assert (1.0, -2.0, 3.0) + 5.0 * rotation[:, 2] == pytest.approx(matrix[:3, 3], abs=EXACT)


@given(phi=st.floats(-360, 360), theta=st.floats(-360, 360))
def test_every_direction_has_two_names(phi: float, theta: float) -> None:
    one, other = paraview_rotations(phi, theta), paraview_rotations(phi + 180.0, 180.0 - theta)
    assert other == pytest.approx(one @ np.diag((-1.0, -1.0, 1.0)), abs=EXACT)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.floats(0.0, 1e-4)), min_size=1, max_size=40))
def test_of_rows_that_repeat_the_first_stays(rows: list[tuple[int, int, float]]) -> None:
    places = np.array([[a + jitter, b] for a, b, jitter in rows])
    directions = [row[:2] for row in rows]
    assert first_of_each(places) == [k for k, own in enumerate(directions) if own not in directions[:k]]


def test_thousands_of_rows_may_have_one_direction() -> None:
    """Each of 36 directions at 3,000 times: 160 million pairs of rows are equal."""
    phi, theta = (np.tile(angle.ravel(), 3000) for angle in np.meshgrid(60.0 * np.arange(6), 60.0 * np.arange(6)))
    kept = first_of_each(paraview_rotations(phi, theta)[:, :, 2])
    assert len(kept) == 18 and max(kept) < 36


def test_ascents_rotations() -> None:
    back = ascent_rotations([0, 90, 0], [0, 0, 90])[:, :, 2]
    assert back == pytest.approx(np.array([(0, 0, 1), (0, 0, 1), (0, -1, 0)]), abs=EXACT)
    up = ascent_rotations([90, 0], [0, 90])[:, :, 1]
    assert up == pytest.approx(np.array([(-1, 0, 0), (0, 0, 1)]), abs=EXACT)


# --- silhouettes ----------------------------------------------------------------------------------------------------


def masks(views: list[Camera], balls: tuple[tuple[float, ...], ...] = BALLS) -> Silhouettes:
    return Silhouettes.of([picture(camera, balls)[..., 3] > 0 for camera in views])


@pytest.mark.parametrize("degrees", [12.0, 30.0, 60.0])
def test_the_angle_of_view_is_found(degrees: float) -> None:
    """With 128 pixels, to half a degree."""
    scale = 0.65 * np.tan(np.radians(0.5 * degrees)) / np.tan(np.radians(15.0))  # the balls fill the views alike
    balls = tuple(tuple(scale * np.array(ball)) for ball in BALLS)
    views = cameras(turns(6, 5), np.radians(degrees), 128)
    silhouettes = masks(views, balls)
    assert silhouettes.usable.sum() > 10
    fit = best_fov([replace(camera, fov_x=0.9) for camera in views], silhouettes)
    assert fit is not None
    assert np.degrees(fit.fov_x) == pytest.approx(degrees, abs=max(0.5, 3 * np.degrees(fit.uncertainty)))
    assert np.degrees(fit.uncertainty) < 1.0 and fit.residual < 1.0


def test_a_ball_in_the_middle_fits_any_angle() -> None:
    views = cameras(turns(6, 5), size=128)
    fit = best_fov(views, masks(views, ((0.0, 0.0, 0.0, 1.2),)))
    assert fit is None or np.degrees(fit.uncertainty) > 1.0


def disagreement(views: list[Camera], silhouettes: Silhouettes) -> np.ndarray:
    return differences(Views.of(views), silhouettes)


def test_true_cameras_agree_and_others_do_not() -> None:
    views = cameras(turns(6, 5), size=128)
    silhouettes = masks(views)
    assert np.nanmedian(np.abs(disagreement(views, silhouettes))) < 0.7
    turned = cameras([(phi, -theta) for phi, theta in turns(6, 5)], size=128)
    assert np.nanmedian(np.abs(disagreement(turned, silhouettes))) > 5.0


def test_parallel_rays() -> None:
    views = [Camera.orthographic(c.camera_to_world, 4.0, 128, 128) for c in cameras(turns(6, 5))]
    silhouettes = masks(views)
    assert np.nanmedian(np.abs(disagreement(views, silhouettes))) < 0.7
    wrong = [replace(c, camera_to_world=c.camera_to_world @ _shift(0.2 * (k % 3))) for k, c in enumerate(views)]
    assert np.nanmedian(np.abs(disagreement(wrong, silhouettes))) > 3.0


def _shift(x: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return matrix


def test_cut_off_and_empty_silhouettes_are_not_used() -> None:
    inside, cut, empty = np.zeros((3, 20, 30), bool)
    inside[5:9, 7:20], cut[5:9, 0:20] = True, True
    assert Silhouettes.of([inside, cut, empty]).usable.tolist() == [True, False, False]
    points = Silhouettes.of([inside]).points[0]
    assert points.min(0).tolist() == [7.25, 5.25] and points.max(0).tolist() == [19.75, 8.75]


# --- files that tell the camera -------------------------------------------------------------------------------------

STATE = """<ParaView><ServerManagerState version="5.11.0">
<Proxy group="views" type="RenderView" id="1">
<Property name="CameraFocalPoint" id="a" number_of_elements="3">
<Element index="0" value="1"/><Element index="1" value="2"/><Element index="2" value="3"/></Property>
<Property name="CameraPosition" id="b" number_of_elements="3">
<Element index="2" value="3"/><Element index="0" value="1"/><Element index="1" value="7"/></Property>
<Property name="CameraViewAngle" id="c" number_of_elements="1"><Element index="0" value="25"/></Property>
<Property name="Name" id="d"><Element index="0" value="text"/></Property>
</Proxy><Proxy group="sources" type="Wavelet" id="2"/>{more}</ServerManagerState></ParaView>"""
SCRIPT = """from paraview.simple import *
renderView1 = CreateView('RenderView')
renderView1.CameraPosition = [1.0, 7.0, 3.0]
renderView1.CameraFocalPoint = [1.0, 2.0, 3.0]
renderView1.CameraParallelScale = compute()
renderView1.CameraViewAngle = 25.0
"""
BESIDE = {
    "focal_point": [1, 2, 3],
    "distance": 5.0,
    "view_angle": 25,
    "parallel_projection": False,
    "parallel_scale": 9,
}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.pvsm", STATE.format(more="")),
        ("a.py", SCRIPT),
        ("camera.json", json.dumps(BESIDE)),
    ],
)
def test_the_camera_of_a_file(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    assert read_shot(tmp_path / name) == Shot((1.0, 2.0, 3.0), 5.0, 25.0)


def test_parallel_projection_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(SCRIPT.replace("compute()", "2.5") + "renderView1.CameraParallelProjection = 1\n")
    assert read_shot(tmp_path / "a.py") == Shot((1.0, 2.0, 3.0), 5.0, None, 2.5)


OTHER = """<Proxy group="views"><Property name="CameraPosition"><Element index="0" value="9"/>
<Element index="1" value="9"/><Element index="2" value="9"/></Property></Proxy>"""


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("none.json", None, "no file"),
        ("a.json", "{", "not JSON"),
        ("a.json", "{}", "contains no camera"),
        ("a.json", '{"distance": -1, "view_angle": 30}', "distance must be above 0"),
        ("a.json", '{"view_angle": 180}', "below 180"),
        ("a.json", '{"view_angle": "wide"}', "finite number"),
        ("a.pvsm", "<a>", "not a ParaView state"),
        ("a.pvsm", "<a/>", "contains no view"),
        ("a.pvsm", STATE.format(more=OTHER), "2 views with different cameras"),
        ("a.py", "a = (", "not a Python script"),
        ("a.py", "a = 1", "contains no view"),
    ],
)
def test_bad_files_of_cameras(tmp_path: Path, name: str, text: str | None, says: str) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(BadInput, match=says):
        read_shot(tmp_path / name)


@pytest.mark.parametrize(
    "values",
    [
        {"CameraPos": [0, 0, 5], "CameraDir": [0, 0, -1], "CameraUp": [0, 1, 0], "CameraHeight": [2.0]},
        {"camera_position": (0, 0, 5), "camera_direction": (0, 0, -3), "camera_up": (0, 1, 0), "camera_height": 2},
        {"CamPosition": [0, 0, 5], "CamFocalPoint": [0, 0, 0], "CamHeight": 2, "CamNearFar": [1, 9]},
    ],
)
def test_metadata_of_an_image(values: dict[str, object]) -> None:
    camera = camera_of(values, 60, 40, "a.h5")
    assert camera is not None and camera.span_x == 3.0  # the height is that of the whole image
    assert camera.position.tolist() == [0, 0, 5] and camera.camera_to_world[:3, :3] == pytest.approx(np.eye(3))


def test_metadata_with_an_angle() -> None:
    camera = camera_of({"camera_to_world": np.eye(4).tolist(), "view_angle": 30}, 60, 40, "a")
    assert camera is not None and np.tan(camera.fov_x / 2) == pytest.approx(1.5 * np.tan(np.radians(15)))
    assert camera_of({"phi": 3}, 60, 40, "a") is None


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"CameraPos": [0, 0, 5], "CameraHeight": 1}, "without a direction"),
        ({"CameraPos": [0, 0, 5], "CameraDir": [0, 0, -1]}, "without an angle of view"),
        ({"CameraPos": [0, 5], "CameraDir": [0, 0, -1], "CameraHeight": 1}, "not three finite numbers"),
        ({"CameraPos": "here", "CameraDir": [0, 0, -1], "CameraHeight": 1}, "not three finite numbers"),
        ({"CameraPos": [0, 0, 5], "CameraDir": [0, 0, -1], "CameraHeight": "tall"}, "not one finite number"),
        ({"CameraPos": [0, 0, 5], "CameraDir": [0, 0, -1], "CameraHeight": -1}, "span_x"),
    ],
)
def test_bad_metadata(values: dict[str, object], says: str) -> None:
    with pytest.raises(BadInput, match=says):
        camera_of(values, 60, 40, "a.h5")
