"""Views with parallel rays, from several distances, or of a part of the subject: their hull, and what they teach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from svv.core.geometry.cameras import Camera, CameraRig, look_at, sphere_cameras
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.occupancy import Occupancy, carve
from svv.io.views.viewset import ViewSet
from svv.train.base.resolutions import fitted_field
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from tests.balls import SHORT, two_balls
from tests.nightly import nightly
from tests.solid_ball import solid_ball

CENTRE, RADIUS, AWAY, FOV = np.array([2.0, -1.0, 0.5]), 0.6, 4.0, 0.5
SPAN = CameraRig((0.0, 0.0, 0.0), AWAY, FOV).view_width


def mask_of(camera: Camera, radius: float = RADIUS) -> np.ndarray:
    origins, directions = camera.rays()
    towards = CENTRE - origins
    along = (towards * directions).sum(-1)
    return np.asarray(((towards - along[..., None] * directions) ** 2).sum(-1) < radius**2)


def hull_of(cameras: list[Camera], radius: float = RADIUS, cells: int = 48) -> tuple[Occupancy, np.ndarray]:
    """The hull of the ball, and how far each cell's centre is from the ball's, in world units."""
    hull = carve(np.stack([mask_of(c, radius) for c in cameras]), cameras, cells)
    where = (np.moveaxis(np.indices(hull.occupied.shape), 0, -1) + 0.5) / hull.cells
    return hull, np.linalg.norm(hull.box.to_world(where) - CENTRE, axis=-1)


def assert_is_the_ball(cameras: list[Camera], radius: float = RADIUS, slack: float = 2.5) -> None:
    hull, away = hull_of(cameras, radius)
    cell = hull.box.size / hull.cells
    assert hull.occupied[away < radius].all()
    assert not hull.occupied[away > radius + slack * cell].any()
    assert (np.abs(hull.box.bounds - CENTRE - np.array([[-1], [1]]) * radius) < 0.1 * radius).all()


@pytest.mark.parametrize("span", [None, SPAN])
def test_the_hull_of_a_ball_is_the_ball(span: float | None) -> None:
    assert_is_the_ball(sphere_cameras(92, CENTRE, AWAY, FOV, 150, span))


def test_the_hull_of_off_centre_views_is_the_ball() -> None:
    cameras = sphere_cameras(92, CENTRE, AWAY, FOV, 150)
    draw = np.random.default_rng(0)
    assert_is_the_ball([replace(c, centre=tuple(75 + draw.uniform(-20, 20, 2))) for c in cameras])


def test_perspective_and_parallel_views_share_a_hull() -> None:
    cameras = sphere_cameras(92, CENTRE, AWAY, FOV, 150)
    assert_is_the_ball([replace(c, span_x=SPAN) if k % 2 else c for k, c in enumerate(cameras)])


def test_a_view_decides_on_what_is_in_its_frame_and_on_nothing_else() -> None:
    """Brute force: cells whose middle is well inside the frame and well off the mask are carved, and only those."""
    draw, cameras = np.random.default_rng(3), []
    for k, camera in enumerate(sphere_cameras(42, CENTRE, AWAY, FOV, 120)):
        matrix = camera.camera_to_world.copy()
        matrix[:3, 3] += draw.uniform(0.5, 1.0) * 3.0 * (k % 3) * -matrix[:3, 2] * 0.3
        centre = tuple(draw.uniform(20, 100, 2)) if k % 2 else None
        cameras.append(Camera(matrix, FOV, 120, 80, SPAN if k % 4 == 1 else None, centre))
    masks = np.stack([mask_of(c) for c in cameras])
    assert 0.2 < np.mean([m.any() and (m[[0, -1]].any() or m[:, [0, -1]].any()) for m in masks])  # many are cut off
    hull = carve(masks, cameras, 40)
    where = hull.box.to_world((np.moveaxis(np.indices(hull.occupied.shape), 0, -1) + 0.5) / hull.cells)
    reach = 0.5 * np.sqrt(3.0) * hull.box.size / hull.cells
    may, must, seen = np.zeros((3, *hull.occupied.shape), bool)
    for camera, mask in zip(cameras, masks, strict=True):
        column, row, ahead = camera.project(where)
        within = np.minimum(np.minimum(column, 120 - column), np.minimum(row, 80 - row))
        pixels = 1.2 * reach / camera.pixel_at(ahead) + 2.0  # the cell's own radius, and some for rounding
        off = distance_transform_edt(~np.pad(mask, 400))[
            np.clip(row + 400, 0, 879).astype(int), np.clip(column + 400, 0, 919).astype(int)
        ]
        may |= (within > -2.0) & (off > 0.0)
        must |= (within > pixels) & (off > 1.5 * pixels) & (ahead > 3 * reach)  # the kernel looks at a square of pixels
        seen |= within > pixels
    carved = hull.occupied == 0
    assert must.sum() > 1000 and carved[must].all()
    assert (may | ~seen)[carved].all()


def test_close_views_carve_nothing_that_they_do_not_see() -> None:
    """Two thirds of the views see a small part of the ball, which the others see whole."""
    cameras = []
    for k, camera in enumerate(sphere_cameras(122, CENTRE, AWAY, FOV, 150)):
        if k % 3:
            matrix = camera.camera_to_world.copy()
            matrix[:3, 3] = CENTRE + 0.45 * (matrix[:3, 3] - CENTRE)
            camera = replace(camera, camera_to_world=matrix, centre=(75.0 + 60 * (-1) ** k, 75.0))
        cameras.append(camera)
    assert np.median([mask_of(c)[:, [0, -1]].any() for c in cameras]) == 1
    hull, away = hull_of(cameras)
    ball, outside = away < RADIUS, away > RADIUS + 4.0 * hull.box.size / hull.cells
    assert hull.occupied[ball].all()
    assert hull.occupied[outside].sum() < 0.02 * ball.sum()  # specks far out that hardly any view sees


@pytest.mark.parametrize("span", nightly([None, 0.6 * SPAN], None))
def test_a_subject_larger_than_every_frame_is_in_the_box(span: float | None) -> None:
    """No frame holds the ball, so its outline is not known; but all of it that some view sees belongs to the hull."""
    radius = 0.9
    cameras = sphere_cameras(92, CENTRE, AWAY, 0.6 * FOV, 150, span)
    hull, away = hull_of(cameras, radius)
    assert hull.occupied[away < radius].mean() > 0.95
    half = 0.5 * (hull.box.bounds[1] - hull.box.bounds[0])
    assert (half >= radius).all() and (half < AWAY).all()


def test_cells_fit_the_pixels_of_parallel_views_as_well() -> None:
    cameras = sphere_cameras(42, CENTRE, AWAY, FOV, 150)
    parallel = [replace(c, span_x=SPAN) for c in cameras]
    box = hull_of(cameras)[0].box
    first, second = (fitted_field(FieldSettings(), c, box)[0].resolutions for c in (cameras, parallel))
    assert first == second
    near = [replace(c, span_x=0.25 * SPAN) for c in parallel[::2]]  # half of them resolve four times as much
    assert fitted_field(FieldSettings(), near + parallel[1::2], box)[0].resolutions >= second


@pytest.mark.parametrize("span", [None, 2.4])
def test_an_off_centre_image_is_exactly_a_crop_of_a_larger_one(span: float | None) -> None:
    scene, pose = solid_ball(), look_at((1.0, 0.5, 2.8), (0.0, 0.0, 0.0))
    large = Camera(pose, 0.5, 96, 80, span)
    fov = 2 * np.arctan(0.5 * 40 / large.focal)
    crop = Camera(pose, fov, 40, 30, span and span * 40 / 96, (48.0 - 31, 40.0 - 22))
    whole, part = scene.render(large, "base"), scene.render(crop, "base")
    for name in ("rgba", "depth", "region"):
        np.testing.assert_array_equal(getattr(whole, name)[22:52, 31:71], getattr(part, name))
    assert (part.rgba[..., 3] > 0.9).any() and (part.rgba[..., 3] == 0).any()


def views_of(cameras: list[Camera]) -> ViewSet:
    names = tuple(f"r_{k:04d}" for k in range(len(cameras)))
    return ViewSet(tuple(cameras), np.stack([two_balls(c) for c in cameras]), names)


def nearest(camera: Camera) -> float:
    """How far the nearest of the two balls' surfaces is."""
    origins, directions = camera.rays()
    found = []
    for x in (-0.35, 0.35):
        towards = np.array([x, 0.0, 0.0]) - origins
        along = (towards * directions).sum(-1)
        inside = 0.3**2 - ((towards - along[..., None] * directions) ** 2).sum(-1)
        found.append((along - np.sqrt(np.maximum(inside, 0.0)))[inside > 0].min())
    return float(min(found))


