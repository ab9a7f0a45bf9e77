"""Cameras of other programs: PyVista's draws a thing where ours says that it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pyvista = pytest.importorskip("pyvista")

import svv  # noqa: E402
from svv.core.geometry.given_cameras import SIDES, camera_of  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from svv.fields.scene.scene import Scene  # noqa: E402
from svv.render.figures.figure import drawing_of  # noqa: E402
from tests.cube import cube_camera  # noqa: E402

SIZE = (90, 60)


@pytest.fixture
def plotter(cube: Scene):
    """A plotter in front of the cube's box, seen from a side, so that left, right, up and down differ."""
    made = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    made.camera.position, made.camera.focal_point, made.camera.up = (1.5, 1.0, 2.0), (0.1, -0.05, 0.0), (0.2, 1.0, 0.1)
    made.camera.is_set = True
    yield made
    made.close()


LENSES: dict[str, dict[str, Any]] = {
    "perspective": {},
    "narrow": {"ViewAngle": 22.0},
    "parallel": {"ParallelProjection": True, "ParallelScale": 0.9},
    "horizontal angle": {"UseHorizontalViewAngle": True, "ViewAngle": 40.0},
    "off the centre": {"WindowCenter": (0.3, -0.2)},
}


@pytest.mark.parametrize("lens", LENSES)
def test_a_ball_lies_where_pyvista_draws_it(plotter: Any, cube: Scene, lens: str) -> None:
    for name, value in LENSES[lens].items():
        getattr(plotter.camera, f"Set{name}")(*(value if isinstance(value, tuple) else (value,)))
    middle, radius = np.array((0.2, 0.1, -0.1)), 0.2
    ball = pyvista.Sphere(radius=radius, center=middle, theta_resolution=60, phi_resolution=60)
    plotter.add_mesh(ball, color="black", lighting=False, reset_camera=False)
    plotter.set_background("white")
    drawn = plotter.screenshot(return_img=True)[..., 0] < 128
    for given in (plotter, plotter.camera):
        origins, directions = camera_of(given, cube, SIZE).rays()
        offset = middle - origins
        along = (offset * directions).sum(-1, keepdims=True)
        away = np.linalg.norm(offset - along * directions, axis=-1)
        assert 100 < drawn.sum() < 3000
        assert drawn[away < radius - 0.03].all() and not drawn[away > radius + 0.03].any()


def test_the_size_is_the_plotters_or_the_one_asked_for(plotter: Any, cube: Scene) -> None:
    assert cube.render(plotter).rgba.shape[:2] == SIZE[::-1]
    for camera, size, wanted in ((plotter, None, SIZE), (plotter.camera, (32, 24), (32, 24))):
        shown = svv.show(cube, camera=camera, size=size, off_screen=True)
        assert shown is not None and shown.size == wanted
    assert camera_of(plotter.camera, cube).width == 800


def test_nine_numbers_are_the_camera_position(plotter: Any, cube: Scene) -> None:
    place = plotter.camera_position
    wanted = camera_of(plotter, cube)
    for given in (place, place.to_list(), tuple(map(tuple, place.to_list())), np.ravel(place.to_list())):
        found = camera_of(given, cube, SIZE)
        np.testing.assert_allclose(found.camera_to_world, wanted.camera_to_world, atol=1e-12)
        assert found.fov_x == pytest.approx(wanted.fov_x)


@pytest.mark.parametrize("side", [*SIDES, (0.3, -1.0, 0.4)], ids=str)
def test_sides_are_pyvistas(cube: Scene, side: Any) -> None:
    plotter = pyvista.Plotter(off_screen=True)
    plotter.add_mesh(pyvista.Cube())
    plotter.camera_position = side
    found = camera_of(side, cube)
    np.testing.assert_allclose(
        found.camera_to_world[:3, :3], camera_of(plotter, cube).camera_to_world[:3, :3], atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.norm(found.position - cube.rig.centre), cube.rig.radius)
    plotter.close()


def test_all_that_take_a_camera_take_a_plotters(plotter: Any, cube: Scene) -> None:
    ours = camera_of(plotter, cube)
    np.testing.assert_array_equal(cube.render(plotter).rgba, cube.render(ours).rgba)
    pixel = tuple(int(i) for i in np.argwhere(cube.render(ours).rgba[..., 3] > 0.5).mean(0)[::-1])
    assert cube.point_at(plotter, pixel) == cube.point_at(ours, pixel)
    kept = svv.Look.of(cube, plotter).camera_for(cube)
    drawn = drawing_of(svv.Panel(cube, plotter.camera_position), width=40.0, legend="none", tell=lambda _: None)
    for found in (kept, drawn.panels[0].camera):
        assert isinstance(found, svv.Camera)
        np.testing.assert_allclose(found.camera_to_world, ours.camera_to_world, atol=1e-12)
    assert svv.volume_panel(cube, camera=plotter).camera is plotter
    np.testing.assert_array_equal(camera_of(cube_camera(), cube).camera_to_world, cube_camera().camera_to_world)


@pytest.mark.parametrize(
    "given", ["front", 3, (1.0, 2.0), [(0, 0, 0)] * 2, (np.nan, 0, 0), {"position": (0, 0, 1)}, object()], ids=range(7)
)
def test_what_is_no_camera_is_refused_with_what_is_one(cube: Scene, given: Any) -> None:
    with pytest.raises(BadInput, match=r"is no camera: give an svv.Camera, .*, iso\.$"):
        cube.render(given)


def test_a_stretched_view_is_refused(plotter: Any, cube: Scene) -> None:
    plotter.camera.model_transform_matrix = np.diag((1.0, 1.0, 3.0, 1.0))
    with pytest.raises(BadInput, match="stretches, shears or moves"):
        cube.render(plotter)