@pytest.mark.slow
def test_parallel_views_teach_as_much_as_others() -> None:
    scores = []
    for span in (None, CameraRig((0.0, 0.0, 0.0), 4.0, np.radians(30)).view_width):
        train, test = (sphere_cameras(n, (0.0, 0.0, 0.0), 4.0, np.radians(30), 56, span) for n in (42, 12))
        scene, _ = train_scene(views_of(train), SHORT)
        assert scene.rig.span_x == span
        scores.append(evaluate_scene(scene, views_of(test), "base").psnr)
        shown = scene.render(test[0], "pcn")
        assert shown.depth[shown.rgba[..., 3] > 0.95].min() == pytest.approx(nearest(test[0]), abs=0.1)
    assert scores[1] > scores[0] - 1.0


def test_views_from_several_distances_teach() -> None:
    """A third of the views see only a part, with the principal point off the centre."""
    train = sphere_cameras(42, (0.0, 0.0, 0.0), 4.0, np.radians(30), 56)
    train = [replace(c, fov_x=np.radians(13), centre=(38.0, 20.0)) if k % 3 == 0 else c for k, c in enumerate(train)]
    test = sphere_cameras(5, (0.0, 0.0, 0.0), 4.0, np.radians(30), 56)
    scene, _ = train_scene(views_of(train), SHORT)
    assert evaluate_scene(scene, views_of(test), "base").psnr > 24.0
